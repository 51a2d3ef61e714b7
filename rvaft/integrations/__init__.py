"""Connections to other systems: ROS, Apache Spark, Foxglove, MQTT, and browsers that look at a live page.

Each needs an extra or a server. Nothing else in `rvaft` imports them: commands, formats of logs and publishers of
detections are found by their entry points.
"""
