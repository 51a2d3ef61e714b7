"""Multi-path properties of verdicts: observational determinism, and its text in HyperLTL."""
