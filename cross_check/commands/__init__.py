"""The commands `rvaft cross-check` and `rvaft traces`."""
