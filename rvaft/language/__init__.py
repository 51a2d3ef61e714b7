"""The language of trees, a superset of Galileo except for a few gates: parser and printer."""
