"""The `rml` backend: trees as specifications in the Runtime Monitoring Language."""

from backends.rml.backend import RmlBackend

__all__ = ["RmlBackend"]
