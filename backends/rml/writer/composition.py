r"""Translation gate by gate for plain trees: a term of the size of the tree.

`strict`, `projected`: `or` becomes `\/`, `and` becomes `|`, `sand` becomes juxtaposition. VOT is a
shuffle of optional parts, of which at least K occur: `(a? | b? | c?) /\ (any any any*)`, or `/\
(any any)` if nothing can follow. (The monitor of ROSMonitoring lacks `any{2}`.) `scattered`: an
event becomes `not_a* a` followed by the rest; `and` awaits each child and joins them with `/\`.

A tree is *plain* if events alone distinguish its parts:

- no variable is remembered, no node is shared, and guards are constant or concern only the event of
  their node;
- a part has an event in all its scenarios, or in none; parts without events are left out, except
  under a choice.

A gate becomes its operator under these conditions; two patterns *overlap* if one event can match
both:

- `strict`, `projected`: `or`: no first events of two children overlap. `and`, VOT: no events of two
  children overlap. VOT: none of its events overlaps an event that may come next after it. Its
  children are countable: each has *marks*, events of which each of its scenarios has exactly one,
  and no mark overlaps another event of the child;
- `scattered`: `or`: each scenario of its parts has one event. `and`: no events of two children
  overlap. VOT: as `or` for K = 1, as `and` for K = n, else excluded.

If K children complete the match (*decided*), `strict` and `projected` require exactly K. RML
commits to the left operand that can take an event; under these conditions no other operand could.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import assert_never

from backends.rml.writer.event_types import when_true
from backends.rml.writer.letters import RmlLetter, RmlLetters
from backends.rml.writer.terms import ALL, AND, ANY, OR, SHUFFLE, THEN, Written, around, join, named, then
from rvaft.core.overlaps import Overlaps
from rvaft.core.part_numbers import NumberedPart, numbered
from rvaft.core.property import Condition, Event, PartKind, parts_below
from rvaft.model.guards import Operation, Operator, variables
from rvaft.model.patterns import variables as variables_of
from rvaft.model.verdict import Semantics
from rvaft.support.bits import bits, meet, union
from rvaft.support.budget import Call, run


@dataclass(slots=True)
class _Facts:
    """Facts about a part: bit sets of occurrences, and of the occurrences that overlap them
    (`near`).
    """

    part: NumberedPart
    children: Sequence["_Facts"] = ()
    events: int = 0
    first: int = 0
    marks: int = 0
    near: int = 0
    near_first: int = 0
    near_marks: int = 0
    follow: int = 0
    single: bool = False
    last: bool = False

    @property
    def node(self) -> str:
        return self.part.of.source.node if self.part.of is not None and self.part.of.source is not None else ""

    @property
    def single_events(self) -> bool:
        """Whether each scenario of each child has one event, so that counting events counts
        children.
        """
        return all(child.single for child in self.children)

    @property
    def decided(self) -> bool:
        """Whether the match ends at the event that completes enough children of a VOT."""
        return self.last and self.single_events


class Composition:
    """Terms for the parts of a plain tree (if `possible`); `equations` holds the named terms."""

    def __init__(self, letters: RmlLetters, semantics: Semantics) -> None:
        self._prop, self._letters = letters.prop, letters
        self.equations: list[tuple[str, Written]] = []
        self._form = numbered(self._prop)
        inside = {
            inner
            for part in self._prop.parts
            for inner in part.parts
            if inner.source and part.source and inner.source.node == part.source.node
        }
        self._wholes = {number for number, part in enumerate(self._form.parts) if part.of not in inside}
        """The outermost part of each node."""
        self._scattered = semantics is Semantics.SCATTERED
        self._parts: list[_Facts] = []
        self._own: list[RmlLetter] = []
        self.possible = self._has_letters() and self._fits()
        self._types: list[str] = []

    @property
    def has_votes(self) -> bool:
        """Whether a VOT needs counting."""
        return any(self._joined(facts) is PartKind.AT_LEAST for facts in self._parts)

    def _joined(self, facts: _Facts) -> PartKind:
        part, count = facts.part, len(facts.children)
        if count < 2:
            return PartKind.SEQUENCE
        if part.op is PartKind.AT_LEAST and part.need == count:
            return PartKind.ALL
        if part.op is PartKind.AT_LEAST and part.need == 1 and (self._scattered or facts.decided):
            return PartKind.ONE
        return part.op

    # Check that the tree is plain.

    def _has_letters(self) -> bool:
        prop = self._prop
        observing = (any(isinstance(one, Event) for one in parts_below(part)) for part in prop.shared)
        if self._letters.remembered or not prop.feasible or any(observing):
            return False
        guarded: dict[str, list[Condition]] = {}
        for part in prop.parts:
            if isinstance(part, Condition):
                guarded.setdefault(part.source.node, []).append(part)
        bound = {event.source.node: set(variables_of(event.pattern)) for event in prop.events}
        for node, conditions in guarded.items():
            if any(not set(variables(one.guard)) <= bound.get(node, set()) for one in conditions):
                return False
        for index, event in enumerate(prop.events):
            letter = self._letters.letter(index, {}, guarded.get(event.source.node, ()))
            if letter is None:
                return False
            self._own.append(letter)
        return True

    def _fits(self) -> bool:
        overlaps = Overlaps([letter.call.pattern(self._prop.tree) for letter in self._own])
        position = {event: index for index, event in enumerate(self._prop.events)}
        for part in self._form.parts:
            facts = _Facts(part, [child for number in part.parts if (child := self._parts[number]).events])
            self._parts.append(facts)
            if part.op is PartKind.EVENT:
                facts.events = facts.first = facts.marks = 1 << position[part.event]
                facts.near = facts.near_first = facts.near_marks = overlaps.compatible(position[part.event])
                facts.single = True
            else:
                facts.last = len(self._parts) == len(self._form.parts)
                self._look_below(facts)
        for facts in reversed(self._parts):
            joined = self._joined(facts)
            for child in facts.children:
                child.follow = facts.follow
                child.last = (
                    facts.last and joined is PartKind.ONE
                )  # with other operators, any child may be the last one
            for child, following in pairwise(facts.children) if facts.part.op is PartKind.SEQUENCE else ():
                child.follow = following.first
            if facts.last and joined is PartKind.SEQUENCE and facts.children:
                facts.children[-1].last = True
        return all(map(self._is_told_apart, self._parts))

    def _look_below(self, facts: _Facts) -> None:
        children, joined, part = facts.children, self._joined(facts), facts.part
        facts.events = union(child.events for child in children)
        facts.near = union(child.near for child in children)
        first = children[:1] if part.op is PartKind.SEQUENCE else children
        facts.first = union(child.first for child in first)
        facts.near_first = union(child.near_first for child in first)
        facts.single = (len(children) == 1 or joined is PartKind.ONE) and facts.single_events
        own = [child for child in children if child.part.op is PartKind.EVENT and child.node == facts.node]
        marked = own or [child for child in children if child.marks]
        if joined is PartKind.ONE:
            marked = marked if len(marked) == len(children) else []
        else:
            marked = [] if joined is PartKind.AT_LEAST else marked[:1]
        facts.marks = union(child.marks for child in marked)
        facts.near_marks = union(child.near_marks for child in marked)

    def _is_told_apart(self, facts: _Facts) -> bool:
        children, joined = facts.children, self._joined(facts)
        if facts.part.op in (PartKind.ONE, PartKind.AT_LEAST) and 0 < len(children) < len(facts.part.parts):
            return False
        match joined:
            case PartKind.ONE if self._scattered:
                return facts.single_events
            case PartKind.AT_LEAST if self._scattered:
                return False
            case PartKind.ONE:
                return not meet((child.first, child.near_first) for child in children)
            case PartKind.ALL | PartKind.AT_LEAST:
                if meet((child.events, child.near) for child in children):
                    return False
                return joined is not PartKind.AT_LEAST or not any(
                    child.near & child.follow or not child.marks or child.near_marks & child.events & ~child.marks
                    for child in children
                )
            case PartKind.SEQUENCE | PartKind.EVENT | PartKind.CONDITION:
                return True
            case never:
                assert_never(never)

    # Terms.

    def written(self) -> Written:
        """Return the term of the whole tree."""
        self._types = [self._type(*pair) for pair in zip(self._letters.nodes, self._own, strict=True)]
        return run(self._awaited(self._parts[-1], ALL)) if self._scattered else self._contiguous()

    def _type(self, name: str, letter: RmlLetter) -> str:
        texts = self._letters.texts(letter)
        if len(texts) == 1:
            return texts[0]
        types, condition = self._letters.types, Operation(Operator.AND, tuple(map(when_true, letter.guards)))
        return types.union(types.checked(letter.call, condition, name), name)

    def _called(self, term: Written) -> Written:
        self.equations.append((f"P{len(self.equations) + 1}", term))
        return named(self.equations[-1][0])

    def _shallow(self, term: Written) -> Written:
        return self._called(term) if term.is_large else term

    def _contiguous(self) -> Written:
        done = dict[int, Written]()
        for number, facts in enumerate(self._parts):
            if facts.part.op is PartKind.EVENT:
                term = named(self._types[facts.events.bit_length() - 1])
            elif facts.events:
                term = self._contiguous_part(facts, [done[n] for n in facts.part.parts if n in done])
            else:
                continue
            done[number] = self._shallow(term) if number in self._wholes else term
        return then(done[self._form.root], ALL)

    def _contiguous_part(self, facts: _Facts, parts: list[Written]) -> Written:
        match self._joined(facts):
            case PartKind.ONE:
                return join(OR, parts)
            case PartKind.ALL:
                return join(SHUFFLE, parts)
            case PartKind.AT_LEAST:
                return join(AND, [join(SHUFFLE, (around(part, "?") for part in parts)), self._enough(facts)])
            case PartKind.SEQUENCE | PartKind.EVENT | PartKind.CONDITION:
                whole = then(*parts)
                if whole.operator != THEN:
                    return whole
                # A shuffle behind a name needs a name: `a (b | c)` parses as an event type with a
                # pattern.
                first, *others = whole.parts
                return then(first, *(self._called(part) if part.operator == SHUFFLE else part for part in others))
            case never:
                assert_never(never)

    def _enough(self, facts: _Facts) -> Written:
        """Return the term that counts at least K parts; exactly K if that ends the match.

        It counts any event if each part has one, otherwise one mark of each part.
        """
        least = then(*[ANY] * facts.part.need)
        if facts.decided:
            return least
        enough = then(least, around(ANY, "*"))
        if facts.single_events:
            return enough
        marks = [self._types[index] for child in facts.children for index in bits(child.marks)]
        return around(enough, ">>", self._letters.types.union(marks, f"{facts.node}_counted"))

    def _awaited(self, facts: _Facts, after: Written) -> Call[Written]:
        """Return the term for a part with gaps between its events, then the rest."""
        match facts.part.op if facts.part.op is PartKind.EVENT else self._joined(facts):
            case PartKind.ONE | PartKind.EVENT:  # any number of other events, one of these, then the rest
                wanted = [self._types[index] for index in bits(facts.events)]
                first = self._letters.nodes[next(bits(facts.events))]
                other = around(named(self._letters.types.neither(wanted, f"not_{first}")), "*")
                return self._shallow(then(other, join(OR, map(named, wanted)), after))
            case PartKind.ALL:
                rest = after if after == ALL else self._called(after)
                parts = list[Written]()
                for child in facts.children:
                    part = yield self._awaited(child, rest)
                    parts.append(part)
                return join(AND, parts)
            case PartKind.SEQUENCE | PartKind.CONDITION:
                for child in reversed(facts.children):
                    after = yield self._awaited(child, after)
                return after
            case PartKind.AT_LEAST:
                raise AssertionError("no vote is left in a plain tree under `scattered`")
            case never:
                assert_never(never)
