"""The tree and what it is made of: immutable values."""
