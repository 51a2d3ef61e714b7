"""The formula of a tree's parts, put together from those of its parts, and where that gives way to the general form.

The formula of a part with what must come strictly after it (`after`):

    event              p & X[!] after                          scattered: F(p & X[!] after)
    choice             the disjunction
    sequence           from the last part to the first, each with the next as its `after`
    AND, VOT           scattered: conjunction and threshold, where no event can serve two of the parts;
                       strict and projected: a window over single events, where no event can serve two of them
    otherwise          the general sum over what may come next
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import assert_never

from backends.ltlf.derivatives import DerivativeTerms, Order, Orders, State
from backends.ltlf.formulas import FALSE, TRUE, Formulas
from backends.ltlf.parts import Anatomy
from rvaft.analysis.normal_form import Op
from rvaft.model.verdict import Semantics
from rvaft.support.bits import union
from rvaft.support.trampoline import Call, run


@dataclass(frozen=True, slots=True)
class Positions:
    """How a semantics reads "here" and "after that": the only place where the three differ in the formulas themselves.

    A formula made by the translation is true at a position when what it stands for is matched from there on. `scattered`: by some
    later events, so that such a formula is *monotone*, true at every earlier position too. `strict`: by exactly the next events.
    `projected`: by exactly the next relevant events; each formula is about a relevant position, and `begin` looks for the first one.
    """

    formulas: Formulas
    semantics: Semantics
    relevant: int = TRUE
    """The atom that tells relevant positions, needed for `projected` alone."""

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

    def steps(self, ways: Iterable[tuple[int, int]]) -> int:
        """One of several events here (`scattered`: somewhere), each with its own formula after it."""
        f = self.formulas
        found = f.disjunction(f.conjunction([event, self.later(after)]) for event, after in ways)
        return f.eventually(found) if self.monotone else found

    def window(self, events: Sequence[int], need: int, after: int) -> int:
        """At least `need` of the events (disjunctions of atoms), each at its own position, then `after`; no event may serve two.

        That is: exactly j positions (`need` ≤ j ≤ n), at each of them one of the events, and none of the events at two of them. It is
        polynomial where unrolling is factorial. What nothing follows is decided as soon as `need` events were seen.
        """
        f = self.formulas
        some = f.disjunction(events)
        found = []
        for length in [need] if after == TRUE else range(need, len(events) + 1):
            whole = after
            for _ in range(length):
                whole = f.conjunction([some, self.later(whole)])
            never = [f.negation(self._twice(event, length)) for event in events] if length else []
            found.append(f.conjunction([whole, *never]))
        return f.disjunction(found)

    def _twice(self, event: int, length: int) -> int:
        """The event is at two of the next `length` positions."""
        f = self.formulas
        once, twice = event, FALSE
        for _ in range(length - 1):
            later = self.later(once)
            twice = f.disjunction([f.conjunction([event, later]), self.later(twice)])
            once = f.disjunction([event, later])
        return twice


class Composer:
    """Translates parts; `event_of` gives the formula of an EVENT part. `limit` bounds states and scenarios."""

    def __init__(self, anatomy: Anatomy, positions: Positions, event_of: Callable[[int], int], *, limit: int) -> None:
        self._anatomy = anatomy
        self._positions = positions
        self._formulas = positions.formulas
        self._event_of = event_of
        self._known: dict[tuple[int, int], int] = {}
        self._free: set[int] = set()
        """Parts below a separable one: they are translated one by one although they share occurrences."""
        self._terms = DerivativeTerms(limit)
        self._term: dict[int, int] = {}
        self._orders = Orders(anatomy.parts, event_of, monotone=positions.monotone, limit=limit)
        self._states: dict[int, frozenset[Order]] = {}

    def whole(self) -> int:
        """The formula of the root, from the first position on."""
        return self._positions.begin(run(self._of(self._anatomy.root, TRUE)))

    def _of(self, number: int, after: int) -> Call[int]:
        if after == FALSE:
            return FALSE
        key = (number, after)
        if key not in self._known:
            self._known[key] = yield self._made(number, after)
        return self._known[key]

    def _made(self, number: int, after: int) -> Call[int]:
        part, formulas = self._anatomy.parts[number], self._formulas
        found: int = after
        if number not in self._free and self._anatomy.is_entangled(number):
            if not self._positions.monotone or not self._anatomy.is_separable(number):
                sum_of_orders: int = yield self._sum([number], number, after)
                return sum_of_orders
            self._free.update(self._anatomy.below(number))
        match part.op:
            case Op.EVENT:
                found = self._positions.steps([(self._event_of(number), after)])
            case Op.SEQUENCE:
                for inner in reversed(part.parts):
                    found = yield self._of(inner, found)
            case Op.ALL | Op.AT_LEAST if not self._positions.monotone and self._anatomy.is_window(number):
                units = (self._anatomy.unit[inner] or () for inner in part.parts)
                events = [formulas.disjunction(map(self._event_of, unit)) for unit in units]
                found = self._positions.window(events, part.need, after) if events else after
            case Op.ALL if self._positions.monotone:
                each: list[int] = []
                for group in self._rival_groups(number):
                    single = len(group) == 1
                    each += [(yield self._of(group[0], after) if single else self._sum(group, number, after))]
                found = formulas.conjunction(each) if each else after
            case Op.AT_LEAST | Op.ALL if not self._positions.monotone or not self._anatomy.rivals_apart(number):
                found = yield self._sum([number], number, after)
            case Op.ONE | Op.AT_LEAST | Op.ALL:
                each = []
                for inner in part.parts:
                    each += [(yield self._of(inner, after))]
                found = formulas.disjunction(each) if part.op is Op.ONE else self._threshold(each, part.need)
            case Op.CONDITION:
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
        parts = self._anatomy.parts[number].parts
        if self._anatomy.rivals_apart(number):
            return [[part] for part in parts]
        groups: list[tuple[list[int], int]] = []
        """Parts, and their events."""
        seen = 0
        for part in parts:
            events, rivals = self._anatomy.events[part], self._anatomy.rivals[part]
            meeting = [group for group in groups if group[1] & rivals] if rivals & seen else []
            seen |= events
            if meeting:
                groups = [group for group in groups if not group[1] & rivals]
            members = [member for group, _ in reversed(meeting) for member in group]
            groups.append(([*members, part], events | union(theirs for _, theirs in meeting)))
        return [members for members, _ in groups]

    def _term_of(self, number: int) -> Call[int]:
        if number not in self._term:
            part = self._anatomy.parts[number]
            for inner in reversed(part.parts):
                yield self._term_of(inner)
            self._term[number] = (
                self._terms.event(self._event_of(number))
                if part.op is Op.EVENT
                else self._terms.part(part.op, [self._term[inner] for inner in part.parts], part.need)
            )
        return self._term[number]

    def _sum(self, some: Sequence[int], whole: int, after: int) -> Call[int]:
        """The general form of some parts of a whole in any order; where occurrences are shared below, of the whole."""
        if not any(self._anatomy.tangled[part] for part in some):
            terms: list[int] = []
            for part in some:
                terms += [(yield self._term_of(part))]
            initial = self._terms.part(Op.ALL, terms)
            found: int = yield self._total(self._terms.over, self._terms.steps, initial, after)
        else:
            if whole not in self._states:
                self._states[whole] = self._orders.of(whole)
            found = yield self._total(self._orders.over, self._orders.steps, self._states[whole], after)
        return found

    def _total(
        self,
        over: Callable[[State], bool],
        steps: Callable[[State], Iterable[tuple[int, State]]],
        initial: State,
        after: int,
    ) -> Call[int]:
        """A sum over what may come next, one shared formula G(state) for each state: exact for every tree.

        G(state) is what follows, if the state may be the end, or one of the events that may come next, with G of the state after it.
        """
        known: dict[State, int] = {}
        junction = self._formulas.disjunction

        def of(state: State) -> Call[int]:
            if state not in known:
                ends = over(state)
                if ends and (after == TRUE or self._positions.monotone):  # nothing longer can say more
                    known[state] = after
                    return after
                following: dict[int, list[int]] = {}
                for event, left in steps(state):
                    following.setdefault(event, []).append((yield of(left)))
                taken = self._positions.steps([(event, junction(rests)) for event, rests in following.items()])
                known[state] = junction([after, taken]) if ends else taken
            return known[state]

        found: int = yield of(initial)
        return found
