"""Monitoring of logs and streams, without the command line."""
