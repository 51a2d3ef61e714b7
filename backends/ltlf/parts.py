"""The parts of a tree as this translation wants them.

In as few as possible, with what one event may serve, guards settled.

Sets of parts and of events are bits, so that a tree of thousands of nodes is no trouble.
"""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Final, TypeAlias, assert_never

from rvaft.core.part_numbers import EMPTY, NumberedPart, NumberedParts, PartKind, divided
from rvaft.core.patterns import Overlaps
from rvaft.core.property import Event
from rvaft.core.scenarios import transitive
from rvaft.model.guards import Guard
from rvaft.model.guards import variables as guard_variables
from rvaft.model.patterns import rigid_variables
from rvaft.support.bits import bits, in_at_least, meet, union
from rvaft.support.budget import Work


def simplified(form: NumberedParts, *, monotone: bool) -> tuple[NumberedPart, ...]:
    """The same scenarios in fewer parts, the root last: below it nothing empty, and nothing nested that need not be.

    Guards are dropped. `monotone`: a match may be found inside a larger one, as any positions may be used.
    """
    kept = form.kept()
    users: defaultdict[int, list[int]] = defaultdict(list)
    for number in kept:
        for inner in form.parts[number].parts:
            users[inner].append(number)
    shared: set[int] = set()
    """What is used twice, or below something that is."""
    for number in reversed(kept):
        if len(users[number]) > 1 or not shared.isdisjoint(users[number]):
            shared.add(number)
    made = _Simplifier(monotone)
    numbers: dict[int, int] = {}
    for number in kept:
        part = form.parts[number]
        simple = made.simple(
            replace(part, parts=tuple(numbers[inner] for inner in part.parts)),
            taken_over=[form.parts[user].op for user in users[number]] == [part.op],
        )
        numbers[number] = simple if isinstance(simple, int) else made.add(simple, shared=number in shared)
        if len(users[number]) > 1:
            made.several.add(numbers[number])
    return tuple(made.parts[: numbers[form.root] + 1])


class _Simplifier:
    """Simple parts, built from parts to wholes."""

    def __init__(self, monotone: bool) -> None:
        self._monotone = monotone
        self.parts: list[NumberedPart] = []
        self.several: set[int] = set()
        """Parts used more than once: their choices are not made where they are used."""
        self._always: list[int] = []
        """Of each part the shared parts that every scenario of it contains, itself among them."""

    def add(self, part: NumberedPart, *, shared: bool) -> int:
        found = in_at_least(len(part.parts) - part.need + 1, [self._always[inner] for inner in part.parts])
        self._always.append(found | shared << len(self.parts))
        self.parts.append(part)
        return len(self.parts) - 1

    def simple(self, part: NumberedPart, *, taken_over: bool = False) -> NumberedPart | int:
        """The simple form of a part of simple parts, or the number of the part that it equals.

        `taken_over`: the only user is of the same kind and takes the parts over anyway.
        """
        rest = [number for number in part.parts if self.parts[number] != EMPTY]
        empty = [number for number in part.parts if self.parts[number] == EMPTY]
        match part.op:
            case PartKind.EVENT:
                return NumberedPart(PartKind.EVENT, of=part.of)
            case PartKind.CONDITION:
                return EMPTY
            case PartKind.AT_LEAST:
                need = max(part.need - len(empty), 0)
                if not rest or (self._monotone and not need):
                    return EMPTY
                if need == len(rest) or (self._monotone and need == 1):
                    return self.simple(NumberedPart(PartKind.ALL if need == len(rest) else PartKind.ONE, tuple(rest)))
                return NumberedPart(PartKind.AT_LEAST, parts=tuple(rest), need=need)
            case PartKind.ONE:
                if empty and (self._monotone or not rest):
                    return EMPTY
                choices = rest if taken_over else self._opened(rest, PartKind.ONE)
                rest = list(dict.fromkeys([*choices, *empty[:1]]))
            case PartKind.ALL | PartKind.SEQUENCE:
                if not taken_over:
                    rest = self._opened(rest, part.op)
            case _:
                assert_never(part.op)
        if part.op is PartKind.ALL and not taken_over:
            # each once, without what every scenario of another one contains anyway
            rest = list(dict.fromkeys(rest))
            twice = in_at_least(2, [self._always[number] for number in rest])
            rest = [number for number in rest if not twice >> number & 1]
        if len(rest) == 1:
            return rest[0]
        return (
            NumberedPart(part.op, parts=tuple(rest), need=1 if part.op is PartKind.ONE else len(rest))
            if rest
            else EMPTY
        )

    def _opened(self, numbers: Sequence[int], op: PartKind) -> list[int]:
        """The numbers, those of the same kind replaced by their parts.

        A choice that is used elsewhere too stays one.
        """
        found: list[int] = []
        todo = list(reversed(numbers))
        while todo:
            number = todo.pop()
            part = self.parts[number]
            if part.op is op and part.parts and not (op is PartKind.ONE and number in self.several):
                todo.extend(reversed(part.parts))
            else:
                found.append(number)
        return found


Context: TypeAlias = tuple[int, ...]
_MANY: Final[Context] = (-1,)
"""Stands for contexts that differ."""


class Anatomy:
    """Simplified parts, and what the translation asks about them.

    Of each part its events; the other events that one event may serve together with one of them
    (`rivals`; variables stand for anything and guards are not looked at, so that what is no rival
    surely is none); and, where every scenario of it observes exactly one event, the parts that are
    that event (`unit`). `tangled` are parts with shared occurrences somewhere below.
    """

    def __init__(self, parts: Sequence[NumberedPart]) -> None:
        self.parts = parts
        self.root = len(parts) - 1
        self.events: list[int] = []
        self.rivals: list[int] = []
        self.unit: list[tuple[int, ...] | None] = []
        self.tangled: list[bool] = []
        overlaps = Overlaps([part.event.pattern for part in parts if part.op is PartKind.EVENT])
        seen = 0
        for number, part in enumerate(parts):
            if part.op is PartKind.EVENT:
                self.events.append(1 << seen)
                self.rivals.append(overlaps.compatible(seen) & ~(1 << seen))
                self.unit.append((number,))
                seen += 1
            else:
                self.events.append(union(self.events[inner] for inner in part.parts))
                self.rivals.append(union(self.rivals[inner] for inner in part.parts))
                units = [self.unit[inner] for inner in part.parts] if part.op is PartKind.ONE else []
                events = dict.fromkeys(event for unit in units for event in unit or ())
                self.unit.append(tuple(events) if units and None not in units else None)
            self.tangled.append(self.is_entangled(number) or any(self.tangled[inner] for inner in part.parts))

    def is_entangled(self, part: int) -> bool:
        """Whether two parts that one scenario may keep share an occurrence."""
        this = self.parts[part]
        return this.op is not PartKind.ONE and meet((self.events[inner], self.events[inner]) for inner in this.parts)

    def rivals_apart(self, part: int) -> bool:
        """Whether no event can serve occurrences in two different parts of this one."""
        return not meet((self.events[inner], self.rivals[inner]) for inner in self.parts[part].parts)

    def below(self, part: int) -> list[int]:
        """The part and all below it, parts before wholes."""
        return NumberedParts(tuple(self.parts[: part + 1])).kept()

    def is_separable(self, root: int) -> bool:
        """Whether parts that share occurrences may be translated one by one as if they did not (`scattered` only).

        A shared part is then written once for each use, and the uses may be matched by different
        events. That is harmless when matches can be moved: what is matchable from one position is
        matchable from every earlier one, so the latest match serves all uses that have the same
        continuation, and the earliest all that have the same start. Dropping any of the three
        conditions has a counterexample; with both continuation and start different, `and (sand x s)
        (sand s y)` would accept s y x s.
        """
        kept = self.below(root)
        unordered = (part for part in kept if self.parts[part].op in (PartKind.ALL, PartKind.AT_LEAST))
        return all(map(self.rivals_apart, unordered)) and self._uses_agree(kept) and self._always_feasible(root)

    def _uses_agree(self, kept: Sequence[int]) -> bool:
        """Whether for every part all its uses are followed by the same, or all are preceded by the same."""
        contexts: dict[int, tuple[Context, Context]] = {kept[-1]: ((), ())}
        for number in reversed(kept):
            before, after = contexts[number]
            if before == after == _MANY:
                return False
            part = self.parts[number]
            last = len(part.parts) - 1
            for index, inner in enumerate(part.parts):
                place = (number, index) if part.op is PartKind.SEQUENCE else None
                own = (before if index == 0 else place or before, after if index == last else place or after)
                known = contexts.get(inner, own)
                agreed = [mine if mine == theirs else _MANY for mine, theirs in zip(own, known, strict=True)]
                contexts[inner] = (agreed[0], agreed[1])
        return True

    def _always_feasible(self, root: int) -> bool:
        """Whether no scenario can be cyclic: not even the precedences of all scenarios together are."""
        around = NumberedParts(tuple(self.parts[: root + 1])).around(dict(enumerate(self.events)))
        events = (number for number, part in enumerate(self.parts) if part.op is PartKind.EVENT)
        return transitive([around.get(number, 0) for number in events]) is not None


GuardsOf: TypeAlias = Mapping[Event, tuple[Guard, ...]]
"""For each event the guards that it is under in all scenarios."""


def settled(form: NumberedParts, *, monotone: bool, work: Work) -> Iterator[tuple[NumberedParts, GuardsOf]]:
    """All scenarios, divided so that it is settled for each event which guards it is under.

    A guard counts in every scenario that contains its condition, and is conjoined to every event of
    that scenario that binds one of its variables. Where some scenarios with such an event contain
    the guard and others do not, the choices that decide it are made one by one.
    """
    if not form.guards:
        yield form, {}
        return

    def look(candidate: NumberedParts) -> GuardsOf | int:
        work.step(10 * len(candidate.parts))
        return _placed(candidate)

    yield from divided(form, look, at_least=not monotone)


def _placed(form: NumberedParts) -> GuardsOf | int:
    """The guards of each event, or a part whose choice decides about one."""
    below = form.below()
    kept = list(below)
    always: dict[int, int] = {}
    """Of each part itself and what is in every scenario that contains it, looking downwards only."""
    for number in kept:
        part = form.parts[number]
        missable = len(part.parts) - part.need + 1
        always[number] = 1 << number | in_at_least(missable, [always[inner] for inner in part.parts])
    above: dict[int, int] = {kept[-1]: 0}
    """Of each part itself and the parts on every way to it."""
    certain: dict[int, int] = {}
    """Of each part what is in every scenario that contains it, as far as is known."""
    for number in reversed(kept):
        certain[number] = always[number] | certain.get(_lowest(above[number]), 0)
        above[number] |= 1 << number
        for inner in form.parts[number].parts:
            above[inner] = above.get(inner, -1) & above[number]
    placed: defaultdict[Event, list[Guard]] = defaultdict(list)
    events = [number for number in kept if form.parts[number].op is PartKind.EVENT]
    names = {event: frozenset(rigid_variables(form.parts[event].event.pattern)) for event in events}
    for number, guard in form.guards:
        if number not in below:
            continue
        together = below[number]
        """What some scenario may contain beside the part: some gate keeps a way to each, or it is below."""
        for part in (form.parts[whole] for whole in kept if below[whole] >> number & 1):
            leading = {inner for inner in part.parts if below[inner] >> number & 1}
            if part.op is not PartKind.ONE and leading:
                together |= union(below[inner] for inner in part.parts if leading != {inner})
        for event in events:
            if names[event].isdisjoint(guard_variables(guard)):
                continue
            if certain[event] >> number & 1:
                placed[form.parts[event].event].append(guard)
            elif together >> event & 1:
                # decided by the topmost choice between the part and the nearest part above both
                between = bits(below[_lowest(above[event] & above[number])])
                return max(p for p in between if form.parts[p].chooses and below[p] >> number & 1)
    return {event: tuple(dict.fromkeys(guards)) for event, guards in placed.items()}


def _lowest(members: int) -> int:
    return (members & -members).bit_length() - 1
