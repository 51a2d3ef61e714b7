"""The compositional translation, and where it gives way to the general form.

The formula of a part with what must come strictly after it (`after`) is built from those of its parts:

    event              p & X[!] after                          scattered: F(p & X[!] after)
    choice             the disjunction
    sequence           from the last part to the first, each with the next as its `after`
    AND, VOT           scattered: conjunction and threshold, where no event can serve two of the parts;
                       strict and projected: a window over single events, where no event can serve two of them
    otherwise          the general sum over what may come next
"""

from collections import Counter, defaultdict
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise, product
from typing import Final, TypeAlias

import networkx as nx

from backends.ltlf.derivatives import Orders, Positions, State, Terms, total
from backends.ltlf.formulas import FALSE, TRUE
from backends.ltlf.parts import Op, Part, Parts, always_in
from rvaft.model.guards import Guard
from rvaft.model.guards import variables as guard_variables
from rvaft.model.patterns import ListPattern, Literal, ObjectPattern, Pattern, rigid_variables
from rvaft.model.values import key
from rvaft.support.budget import CellBudget
from rvaft.support.trampoline import Call, run

# Which event patterns can be served by one event.
#
# Conservative: variables stand for anything, whatever they are bound to, and guards are not looked at. So "cannot" is certain.

Path: TypeAlias = tuple[str | int, ...]


def may_overlap(left: Pattern, right: Pattern) -> bool:
    """Whether some event may match both patterns."""
    todo = [(left, right)]
    while todo:
        match todo.pop():
            case Literal() as a, Literal() as b:
                if a != b:
                    return False
            case ObjectPattern(fields), ObjectPattern(others):
                by_name = dict(others)
                todo.extend((inner, by_name[name]) for name, inner in fields if name in by_name)
            case ListPattern(items), ListPattern(others):
                if len(items) != len(others):
                    return False
                todo.extend(zip(items, others, strict=True))
            case (Literal() | ObjectPattern() | ListPattern(), Literal() | ObjectPattern() | ListPattern()):
                return False
            case _:  # a variable or `_` on one side fits anything
                pass
    return True


def overlaps(patterns: Sequence[Pattern]) -> list[int]:
    """For each pattern the set (bits) of the other patterns that one event may match together with it."""
    alike: dict[Pattern, int] = {}
    for number, pattern in enumerate(patterns):
        alike[pattern] = alike.get(pattern, 0) | 1 << number
    together = dict(alike)
    for a, b in _candidates(list(alike)):
        if may_overlap(a, b):
            together[a] |= alike[b]
            together[b] |= alike[a]
    return [together[pattern] & ~(1 << number) for number, pattern in enumerate(patterns)]


def _candidates(patterns: Sequence[Pattern]) -> Iterator[tuple[Pattern, Pattern]]:
    """The pairs that do not differ in the literal at one place (the name of a topic, say), chosen so that they are few."""
    literals = {pattern: dict(_literals(pattern)) for pattern in patterns}
    counts: defaultdict[Path, Counter[Hashable]] = defaultdict(Counter)
    for found in literals.values():
        for place, literal in found.items():
            counts[place][literal] += 1
    if not counts:
        yield from combinations(patterns, 2)
        return
    where = min(counts, key=lambda place: _cost(counts[place], len(patterns)))
    buckets: defaultdict[Hashable, list[Pattern]] = defaultdict(list)
    rest: list[Pattern] = []
    for pattern, found in literals.items():
        (buckets[found[where]] if where in found else rest).append(pattern)
    for bucket in buckets.values():
        yield from combinations(bucket, 2)
        yield from product(rest, bucket)
    yield from combinations(rest, 2)


def _cost(counts: Counter[Hashable], total: int) -> int:
    return sum(count * count for count in counts.values()) + (total - counts.total()) * total


def _literals(pattern: Pattern) -> Iterator[tuple[Path, Hashable]]:
    todo: list[tuple[Path, Pattern]] = [((), pattern)]
    while todo:
        path, part = todo.pop()
        match part:
            case Literal(value):
                yield path, key(value)
            case ObjectPattern(fields):
                todo.extend(((*path, name), inner) for name, inner in fields)
            case ListPattern(items):
                todo.extend(((*path, index), inner) for index, inner in enumerate(items))
            case _:
                pass


# What the translation asks about the parts of a tree: events under a part, parts that share them, parts that one event may serve.
#
# Sets of events are bits, so that a tree of thousands of nodes is no trouble.


@dataclass(frozen=True, slots=True)
class Shape:
    """Simplified parts, and for each part three answers.

    Its events (`events`); the other events that one event may serve together with one of them (`rivals`); and, where
    every scenario of the part observes exactly one event, the parts that are that event (`unit`).
    """

    rows: tuple[Part, ...]
    events: tuple[int, ...]
    rivals: tuple[int, ...]
    unit: tuple[tuple[int, ...] | None, ...]

    @property
    def root(self) -> int:
        """The number of the whole."""
        return len(self.rows) - 1


def shape_of(parts: Parts, patterns: Mapping[str, Pattern]) -> Shape:
    """The answers for simplified parts."""
    numbers = [number for number, part in enumerate(parts.rows) if part.op is Op.EVENT]
    bit = {number: 1 << index for index, number in enumerate(numbers)}
    rival = dict(zip(numbers, overlaps([patterns[parts.rows[n].node] for n in numbers]), strict=True))
    events: list[int] = []
    rivals: list[int] = []
    unit: list[tuple[int, ...] | None] = []
    for number, part in enumerate(parts.rows):
        events.append(_union(bit.get(number, 0), part, events))
        rivals.append(_union(rival.get(number, 0), part, rivals))
        unit.append(_unit(number, part, unit))
    return Shape(parts.rows, tuple(events), tuple(rivals), tuple(unit))


def _union(own: int, part: Part, sets: Sequence[int]) -> int:
    for inner in part.parts:
        own |= sets[inner]
    return own


def _unit(number: int, part: Part, unit: Sequence[tuple[int, ...] | None]) -> tuple[int, ...] | None:
    if part.op is Op.EVENT:
        return (number,)
    if part.op is not Op.ONE or not part.parts:
        return None
    found: list[int] = []
    for inner in part.parts:
        alternatives = unit[inner]
        if alternatives is None:
            return None
        found.extend(alternatives)
    return tuple(dict.fromkeys(found))


def rivals_apart(shape: Shape, part: int) -> bool:
    """Whether no event can serve occurrences in two different parts of this one, nor one occurrence be in both and rival there."""
    seen = 0
    for inner in shape.rows[part].parts:
        if shape.rivals[inner] & seen:
            return False
        seen |= shape.events[inner]
    return True


def entangled(shape: Shape, part: int) -> bool:
    """Whether two parts that one scenario may keep share an occurrence."""
    if shape.rows[part].op is Op.ONE:
        return False
    seen = 0
    for inner in shape.rows[part].parts:
        if shape.events[inner] & seen:
            return True
        seen |= shape.events[inner]
    return False


def tangled(shape: Shape) -> list[bool]:
    """For each part, whether it or some part below it is entangled."""
    found: list[bool] = []
    for number, part in enumerate(shape.rows):
        found.append(entangled(shape, number) or any(found[inner] for inner in part.parts))
    return found


def disjoint_events(shape: Shape, part: int) -> bool:
    """Whether all parts are single events and no event can serve two of them: the condition of the windows."""
    return (
        all(shape.unit[inner] is not None for inner in shape.rows[part].parts)
        and rivals_apart(shape, part)
        and not entangled(shape, part)
    )


# When parts that share occurrences may be translated as if they did not (`scattered` only).
#
# A shared part is then written once for each use, and the uses may be matched by different events. That is harmless when matches can be
# moved: what is matchable from one position is matchable from every earlier one, so the latest match serves all uses that have the
# same continuation, and the earliest all that have the same start. Dropping any of the three conditions has a counterexample; with both
# continuation and start different, `and (sand x s) (sand s y)` would accept s y x s.

Context: TypeAlias = tuple[int, ...]
MANY: Final[Context] = (-1,)
"""Stands for contexts that differ."""


def separable(shape: Shape, root: int) -> bool:
    """Whether the parts below this one, shared ones among them, may be translated one by one."""
    kept = _kept(shape.rows, root)
    return (
        all(rivals_apart(shape, part) for part in kept if shape.rows[part].op in (Op.ALL, Op.AT_LEAST))
        and same_continuation_or_start(shape.rows, kept)
        and always_feasible(shape, kept)
    )


def same_continuation_or_start(rows: Sequence[Part], kept: Sequence[int]) -> bool:
    """Whether for every part all its uses are followed by the same, or all are preceded by the same."""
    after: dict[int, Context] = {kept[-1]: ()}
    before: dict[int, Context] = {kept[-1]: ()}
    for number in reversed(kept):
        if after[number] == MANY and before[number] == MANY:
            return False
        part = rows[number]
        for index, inner in enumerate(part.parts):
            first, last = index == 0, index == len(part.parts) - 1
            in_sequence = part.op is Op.SEQUENCE
            _use(after, inner, after[number] if last or not in_sequence else (number, index))
            _use(before, inner, before[number] if first or not in_sequence else (number, index))
    return True


def _use(contexts: dict[int, Context], part: int, context: Context) -> None:
    contexts[part] = context if contexts.get(part, context) == context else MANY


def always_feasible(shape: Shape, kept: Sequence[int]) -> bool:
    """Whether no scenario can be cyclic: not even the precedences of all scenarios together are."""
    graph = nx.DiGraph()
    for number in kept:
        parts = [part for part in shape.rows[number].parts if shape.events[part]]
        if not shape.rows[number].parts:
            graph.add_edge(("begin", number), ("end", number))
        for part in parts:
            graph.add_edge(("begin", number), ("begin", part))
            graph.add_edge(("end", part), ("end", number))
        if shape.rows[number].op is Op.SEQUENCE:
            for earlier, later in pairwise(parts):
                graph.add_edge(("end", earlier), ("begin", later))
    acyclic: bool = nx.is_directed_acyclic_graph(graph)
    return acyclic


def _kept(rows: Sequence[Part], root: int) -> list[int]:
    seen = {root}
    for number in range(root, -1, -1):
        if number in seen:
            seen.update(rows[number].parts)
    return sorted(seen)


# Which guards every event is under.
#
# A guard counts in every scenario that contains its node, and is conjoined to every event of that scenario that binds one of its
# variables. Where some scenarios with such an event contain the guard and others do not, the choices that decide it are made
# one by one, until for each event it is settled which guards it is under.


@dataclass(frozen=True, slots=True)
class Settled:
    """Some of the scenarios of a tree, and for each of their events (by node) the guards it is under in all of them."""

    parts: Parts
    guards: Mapping[str, tuple[Guard, ...]]


def settle(parts: Parts, patterns: Mapping[str, Pattern], *, monotone: bool, limit: int) -> Iterator[Settled]:
    """All scenarios, divided so that the guards are settled; `patterns` holds the event of each node."""
    if not parts.guards:
        yield Settled(parts, {})
        return
    waiting = [parts]
    budget = CellBudget("the choices that guards depend on take more than the limit allows", limit)
    while waiting:
        candidate = waiting.pop()
        budget.spend(len(candidate.kept()))
        found = _placed(candidate, patterns)
        if isinstance(found, Settled):
            yield found
        else:
            ways = [candidate.resolve(found, way) for way in _ways(candidate.rows[found], monotone=monotone)]
            waiting.extend(reversed(ways))


def _ways(part: Part, *, monotone: bool) -> Iterator[tuple[int, ...]]:
    if part.op is Op.ONE:
        yield from ((chosen,) for chosen in part.parts)
        return
    for size in range(part.need, part.need + 1 if monotone else len(part.parts) + 1):
        yield from combinations(part.parts, size)


def _placed(parts: Parts, patterns: Mapping[str, Pattern]) -> Settled | int:
    """The guards of each event, or a part whose choice decides about one."""
    kept = parts.kept()
    graph = _Graph(parts.rows, kept)
    placed: dict[str, list[Guard]] = {}
    guards = [(number, guard) for number, guard in parts.guards if number in graph.below]
    for number, guard in guards:
        names = set(guard_variables(guard))
        for event in kept:
            node = parts.rows[event].node
            if parts.rows[event].op is not Op.EVENT or names.isdisjoint(rigid_variables(patterns[node])):
                continue
            if graph.implies(event, number):
                placed.setdefault(node, []).append(guard)
            elif graph.together(event, number):
                return graph.deciding(event, number)
    return Settled(parts, {node: tuple(dict.fromkeys(found)) for node, found in placed.items()})


class _Graph:
    """Who is in which scenarios with whom; sets of parts are bits."""

    def __init__(self, rows: Sequence[Part], kept: Sequence[int]) -> None:
        self.rows = rows
        self.kept = kept
        self.below: dict[int, int] = {}
        """Of each part itself and all it reaches."""
        self.always: dict[int, int] = {}
        """Of each part itself and what is in every scenario that contains it, looking downwards only."""
        for number in kept:
            part = rows[number]
            self.below[number] = 1 << number
            for inner in part.parts:
                self.below[number] |= self.below[inner]
            self.always[number] = 1 << number | always_in(part, [self.always[inner] for inner in part.parts])
        self.above = self._dominators()

    def _dominators(self) -> dict[int, int]:
        """Of each part itself and the parts on every way to it."""
        above: dict[int, int] = {self.kept[-1]: 0}
        for number in reversed(self.kept):
            above[number] |= 1 << number
            for part in self.rows[number].parts:
                above[part] = above[part] & above[number] if part in above else above[number]
        return above

    def implies(self, event: int, number: int) -> bool:
        """Whether every scenario with the event contains the part; conservative."""
        return any(self.always[part] >> number & 1 for part in _bits(self.above[event]))

    def together(self, event: int, number: int) -> bool:
        """Whether some scenario may contain both: there is a gate that keeps a way to each, or one is on the way to the other."""
        if self.below[number] >> event & 1 or self.below[event] >> number & 1:
            return True
        for part in self.kept:
            if self.rows[part].op is not Op.ONE:
                to_event = {p for p in self.rows[part].parts if self.below[p] >> event & 1}
                to_number = {p for p in self.rows[part].parts if self.below[p] >> number & 1}
                if to_event and to_number and len(to_event | to_number) > 1:
                    return True
        return False

    def deciding(self, event: int, number: int) -> int:
        """The topmost choice between the part and the nearest part on every way to it and to the event."""
        common = self.above[event] & self.above[number]
        nearest = (common & -common).bit_length() - 1
        return max(
            part for part in _bits(self.below[nearest]) if self.rows[part].chooses and self.below[part] >> number & 1
        )


def _bits(members: int) -> Iterator[int]:
    while members:
        lowest = members & -members
        yield lowest.bit_length() - 1
        members ^= lowest


# AND and VOT over single events, position by position: polynomial where the paper's unrolling is factorial.
#
# At least K of n events, no event able to serve two of them: exactly j positions (K ≤ j ≤ n), at each of them one of the events, and none
# of the events at two of them.


def window(positions: Positions, events: Sequence[int], need: int, after: int) -> int:
    """At least `need` of the events (disjunctions of atoms), each at its own position, then `after`.

    What nothing follows is decided as soon as `need` events were seen.
    """
    formulas = positions.formulas
    some = formulas.disjunction(events)
    lengths = [need] if after == TRUE else range(need, len(events) + 1)
    ways = []
    for length in lengths:
        if length == 0:
            ways.append(after)
            continue
        whole = _repeat(positions, some, length, after)
        never_twice = [formulas.negation(twice) for twice in _twice(positions, events, length)]
        ways.append(formulas.conjunction([whole, *never_twice]))
    return formulas.disjunction(ways)


def _repeat(positions: Positions, some: int, length: int, after: int) -> int:
    formula = after
    for _ in range(length):
        formula = positions.formulas.conjunction([some, positions.later(formula)])
    return formula


def _twice(positions: Positions, events: Sequence[int], length: int) -> list[int]:
    """For each event: at two of the next `length` positions."""
    formulas = positions.formulas
    found = []
    for event in events:
        once, twice = event, FALSE
        for _ in range(length - 1):
            twice = formulas.disjunction(
                [formulas.conjunction([event, _next(positions, once)]), _next(positions, twice)]
            )
            once = formulas.disjunction([event, _next(positions, once)])
        found.append(twice)
    return found


def _next(positions: Positions, formula: int) -> int:
    return FALSE if formula == FALSE else positions.later(formula)


class Composer:
    """Translates the parts of one shape; `event_of` gives the formula of an EVENT part. `limit` bounds states and scenarios."""

    def __init__(self, shape: Shape, positions: Positions, event_of: Callable[[int], int], *, limit: int) -> None:
        self._shape = shape
        self._positions = positions
        self._formulas = positions.formulas
        self._event_of = event_of
        self._known: dict[tuple[int, int], int] = {}
        self._free: set[int] = set()
        """Parts below a separable one: they are translated one by one although they share occurrences."""
        self._tangled = tangled(shape)
        self._terms = Terms(limit)
        self._term: dict[int, int] = {}
        self._orders = Orders(shape.rows, monotone=positions.monotone, limit=limit)
        self._states: dict[int, State] = {}

    def whole(self) -> int:
        """The formula of the root, from the first position on."""
        return self._positions.begin(run(self._of(self._shape.root, TRUE)))

    def _of(self, part: int, after: int) -> Call[int]:
        key = (part, after)
        if key not in self._known:
            self._known[key] = yield self._made(part, after)
        return self._known[key]

    def _made(self, part: int, after: int) -> Call[int]:
        row = self._shape.rows[part]
        found: int
        if after == FALSE:
            return FALSE
        if part not in self._free and entangled(self._shape, part):
            if not self._positions.monotone or not separable(self._shape, part):
                found = yield self._sum_of_orders(part, after)
                return found
            self._set_free(part)
        match row.op:
            case Op.EVENT:
                return self._positions.step(self._event_of(part), after)
            case Op.ONE:
                return self._formulas.disjunction((yield self._each(row.parts, after)))
            case Op.SEQUENCE:
                for inner in reversed(row.parts):
                    after = yield self._of(inner, after)
                return after
            case Op.ALL | Op.AT_LEAST if not row.parts:
                return after
            case Op.ALL | Op.AT_LEAST if self._positions.monotone:
                found = yield self._anywhere(part, after)
                return found
            case Op.ALL | Op.AT_LEAST:
                found = yield self._in_place(part, after)
                return found

    def _set_free(self, part: int) -> None:
        todo = [part]
        while todo:
            number = todo.pop()
            if number not in self._free:
                self._free.add(number)
                todo.extend(self._shape.rows[number].parts)

    def _each(self, parts: Sequence[int], after: int) -> Call[list[int]]:
        found: list[int] = []
        for inner in parts:
            found += [(yield self._of(inner, after))]
        return found

    def _anywhere(self, part: int, after: int) -> Call[int]:
        """AND and VOT under `scattered`."""
        row = self._shape.rows[part]
        if row.op is Op.AT_LEAST:
            if not rivals_apart(self._shape, part):
                threshold: int = yield self._sum([part], part, after)
                return threshold
            return self._threshold((yield self._each(row.parts, after)), row.need)
        found = []
        apart = rivals_apart(self._shape, part)
        groups = [[inner] for inner in row.parts] if apart else self._rival_groups(row.parts)
        for group in groups:
            if len(group) == 1:
                found.append((yield self._of(group[0], after)))
            else:
                found.append((yield self._sum(group, part, after)))
        return self._formulas.conjunction(found)

    def _threshold(self, parts: Sequence[int], need: int) -> int:
        """At least `need` of the formulas: T(i, j) = f_i & T(i+1, j-1) | T(i+1, j)."""
        f = self._formulas
        row = [TRUE] + [FALSE] * need
        for formula in reversed(parts):
            row = [TRUE] + [
                f.disjunction([f.conjunction([formula, row[count - 1]]), row[count]]) for count in range(1, need + 1)
            ]
        return row[need]

    def _rival_groups(self, parts: Sequence[int]) -> list[list[int]]:
        """The parts, those together of which one event may serve two."""
        groups: list[tuple[list[int], int, int]] = []
        for part in parts:
            members, events, rivals = [part], self._shape.events[part], self._shape.rivals[part]
            apart = []
            for group in groups:
                if group[2] & events:
                    members, events, rivals = [*group[0], *members], events | group[1], rivals | group[2]
                else:
                    apart.append(group)
            groups = [*apart, (members, events, rivals)]
        return [members for members, _, _ in groups]

    def _in_place(self, part: int, after: int) -> Call[int]:
        """AND and VOT under `strict` and `projected`."""
        row = self._shape.rows[part]
        if not disjoint_events(self._shape, part):
            found: int = yield self._sum([part], part, after)
            return found
        need = row.need if row.op is Op.AT_LEAST else len(row.parts)
        return window(self._positions, [self._unit(inner) for inner in row.parts], need, after)

    def _unit(self, part: int) -> int:
        events = self._shape.unit[part]
        assert events is not None
        return self._formulas.disjunction(self._event_of(event) for event in events)

    def _term_of(self, part: int) -> int:
        todo = [part]
        while todo:
            number = todo[-1]
            row = self._shape.rows[number]
            missing = [inner for inner in row.parts if inner not in self._term]
            if missing:
                todo.extend(missing)
                continue
            todo.pop()
            if row.op is Op.EVENT:
                self._term[number] = self._terms.event(self._event_of(number))
            else:
                self._term[number] = self._terms.part(row, [self._term[inner] for inner in row.parts])
        return self._term[part]

    def _sum(self, some: Sequence[int], whole: int, after: int) -> Call[int]:
        """The general form of some parts of a whole in any order; where occurrences are shared below, of the whole."""
        if any(self._tangled[part] for part in some):
            return self._sum_of_orders(whole, after)
        return self._sum_of_terms([self._term_of(part) for part in some], after)

    def _sum_of_terms(self, terms: list[int], after: int) -> Call[int]:
        initial = self._terms.all_of(terms)
        return total(self._positions, initial, done=self._terms.over, steps=self._terms.steps, after=after)

    def _sum_of_orders(self, part: int, after: int) -> Call[int]:
        if part not in self._states:
            self._states[part] = self._orders.of(part)

        def steps(state: State) -> list[tuple[int, State]]:
            return [(self._event_of(event), following) for event, following in self._orders.steps(state)]

        return total(self._positions, self._states[part], done=self._orders.over, steps=steps, after=after)
