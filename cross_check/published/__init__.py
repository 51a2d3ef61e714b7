"""Runners of published tools: each runs texts of a backend in a program of others."""
