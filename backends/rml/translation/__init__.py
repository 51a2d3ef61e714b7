"""The translation of a tree into RML."""

from backends.rml.translation.translating import Translation, translate

__all__ = ["Translation", "translate"]
