"""Which partial matches another one makes superfluous.

**Taken or passed over.** Under `scattered` a configuration may pass over every event. Passing over
is of no use where the occurrence belongs to all that the configuration can still become and taking
it costs nothing: no variable is bound by it, no choice made. Then whatever the configuration could
do later, it can do with the event taken, within the same branch (so that the explanation still
finds the lowest). The same goes for a choice that every scenario makes and that nothing has to come
before, where the event is all of the child with the lowest branch.

**Different values.** Take two partial matches that have come equally far (the same taken, decided
with the same outcome, and broken) and whose bindings agree but for some variables that no
occurrence to come mentions: these are of consequence through the guards still open alone. An open
guard is *for greater values* of such a variable if, whatever the values of the others, it holds for
y where it holds for x < y; and likewise for smaller values. If all open guards that mention the
variable are for greater values of it, a completion of the match with x is one of the match with y >
x: the same events for the same occurrences, the same scenario, of the same branches. With several
such variables replace one after the other. So the match with the lesser value may be dropped as
long as the other, or one that can do all that it can, is kept.

What makes a guard one for greater (smaller) values, as `rvaft.model.guards` evaluates it:

- Rounding is monotone: of two whole numbers, x <= y, and a constant c, x + c <= y + c holds for the computed results
  too: exactly if c is whole, and after rounding if not (x is then first rounded to a double). So it does for two
  numbers that are not whole, always after rounding. The same goes for x + e where e is whatever the rest of the guard
  gives, the same for both. Not so between a whole number and another one: 0.5 + (2**53 + 1) is 2**53 after rounding,
  but 0 + (2**53 + 1) is exact. So two values are compared only if both are whole, or neither is. A sum may be whole for
  the one and not for the other. Hence to a sum only constants are added, and of whole ones only those up to 2**53: of
  these, and of a number that is not whole and so less than 2**52, the sum is less than 2**54, where a whole number that
  is greater (or smaller) than a sum is not passed by rounding it.
- Comparisons of numbers are exact, whatever their types. On texts they are those of code points;
  arithmetic on texts is undefined.
- What is undefined does not hold, nor does its negation. So it must not depend on x whether a
  comparison is defined. Types decide it, and being finite, and the conversion of a whole number to
  a double. Therefore values and constants beyond `MOST` are left out: added to a finite double such
  values leave a finite double, since they are less than half of the last place of the largest.
  After the one operand that is not a constant only whole constants are allowed, for a sum of whole
  numbers may be too large for a double.
- So a comparison stays defined, or undefined, as the value changes: it is *steady*. Then its
  negation is for the other direction, and steady.
- `and` holds where all its operands do: it is monotone if they are. But what it does not look at
  may be undefined, so that `and` may turn from false to undefined where its first operand turns
  from false to true. So neither is it steady, nor is `or`, unless only the last operand mentions
  the variable and is. `or` looks at an operand where those before are false, which for them must
  not turn into undefined: it is monotone if its operands are, and those before the last are steady.

**Values that others must differ from.** A variable that is mentioned only where it must differ
(`!=`) from values to come is told apart by these alone: k of them exclude at most k values. So of
matches that agree otherwise as many are kept as it takes for some to be left, whatever is excluded,
if another one were: a match is not needed if each choice of values to come that excludes all that
are kept excludes it too.

**Times.** Of a difference of times (`core.times`) only the least and the greatest of the times
known on either side matter, and whole numbers are exact. Where events with times before a floor no
longer count, a greatest time below it is as good as any other.

Anything else is left alone: equality, products, a variable on both sides. What is not said to be
comparable counts as equal only if nothing can tell the values apart (`fingerprint`).
"""

from collections.abc import Hashable, Mapping, Sequence
from itertools import chain
from operator import ge
from typing import Final, NamedTuple, assert_never

from rvaft.core.part_numbers import PartKind
from rvaft.core.times import Extreme
from rvaft.engine.compiled_tree import CompiledTree
from rvaft.engine.configuration import DONE, MORE, POSSIBLE, SURE, TOUCHED, Configuration
from rvaft.engine.partial_matches import Matching
from rvaft.model.guards import ORDERINGS, Guard, Operation, Operator, variables, walk
from rvaft.model.patterns import Literal, Variable
from rvaft.model.values import Json, exact, is_number, key


def commits(matching: Matching, before: Configuration, after: Configuration, node: int, *, firsts: int) -> bool:
    """Whether the configuration after a node's event can do all that the one before it can.

    `firsts` are the parts of the core that a choice, which every scenario makes, can keep with the lowest branch.
    """
    compiled, flags = matching.compiled, matching.progress.flags
    if after.binding != before.binding or after.closed != before.closed:
        return False
    if any(name not in before.binding for name in compiled.exported[node]):
        return False
    part = compiled.part_of[node]
    chosen = (
        firsts >> part & 1 > 0 and flags(after, part) == TOUCHED | DONE | SURE and before.inversions == after.inversions
    )
    if compiled.core and not matching.shared.settled(before, node, chosen=chosen):
        return False

    def ends(node: int, flags: int) -> bool:  # nothing more comes of it in the same branch
        return flags & SURE > 0 and not (flags & MORE and compiled.picks >> node & 1)

    def keeps(gate: int, child: int) -> bool:  # nothing is lost by what happened below the child
        siblings = compiled.children[gate]
        match compiled.ops[gate]:
            case PartKind.ALL | PartKind.EVENT | PartKind.CONDITION:
                return True
            case PartKind.SEQUENCE:
                return all(ends(elder, flags(before, elder)) for elder in siblings[: compiled.slot[child]])
            case PartKind.ONE | PartKind.AT_LEAST as op:
                able = sum(flags(before, sibling) & POSSIBLE > 0 for sibling in siblings)
                if flags(before, child) & TOUCHED or able <= compiled.need[gate]:
                    return True
                return op is PartKind.AT_LEAST and flags(after, child) & SURE > 0 and not compiled.picks >> child & 1
            case _ as never:
                assert_never(never)

    follows = node not in compiled.members and compiled.own[node] and not compiled.top_down
    if follows and not ends(node, matching.progress.inner(after, node)):
        return False
    child = node
    while compiled.parent[child] >= 0:
        if not keeps(compiled.parent[child], child):
            return False
        child = compiled.parent[child]
    return True


MOST: Final = 10**100

_EXACT: Final = 2**53
"""All whole numbers up to this one are doubles."""
_MIXED: Final = None
_SUMS: Final = (Operator.ADD, Operator.SUB)
_FIRST_GREATER: Final = (Operator.GT, Operator.GE)


class Term(NamedTuple):
    """A number or text that a binding gives, and whether a greater (1) or a smaller (-1) one can do more."""

    sign: int
    extreme: Extreme

    def value(self, binding: Mapping[str, Json]) -> Json:
        """Its value."""
        names = self.extreme.names
        return binding[names[0]] if len(names) == 1 else self.extreme.of(binding)


class Rank(NamedTuple):
    """Where a partial match stands among those of its stage: only in one `place` can one make another superfluous."""

    place: Hashable
    values: tuple[Json, ...]
    """Of each the greater can do more."""
    told_apart: tuple[Hashable, ...]
    """Values that others, yet to come, must differ from."""


class _Backwards(str):
    """A text in the opposite order."""

    __slots__ = ()
    __lt__, __le__, __gt__, __ge__ = str.__gt__, str.__ge__, str.__lt__, str.__le__


class Ranking(NamedTuple):
    """How bindings of partial matches that have come equally far compare."""

    exact: tuple[str, ...] = ()
    """The variables whose values must be the same."""
    terms: tuple[Term, ...] = ()
    excluded: tuple[str, ...] = ()
    """The variables whose values matter only in that others differ from them."""
    differing: tuple[tuple[int, ...], ...] = ()
    """For each value yet to come: of which of these, by their places in the tuple, it must differ."""
    floored: bool = False
    """Whether of the second of two terms, a greatest time, only matters how far it is above the
    times that are still to come.
    """

    def of(self, binding: Mapping[str, Json]) -> Rank:
        """The rank of a binding."""
        place: list[Hashable] = [exact(binding[name]) for name in self.exact]
        if not self.terms and not self.excluded:
            return Rank(tuple(place), (), ())
        values: list[Json] = []
        for sign, extreme in self.terms:
            value = binding[extreme.names[0]] if len(extreme.names) == 1 else extreme.of(binding)
            kind = scale(value)
            place.append(tuple([exact(binding[name]) for name in extreme.names]) if kind is None else kind)
            values.append(0 if kind is None else value if sign > 0 else _Backwards(value) if kind is str else -value)
        told_apart = [key(binding[name]) for name in self.excluded]
        place.extend(type(one) is object for one in told_apart)  # what equals nothing has no equal in what it can do
        return Rank(tuple(place), tuple(values), tuple(told_apart))

    def covers(self, rivals: Sequence[Rank], rank: Rank) -> bool:
        """Whether, of rivals in its place, some can do all that one with this rank can, whatever comes."""
        able = [rival for rival in rivals if all(map(ge, rival.values, rank.values))]
        return bool(able) and not self._tells(rank.told_apart, [rival.told_apart for rival in able], 0, {})

    def _tells(
        self,
        one: tuple[Hashable, ...],
        rivals: Sequence[tuple[Hashable, ...]],
        number: int,
        values: Mapping[int, Hashable],
    ) -> bool:
        """Whether the values to come, some of which are these, can exclude all the rivals from a
        number on and not the one.
        """
        while number < len(rivals) and any(
            rivals[number][place] == value for group, value in values.items() for place in self.differing[group]
        ):
            number += 1
        if number == len(rivals):
            return True
        for group, places in enumerate(self.differing):
            if group not in values:
                for value in dict.fromkeys(rivals[number][place] for place in places):
                    free = all(one[place] != value for place in places)
                    if free and self._tells(one, rivals, number + 1, {**values, group: value}):
                        return True
        return False


MOST_EXCLUDED: Final = 9
"""Variables times values that they must differ from, up to which representatives are looked for."""


def ranking(compiled: CompiledTree, configuration: Configuration) -> Ranking:
    """How the bindings of configurations that have come as far as this one compare."""
    binding = configuration.binding
    fixed = {name for name in binding if compiled.mentions[name] & ~configuration.taken}
    terms: dict[Term, None] = {}
    differing: dict[Guard, list[str]] = {}
    floored = True
    waiting = {node for name in binding for node in compiled.guarded_by.get(name, ())}
    guards = [compiled.conditions[node] for node in sorted(waiting) if not configuration.closed >> node & 1]
    for part, mentioned, over_times, asked in chain(*guards):
        bound = [name for name in mentioned if name in binding]
        if bound and over_times:
            if asked is None:
                fixed.update(bound)
            for one in asked or ():
                if plus := one.plus.among(binding).names:
                    floored &= one.plus.operator is Operator.MAX and len(plus) < len(one.plus.names)
                sides = Term(-1, one.plus.among(binding)), Term(1, one.minus.among(binding))
                terms.update((term, None) for term in sides if term.extreme.names)
            continue
        for name in bound:
            other, sign = _differs(part, name), tendency(part, name)
            if other is not None:
                differing.setdefault(other, []).append(name)
            elif sign:
                terms[Term(sign, Extreme(Operator.MAX, (name,)))] = None
            else:
                fixed.add(name)
    for sign, extreme in [*terms]:
        if extreme.names[0] not in compiled.times and Term(-sign, extreme) in terms:
            fixed.update(extreme.names)
    groups = [names for names in differing.values() if not fixed.issuperset(names)]
    excluded = sorted({name for names in groups for name in names} - fixed)
    if len(excluded) * len(groups) > MOST_EXCLUDED:
        fixed.update(excluded)
        excluded, groups = [], []
    told = [tuple(place for place, name in enumerate(excluded) if name in names) for names in groups]
    rising = sorted((term for term in terms if not fixed.issuperset(term.extreme.names)), key=lambda term: -term.sign)
    floored &= [term.sign for term in rising] == [1, -1] and rising[1].extreme.names[0] in compiled.times
    return Ranking(tuple(sorted(fixed)), tuple(rising), tuple(excluded), tuple(told), floored)


def _differs(guard: Guard, name: str) -> Guard | None:
    """What a guard asks the value of a variable to differ from, if it asks only that."""
    match guard:
        case Operation(Operator.NE, sides) | Operation(Operator.NOT, (Operation(Operator.EQ, sides),)):
            return _beside(sides, name)
        case _:
            return None


def repeats(guard: Guard, name: str) -> Guard | None:
    """What a guard asks the value of a variable to equal, if it asks only that."""
    match guard:
        case Operation(Operator.EQ, sides) | Operation(Operator.NOT, (Operation(Operator.NE, sides),)):
            return _beside(sides, name)
        case _:
            return None


def _beside(sides: Sequence[Guard], name: str) -> Guard | None:
    """Of two terms the one that is not this variable; None where it is neither, or in both."""
    for one, other in (sides, sides[::-1]):
        if isinstance(one, Variable) and one.name == name and name not in variables(other):
            return other
    return None


def tendency(guard: Guard, name: str) -> int | None:
    """Whether a guard is for greater (1) or smaller (-1) values of a variable, does not mention it
    (0), or is neither (None).
    """
    if name not in variables(guard):
        return 0
    match guard:
        case Operation(Operator.AND | Operator.OR as operator, operands):
            if operator is Operator.OR and not all(_steady(operand, name) for operand in operands[:-1]):
                return _MIXED
            signs = {tendency(operand, name) for operand in operands} - {0}
            return signs.pop() if len(signs) == 1 else _MIXED
        case Operation(Operator.NOT, (operand,)):
            return _turned(tendency(operand, name)) if _steady(operand, name) else _MIXED
        case Operation(operator, (left, right)) if operator in ORDERINGS:
            if name in variables(left) and name in variables(right):
                return _MIXED
            slope = _slope(left, name)[0] if name in variables(left) else _turned(_slope(right, name)[0])
            return slope if operator in _FIRST_GREATER else _turned(slope)
        case _:
            return _MIXED


def _steady(guard: Guard, name: str) -> bool:
    """Whether a guard that is monotone in a variable is defined, or undefined, whatever its value."""
    if name not in variables(guard):
        return True
    match guard:
        case Operation(Operator.AND | Operator.OR, (*first, last)):
            return _steady(last, name) and not any(name in variables(operand) for operand in first)
        case Operation(Operator.NOT, (operand,)):
            return _steady(operand, name)
        case _:
            return True


def _turned(sign: int | None) -> int | None:
    return _MIXED if sign is None else -sign


def _slope(term: Guard, name: str) -> tuple[int | None, bool]:
    """The sign of a variable in a sum that mentions it once, and whether the rest of it is constants.

    To a sum with a term that is no constant only whole constants are added, and of whole constants beyond 2**53, and of
    other terms, one alone is added, to the variable itself.
    """
    match term:
        case Variable():
            return 1, True
        case Operation(Operator.NEGATE, (inner,)):
            slope, alone = _slope(inner, name)
            return _turned(slope), alone
        case Operation(Operator.ADD | Operator.SUB as operator, (left, right)):
            if name in variables(left) and name in variables(right):
                return _MIXED, False
            inner, other = (left, right) if name in variables(left) else (right, left)
            slope, alone = _slope(inner, name)
            if operator is Operator.SUB and inner is right:
                slope = _turned(slope)
            itself = not any(isinstance(part, Operation) and part.operator in _SUMS for part in walk(inner))
            if isinstance(other, Literal) and isinstance(other.value, int | float) and _moderate(other.value):
                whole = other.value == int(other.value)
                fits = itself or abs(other.value) <= _EXACT if whole else alone
                return (slope, alone) if fits else (_MIXED, False)
            return (slope, False) if itself else (_MIXED, False)
        case _:
            return _MIXED, False


def _moderate(value: Json) -> bool:
    return is_number(value) and -MOST <= value <= MOST


def scale(value: Json) -> type | None:
    """What two values have in common that can be compared (`int` if both are whole); None for a
    value that cannot be.
    """
    if type(value) is str or (type(value) is int and _moderate(value)):
        return type(value)
    if type(value) is float and _moderate(value):
        return int if value.is_integer() else float
    return None
