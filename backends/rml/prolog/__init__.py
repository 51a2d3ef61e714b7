"""The `rml-prolog` backend: what `rml` emits, in the form that RML's monitors load."""

from backends.rml.prolog.backend import RmlPrologBackend

__all__ = ["RmlPrologBackend"]
