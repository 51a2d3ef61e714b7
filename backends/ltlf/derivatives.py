"""States of the general form for parts that share no occurrence: what is left to observe, as a term.

A term is a number, equal terms equal numbers. Its steps are the events that may come next, each with what is then left (partial
derivatives): of parts in any order one makes a step, of alternatives one is taken, of a sequence the next part begins when
those before may be over. Parts that ask for the same events are the same term, so symmetric states fall together.
"""

from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Final, NamedTuple, TypeAlias, TypeVar

from backends.ltlf.formulas import TRUE, Formulas
from backends.ltlf.parts import Op, Part
from rvaft.model.verdict import Semantics
from rvaft.support.budget import CellBudget
from rvaft.support.trampoline import Call

# How a semantics reads "here" and "after that": the only place where the three differ in the formulas themselves.
#
# A formula made by the translation is true at a position when what it stands for is matched from there on. `scattered`: by some later
# events, so that such a formula is *monotone*, true at every earlier position too. `strict`: by exactly the next events.
# `projected`: by exactly the next relevant events; each formula is about a relevant position, and `begin` looks for the first one.


@dataclass(frozen=True, slots=True)
class Positions:
    """The formulas of one semantics; `relevant` is the atom that tells relevant positions, needed for `projected` alone."""

    formulas: Formulas
    semantics: Semantics
    relevant: int = TRUE

    @property
    def monotone(self) -> bool:
        """Whether any positions may be used."""
        return self.semantics is Semantics.SCATTERED

    def begin(self, formula: int) -> int:
        """The formula from the first position that counts; `projected`: `!rel U (rel & f)`."""
        f = self.formulas
        if self.semantics is not Semantics.PROJECTED or formula == TRUE:
            return formula
        return f.until(f.negation(self.relevant), f.conjunction([self.relevant, formula]))

    def later(self, formula: int) -> int:
        """The formula from the next position that counts; true stands for "nothing more" and demands no position."""
        return TRUE if formula == TRUE else self.formulas.next(self.begin(formula))

    def step(self, event: int, after: int) -> int:
        """An event here (`scattered`: somewhere), and the formula after it."""
        found = self.formulas.conjunction([event, self.later(after)])
        return self.formulas.eventually(found) if self.monotone else found

    def steps(self, ways: list[tuple[int, int]]) -> int:
        """One of several events, each with its own formula after it."""
        f = self.formulas
        found = f.disjunction(f.conjunction([event, self.later(after)]) for event, after in ways)
        return f.eventually(found) if self.monotone else found


# States of the general form for parts that share occurrences: the scenarios that are still possible, as partial orders.
#
# A shared occurrence is observed once, wherever it is used, so that scenarios cannot be put together from those of the parts. Here they are
# written out: each as its remaining occurrences with those that must come before. A state is the set of the scenarios that agree
# with what was observed.

Order: TypeAlias = frozenset[tuple[int, int]]
"""Occurrences (parts) with the set (bits) of those that must come before."""

State: TypeAlias = frozenset[Order]


class Orders:
    """The scenarios of parts, and the steps that lead through them."""

    def __init__(self, rows: Sequence[Part], *, monotone: bool, limit: int) -> None:
        self._rows = rows
        self._monotone = monotone
        self._budget = CellBudget(
            "the scenarios of parts that share occurrences take more than the limit allows", limit
        )

    def of(self, root: int) -> State:
        """The feasible scenarios of a part."""
        found: set[Order] = set()
        for kept in _resolutions(self._rows, root, monotone=self._monotone):
            self._budget.spend(len(kept))
            order = _order(self._rows, kept)
            if _acyclic(order):
                found.add(order)
        return frozenset(found)

    def over(self, state: State) -> bool:
        """Whether some scenario has nothing left."""
        return frozenset() in state

    def steps(self, state: State) -> Iterator[tuple[int, State]]:
        """The occurrences that may come next, each with the scenarios that agree with it."""
        ways: dict[int, set[Order]] = {}
        for order in state:
            for occurrence, before in order:
                if not before:
                    self._budget.spend(len(order))
                    ways.setdefault(occurrence, set()).add(_without(order, occurrence))
        for occurrence in sorted(ways):
            yield occurrence, frozenset(ways[occurrence])


def _without(order: Order, gone: int) -> Order:
    bit = 1 << gone
    return frozenset((pair[0], pair[1] & ~bit) if pair[1] & bit else pair for pair in order if pair[0] != gone)


def _resolutions(rows: Sequence[Part], root: int, *, monotone: bool) -> Iterator[dict[int, tuple[int, ...]]]:
    """Every way to make the choices: the kept parts, each with its kept parts. A shared part is resolved once."""
    agenda: list[tuple[dict[int, tuple[int, ...]], frozenset[int]]] = [({}, frozenset([root]))]
    while agenda:
        kept, reached = agenda.pop()
        if not reached:
            yield kept
            continue
        number = max(reached)  # wholes before parts, so that none is reached again once it is resolved
        ways = list(_ways(rows[number], monotone=monotone))
        agenda.extend(({**kept, number: way}, reached - {number} | set(way)) for way in reversed(ways))


def _ways(part: Part, *, monotone: bool) -> Iterator[tuple[int, ...]]:
    if part.op is Op.ONE:
        yield from ((chosen,) for chosen in part.parts)
    elif part.op is Op.AT_LEAST:
        for size in range(part.need, part.need + 1 if monotone else len(part.parts) + 1):
            yield from combinations(part.parts, size)
    else:
        yield part.parts


def _order(rows: Sequence[Part], kept: dict[int, tuple[int, ...]]) -> Order:
    inside: dict[int, int] = {}
    before: dict[int, int] = {}
    for number in sorted(kept):
        if rows[number].op is Op.EVENT:
            inside[number] = 1 << number
            before[number] = 0
            continue
        members = 0
        for part in kept[number]:
            if rows[number].op is Op.SEQUENCE and members:
                for occurrence in before:
                    if inside[part] >> occurrence & 1:
                        before[occurrence] |= members
            members |= inside[part]
        inside[number] = members
    return frozenset(before.items())


def _acyclic(order: Order) -> bool:
    left = dict(order)
    while left:
        first = [occurrence for occurrence, before in left.items() if not before]
        if not first:
            return False
        gone = 0
        for occurrence in first:
            del left[occurrence]
            gone |= 1 << occurrence
        left = {occurrence: before & ~gone for occurrence, before in left.items()}
    return True


DONE: Final = 0


class _Row(NamedTuple):
    op: Op
    inner: tuple[int, ...] = ()
    number: int = 0
    """The event (a formula) of EVENT, the count of AT_LEAST."""


class Terms:
    """The terms made so far; a sequence is its first part and the rest, so that the rests of long ones are shared."""

    def __init__(self, limit: int) -> None:
        self._budget = CellBudget(
            "the states of the sum over all orders of the events take more than the limit allows", limit
        )
        self._rows: list[_Row] = [_Row(Op.SEQUENCE)]
        self._index: dict[_Row, int] = {self._rows[0]: DONE}
        self._over: list[bool] = [True]
        self._steps: dict[int, tuple[tuple[int, int], ...]] = {DONE: ()}

    def over(self, term: int) -> bool:
        """Whether nothing more need be observed."""
        return self._over[term]

    def part(self, part: Part, inner: list[int]) -> int:
        """The term of a part whose own parts have these terms."""
        match part.op:
            case Op.SEQUENCE:
                return self._sequence(inner)
            case Op.ALL:
                return self._all(inner)
            case Op.ONE:
                return self._one(inner)
            case _:
                return self._at_least(part.need, inner)

    def all_of(self, terms: list[int]) -> int:
        """The term of several in any order."""
        return self._all(terms)

    def event(self, event: int) -> int:
        """The term of an event."""
        return self._make(_Row(Op.EVENT, (), event))

    def _make(self, row: _Row) -> int:
        found = self._index.get(row)
        if found is None:
            found = len(self._rows)
            self._budget.spend(1 + len(row.inner))
            self._index[row] = found
            self._rows.append(row)
            self._over.append(self._may_end(row))
        return found

    def _may_end(self, row: _Row) -> bool:
        match row.op:
            case Op.EVENT:
                return False
            case Op.ONE:
                return any(self._over[term] for term in row.inner)
            case Op.AT_LEAST:
                return sum(self._over[term] for term in row.inner) >= row.number
            case _:
                return all(self._over[term] for term in row.inner)

    def _sequence(self, inner: Sequence[int]) -> int:
        parts: list[int] = []
        for term in inner[:-1]:
            row, left = self._rows[term], term
            while row.op is Op.SEQUENCE and row.inner:
                parts.append(row.inner[0])
                left = row.inner[1]
                row = self._rows[left]
            if left != DONE:
                parts.append(left)
        rest = inner[-1] if inner else DONE
        for part in reversed(parts):
            rest = part if rest == DONE else self._make(_Row(Op.SEQUENCE, (part, rest)))
        return rest

    def _all(self, inner: Iterable[int]) -> int:
        flat = sorted(part for term in inner if term != DONE for part in self._opened(term, Op.ALL))
        if len(flat) <= 1:
            return flat[0] if flat else DONE
        return self._make(_Row(Op.ALL, tuple(flat)))

    def _one(self, inner: Iterable[int]) -> int:
        unique = sorted(set(inner))
        return unique[0] if len(unique) == 1 else self._make(_Row(Op.ONE, tuple(unique)))

    def _at_least(self, need: int, inner: Iterable[int]) -> int:
        terms = sorted(inner)
        rest = [term for term in terms if term != DONE]
        need = max(need - (len(terms) - len(rest)), 0)
        if need == len(rest):
            return self._all(rest)
        return self._make(_Row(Op.AT_LEAST, tuple(rest), need))

    def _opened(self, term: int, op: Op) -> tuple[int, ...]:
        row = self._rows[term]
        return row.inner if row.op is op else (term,)

    def steps(self, term: int) -> tuple[tuple[int, int], ...]:
        """The events that may come next, each with the term that is then left."""
        todo = [term]
        while todo:
            current = todo[-1]
            missing = [inner for inner in self._first(current) if inner not in self._steps]
            if missing:
                todo.extend(missing)
            else:
                todo.pop()
                if current not in self._steps:
                    self._steps[current] = tuple(dict.fromkeys(self._made(current)))
        return self._steps[term]

    def _first(self, term: int) -> list[int]:
        row = self._rows[term]
        if row.op is not Op.SEQUENCE:
            return list(row.inner)
        first: list[int] = []
        for inner in row.inner:
            first.append(inner)
            if not self._over[inner]:
                break
        return first

    def _made(self, term: int) -> Iterable[tuple[int, int]]:
        row = self._rows[term]
        if row.op is Op.EVENT:
            yield row.number, DONE
            return
        for index, inner in enumerate(self._first(term)):
            others = (*row.inner[:index], *row.inner[index + 1 :])
            for event, left in self._steps[inner]:
                match row.op:
                    case Op.SEQUENCE:
                        yield event, self._sequence([left, *row.inner[index + 1 :]])  # the rest begins, or goes on
                    case Op.ALL:
                        yield event, self._all([left, *others])
                    case Op.ONE:
                        yield event, left
                    case _:
                        yield event, self._all([left, self._at_least(row.number - 1, others)])


# The general form: a sum over what may come next, one shared formula per state of the observation.
#
# G(state) is the formula for the rest: what follows, if the state may be the end, or one of the events that may come next, with G of the state
# after it. Exact for every tree, but there may be exponentially many states; used where no compositional form is sound.

StateOfSum = TypeVar("StateOfSum", bound=Hashable)


def total(
    positions: Positions,
    initial: StateOfSum,
    *,
    done: Callable[[StateOfSum], bool],
    steps: Callable[[StateOfSum], Iterable[tuple[int, StateOfSum]]],
    after: int,
) -> Call[int]:
    """The formula of the initial state; `steps` gives events (formulas) with the states after them and ends somewhere."""
    formulas = positions.formulas
    known: dict[StateOfSum, int] = {}

    def of(state: StateOfSum) -> Call[int]:
        if state in known:
            return known[state]
        ends = done(state)
        if ends and (after == TRUE or positions.monotone):  # nothing longer can say more
            known[state] = after
            return after
        ways: dict[int, list[int]] = {}
        for event, following in steps(state):
            rest = yield of(following)
            ways.setdefault(event, []).append(rest)
        taken = positions.steps([(event, formulas.disjunction(rests)) for event, rests in ways.items()])
        known[state] = formulas.disjunction([after, taken]) if ends else taken
        return known[state]

    return of(initial)
