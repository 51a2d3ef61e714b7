"""Connections to ROS, Apache Spark, Foxglove, MQTT, browsers and editors.

Each needs an extra or a server. The rest of `rvaft` finds them by entry points only.
"""
