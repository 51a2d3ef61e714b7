"""The language of trees: a superset of Galileo's static part, read and written."""
