"""How specification languages compare: sizes, seconds and events per second of the same trees in
each; what `rvaft compare` runs.
"""
