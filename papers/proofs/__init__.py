"""The machine-checked meaning: a section of a paper, and its figures."""
