"""Logs read many lines at a time, and of each line no more than a tree reads.

What comes out is what `rvaft.traces` gives for the same bytes: the same events as far as the tree is concerned, and the same errors.
Lines about which there is any doubt are read by `rvaft.traces` itself.
"""
