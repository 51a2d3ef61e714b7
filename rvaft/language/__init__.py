"""The language of trees, a superset of Galileo apart from a few gates: parser and printer."""
