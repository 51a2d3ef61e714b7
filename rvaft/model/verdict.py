"""The three verdicts and the four semantics."""

from enum import StrEnum


class Verdict(StrEnum):
    """The verdict after a prefix: detected, no longer possible, or unknown.

    >>> [(verdict.symbol, verdict.final) for verdict in Verdict]
    [('⊤', True), ('⊥', True), ('?', False)]
    """

    TRUE = "true"
    FALSE = "false"
    UNKNOWN = "unknown"

    def __bool__(self) -> bool:
        """Whether the verdict is ⊤: `if monitor.step(event): ...` acts on a detection.

        >>> [bool(verdict) for verdict in Verdict]
        [True, False, False]
        """
        return self is Verdict.TRUE

    @property
    def final(self) -> bool:
        """Whether the verdict can never change again."""
        return self is not Verdict.UNKNOWN

    @property
    def symbol(self) -> str:
        """The symbol in the literature: ⊤, ⊥ or ?."""
        return {"true": "⊤", "false": "⊥", "unknown": "?"}[self.value]


class Semantics(StrEnum):
    """The positions of a trace that a match may use.

    >>> Semantics("scattered") is Semantics.SCATTERED
    True
    """

    STRICT = "strict"
    PROJECTED = "projected"
    CONSECUTIVE = "consecutive"
    SCATTERED = "scattered"

    @property
    def projects(self) -> bool:
        """Whether a match uses consecutive relevant events."""
        return self in (Semantics.PROJECTED, Semantics.CONSECUTIVE)

    @property
    def ends(self) -> bool:
        """Whether the verdict can become false: a match begins with the first (relevant) event."""
        return self in (Semantics.STRICT, Semantics.PROJECTED)
