"""Subsumption: partial matches that another partial match makes superfluous.

**Taken or skipped.** Under `scattered`, a partial match may skip every event. Skipping is
superfluous if every continuation has the occurrence, and taking it binds no variable and makes no
choice. The same holds for a choice that every scenario makes and that nothing must precede, if the
event completes the child with the lowest branch.

**Different values.** Two partial matches have the same events taken, decided guards and broken
orders. Their bindings differ only in variables that no later occurrence mentions, so only open
guards depend on these. An open guard is *rising* in a variable if, for all values of the others, it
holds for y if it holds for some x < y; *falling* is the opposite. If all open guards with the
variable are rising, each completion with x is one with y > x. So the match with the lesser value
may be dropped while one at least as good is kept.

A guard, as `rvaft.model.guards` evaluates it, is rising or falling by these rules:

- Rounding is monotone. For integers x <= y and a constant c, x + c <= y + c holds for the computed
  results: exactly if c is an integer, otherwise after rounding. For two non-integers it holds after
  rounding, and so it does for x + e with the same e.
- Between an integer and a non-integer it fails: 0.5 + (2**53 + 1) rounds to 2**53, but 0 + (2**53 +
  1) is exact. So two values are compared only if both are integers or neither is. A sum may be an
  integer for only one of them, so only constants are added to a sum, and integer constants only up
  to 2**53. Then the sum of a non-integer (less than 2**52) is less than 2**54, where rounding never
  passes an integer on the other side.
- Comparisons of numbers are exact for all types. Texts are compared by code points; arithmetic on
  texts is undefined.
- An undefined guard does not hold, nor does its negation, so whether a comparison is defined must
  not depend on x. It depends on types, finiteness, and the conversion of an integer to a double.
  Values and constants beyond `MOST` are excluded, so that sums with a double stay finite. Only
  integer constants follow an operand that is no constant, because a sum of integers may be too
  large for a double.
- So a comparison stays defined or undefined as the value changes: it is *steady*. Its negation is
  steady too, with the opposite direction.
- `and` is monotone if its operands are. But an operand that is not evaluated may be undefined, so
  `and` and `or` are steady only if just the last operand has the variable and is steady. `or`
  evaluates an operand if the earlier ones are false, so it is monotone if its operands are, and
  those before the last are steady.

**Excluded values.** If a variable occurs only in inequalities (`!=`) with later values, k such
values exclude at most k of its values. A match is superfluous if each choice of later values that
excludes all kept matches excludes it too.

**Times.** Of a difference of times (`core.times`), only the extremes of the known times on each
side matter, and integers are exact. Below the watermark, greatest times are equivalent. Of a window
over choices, the least and the greatest time so far are remembered.

All other variables are compared for equality (`fingerprint`).
"""

from collections.abc import Hashable, Iterator, Mapping, Sequence
from itertools import chain
from operator import ge
from typing import Final, NamedTuple, assert_never

from rvaft.core.property import PartKind
from rvaft.core.times import Extreme, TimeDifference
from rvaft.engine.compiled_tree import CompiledTree, Register
from rvaft.engine.configuration import DONE, MORE, POSSIBLE, SURE, TOUCHED, Configuration
from rvaft.engine.partial_matches import Matching
from rvaft.model.guards import ORDERINGS, Guard, Operation, Operator, variables, walk
from rvaft.model.nodes import Side
from rvaft.model.patterns import Literal, Variable
from rvaft.model.values import EXACT_INTEGERS, Json, exact, is_number, key


def commits(matching: Matching, before: Configuration, after: Configuration, node: int, *, firsts: int) -> bool:
    """Whether the partial match `after` a node's event subsumes the one `before`.

    `firsts` are the core parts with the lowest branch of a choice that every scenario makes.
    """
    compiled, flags = matching.compiled, matching.progress.flags
    if compiled.clauses:  # an absent event may come, or be used by a later occurrence
        return False
    if after.binding != before.binding or after.closed != before.closed:
        return False
    if any(name not in before.binding for name in compiled.exported[node]):
        return False
    if any(name in after.binding for one in compiled.registers[node] for name in one[1:]):
        return False
    if (after.unfit, after.broken) != (before.unfit, before.broken):
        return False
    open_points = (one for one in compiled.pointed.values() if not after.closed >> one.node & 1)
    if any(name in after.binding for one in open_points for name in one.times):  # another event may move one
        return False
    part = compiled.part_of[node]
    chosen = (
        firsts >> part & 1 > 0 and flags(after, part) == TOUCHED | DONE | SURE and before.inversions == after.inversions
    )
    if compiled.core and not matching.shared.settled(before, node, chosen=chosen):
        return False

    def ends(node: int, flags: int) -> bool:  # no later event of the node in the same branch
        return flags & SURE > 0 and not (flags & MORE and compiled.picks >> node & 1)

    def keeps(gate: int, child: int) -> bool:  # the event below the child loses nothing
        siblings, slot = compiled.children[gate], compiled.slot[child]
        if compiled.ends >> gate & 1 and (
            not all(ends(elder, flags(before, elder)) for elder in siblings[:slot])
            or any(flags(before, later) & TOUCHED for later in siblings[slot + 1 :])
        ):
            return False
        match compiled.ops[gate]:
            case PartKind.ALL | PartKind.EVENT | PartKind.CONDITION:
                return True
            case PartKind.SEQUENCE:
                return all(ends(elder, flags(before, elder)) for elder in siblings[:slot])
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

_MIXED: Final = None
_SUMS: Final = (Operator.ADD, Operator.SUB)
_FIRST_GREATER: Final = (Operator.GT, Operator.GE)


class Term(NamedTuple):
    """A number or text; the greater (sign 1) or smaller (-1) is at least as good."""

    sign: int
    extreme: Extreme

    def value(self, binding: Mapping[str, Json]) -> Json:
        """Return the value of the term in a binding."""
        return self.extreme.of(binding)


class Rank(NamedTuple):
    """The rank of a partial match; only equal `place` values are compared."""

    place: Hashable
    values: tuple[Json, ...]
    """Values of which the greater is at least as good."""
    excluded: tuple[Hashable, ...]
    """Values that later values must differ from."""


_ONLY: Final = Rank((), (), ())
"""The rank in a stage where each partial match is as good as any other."""
_new: Final = tuple.__new__  # twice as fast as the constructors of the classes


class _Backwards(str):
    __slots__ = ()
    __lt__, __le__, __gt__, __ge__ = str.__gt__, str.__ge__, str.__lt__, str.__le__


class Extent(NamedTuple):
    """The first term is the least time of some variables; term `end` is their greatest.

    So a member that is at least as good has its first value between the two: its times are between
    them.
    """

    end: int
    most: int
    """The maximum difference of the two in a match; 0 for one variable."""


class Ranking(NamedTuple):
    """The comparison of the bindings of partial matches in one stage."""

    exact: tuple[str, ...] = ()
    """The variables whose values must be equal."""
    terms: tuple[Term, ...] = ()
    excluded: tuple[str, ...] = ()
    """The variables that occur only in inequalities with later values."""
    differing: tuple[tuple[int, ...], ...] = ()
    """By later value, the `excluded` variables that differ from it."""
    above_watermark: bool = False
    """Whether a greatest time matters only above the watermark."""
    extent: Extent | None = None

    def of(self, binding: Mapping[str, Json]) -> Rank:
        """Return the rank of a binding."""
        names, terms, names_excluded, *_ = self
        if not terms and not names_excluded:
            return _new(Rank, (tuple([exact(binding[name]) for name in names]), (), ())) if names else _ONLY
        place: list[Hashable] = [exact(binding[name]) for name in names]
        values: list[Json] = []
        for sign, extreme in terms:
            value = extreme.of(binding)
            kind = scale(value)
            place.append(tuple([exact(binding[name]) for name in extreme.names]) if kind is None else kind)
            values.append(0 if kind is None else value if sign > 0 else _Backwards(value) if kind is str else -value)
        excluded = [key(binding[name]) for name in names_excluded]
        place += [type(one) is object for one in excluded]  # a value that equals nothing has no substitute
        return _new(Rank, (tuple(place), tuple(values), tuple(excluded)))

    def covers(self, rivals: Sequence[Rank], rank: Rank) -> bool:
        """Whether some rivals in the same place are at least as good."""
        able = [rival for rival in rivals if all(map(ge, rival.values, rank.values))]
        return bool(able) and not self._exclude_only(rank.excluded, [rival.excluded for rival in able], 0, {})

    def _exclude_only(
        self,
        excluded: tuple[Hashable, ...],
        rivals: Sequence[tuple[Hashable, ...]],
        number: int,
        values: Mapping[int, Hashable],
    ) -> bool:
        """Whether later values can exclude all rivals from `number` on, but not `excluded`."""
        while number < len(rivals) and any(
            rivals[number][place] == value for group, value in values.items() for place in self.differing[group]
        ):
            number += 1
        if number == len(rivals):
            return True
        for group, places in enumerate(self.differing):
            if group not in values:
                for value in dict.fromkeys(rivals[number][place] for place in places):
                    free = all(excluded[place] != value for place in places)
                    if free and self._exclude_only(excluded, rivals, number + 1, {**values, group: value}):
                        return True
        return False


MOST_EXCLUDED: Final = 9
"""Beyond this product of variables and inequalities, values must be equal."""


def ranking(matching: Matching, configuration: Configuration) -> Ranking:
    """Return the ranking of a stage."""
    compiled, binding = matching.compiled, configuration.binding
    rigid = [name for name in binding if name in compiled.mentions]
    fixed = {name for name in rigid if matching.progress.mentioned(configuration, name)}
    fixed.update(name for name in binding if name in compiled.absent_with or name in compiled.kept)
    terms: dict[Term, None] = {}
    differing: dict[Guard, list[str]] = {}
    above_watermark = True
    extents: dict[tuple[Term, Term], int] = {}
    waiting = {node for name in binding for node in compiled.guarded_by.get(name, ())}
    guards = [compiled.conjuncts[node] for node in sorted(waiting) if not configuration.closed >> node & 1]
    for part, mentioned, over_times, differences in chain(*guards):
        bound = [name for name in mentioned if name in binding]
        if bound and over_times:
            if differences is None:
                fixed.update(bound)
            for one in differences or ():
                if one.plus.among(binding).names:
                    above_watermark &= one.plus.operator is Operator.MAX and _is_to_grow(matching, configuration, one)
                ends = Term(-1, _plain(one.plus.among(binding))), Term(1, _plain(one.minus.among(binding)))
                terms.update((term, None) for term in ends if term.extreme.names)
                most = _duration(ends[0].extreme, ends[1].extreme, one.most)
                if most is not None:
                    extents[ends] = min(most, extents.get(ends, most))
            continue
        for name in bound:
            other, sign = _differs(part, name), tendency(part, name)
            if other is not None:
                differing.setdefault(other, []).append(name)
            elif sign:
                terms[Term(sign, Extreme(Operator.MAX, (name,)))] = None
            else:
                fixed.add(name)
    for register in _registers(compiled, binding):
        both = _interval(register)
        terms.update(dict.fromkeys(_compared(matching, register, both)))
        if matching.early and register.node in compiled.windows and register.node not in compiled.members:
            extents[both] = compiled.windows[register.node]
    for sign, extreme in [*terms]:
        if extreme.names[0] not in compiled.times and Term(-sign, extreme) in terms:
            fixed.update(extreme.names)
    groups = [names for names in differing.values() if not fixed.issuperset(names)]
    excluded = sorted({name for names in groups for name in names} - fixed)
    if len(excluded) * len(groups) > MOST_EXCLUDED:
        fixed.update(excluded)
        excluded, groups = [], []
    inequalities = [tuple(place for place, name in enumerate(excluded) if name in names) for names in groups]
    rising = sorted((term for term in terms if not fixed.issuperset(term.extreme.names)), key=lambda term: -term.sign)
    above_watermark &= [term.sign for term in rising] == [1, -1] and rising[1].extreme.names[0] in compiled.times
    extent = None
    for (last, first), most in extents.items():
        if last in rising and first in rising:
            rising.insert(0, rising.pop(rising.index(first)))
            extent = Extent(rising.index(last), most)
            break
    return Ranking(tuple(sorted(fixed)), tuple(rising), tuple(excluded), tuple(inequalities), above_watermark, extent)


def _is_to_grow(matching: Matching, configuration: Configuration, difference: TimeDifference) -> bool:
    """Whether a later event surely has one of the times from which another is subtracted."""
    names, register_of = difference.plus.names, matching.compiled.register_of
    return register_of.keys().isdisjoint(names) and not all(matching.is_bound(configuration, name) for name in names)


def _registers(compiled: CompiledTree, binding: Mapping[str, Json]) -> Iterator[Register]:
    """Yield the registers that are remembered as a whole."""
    for name in binding:
        register = compiled.register_of.get(name)
        if register is not None and name == register.least and register.greatest in binding:  # as a window has
            yield register


def _compared(matching: Matching, register: Register, both: tuple[Term, Term]) -> Iterator[Term]:
    """Yield the terms of a register that matter: of `for D after`, the end."""
    if matching.is_window(register.node):
        yield from both
    for clause in matching.compiled.clauses_of.get(register.node, ()):
        yield both[0] if clause.part.side is Side.AFTER else both[1]


def _interval(register: Register) -> tuple[Term, Term]:
    """Return the terms of a register: the earlier the greatest time and the later the least, the better."""
    greatest, least = (Extreme(Operator.MAX, (name,)) for name in (register.greatest, register.least))
    return Term(-1, greatest), Term(1, least)


def _plain(extreme: Extreme) -> Extreme:
    return extreme if len(extreme.names) > 1 else Extreme(Operator.MAX, extreme.names)


def _duration(last: Extreme, first: Extreme, most: int) -> int | None:
    """Return how far the greatest and the least of the same times are apart at most, or None."""
    if not last.names or {*last.names} != {*first.names}:
        return None
    if len(last.names) == 1:
        return 0
    return most if (last.operator, first.operator) == (Operator.MAX, Operator.MIN) else None


def _differs(guard: Guard, name: str) -> Guard | None:
    match guard:
        case Operation(Operator.NE, sides) | Operation(Operator.NOT, (Operation(Operator.EQ, sides),)):
            return _beside(sides, name)
        case _:
            return None


def repeats(guard: Guard, name: str) -> Guard | None:
    """Return the term that a variable must equal, or None."""
    match guard:
        case Operation(Operator.EQ, sides) | Operation(Operator.NOT, (Operation(Operator.NE, sides),)):
            return _beside(sides, name)
        case _:
            return None


def _beside(sides: Sequence[Guard], name: str) -> Guard | None:
    for one, other in (sides, sides[::-1]):
        if isinstance(one, Variable) and one.name == name and name not in variables(other):
            return other
    return None


def tendency(guard: Guard, name: str) -> int | None:
    """Return 1 if a guard is rising in a variable, -1 if falling, 0 if constant, else None."""
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
    """Whether a monotone guard is always or never defined."""
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
    """Return the sign of a variable in a sum that has it once, and whether the rest is constant.

    Only integer constants up to 2**53 are added to a sum. Other terms are added only to the
    variable itself.
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
                fits = itself or abs(other.value) <= EXACT_INTEGERS if whole else alone
                return (slope, alone) if fits else (_MIXED, False)
            return (slope, False) if itself else (_MIXED, False)
        case _:
            return _MIXED, False


def _moderate(value: Json) -> bool:
    return is_number(value) and -MOST <= value <= MOST


def scale(value: Json) -> type | None:
    """Return `int` for integral numbers, or the type within which values are comparable."""
    kind = type(value)
    if kind is str or (kind is int and -MOST <= value <= MOST):
        return kind
    if kind is float and -MOST <= value <= MOST:
        return int if value.is_integer() else float
    return None
