"""The translation of a tree into RML."""

from backends.rml.writer.translation import Translation, translate

__all__ = ["Translation", "translate"]
