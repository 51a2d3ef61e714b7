"""Residuals of a property after some events, and the moves between them.

A *residual* is the remainder of a set of scenarios after some events; residuals that differ only by
interchangeable parts are merged. A *move* matches one more event. A scenario matches a word if and
only if moves with its labels lead from a start to a complete residual.

An event below an alternative decides a choice; a later event decides it silently. A choice can wait
if the parts below its alternatives are not shared. Otherwise its decision may order past events, so
each way to decide is a separate start.

Automata and LTLf use residuals, which drop the bindings and require a guard at each event with one
of its variables. RML does not: its partial matches keep registers and evaluate each guard once.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import combinations, product
from math import comb
from types import MappingProxyType
from typing import Final, NamedTuple, assert_never

from rvaft.core.part_numbers import NumberedPart, NumberedParts, divided
from rvaft.core.property import Condition, Event, PartKind
from rvaft.model.guards import Guard, variables
from rvaft.model.patterns import rigid_variables
from rvaft.support.bits import bits, mask_of, union
from rvaft.support.budget import Work

_WIDE: Final = 1 << 61


class Residual(NamedTuple):
    """The remaining events, choices and guards, as bit sets.

    - `start`: the index of the start.
    - `open`: required events, undecided choices, and guards that must hold at a later event.
    - `taken`: alternatives of open choices that are already taken.
    - `broken`: guards that did not hold, so that no choice may require them.
    """

    start: int
    open: int
    taken: int = 0
    broken: int = 0

    def __hash__(self) -> int:
        """Hash wide integers as bytes: Python gives shifted integers the same hash."""
        if self.open < _WIDE:
            return hash((self.start, self.open, self.taken, self.broken))
        return hash((self.start, self.open.to_bytes(self.open.bit_length() // 8 + 1), self.taken))


class Move(NamedTuple):
    """A match of one more event with `label`; `event` is the number of one of the equivalent parts.

    The guards `needed` must hold at the event. Guards of `noted` that do not hold become broken.
    """

    event: int
    label: int
    needed: int
    noted: int
    target: Residual


class ResidualSpace:
    """The residuals of a graph of parts; `label` maps the number of an event part to its label.

    `guards` maps each guard to its bit; all other bits are higher. `at_least` keeps the ways to
    choose more than K parts, which are redundant if events may be skipped. `work` may raise
    `TooLarge`.

    >>> import rvaft
    >>> from rvaft.core.build import build
    >>> from rvaft.core.part_numbers import numbered
    >>> form = numbered(build(rvaft.loads("t sand v c; v or a b;")))
    >>> left = ResidualSpace(form, lambda number: number, at_least=True, work=Work(100))
    >>> [start] = left.starts
    >>> first, other = left.moves(start)
    >>> [form.parts[move.label].event.source.node for move in (first, other)], first.target == other.target
    (['a', 'b'], True)
    >>> [last] = left.moves(first.target)
    >>> [left.is_complete(one) for one in (start, first.target, last.target)]
    [False, False, True]
    """

    def __init__(
        self,
        form: NumberedParts,
        label: Callable[[int], int],
        guards: Mapping[Guard, int] = MappingProxyType({}),
        *,
        at_least: bool,
        work: Work,
    ) -> None:
        events = (number for number in reversed(form.kept()) if form.parts[number].op is PartKind.EVENT)
        labels = {number: (label(number), _on_variables(form.parts[number].event, guards)) for number in events}
        graphs = enumerate(_decided(form, at_least=at_least, work=work))
        self._of_start = [
            _Start(graph, number, labels, guards, at_least=at_least, work=work) for number, graph in graphs
        ]
        self.starts = tuple(plan.start for plan in self._of_start)
        """The residuals before any event; together they have all scenarios."""
        self.width = max(plan.width for plan in self._of_start)
        """The number of bits in the sets, to which the cost of a move is proportional."""

    def moves(self, left: Residual) -> tuple[Move, ...]:
        """Return the moves from a residual, in a stable order; cached."""
        return self._of_start[left.start].moves(left)

    def breaking(self, move: Move, holding: int) -> Residual:
        """Return the target of a move if exactly the guards `holding` of those it notes hold."""
        return self._of_start[move.target.start].breaking(move, holding)

    def is_complete(self, left: Residual) -> bool:
        """Whether no further event is required."""
        return self._of_start[left.start].is_complete(left)

    def dominates(self, one: Residual, other: Residual) -> bool:
        """Whether `one` completes on every word on which `other` does, if events may be skipped.

        False proves nothing.
        """
        return one.start == other.start and self._of_start[one.start].dominates(one, other)


def _decided(form: NumberedParts, *, at_least: bool, work: Work) -> list[NumberedParts]:
    """Return equivalent graphs that decide all choices that cannot wait, in a stable order."""
    what = "ways to decide choices between parts that share nodes"

    def look(graph: NumberedParts) -> int | None:
        choice = _urgent(graph, work)
        if choice is not None:
            part = graph.parts[choice]
            work.check(comb(len(set(part.parts)), part.need), what)
        return choice

    done: list[NumberedParts] = []
    for graph, _ in divided(form, look, at_least=at_least):
        done.append(graph)
        work.check(len(done), what)
    return done


_LOOK: Final = 100
"""Steps for each part to find a choice that cannot wait: about ten microseconds."""


def _urgent(form: NumberedParts, work: Work) -> int | None:
    """Return the first choice with an alternative that reaches a part also reached otherwise."""
    kept = form.kept()
    references = Counter(child for number in kept for child in form.parts[number].parts)
    if all(count == 1 for count in references.values()):
        return None
    work.step(_LOOK * len(kept))
    parents, inside, entered = dict.fromkeys(kept, 0), form.below(), dict[int, int]()
    for number in kept:
        for child in form.parts[number].parts:
            parents[child] |= 1 << number
    for number in kept:
        entered[number] = union(entered[child] | parents[child] for child in form.parts[number].parts)
    for number in reversed(kept):
        part = form.parts[number]
        if part.chooses and any(references[child] > 1 or entered[child] & ~inside[child] for child in part.parts):
            return number
    return None


class _Alternative(NamedTuple):
    """One child of a choice. `up` is the alternative that contains the choice, if any.

    `mandatory` are the bits that it requires, `whole` all bits below it, `first` its possible first
    events, `silent` the smallest sets of guards that complete it without an event.
    """

    choice: int
    up: int | None
    mandatory: int
    whole: int
    first: int
    silent: tuple[int, ...]


class _Choice(NamedTuple):
    """A choice of at least `least` alternatives; `more` allows further ones.

    `mask` has the bits of the alternatives, `silent` those that can complete without an event.
    """

    mask: int
    silent: int
    least: int
    more: bool


class _Occurrence(NamedTuple):
    """An event of a graph: its part, label, guards on its variables (`bound`), and the alternative
    above.

    The bits `before` and `after` are ordered before and after it.
    """

    part: int
    label: int
    bound: int
    alternative: int | None
    before: int
    after: int


class _Start:
    """The tables and moves of one graph whose choices can all wait.

    Raises `TooLarge` if a choice has too many silent ways.
    """

    def __init__(
        self,
        form: NumberedParts,
        number: int,
        labels: Mapping[int, tuple[int, int]],
        guards: Mapping[Guard, int],
        *,
        at_least: bool,
        work: Work,
    ) -> None:
        self._work = work
        self._moves: dict[Residual, tuple[Move, ...]] = {}
        graph: dict[int, NumberedPart] = {part: form.parts[part] for part in reversed(form.kept())}
        self._guards = mask_of(guards.values())
        bit, option = _laid_out(graph, self._guards.bit_length())
        whole, mandatory, first, silent = _extents(graph, bit, guards, work)
        self._whole, self._root = whole, form.root
        above: dict[int, int | None] = dict.fromkeys(graph)  # the alternative above each part
        self.alternatives: dict[int, _Alternative] = {}
        self.choices: dict[int, _Choice] = {}
        for part, this in graph.items():
            up = above[part]
            for child in this.parts:
                above[child] = option.get(child, up)
                if this.chooses:
                    known = (mandatory[child], whole[child], first[child], silent[child])
                    self.alternatives[option[child]] = _Alternative(bit[part], up, *known)
            if this.chooses:
                mask = mask_of(option[child] for child in this.parts)
                quiet = mask_of(alternative for alternative in bits(mask) if self.alternatives[alternative].silent)
                self.choices[bit[part]] = _Choice(mask, quiet, this.need, at_least and this.op is PartKind.AT_LEAST)
        before, after = form.around(whole), form.around(whole, backwards=True)
        self.occurrences: dict[int, _Occurrence] = {}
        self._binders = dict.fromkeys(bits(self._guards), 0)
        for part in filter(labels.__contains__, graph):
            event, label_and_guards = bit[part], labels[part]
            self.occurrences[event] = _Occurrence(part, *label_and_guards, above[part], before[part], after[part])
            self._binders.update((guard, self._binders[guard] | 1 << event) for guard in bits(label_and_guards[1]))
        self._choosing = mask_of(self.choices)
        self._events = mask_of(self.occurrences)
        self.width = (self._events | self._guards).bit_length()
        self._rests = _Rests(graph, labels, guards, bit, option) if self._has_alike() else None
        self._size = len(graph)
        self._known: dict[tuple[int, ...], Residual] = {}
        self.start = self._tidy(Residual(number, mandatory[form.root]))

    def _has_alike(self) -> bool:
        alike: dict[tuple[int, int], int] = {}
        for event, occurrence in self.occurrences.items():
            alike[occurrence.label, occurrence.bound] = alike.get((occurrence.label, occurrence.bound), 0) | 1 << event
        return any(
            alike[occurrence.label, occurrence.bound] & ~(occurrence.before | occurrence.after | 1 << event)
            for event, occurrence in self.occurrences.items()
        )

    def moves(self, left: Residual) -> tuple[Move, ...]:
        if left not in self._moves:
            self._moves[left] = found = tuple({move[1:]: move for move in self._find(left)}.values())
            self._work.step(len(found) * (20 + self.width // 5))
        return self._moves[left]

    def breaking(self, move: Move, holding: int) -> Residual:
        broken = move.noted & ~holding
        return self._tidy(move.target._replace(broken=move.target.broken | broken)) if broken else move.target

    def is_complete(self, left: Residual) -> bool:
        if left.open & self._events:
            return False
        return all(self._silently(left, choice) for choice in bits(left.open & self._choosing))

    def dominates(self, one: Residual, other: Residual) -> bool:
        if one.open & ~other.open or one.broken & ~other.broken:
            return False
        behind = other.taken & ~one.taken
        return not behind or not any(self.choices[choice].mask & behind for choice in bits(one.open & self._choosing))

    def _find(self, left: Residual) -> Iterator[Move]:
        repeated = 0 if self._rests is None else self._rests.repeated(left, self._whole)
        for event in self._candidates(left):
            if repeated >> event & 1:
                continue
            occurrence = self.occurrences[event]
            entered = self._enter(left, event)
            if entered is None or occurrence.before & entered.open & self._events:
                continue
            for settled in self._settle(entered, occurrence.before & entered.open & self._choosing):
                target = settled._replace(open=settled.open & ~(1 << event))
                needed = occurrence.bound & settled.open
                noted = occurrence.bound & ~needed
                noted &= self._possible(target) if noted else 0
                yield Move(occurrence.part, occurrence.label, needed, noted, self._tidy(target))

    def _candidates(self, left: Residual) -> Iterator[int]:
        """Return the events that no waiting event is known to precede."""
        waiting = left.open & self._events
        while waiting:
            event = (waiting & -waiting).bit_length() - 1
            yield event
            waiting &= ~(1 << event | self.occurrences[event].after)
        yield from bits(union(self.alternatives[number].first for number in bits(self._untaken(left))))

    def _untaken(self, left: Residual) -> int:
        masks = (self.choices[choice].mask for choice in bits(left.open & self._choosing))
        return union(masks) & ~left.taken

    def _possible(self, left: Residual) -> int:
        return union(self.alternatives[number].whole for number in bits(self._untaken(left)))

    def _enter(self, left: Residual, event: int) -> Residual | None:
        """Take the alternatives above an event; return None if that is no longer possible."""
        if left.open >> event & 1:
            return left
        path: list[int] = []
        above = self.occurrences[event].alternative
        while above is not None:
            path.append(above)
            if left.open >> self.alternatives[above].choice & 1:
                break
            above = self.alternatives[above].up
        else:
            return None
        self._work.step(len(path) * (10 + self.width // 50))
        still, taken = left.open, left.taken
        for number in reversed(path):
            alternative = self.alternatives[number]
            if taken >> number & 1 or alternative.mandatory & left.broken:
                return None
            choice = self.choices[alternative.choice]
            chosen = taken & choice.mask | 1 << number
            if chosen == choice.mask or (not choice.more and chosen.bit_count() == choice.least):
                still &= ~(1 << alternative.choice)
                taken &= ~choice.mask
            else:
                taken |= chosen
            still |= alternative.mandatory
        return left._replace(open=still, taken=taken)

    def _settle(self, left: Residual, choices: int) -> Iterator[Residual]:
        if not choices:
            yield left
            return
        ways = [self._silently(left, choice) for choice in bits(choices)]
        taken = left.taken & ~union(self.choices[choice].mask for choice in bits(choices))
        for guards in _smallest(union(chosen) for chosen in product(*ways)):
            yield left._replace(open=left.open & ~choices | guards, taken=taken)

    def _silently(self, left: Residual, number: int) -> tuple[int, ...]:
        choice = self.choices[number]
        missing = choice.least - (left.taken & choice.mask).bit_count()
        if missing <= 0:
            return (0,)
        untaken = (self.alternatives[alternative].silent for alternative in bits(choice.silent & ~left.taken))
        able = [ways for silent in untaken if (ways := [mask for mask in silent if not mask & left.broken])]
        return _smallest(union(chosen) for some in combinations(able, missing) for chosen in product(*some))

    def _tidy(self, left: Residual) -> Residual:
        """Drop unaffected guards; return the representative of equivalent residuals."""
        required = left.open & self._guards
        if required or left.broken:
            possible = self._possible(left)
            coming = left.open | possible
            idle = mask_of(guard for guard in bits(required) if not self._binders[guard] & coming)
            left = left._replace(open=left.open & ~idle, broken=left.broken & possible)
        if self._rests is None:
            return left
        self._work.step(10 * self._size)
        key = (self._rests.of(left)[self._root], left.open & self._guards, left.broken)
        return self._known.setdefault(key, left)


def _on_variables(event: Event, guards: Mapping[Guard, int]) -> int:
    names = set(rigid_variables(event.pattern)) if guards else set()
    return mask_of(number for guard, number in guards.items() if not names.isdisjoint(variables(guard)))


def _laid_out(graph: dict[int, NumberedPart], least: int) -> tuple[dict[int, int], dict[int, int]]:
    bit: dict[int, int] = {}
    option: dict[int, int] = {}
    for part, this in graph.items():
        if this.chooses or this.op is PartKind.EVENT:
            bit[part] = least + len(bit) + len(option)
        for child in this.parts if this.chooses else ():
            option[child] = least + len(bit) + len(option)
    return bit, option


class _Rests:
    """Canonical numbers of the remainders of parts, equal if only interchangeable events differ.

    A shared part is equivalent only to itself; 0 is an empty remainder.
    """

    def __init__(
        self,
        graph: dict[int, NumberedPart],
        labels: Mapping[int, tuple[int, int]],
        guards: Mapping[Guard, int],
        bit: Mapping[int, int],
        option: Mapping[int, int],
    ) -> None:
        uses = Counter(child for part in graph.values() for child in part.parts)
        self._graph, self._bit, self._option = graph, bit, option
        self._shared = frozenset(part for part, count in uses.items() if count > 1)
        self._numbers: dict[tuple[object, ...], int] = {(): 0}
        self._inside: dict[int, list[int]] = {0: []}
        """The components of the number of an unordered part."""
        self.full: dict[int, int] = {}
        for part, this in reversed(graph.items()):
            own = guards[this.of.guard] if isinstance(this.of, Condition) else labels.get(part)
            inner = [self.full[child] for child in this.parts]
            key = (this.op, this.need, own, *(inner if this.op is PartKind.SEQUENCE else sorted(inner)))
            self.full[part] = self._number(part, *key) if part in self._shared else self._number(*key)

    def _number(self, *key: object) -> int:
        return self._numbers.setdefault(key, len(self._numbers))

    def of(self, left: Residual) -> dict[int, int]:
        rests: dict[int, int] = {}
        for part, this in reversed(self._graph.items()):
            is_open = part in self._bit and left.open >> self._bit[part] & 1
            inner = [rests[child] for child in this.parts if rests[child]]
            if this.op is PartKind.EVENT:
                rest = self.full[part] if is_open else 0
            elif this.op is PartKind.SEQUENCE:
                rest = self._number(this.op, *inner) if len(inner) > 1 else sum(inner)
            else:
                found = [component for rest in inner for component in self._inside.get(rest, (rest,))]
                if is_open:
                    untaken = sorted(
                        self.full[child] for child in this.parts if not left.taken >> self._option[child] & 1
                    )
                    need = max(0, this.need + len(untaken) - len(this.parts))
                    found.append(self._number(this.op, need, *untaken))
                found.sort()
                rest = self._number(PartKind.ALL, *found) if len(found) > 1 else sum(found)
                if len(found) > 1:
                    self._inside[rest] = found
            rests[part] = self._number(part, rest) if rest and part in self._shared else rest
        return rests

    def repeated(self, left: Residual, whole: Mapping[int, int]) -> int:
        """Return the bits of children of unordered parts with the same remainder as an earlier
        child.
        """
        rests, found = self.of(left), 0
        for this in self._graph.values():
            seen: dict[tuple[int, int, int], int] = {}
            for child in this.parts if this.op is not PartKind.SEQUENCE else ():
                taken = left.taken >> self._option[child] & 1 if this.chooses else 0
                first = seen.setdefault((rests[child], rests[child] or self.full[child], taken), child)
                found |= 0 if first == child else whole[child] & ~whole[first]
        return found


def _extents(
    graph: dict[int, NumberedPart], bit: Mapping[int, int], guards: Mapping[Guard, int], work: Work
) -> tuple[dict[int, int], dict[int, int], dict[int, int], dict[int, tuple[int, ...]]]:
    whole: dict[int, int] = {}
    mandatory: dict[int, int] = {}
    first: dict[int, int] = {}
    silent: dict[int, tuple[int, ...]] = {}
    for part, this in reversed(graph.items()):
        own = 1 << bit[part] if part in bit else 0
        match this.op:
            case PartKind.EVENT:
                whole[part] = mandatory[part] = first[part] = own
                silent[part] = ()
            case PartKind.CONDITION:
                assert isinstance(this.of, Condition)
                whole[part] = mandatory[part] = guard = 1 << guards[this.of.guard]
                first[part], silent[part] = 0, (guard,)
            case PartKind.ALL | PartKind.SEQUENCE | PartKind.ONE | PartKind.AT_LEAST:
                whole[part] = own | union(whole[child] for child in this.parts)
                mandatory[part] = own or union(mandatory[child] for child in this.parts)
                silent[part] = _silent([silent[child] for child in this.parts], this, work)
                first[part] = 0
                for child in this.parts:
                    first[part] |= first[child]
                    if this.op is PartKind.SEQUENCE and not silent[child]:
                        break
            case _:
                assert_never(this.op)
    return whole, mandatory, first, silent


def _silent(ways: list[tuple[int, ...]], part: NumberedPart, work: Work) -> tuple[int, ...]:
    able = [way for way in ways if way]
    need = part.need if part.chooses else len(ways)
    if part.chooses and need > 1:
        work.check(comb(len(able), need), "ways to decide choices by guards alone")
    found: set[int] = set()
    for chosen in combinations(able, need):
        together: tuple[int, ...] = (0,)
        for way in chosen:
            if way != (0,):
                together = _smallest(one | other for one in together for other in way)
            work.check(len(together), "ways to decide choices by guards alone")
        found.update(together)
    return _smallest(found)


def _smallest(sets: Iterable[int]) -> tuple[int, ...]:
    """Return the minimal sets (antichain), in a stable order.

    >>> _smallest([0b110, 0b011, 0b010, 0b101])
    (2, 5)
    """
    kept: list[int] = []
    for mask in sorted(set(sets), key=lambda mask: (mask.bit_count(), mask)):
        if not any(other & ~mask == 0 for other in kept):
            kept.append(mask)
    return tuple(kept)
