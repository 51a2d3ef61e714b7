"""The translation of a tree into RML."""

from backends.rml.writer.translation import translate

__all__ = ["translate"]
