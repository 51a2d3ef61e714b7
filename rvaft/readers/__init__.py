"""Readers of log formats, found by name or by the suffix of a file."""
