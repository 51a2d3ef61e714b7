"""The participant `rml-published`: the published monitor of RML, run by SWI-Prolog from a checkout that the user names."""

from cross_check.published.running import NAME, published_of, run

__all__ = ["NAME", "published_of", "run"]
