"""The commands `rvaft cross-check`, `rvaft traces` and `rvaft robust`."""
