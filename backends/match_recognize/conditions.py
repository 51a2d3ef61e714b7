"""Guards over several events as SQL conditions: TRUE exactly when the guard holds, else FALSE or
NULL.

Expressions over one event are columns.
"""

from collections.abc import Callable
from typing import Final, TypeAlias

from backends.event_columns import constant, require_exact_sums
from backends.field_conditions import conjunction, disjunction
from rvaft.core.conditions import (
    ComparisonTest,
    ConditionTest,
    EqualityTest,
    SortTest,
    TruthCondition,
    TruthTest,
    Unsayable,
    spelled,
)
from rvaft.errors import TooLarge
from rvaft.model.guards import Guard, Operation, Operator, TermSort
from rvaft.model.patterns import Literal

Column: TypeAlias = Callable[[str, Guard], str | None]
"""Return the column for an aspect of an expression over one event, or None for several events."""

NEVER: Final = "FALSE"
ALWAYS: Final = "TRUE"
LENGTH: Final = 20_000
"""Maximum number of characters of a condition."""
_ASPECTS: Final = {TermSort.NUMBER: "number", TermSort.TIME: "time", TermSort.TEXT: "string", TermSort.TRUTH: "truth"}
_CALLED: Final = {Operator.MIN: "LEAST", Operator.MAX: "GREATEST", Operator.ABS: "ABS"}


def written(condition: TruthCondition, column: Column) -> str:
    """Return the condition in SQL; raises `Unsayable` and `TooLarge`."""

    def test(one: ConditionTest) -> str:
        match one:
            case TruthTest(term, wanted):
                alone = column("truth", term)
                if alone is None and isinstance(term, Operation):
                    raise Unsayable(f"it applies {term.operator.name.lower()} to values of several events")
                return alone or NEVER if wanted else f"NOT {alone}"
            case EqualityTest(left, right, wanted):
                return f"{value(left, 'text')} {'=' if wanted else '<>'} {value(right, 'text')}"
            case ComparisonTest(sort, left, sign, right):
                require_exact_sums(left, right, time=sort is TermSort.TIME)
                return f"{value(left, _ASPECTS[sort])} {sign} {value(right, _ASPECTS[sort])}"
            case SortTest(term, sort, wanted=True):
                return f"{value(term, _ASPECTS[sort])} IS NOT NULL"
            case SortTest(term, sort):
                return f"{value(term, 'text')} IS NOT NULL AND {value(term, _ASPECTS[sort])} IS NULL"

    def value(term: Guard, aspect: str) -> str:
        if isinstance(term, Literal):
            return _literal(constant(term, aspect))
        if (alone := column(aspect, term)) is not None:
            return alone
        assert isinstance(term, Operation), "a variable is of some event"
        operands = [value(one, aspect) for one in term.operands]
        match term.operator:
            case Operator.ADD | Operator.SUB:
                return f"({f' {term.operator} '.join(operands)})"
            case Operator.NEGATE:
                return f"(0 - {operands[0]})"
            case Operator.NUMBER:
                return operands[0]
            case Operator.MIN | Operator.MAX | Operator.ABS:
                return f"{_CALLED[term.operator]}({', '.join(operands)})"
            case operator:
                raise Unsayable(f"{operator.name.lower()} of doubles is not exact")

    def join(every: bool, parts: list[str]) -> str:
        found = conjunction(parts, " AND ", ALWAYS, NEVER) if every else disjunction(parts, " OR ", ALWAYS, NEVER)
        if len(found) > LENGTH:
            raise TooLarge("characters of a condition", limit=LENGTH)
        return found

    return spelled(condition, test, join)


def _literal(cell: object) -> str:
    if isinstance(cell, str):
        quoted = cell.replace("'", "''")
        return f"'{quoted}'"
    text = f"{cell!r}" if isinstance(cell, int) or "e" in repr(cell) else f"{cell!r}E0"
    return f"({text})" if text.startswith("-") else text
