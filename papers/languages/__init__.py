"""A comparison of specification languages: gates × arity × semantics × language."""
