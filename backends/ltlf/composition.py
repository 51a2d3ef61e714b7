"""The formula of a tree's parts, put together from those of its parts, and where that gives way to the general form.

The formula of a part with what must come strictly after it (`after`):

    event              p & X[!] after                          scattered: F(p & X[!] after)
    choice             the disjunction
    sequence           from the last part to the first, each with the next as its `after`
    AND, VOT           scattered: conjunction and threshold, where no event can serve two of the parts;
                       strict and projected: a window over single events, where no event can serve two of them
    otherwise          the general sum over what may come next

The sum goes over states of two kinds. Parts that share no occurrence are *terms*, whose steps are
found part by part (partial derivatives). Where occurrences are shared, a state is the set of the
scenarios that are still possible, as partial orders. There may be exponentially many.
"""

from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from typing import Final, NamedTuple, TypeAlias, TypeVar, assert_never

from backends.ltlf.formulas import FALSE, TRUE, Formulas
from backends.ltlf.parts import Anatomy
from rvaft.core.part_numbers import NumberedPart, NumberedParts, PartKind, divided
from rvaft.model.verdict import Semantics
from rvaft.support.bits import bits, union
from rvaft.support.budget import Call, CellBudget, run

State = TypeVar("State", bound=Hashable)


class Composer:
    """Translates parts.

    `event_of` gives the formula of an EVENT part, `relevant` is the atom of relevant positions
    (`projected`, `consecutive`).

    A formula is true at a position when what it stands for is matched from there on. `scattered`:
    by some later events, so that such a formula is *monotone*, true at every earlier position too.
    `strict`: by exactly the next events. `projected`: by exactly the next relevant events; each
    formula is about a relevant position, and `_begin` looks for the first one. `consecutive`:
    likewise, from anywhere. `limit` bounds states and scenarios.
    """

    def __init__(
        self,
        formulas: Formulas,
        anatomy: Anatomy,
        event_of: Callable[[int], int],
        *,
        semantics: Semantics,
        relevant: int,
        limit: int,
    ) -> None:
        self._formulas = formulas
        self._anatomy = anatomy
        self._event_of = event_of
        self._monotone = semantics is Semantics.SCATTERED
        self._relative = semantics.projects
        self._anywhere = semantics is Semantics.CONSECUTIVE
        self._relevant = relevant
        self._known: dict[tuple[int, int], int] = {}
        self._free: set[int] = set()
        """Parts below a separable one: they are translated one by one although they share occurrences."""
        self._terms = _Terms(limit)
        self._term: dict[int, int] = {}
        self._orders = _Orders(anatomy.parts, event_of, monotone=self._monotone, limit=limit)
        self._states: dict[int, frozenset[_Order]] = {}

    def whole(self) -> int:
        """The formula of the root, from the first position on; `consecutive`: from some relevant one, `F(rel & f)`."""
        formula = run(self._of(self._anatomy.root, TRUE))
        if self._anywhere and formula != TRUE:
            return self._formulas.eventually(self._formulas.conjunction([self._relevant, formula]))
        return self._begin(formula)

    # Positions: the only place where the semantics differ in the formulas themselves.

    def _begin(self, formula: int) -> int:
        """The formula from the first position that counts; `projected`: `!rel U (rel & f)`."""
        f = self._formulas
        if not self._relative or formula == TRUE:
            return formula
        return f.until(f.negation(self._relevant), f.conjunction([self._relevant, formula]))

    def _later(self, formula: int) -> int:
        """The formula from the next position that counts; true stands for "nothing more" and demands no position."""
        return TRUE if formula == TRUE else self._formulas.next(self._begin(formula))

    def _steps(self, ways: Iterable[tuple[int, int]]) -> int:
        """One of several events here (`scattered`: somewhere), each with its own formula after it."""
        f = self._formulas
        found = f.disjunction(f.conjunction([event, self._later(after)]) for event, after in ways)
        return f.eventually(found) if self._monotone else found

    def _window(self, events: Sequence[int], need: int, after: int) -> int:
        """At least `need` of the events (disjunctions of atoms), each at its own position, then `after`.

        No event may serve two.

        That is: exactly j positions (`need` ≤ j ≤ n), at each of them one of the events, and none
        of the events at two of them. It is polynomial where unrolling is factorial. What nothing
        follows is decided as soon as `need` events were seen.
        """
        f = self._formulas
        some = f.disjunction(events)
        found = []
        for length in [need] if after == TRUE else range(need, len(events) + 1):
            whole = after
            for _ in range(length):
                whole = f.conjunction([some, self._later(whole)])
            demands = [whole]
            for event in events if length else ():
                once, twice = event, FALSE  # of the last positions
                for _ in range(length - 1):
                    later = self._later(once)
                    twice = f.disjunction([f.conjunction([event, later]), self._later(twice)])
                    once = f.disjunction([event, later])
                demands.append(f.negation(twice))
            found.append(f.conjunction(demands))
        return f.disjunction(found)

    # Parts.

    def _of(self, number: int, after: int) -> Call[int]:
        if after == FALSE:
            return FALSE
        key = (number, after)
        if key not in self._known:
            self._known[key] = yield self._made(number, after)
        return self._known[key]

    def _made(self, number: int, after: int) -> Call[int]:
        part, anatomy, formulas = self._anatomy.parts[number], self._anatomy, self._formulas
        found: int = after
        if number not in self._free and anatomy.is_entangled(number):
            if not self._monotone or not anatomy.is_separable(number):
                found = yield self._sum([number], number, after)
                return found
            self._free.update(anatomy.below(number))
        units = [anatomy.unit[inner] for inner in part.parts]
        match part.op:
            case PartKind.EVENT:
                found = self._steps([(self._event_of(number), after)])
            case PartKind.SEQUENCE:
                for inner in reversed(part.parts):
                    found = yield self._of(inner, found)
            case PartKind.ALL if self._monotone:
                each: list[int] = []
                for group in self._rival_groups(number):
                    alone = len(group) == 1
                    each += [(yield self._of(group[0], after) if alone else self._sum(group, number, after))]
                found = formulas.conjunction(each) if each else after
            case PartKind.ALL | PartKind.AT_LEAST if (
                not self._monotone and None not in units and anatomy.rivals_apart(number)
            ):
                events = [formulas.disjunction(map(self._event_of, unit or ())) for unit in units]
                found = self._window(events, part.need, after) if events else after
            case PartKind.ALL | PartKind.AT_LEAST if not self._monotone or not anatomy.rivals_apart(number):
                found = yield self._sum([number], number, after)
            case PartKind.ALL | PartKind.AT_LEAST | PartKind.ONE:
                each = []
                for inner in part.parts:
                    each += [(yield self._of(inner, after))]
                found = formulas.disjunction(each) if part.op is PartKind.ONE else self._threshold(each, part.need)
            case PartKind.CONDITION:
                raise AssertionError(part)
            case _:
                assert_never(part.op)
        return found

    def _threshold(self, formulas: Sequence[int], need: int) -> int:
        """At least `need` of the formulas: T(i, j) = f_i & T(i+1, j-1) | T(i+1, j)."""
        f = self._formulas
        row = [TRUE]
        for formula in reversed(formulas):
            rest = [*row, FALSE]
            counts = range(1, min(len(row), need) + 1)
            row = [TRUE, *(f.disjunction([f.conjunction([formula, rest[j - 1]]), rest[j]]) for j in counts)]
        return row[need]

    def _rival_groups(self, number: int) -> list[list[int]]:
        """The parts of a part, those together of which one event may serve two."""
        groups: list[tuple[list[int], int]] = []
        """Parts, and their events."""
        seen = 0
        for part in self._anatomy.parts[number].parts:
            events, rivals = self._anatomy.events[part], self._anatomy.rivals[part]
            meeting = [group for group in groups if group[1] & rivals] if rivals & seen else []
            seen |= events
            if meeting:
                groups = [group for group in groups if not group[1] & rivals]
            members = [member for group, _ in reversed(meeting) for member in group]
            groups.append(([*members, part], events | union(theirs for _, theirs in meeting)))
        return [members for members, _ in groups]

    # The general form.

    def _sum(self, some: Sequence[int], whole: int, after: int) -> Call[int]:
        """The general form of some parts of a whole in any order; where occurrences are shared below, of the whole."""
        if any(self._anatomy.tangled[part] for part in some):
            if whole not in self._states:
                self._states[whole] = self._orders.of(whole)
            found: int = yield self._total(self._orders.over, self._orders.steps, self._states[whole], after)
            return found
        terms: list[int] = []
        for part in some:
            terms += [(yield self._term_of(part))]
        initial = self._terms.part(PartKind.ALL, terms)
        found = yield self._total(self._terms.over.__getitem__, self._terms.steps, initial, after)
        return found

    def _term_of(self, number: int) -> Call[int]:
        if number not in self._term:
            part = self._anatomy.parts[number]
            for inner in reversed(part.parts):
                yield self._term_of(inner)
            inside = [self._term[inner] for inner in part.parts]
            event = part.op is PartKind.EVENT
            term = (
                self._terms.make(PartKind.EVENT, (), self._event_of(number))
                if event
                else self._terms.part(part.op, inside, part.need)
            )
            self._term[number] = term
        return self._term[number]

    def _total(
        self,
        over: Callable[[State], bool],
        steps: Callable[[State], Iterable[tuple[int, State]]],
        initial: State,
        after: int,
    ) -> Call[int]:
        """A sum over what may come next, one shared formula G(state) for each state: exact for every tree.

        G(state) is what follows, if the state may be the end, or one of the events that may come
        next, with G of the state after it.
        """
        known: dict[State, int] = {}
        junction = self._formulas.disjunction

        def of(state: State) -> Call[int]:
            if state not in known:
                ends = over(state)
                if ends and (after == TRUE or self._monotone):  # nothing longer can say more
                    known[state] = after
                    return after
                following: dict[int, list[int]] = {}
                for event, left in steps(state):
                    following.setdefault(event, []).append((yield of(left)))
                taken = self._steps([(event, junction(rests)) for event, rests in following.items()])
                known[state] = junction([after, taken]) if ends else taken
            return known[state]

        found: int = yield of(initial)
        return found


_Order: TypeAlias = frozenset[tuple[int, int]]
"""A scenario: occurrences (parts) with the set (bits) of those that must come before."""


def _choice_or_kept(form: NumberedParts) -> list[int] | int:
    """The topmost choice, or the parts where there is none."""
    kept = form.kept()
    return next((number for number in reversed(kept) if form.parts[number].chooses), kept)


class _Orders:
    """Parts that share occurrences. `event_of` gives the formula of an occurrence.

    A shared occurrence is observed once, wherever it is used, so that scenarios cannot be put
    together from those of the parts: they are written out.
    """

    def __init__(
        self, parts: Sequence[NumberedPart], event_of: Callable[[int], int], *, monotone: bool, limit: int
    ) -> None:
        self._parts = parts
        self._event_of = event_of
        self._monotone = monotone
        what = "the scenarios of parts that share occurrences take more than the limit allows"
        self._budget = CellBudget(what, limit)

    def of(self, root: int) -> frozenset[_Order]:
        """The scenarios of a part. Cyclic ones lead nowhere. A shared part is resolved once."""
        found: set[_Order] = set()
        whole = NumberedParts(tuple(self._parts[: root + 1]))
        for form, kept in divided(whole, _choice_or_kept, at_least=not self._monotone):
            self._budget.spend(len(kept))
            inside: dict[int, int] = {}
            before: dict[int, int] = {}
            for number in kept:
                part = form.parts[number]
                inside[number] = 0
                if part.op is PartKind.EVENT:
                    inside[number] = 1 << number
                    before[number] = 0
                for inner in part.parts:
                    for occurrence in bits(inside[inner]) if part.op is PartKind.SEQUENCE and inside[number] else ():
                        before[occurrence] |= inside[number]
                    inside[number] |= inside[inner]
            found.add(frozenset(before.items()))
        return frozenset(found)

    def over(self, state: frozenset[_Order]) -> bool:
        return frozenset() in state

    def steps(self, state: frozenset[_Order]) -> list[tuple[int, frozenset[_Order]]]:
        """The occurrences that may come next, each with the scenarios that agree with it."""
        following: dict[int, set[_Order]] = {}
        for order in state:
            for occurrence, before in order:
                if not before:
                    self._budget.spend(len(order))
                    gone = ~(1 << occurrence)
                    rest = ((other, earlier & gone) for other, earlier in order if other != occurrence)
                    following.setdefault(occurrence, set()).add(frozenset(rest))
        return [(self._event_of(occurrence), frozenset(following[occurrence])) for occurrence in sorted(following)]


_DONE: Final = 0


class _Term(NamedTuple):
    """What has to be observed: an event, or something of other terms.

    `number` is the formula of EVENT, the count of AT_LEAST.
    """

    op: PartKind
    inner: tuple[int, ...] = ()
    number: int = 0


class _Terms:
    """Parts that share no occurrence as terms, equal terms equal numbers; a sequence is its first
    part and the rest, which long ones share.

    The steps of a term: of parts in any order one makes a step, of alternatives one is taken, of a
    sequence the next part begins when those before may be over. Parts that ask for the same events
    are the same term, so symmetric states fall together.
    """

    def __init__(self, limit: int) -> None:
        what = "the states of the sum over all orders of the events take more than the limit allows"
        self._budget = CellBudget(what, limit)
        self._rows = [_Term(PartKind.SEQUENCE)]
        self._index = {self._rows[0]: _DONE}
        self._known: dict[int, tuple[tuple[int, int], ...]] = {_DONE: ()}
        self.over = [True]
        """Of each term: whether nothing more need be observed."""

    def part(self, op: PartKind, inner: Sequence[int], need: int = 0) -> int:
        """The term of a part, not an event, whose own parts have these terms."""
        match op:
            case PartKind.SEQUENCE:
                return self._sequence(inner)
            case PartKind.ALL:
                rows = ((term, self._rows[term]) for term in inner if term != _DONE)
                flat = sorted(one for term, row in rows for one in (row.inner if row.op is PartKind.ALL else (term,)))
                return self.make(op, tuple(flat)) if len(flat) > 1 else flat[0] if flat else _DONE
            case PartKind.ONE:
                unique = sorted(set(inner))
                return unique[0] if len(unique) == 1 else self.make(op, tuple(unique))
            case PartKind.AT_LEAST:
                rest = sorted(term for term in inner if term != _DONE)
                need = max(need - (len(inner) - len(rest)), 0)
                return self.part(PartKind.ALL, rest) if need == len(rest) else self.make(op, tuple(rest), need)
            case PartKind.EVENT | PartKind.CONDITION:
                raise AssertionError(op)
            case _:
                assert_never(op)

    def make(self, op: PartKind, inner: tuple[int, ...], number: int = 0) -> int:
        row = _Term(op, inner, number)
        found = self._index.setdefault(row, len(self._rows))
        if found == len(self._rows):
            self._budget.spend(1 + len(inner))
            need = {PartKind.EVENT: 1, PartKind.ONE: 1, PartKind.AT_LEAST: number}.get(op, len(inner))
            self._rows.append(row)
            self.over.append(sum(self.over[term] for term in inner) >= need)
        return found

    def _sequence(self, inner: Sequence[int]) -> int:
        parts: list[int] = []
        for term in inner[:-1]:
            row, left = self._rows[term], term
            while row.op is PartKind.SEQUENCE and row.inner:
                parts.append(row.inner[0])
                left = row.inner[1]
                row = self._rows[left]
            if left != _DONE:
                parts.append(left)
        rest = inner[-1] if inner else _DONE
        for part in reversed(parts):
            rest = part if rest == _DONE else self.make(PartKind.SEQUENCE, (part, rest))
        return rest

    def steps(self, term: int) -> tuple[tuple[int, int], ...]:
        """The events that may come next, each with the term that is then left."""
        return run(self._steps_of(term))

    def _steps_of(self, term: int) -> Call[tuple[tuple[int, int], ...]]:
        if term not in self._known:
            op, first, _ = self._rows[term]
            if op is PartKind.SEQUENCE and not self.over[first[0]]:
                first = first[:1]  # the rest does not begin yet
            for inner in reversed(first):
                yield self._steps_of(inner)
            self._known[term] = tuple(dict.fromkeys(self._made(term, first)))
        return self._known[term]

    def _made(self, term: int, first: Sequence[int]) -> Iterator[tuple[int, int]]:
        """The steps of a term, made by those of its parts that may be first."""
        op, parts, number = self._rows[term]
        if op is PartKind.EVENT:
            yield number, _DONE
        for index, inner in enumerate(first):
            if index and op is not PartKind.SEQUENCE and inner == first[index - 1]:
                continue  # those that ask for the same make the same step
            others = (*parts[:index], *parts[index + 1 :])
            for event, left in self._known[inner]:
                match op:
                    case PartKind.SEQUENCE:  # the rest begins, or goes on
                        yield event, self._sequence([left, *parts[index + 1 :]])
                    case PartKind.ALL:
                        yield event, self.part(PartKind.ALL, [left, *others])
                    case PartKind.ONE:
                        yield event, left
                    case PartKind.AT_LEAST:
                        yield event, self.part(PartKind.ALL, [left, self.part(PartKind.AT_LEAST, others, number - 1)])
                    case PartKind.EVENT | PartKind.CONDITION:
                        raise AssertionError(op)
                    case _:
                        assert_never(op)
