"""The tree and its parts, as immutable values."""
