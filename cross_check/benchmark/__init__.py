"""How specification languages compare: sizes, seconds and events per second of the same tree in each; what `rvaft compare` runs."""
