"""Specification languages: one package each, none sharing translation code with another."""
