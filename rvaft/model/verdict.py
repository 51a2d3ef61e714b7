"""The three verdicts and the four semantics."""

from enum import StrEnum


class Verdict(StrEnum):
    """What is known after a prefix: detected, can no longer be detected, or neither.

    >>> [(verdict.symbol, verdict.final) for verdict in Verdict]
    [('⊤', True), ('⊥', True), ('?', False)]
    """

    TRUE = "true"
    FALSE = "false"
    UNKNOWN = "unknown"

    @property
    def final(self) -> bool:
        """Whether the verdict can never change again."""
        return self is not Verdict.UNKNOWN

    @property
    def symbol(self) -> str:
        """The sign the literature prints: ⊤, ⊥ or ?."""
        return {"true": "⊤", "false": "⊥", "unknown": "?"}[self.value]


class Semantics(StrEnum):
    """Which positions of a trace a match may use.

    >>> Semantics("scattered") is Semantics.SCATTERED
    True
    """

    STRICT = "strict"
    PROJECTED = "projected"
    CONSECUTIVE = "consecutive"
    SCATTERED = "scattered"

    @property
    def projects(self) -> bool:
        """Whether the relevant events alone count, and each of them does, one after the other."""
        return self in (Semantics.PROJECTED, Semantics.CONSECUTIVE)

    @property
    def ends(self) -> bool:
        """Whether the verdict can become false: where a match has to begin with the first event, or
        the first relevant one.
        """
        return self in (Semantics.STRICT, Semantics.PROJECTED)
