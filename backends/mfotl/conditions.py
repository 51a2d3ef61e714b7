"""Guards over several events as disjunctions of conjunctions of MonPoly's comparisons, each of which is about arguments that are bound.

A guard that is undefined is neither true nor false: what makes it true and what makes it false are said apart.
"""

from collections.abc import Callable, Sequence
from itertools import product
from typing import Final, TypeAlias

from backends.mfotl.predicates import Column, decimal_text, hexadecimal, word
from rvaft.errors import TooLarge
from rvaft.model.event_time import TIME
from rvaft.model.guards import Guard, Operation, Operator, variables, walk
from rvaft.model.patterns import Literal, ObjectPattern, Pattern, Variable
from rvaft.model.values import equal, is_number

Ways: TypeAlias = tuple[tuple[str, ...], ...]
"""A disjunction of conjunctions."""

NEVER: Final[Ways] = ()
ALWAYS: Final[Ways] = ((),)
MOST: Final = 500
"""The most conjunctions of one guard."""
_OPERANDS: Final = 40
"""The most operands of sums in a comparison: more could leave what doubles hold exactly."""

_COMPARED: Final = {Operator.LT: "<", Operator.LE: "<=", Operator.GT: ">", Operator.GE: ">="}
_FALSE: Final = {Operator.LT: ">=", Operator.LE: ">", Operator.GT: "<=", Operator.GE: "<"}


class Unsayable(Exception):
    """Why a guard cannot be said."""


def times_of(pattern: Pattern) -> frozenset[str]:
    """The variables that hold the time of an event of a pattern."""
    fields = pattern.fields if isinstance(pattern, ObjectPattern) else ()
    return frozenset(part.name for name, part in fields if name == TIME and isinstance(part, Variable))


def both(*several: Ways) -> Ways:
    """What is so where all of these are; raises `TooLarge`."""
    found: Ways = ALWAYS
    for ways in several:
        if len(found) * len(ways) > MOST:
            raise TooLarge("ways in which a guard can hold", limit=MOST)
        found = tuple(dict.fromkeys(tuple(dict.fromkeys(a + b)) for a, b in product(found, ways)))
    return found


def either(*several: Ways) -> Ways:
    """What is so where one of these is."""
    return tuple(dict.fromkeys(way for ways in several for way in ways))


class Conditions:
    """The guards of a tree; `times` are the variables that hold times, `column` writes the argument of a column."""

    def __init__(self, times: frozenset[str], column: Callable[[Column], str]) -> None:
        self._times = times
        self._column = column

    def columns(self, guard: Guard) -> set[Column]:
        """What a guard looks at of its variables."""
        found: set[Column] = set()
        Conditions(self._times, lambda column: found.add(column) or "").truth(guard, wanted=True)  # type: ignore[func-returns-value]
        return found

    def truth(self, guard: Guard, *, wanted: bool) -> Ways:
        """When a guard is true (or false), as it is defined; raises `Unsayable` and `TooLarge`."""
        if not isinstance(guard, Operation):
            return self._equal(guard, Literal(wanted), wanted=True)
        left, *others = guard.operands
        match guard.operator:
            case Operator.NOT:
                return self.truth(left, wanted=not wanted)
            case Operator.AND | Operator.OR:
                decides = guard.operator is Operator.OR
                if wanted is not decides:
                    return both(*(self.truth(one, wanted=wanted) for one in guard.operands))
                undecided, found = ALWAYS, NEVER
                for one in guard.operands:  # what stands to the right is looked at where all before it leave it open
                    found = either(found, both(undecided, self.truth(one, wanted=decides)))
                    undecided = both(undecided, self.truth(one, wanted=not decides))
                return found
            case Operator.EQ | Operator.NE:
                return self._equal(left, others[0], wanted=wanted is (guard.operator is Operator.EQ))
            case Operator.IN:
                if wanted:
                    return either(*(self._equal(left, one, wanted=True) for one in others))
                return both(*(self._equal(left, one, wanted=False) for one in others))
            case Operator.LT | Operator.LE | Operator.GT | Operator.GE:
                sign = (_COMPARED if wanted else _FALSE)[guard.operator]
                numbers = self._compared(sign, left, others[0])
                return either(numbers, self._strings(sign, left, others[0]))
            case _:
                raise Unsayable(f"it calculates {guard.operator.name.lower()} of what several events have")

    def _equal(self, left: Guard, right: Guard, *, wanted: bool) -> Ways:
        if isinstance(left, Literal) and isinstance(right, Literal):
            return ALWAYS if equal(left.value, right.value) is wanted else NEVER
        if not any(isinstance(one, Operation) or self._is_time(one) for one in (left, right)):
            same = " = ".join(
                self._column((one.name, "text")) if isinstance(one, Variable) else f'"{word(one.value)}"'
                for one in (left, right)
                if not isinstance(one, Operation)
            )
            return ((same if wanted else f"NOT ({same})",),)
        numbers = self._compared("=" if wanted else "<>", left, right)
        one, other = (left, right) if isinstance(right, Operation) else (right, left)
        if wanted or isinstance(one, Operation):
            return numbers
        calculated = tuple(conditions for conditions, _ in self._terms(other))
        if isinstance(one, Literal):
            return numbers if is_number(one.value) else calculated
        return either(
            numbers, both(((f"NOT ({self._is(one, 'n')})",),), calculated)
        )  # what is no number is not equal to one

    def _compared(self, sign: str, left: Guard, right: Guard) -> Ways:
        """Two numbers compared; nothing where one of them is none."""
        if any(isinstance(side, Literal) and not is_number(side.value) for side in (left, right)):
            return NEVER
        if sign in ("<", "<=") and isinstance(left, Operation) and left.operator is Operator.SUB:
            greatest, least = (
                _operands(one, op) for one, op in zip(left.operands, (Operator.MAX, Operator.MIN), strict=True)
            )
            if len(greatest) + len(least) > 2:  # a window: what is so of the extremes is so of all
                pairs = (Operation(Operator.SUB, pair) for pair in product(greatest, least))
                return both(*(self._compared(sign, pair, right) for pair in pairs))
        integers = {self._is_integer(side) for side in (left, right) if variables(side)}
        if len(integers) > 1:
            raise Unsayable("it compares a time with what is none")
        whole = integers == {True}
        found = []
        for (some, one), (more, other) in product(self._terms(left, whole), self._terms(right, whole)):
            written = f"NOT ({one} = {other})" if sign == "<>" else f"{one} {sign} {other}"
            found.append((*some, *more, written))
        return both(tuple(found))

    def _strings(self, sign: str, left: Guard, right: Guard) -> Ways:
        found: list[str] = []
        conditions: list[str] = []
        for side in (left, right):
            one: Guard = side
            if isinstance(one, Literal) and isinstance(one.value, str):
                found.append(f'"{hexadecimal(one.value)}"')
            elif isinstance(one, Variable) and not self._is_time(one):
                conditions.append(self._is(one, "s"))
                found.append(self._column((one.name, "string")))
            else:
                return NEVER
        return ((*conditions, f"{found[0]} {sign} {found[1]}"),)

    def _terms(self, guard: Guard, whole: bool | None = None) -> list[tuple[tuple[str, ...], str]]:
        """The ways in which a number comes about: conditions, and how it is written then."""
        whole = self._is_integer(guard) if whole is None else whole
        if isinstance(guard, Literal):
            number = guard.value
            if not isinstance(number, int | float) or isinstance(number, bool):
                return []
            return [((), str(number) if whole else decimal_text(number))]
        if isinstance(guard, Variable):
            return [((self._is(guard, "n"),), self._column((guard.name, "integer" if whole else "number")))]
        if sum(not isinstance(one, Operation) for one in walk(guard)) > _OPERANDS:
            raise Unsayable("its sums are too long for doubles to calculate as whole numbers do")
        ways = [self._terms(one, whole) for one in guard.operands]
        combined = [(tuple(c for some, _ in way for c in some), [text for _, text in way]) for way in product(*ways)]
        match guard.operator:
            case Operator.ADD | Operator.SUB:
                sign = guard.operator.value
                return [(conditions, f"({f' {sign} '.join(texts)})") for conditions, texts in combined]
            case Operator.NEGATE:
                return [(conditions, f"({'0' if whole else '0.0'} - {texts[0]})") for conditions, texts in combined]
            case Operator.DIV if not variables(guard):  # a time point that no event has
                return []
            case Operator.MIN | Operator.MAX:
                before, after = ("<", "<=") if guard.operator is Operator.MIN else (">", ">=")
                return [
                    ((*conditions, *_first(texts, number, before, after)), text)
                    for conditions, texts in combined
                    for number, text in enumerate(texts)
                ]
            case _:
                raise Unsayable(f"MonPoly's doubles calculate {guard.operator.name.lower()} otherwise")

    def _is_time(self, guard: Guard) -> bool:
        return isinstance(guard, Variable) and guard.name in self._times

    def _is_integer(self, guard: Guard) -> bool:
        """Whether it is calculated of times; raises `Unsayable` where of other things, too."""
        kinds = {name in self._times for name in variables(guard)}
        if len(kinds) > 1:
            raise Unsayable("it calculates with a time and with what is none")
        return kinds == {True}

    def _is(self, variable: Variable, kind: str) -> str:
        return f'{self._column((variable.name, "kind"))} = "{kind}"'


def _operands(guard: Guard, operator: Operator) -> tuple[Guard, ...]:
    return guard.operands if isinstance(guard, Operation) and guard.operator is operator else (guard,)


def _first(texts: Sequence[str], number: int, before: str, after: str) -> list[str]:
    """The conditions under which one of several numbers is the least, or the greatest, and the first of those."""
    pairs = ((before if other < number else after, text) for other, text in enumerate(texts) if other != number)
    return [f"{texts[number]} {sign} {text}" for sign, text in pairs]
