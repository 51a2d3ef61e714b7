"""Drawings of trees, and trees in other formats."""
