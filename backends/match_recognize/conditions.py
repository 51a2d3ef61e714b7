"""Guards over several events as conditions of SQL that are TRUE exactly where a guard is true, or where it is false: what is undefined is NULL, or FALSE.

What is about one event alone stands in a column of its own; comparisons and sums of several columns are left to SQL.
"""

from collections.abc import Callable, Iterable
from typing import Final, TypeAlias

from backends.match_recognize.rows import EXACT, LONGEST, json_text
from rvaft.model import guards
from rvaft.model.guards import Guard, Operation, Operator, variables
from rvaft.model.patterns import Literal
from rvaft.model.values import is_number

Column: TypeAlias = Callable[[str, Guard], str | None]
"""The column of an aspect of what is about one event, None for what several events have."""

NEVER: Final = "FALSE"
ALWAYS: Final = "TRUE"
_COMPARED: Final = {Operator.LT: "<", Operator.LE: "<=", Operator.GT: ">", Operator.GE: ">="}
_FALSE: Final = {Operator.LT: ">=", Operator.LE: ">", Operator.GT: "<=", Operator.GE: "<"}
_CALLED: Final = {Operator.MIN: "LEAST", Operator.MAX: "GREATEST", Operator.ABS: "ABS"}
_OPERANDS: Final = 40
"""The most operands of sums in a comparison: more could leave what doubles hold exactly."""


class NoCondition(Exception):
    """Why a guard is no condition of SQL."""


class RowConditions:
    """The guards of an order of events, with the column of what is about one of them; `times` are the variables that hold times."""

    def __init__(self, times: frozenset[str], column: Column) -> None:
        self._times = times
        self._column = column

    def when(self, guard: Guard, *, wanted: bool = True) -> str:
        """What is TRUE exactly where a guard is true (or false), as it is defined; raises `NoCondition`."""
        if not variables(guard):
            return ALWAYS if guards.value(guard, {}) is wanted else NEVER
        alone = self._column("truth", guard)
        if alone is not None:
            return alone if wanted else f"NOT {alone}"
        assert isinstance(guard, Operation), "a variable is of some event"
        left, *others = guard.operands
        match guard.operator:
            case Operator.NOT:
                return self.when(left, wanted=not wanted)
            case Operator.AND | Operator.OR:
                decides = guard.operator is Operator.OR
                if wanted is not decides:
                    return _all(self.when(one, wanted=wanted) for one in guard.operands)
                found = self.when(guard.operands[-1], wanted=decides)
                for one in reversed(
                    guard.operands[:-1]
                ):  # the right side is looked at where the left one leaves it open
                    found = _any([self.when(one, wanted=decides), _all([self.when(one, wanted=not decides), found])])
                return found
            case Operator.EQ | Operator.NE:
                return self._equal(left, others[0], wanted=wanted is (guard.operator is Operator.EQ))
            case Operator.IN:
                several = [self._equal(left, one, wanted=wanted) for one in others]
                return _any(several) if wanted else _all(several)
            case Operator.LT | Operator.LE | Operator.GT | Operator.GE:
                sign, right = (_COMPARED if wanted else _FALSE)[guard.operator], others[0]
                strings = [self._string(left), self._string(right)]
                compared = [] if None in strings else [f"{strings[0]} {sign} {strings[1]}"]
                return _any([*self._numbers(left, sign, right), *compared])
            case _:
                raise NoCondition(f"it calculates {guard.operator.name.lower()} of what several events have")

    def _equal(self, left: Guard, right: Guard, *, wanted: bool) -> str:
        left, right = guards.folded(left), guards.folded(right)
        if any(isinstance(one, Operation) and not variables(one) for one in (left, right)):
            return NEVER  # what has no value
        sign, texts = "=" if wanted else "<>", (self._text(left), self._text(right))
        if None not in texts:
            return f"{texts[0]} {sign} {texts[1]}"
        found = self._numbers(left, sign, right)
        if not wanted and texts != (None, None):  # what is no number is not equal to one
            one, other = (left, right) if texts[1] is None else (right, left)
            calculated = f"{self._number(other, self._kind(other))} IS NOT NULL"
            if not isinstance(one, Literal):
                found.append(
                    _all(
                        [calculated, f"{self._text(one)} IS NOT NULL", f"{self._column(self._kind(one), one)} IS NULL"]
                    )
                )
            elif not is_number(one.value):
                found.append(calculated)
        return _any(found)

    def _numbers(self, left: Guard, sign: str, right: Guard) -> list[str]:
        """Two numbers compared; nothing where one of them is none."""
        if any(isinstance(side, Literal) and not is_number(side.value) for side in (left, right)):
            return []
        if sum(not isinstance(one, Operation) for side in (left, right) for one in guards.walk(side)) > _OPERANDS:
            raise NoCondition("its sums are too long for doubles to calculate as whole numbers do")
        kinds = {self._kind(side) for side in (left, right) if variables(side)}
        if len(kinds) > 1:
            raise NoCondition("it compares a time with what is none")
        sides = [self._number(side, *kinds) for side in (left, right)]
        return [] if None in sides else [f"{sides[0]} {sign} {sides[1]}"]

    def _number(self, guard: Guard, kind: str) -> str | None:
        """A number; None where it never is one."""
        if not variables(guard):
            constant = guards.value(guard, {})
            if constant is guards.UNDEFINED or not is_number(constant):
                return None
            if abs(constant) > (LONGEST if kind == "time" else EXACT):
                raise NoCondition(f"it compares with {constant}, which is no exact number there")
            written = (
                str(constant)
                if kind == "time"
                else f"{float(constant) + 0.0!r}E0".replace("E0", "" if "e" in repr(float(constant)) else "E0")
            )
            return f"({written})" if constant < 0 else written
        alone = self._column(kind, guard)
        if alone is not None or not isinstance(guard, Operation):
            return alone
        operands = [self._number(one, kind) for one in guard.operands]
        numbers = [one for one in operands if one is not None]
        if len(numbers) < len(operands):
            return None
        match guard.operator:
            case Operator.ADD | Operator.SUB:
                return f"({f' {guard.operator.value} '.join(numbers)})"
            case Operator.NEGATE:
                return f"(0 - {numbers[0]})"
            case Operator.NUMBER:
                return numbers[0]
            case Operator.MIN | Operator.MAX | Operator.ABS:
                return f"{_CALLED[guard.operator]}({', '.join(numbers)})"
            case _:
                raise NoCondition(f"doubles calculate {guard.operator.name.lower()} otherwise")

    def _text(self, guard: Guard) -> str | None:
        """Any value as JSON, None for what several events have."""
        if isinstance(guard, Literal):
            quoted = json_text(guard.value).replace("'", "''")
            return f"'{quoted}'"
        return self._column("text", guard)

    def _string(self, guard: Guard) -> str | None:
        """A string with its order, None for what several events have and for what is none."""
        if isinstance(guard, Literal):
            return f"'{guard.value.encode('utf-8', 'surrogatepass').hex()}'" if isinstance(guard.value, str) else None
        makes_none = isinstance(guard, Operation) and guard.operator is not Operator.LOWER
        return None if makes_none or self._kind(guard) == "time" else self._column("string", guard)

    def _kind(self, guard: Guard) -> str:
        """Whether it is calculated of times; raises `NoCondition` where of other things, too."""
        kinds = {name in self._times for name in variables(guard)}
        if len(kinds) > 1:
            raise NoCondition("it calculates with a time and with what is none")
        return "time" if kinds == {True} else "number"


def _all(several: Iterable[str]) -> str:
    """The conjunction, each condition once."""
    found = dict.fromkeys(one for one in several if one != ALWAYS)
    return NEVER if NEVER in found else " AND ".join(found) or ALWAYS


def _any(several: Iterable[str]) -> str:
    """The disjunction, each condition once."""
    found = dict.fromkeys(one for one in several if one != NEVER)
    return ALWAYS if ALWAYS in found else f"({' OR '.join(found)})" if len(found) > 1 else next(iter(found), NEVER)
