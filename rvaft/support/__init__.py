"""Utilities without knowledge of trees."""
