"""Connections to ROS, Apache Spark, Foxglove, MQTT and browsers.

Each needs an extra or a server. The rest of `rvaft` finds them by entry points only.
"""
