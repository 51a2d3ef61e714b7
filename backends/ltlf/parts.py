"""The parts of a property simplified for LTLf, with rival events and settled guards.

Bit sets of parts and of events scale to thousands of nodes.
"""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Final, TypeAlias, assert_never

from rvaft.core.overlaps import Overlaps
from rvaft.core.part_numbers import EMPTY, NumberedPart, NumberedParts, divided
from rvaft.core.precedence import transitive
from rvaft.core.property import Event, PartKind
from rvaft.model.guards import Guard
from rvaft.model.guards import variables as guard_variables
from rvaft.model.patterns import rigid_variables
from rvaft.support.bits import bits, in_at_least, meet, union
from rvaft.support.budget import Work


def simplified(form: NumberedParts, *, monotone: bool) -> tuple[NumberedPart, ...]:
    """Return the same scenarios in fewer parts, the root last, without empty or needlessly nested
    parts.

    Guards are dropped. `monotone`: a match may lie inside a larger one (`scattered`).
    """
    kept = form.kept()
    users: defaultdict[int, list[int]] = defaultdict(list)
    for number in kept:
        for inner in form.parts[number].parts:
            users[inner].append(number)
    shared: set[int] = set()
    """Parts that are used twice, and their descendants."""
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
    def __init__(self, monotone: bool) -> None:
        self._monotone = monotone
        self.parts: list[NumberedPart] = []
        self.several: set[int] = set()
        """Parts with several users."""
        self._always: list[int] = []

    def add(self, part: NumberedPart, *, shared: bool) -> int:
        found = in_at_least(len(part.parts) - part.need + 1, [self._always[inner] for inner in part.parts])
        self._always.append(found | shared << len(self.parts))
        self.parts.append(part)
        return len(self.parts) - 1

    def simple(self, part: NumberedPart, *, taken_over: bool = False) -> NumberedPart | int:
        """Return the simplified part, or the number of an equal part.

        `taken_over`: the only user has the same kind and absorbs the children.
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
            # each once, without parts that another one implies
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
        """Return the numbers with parts of the same kind replaced by their children.

        A choice that another part uses stays.
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
"""A placeholder for differing contexts."""


class Anatomy:
    """Simplified parts with the facts that the translation needs.

    - `events`: the events of a part.
    - `rivals`: other events that one trace event may match together with an event of the part; variables
      and guards are ignored, so non-rivals are certain.
    - `unit`: the EVENT parts, if every scenario of the part has exactly one event.
    - `tangled`: whether parts below share occurrences.
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
        """Return whether two parts of one scenario share an occurrence."""
        this = self.parts[part]
        return this.op is not PartKind.ONE and meet((self.events[inner], self.events[inner]) for inner in this.parts)

    def rivals_apart(self, part: int) -> bool:
        """Return whether no event can match occurrences in two children."""
        return not meet((self.events[inner], self.rivals[inner]) for inner in self.parts[part].parts)

    def below(self, part: int) -> list[int]:
        """Return the part and its descendants, children first."""
        return NumberedParts(tuple(self.parts[: part + 1])).kept()

    def is_separable(self, root: int) -> bool:
        """Return whether parts with shared occurrences may be translated separately (`scattered`
        only).

        A shared part is then written once per use, and different events may match the uses. This is
        correct if a match from one position is possible from every earlier one: the latest match
        then serves all uses with the same continuation, and the earliest one all uses with the same
        start. Each condition is necessary: `and (sand x s) (sand s y)` would accept s y x s.
        """
        kept = self.below(root)
        unordered = (part for part in kept if self.parts[part].op in (PartKind.ALL, PartKind.AT_LEAST))
        return all(map(self.rivals_apart, unordered)) and self._uses_agree(kept) and self._always_feasible(root)

    def _uses_agree(self, kept: Sequence[int]) -> bool:
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
        around = NumberedParts(tuple(self.parts[: root + 1])).around(dict(enumerate(self.events)))
        events = (number for number, part in enumerate(self.parts) if part.op is PartKind.EVENT)
        return transitive([around.get(number, 0) for number in events]) is not None


GuardsOf: TypeAlias = Mapping[Event, tuple[Guard, ...]]
"""For each event, its guards in all scenarios."""


def settled(form: NumberedParts, *, monotone: bool, work: Work) -> Iterator[tuple[NumberedParts, GuardsOf]]:
    """Yield divisions of the scenarios in which the guards of each event are fixed.

    A guard is conjoined to each event that binds one of its variables. If only some scenarios with
    such an event contain the guard, the deciding choices are split.
    """
    if not form.guards:
        yield form, {}
        return

    def look(candidate: NumberedParts) -> GuardsOf | int:
        work.step(10 * len(candidate.parts))
        return _placed(candidate)

    yield from divided(form, look, at_least=not monotone)


def _placed(form: NumberedParts) -> GuardsOf | int:
    """Return the guards of each event, or a part whose choice decides about one."""
    below = form.below()
    kept = list(below)
    always: dict[int, int] = {}
    for number in kept:
        part = form.parts[number]
        missable = len(part.parts) - part.need + 1
        always[number] = 1 << number | in_at_least(missable, [always[inner] for inner in part.parts])
    above: dict[int, int] = {kept[-1]: 0}
    """Per part, itself and its dominators."""
    certain: dict[int, int] = {}
    """Per part, parts that are in every scenario with it."""
    for number in reversed(kept):
        certain[number] = always[number] | certain.get(_lowest(above[number]), 0)
        above[number] |= 1 << number
        for inner in form.parts[number].parts:
            above[inner] = above.get(inner, -1) & above[number]
    placed: defaultdict[Event, list[Guard]] = defaultdict(list)
    events = [number for number in kept if form.parts[number].op is PartKind.EVENT]
    binding: defaultdict[str, dict[int, int]] = defaultdict(dict)
    """The events of each variable, each with its place."""
    for place, event in enumerate(events):
        for name in rigid_variables(form.parts[event].event.pattern):
            binding[name][event] = place
    parents: defaultdict[int, list[int]] = defaultdict(list)
    for whole in kept:
        for inner in form.parts[whole].parts:
            parents[inner].append(whole)
    for number, guard in form.guards:
        if number not in below:
            continue
        together = below[number]
        """The parts that some scenario may contain beside the condition."""
        wholes = {number}
        for whole in (agenda := [number]):
            agenda += (new := [one for one in parents[whole] if one not in wholes])
            wholes.update(new)
        for part in (form.parts[whole] for whole in wholes):
            leading = set[int]() if part.op is PartKind.ONE else wholes & {*part.parts}
            if leading:
                together |= union(below[inner] for inner in part.parts if leading != {inner})
        having = {event: place for name in guard_variables(guard) for event, place in binding[name].items()}
        for event in sorted(having, key=having.__getitem__):
            if certain[event] >> number & 1:
                placed[form.parts[event].event].append(guard)
            elif together >> event & 1:
                # the topmost choice between the part and the nearest common dominator decides
                between = bits(below[_lowest(above[event] & above[number])])
                return max(p for p in between if form.parts[p].chooses and below[p] >> number & 1)
    return {event: tuple(dict.fromkeys(guards)) for event, guards in placed.items()}


def _lowest(members: int) -> int:
    return (members & -members).bit_length() - 1
