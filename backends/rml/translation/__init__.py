"""The translation of a tree into RML."""

from backends.rml.translation.translate import Translation, translate

__all__ = ["Translation", "translate"]
