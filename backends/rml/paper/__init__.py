"""The translation to RML as it was published, never repaired (Cardoso, Ferrando, Fisher, FMAS 2022, sections 3.2 and 4.2)."""

from backends.rml.paper.backend import RmlPaperBackend

__all__ = ["RmlPaperBackend"]
