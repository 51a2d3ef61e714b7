"""Analyses of risk: cut sets, probabilities, attacks, and the probability given a log (semantics, section 8)."""
