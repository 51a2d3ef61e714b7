"""Logs in whatever format they are: one reader for each format, found by its name or by the name of the file."""
