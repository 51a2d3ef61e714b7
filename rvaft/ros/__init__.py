"""Configurations of ROSMonitoring: from a tree to monitors of ROS topics and the commands that start their oracles.

`topics` says which topics a monitor subscribes to, `planning` which monitors there are, `configuration` writes them as YAML,
`specifications` as RML, `commands` what to run, `folder` puts all files where they belong or none.
"""
