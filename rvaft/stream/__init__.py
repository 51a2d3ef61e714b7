"""Monitors at work: many logs, many monitors, streams; what `rvaft monitor` runs, without the command line."""
