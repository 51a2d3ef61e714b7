"""Comparison of specification languages by size and speed on the same trees."""
