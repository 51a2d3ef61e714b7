r"""The translation gate by gate, for plain trees: a term of the size of the tree.

strict, projected: `or` is `\/`, `and` is `|`, `sand` is juxtaposition; VOT is a shuffle of optional parts, of which at least K must be taken:
`(a? | b? | c?) /\ (any any any*)`, or `/\ (any any)` where nothing can follow. (The monitor in ROSMonitoring does not know `any{2}`.)
scattered: an event is awaited with `not_a* a` and followed by the rest; `and` awaits each child on its own and joins with `/\`.

A tree is *plain* where its parts can be told apart by the events alone:
- no variable is remembered and no node is shared; guards hold always or speak of their own node's event only;
- a part has an event in each of its scenarios, or has none at all and is left out (under a choice it may not be left out).
Then a gate can be written by its operator under these conditions, `overlap` meaning that one event might match both patterns:
- under `strict` and `projected`: `or`, no first events of two children overlap; `and` and VOT, no events of two children overlap;
  VOT, no event of it overlaps with one that may come next after it, and its children can be counted: each has *marks*, events of which
  every scenario of it has exactly one, and no mark overlaps with another event of the same child;
- under `scattered`: `or` over parts that are one event in each scenario; `and`, no events of two children overlap; VOT is like `or` for K = 1 and like
  `and` for K = n, otherwise not.
Where K children end the whole match at once (*decided*), `strict` and `projected` have exactly K of them too.
RML commits to the left operand that can take an event; under these conditions no other one could have.
"""

from collections.abc import Iterable
from itertools import pairwise
from typing import assert_never

from backends.rml.writer.conditions import when_true
from backends.rml.writer.determinise import RmlLetter, RmlLetters
from backends.rml.writer.observations import own_variables
from backends.rml.writer.terms import ALL, AND, ANY, OR, SHUFFLE, THEN, Equations, Written, around, join, named, then
from rvaft.analysis.normal_form import Op, is_constant, is_impossible, normal_form
from rvaft.analysis.unification import Overlaps
from rvaft.model.guards import Operation, Operator, variables
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics
from rvaft.support.bits import bits, union
from rvaft.support.trampoline import Call, run


class Plain:
    """What a translation gate by gate looks at; sets of occurrences are integers. `possible` says whether there is one.

    Everything is known for the numbers of the parts of the normal form: `events` and `first` events, `marks`, what `follows`, and what
    overlaps with each of these.
    """

    def __init__(self, tree: RVAFT, letters: RmlLetters, semantics: Semantics) -> None:
        self.tree = tree
        self.form = normal_form(tree, as_written=True)
        self.letters: list[RmlLetter] = []
        self._scattered = semantics is Semantics.SCATTERED
        size = len(self.form.parts)
        self.events, self.first, self.marks, self.follow = ([0] * size for _ in range(4))
        self._near, self._near_first, self._near_marks = ([0] * size for _ in range(3))
        """What overlaps with the events, the first events and the marks; kept, for a set of bits is slow to walk."""
        self._single = [False] * size
        self._last = {self.form.root}
        """The parts that end the whole match: nothing may come after these or beside them."""
        self.possible = self._has_letters(letters) and all(map(self._fits, range(size)))

    def children(self, number: int) -> tuple[int, ...]:
        """The parts with events, in the order of time where there is one."""
        return tuple(part for part in self.form.parts[number].parts if self.events[part])

    def single_events(self, number: int) -> bool:
        """Whether each child is one event in each scenario, so that events are counted where children are."""
        return all(self._single[child] for child in self.children(number))

    def decided(self, number: int) -> bool:
        """Whether the match ends with the event that makes enough children of a VOT: one more can never be needed."""
        return number in self._last and self.single_events(number)

    def joined(self, number: int) -> Op:
        """How the children are written; where there is at most one, as a SEQUENCE."""
        part, count = self.form.parts[number], len(self.children(number))
        if count < 2:
            return Op.SEQUENCE
        if part.op is Op.AT_LEAST and part.need == count:
            return Op.ALL
        if part.op is Op.AT_LEAST and part.need == 1 and (self._scattered or self.decided(number)):
            return Op.ONE
        return part.op

    def _has_letters(self, letters: RmlLetters) -> bool:
        if letters.observations.remembered or self.tree.shared:
            return False
        guarded = [node for node in self.tree.top_down() if node.when is not None and not is_constant(node)]
        if any(map(is_impossible, self.tree.nodes.values())) or not all(
            node.has_event and set(variables(node.when)) <= set(own_variables(node.on))  # type: ignore[arg-type]
            for node in guarded
        ):
            return False
        names = {node.name for node in guarded}
        for index, name in enumerate(self.tree.occurrences):
            letter = letters.letter(index, {}, names & {name})
            if letter is None:
                return False
            self.letters.append(letter)
        overlaps = Overlaps([letter.call.pattern(self.tree) for letter in self.letters])
        position = {name: index for index, name in enumerate(self.tree.occurrences)}
        for number, part in enumerate(self.form.parts):
            if part.op is Op.EVENT:
                own, near = 1 << position[part.node], overlaps.compatible(position[part.node])
                self.events[number] = self.first[number] = self.marks[number] = own
                self._near[number] = self._near_first[number] = self._near_marks[number] = near
                self._single[number] = True
            else:
                self._look_below(number)
        for number in reversed(range(len(self.form.parts))):
            self._look_behind(number)
        return True

    def _look_below(self, number: int) -> None:
        part = self.form.parts[number]
        self.events[number] = union(self.events[inner] for inner in part.parts)
        self._near[number] = union(self._near[inner] for inner in part.parts)
        children, joined = self.children(number), self.joined(number)
        first = children[:1] if part.op is Op.SEQUENCE else children
        self.first[number] = union(self.first[child] for child in first)
        self._near_first[number] = union(self._near_first[child] for child in first)
        alone = len(children) == 1 or joined is Op.ONE
        self._single[number] = alone and self.single_events(number)
        own = [c for c in children if self.form.parts[c].op is Op.EVENT and self.form.parts[c].node == part.node]
        marked = own or [child for child in children if self.marks[child]]
        if joined is Op.ONE:
            marked = marked if len(marked) == len(children) else []
        else:
            marked = [] if joined is Op.AT_LEAST else marked[:1]
        self.marks[number] = union(self.marks[child] for child in marked)
        self._near_marks[number] = union(self._near_marks[child] for child in marked)

    def _look_behind(self, number: int) -> None:
        """Which events may come right after the children, and which of them are the last."""
        children, joined = self.children(number), self.joined(number)
        for child in children:
            self.follow[child] = self.follow[number]
        for child, following in pairwise(children) if self.form.parts[number].op is Op.SEQUENCE else ():
            self.follow[child] = self.first[following]
        if number in self._last and joined in (Op.ONE, Op.SEQUENCE):  # of the others any child may be the last one
            self._last.update(children if joined is Op.ONE else children[-1:])

    def _fits(self, number: int) -> bool:
        part, children = self.form.parts[number], self.children(number)
        if part.op in (Op.ONE, Op.AT_LEAST) and 0 < len(children) < len(part.parts):
            return False
        match self.joined(number):
            case Op.ONE if self._scattered:
                return self.single_events(number)
            case Op.ONE:
                return _are_apart((self._near_first[child], self.first[child]) for child in children)
            case Op.ALL:
                return _are_apart((self._near[child], self.events[child]) for child in children)
            case Op.AT_LEAST:
                return (
                    not self._scattered
                    and _are_apart((self._near[child], self.events[child]) for child in children)
                    and not any(self._near[c] & self.follow[c] for c in children)
                    and all(self.marks[c] for c in children)
                    and not any(self._near_marks[c] & self.events[c] & ~self.marks[c] for c in children)
                )
            case Op.SEQUENCE | Op.EVENT | Op.CONDITION:
                return True
            case never:
                assert_never(never)


def _are_apart(parts: Iterable[tuple[int, int]]) -> bool:
    """Whether no events of two parts overlap; of each what it overlaps with and its events."""
    seen = 0
    for near, events in parts:
        if near & seen:
            return False
        seen |= events
    return True


class Composition:
    """Terms for the parts of a plain tree; `equations` holds what was given a name."""

    def __init__(self, plain: Plain, letters: RmlLetters) -> None:
        self.plain = plain
        self.tree = plain.tree
        self.letters = letters
        self.equations = Equations()
        self.types = [self._type(index) for index in range(len(plain.letters))]

    def _type(self, index: int) -> str:
        """One event type for an occurrence, its own guard folded in."""
        letter = self.plain.letters[index]
        texts = self.letters.texts(letter)
        if len(texts) == 1:
            return texts[0]
        name, types = self.tree.occurrences[index], self.letters.types
        condition = Operation(Operator.AND, tuple(map(when_true, letter.guards)))
        return types.union(types.checked(letter.call, condition, name), name)

    def _types(self, occurrences: int) -> list[str]:
        return [self.types[index] for index in bits(occurrences)]

    # -- strict and projected: the events of a match follow one another ------------------------------------------------

    def contiguous(self) -> Written:
        """The whole tree where the events of a match follow one another."""
        form, done = self.plain.form, dict[int, Written]()
        for number, part in enumerate(form.parts):
            if not self.plain.events[number]:
                continue
            if part.op is Op.EVENT:
                (name,) = self._types(self.plain.events[number])
                term = named(name)
            else:
                term = self._joined(number, [done[child] for child in self.plain.children(number)])
            done[number] = self.equations.shallow(term) if form.whole[part.node] == number else term
        return then(done[form.root], ALL)

    def _joined(self, number: int, parts: list[Written]) -> Written:
        match self.plain.joined(number):
            case Op.ONE:
                return join(OR, parts)
            case Op.ALL:
                return join(SHUFFLE, parts)
            case Op.AT_LEAST:
                return join(AND, [join(SHUFFLE, (around(part, "?") for part in parts)), self._enough(number)])
            case Op.SEQUENCE | Op.EVENT | Op.CONDITION:
                return self._sequence(parts)
            case never:
                assert_never(never)

    def _sequence(self, parts: list[Written]) -> Written:
        """The parts one after the other; a shuffle behind a name gets a name, for `a (b | c)` is an event type with a pattern."""
        whole = then(*parts)
        if whole.operator != THEN:
            return whole
        first, *others = whole.parts
        return then(first, *(self.equations.called(part) if part.operator == SHUFFLE else part for part in others))

    def _enough(self, number: int) -> Written:
        """At least K parts are taken: of single events any may be counted, else one of each part is. Exactly K where that is the end."""
        part = self.plain.form.parts[number]
        least = then(*[ANY] * part.need)
        if self.plain.decided(number):
            return least
        enough = then(least, around(ANY, "*"))
        if self.plain.single_events(number):
            return enough
        marks = [name for child in self.plain.children(number) for name in self._types(self.plain.marks[child])]
        return around(enough, ">>", self.letters.types.union(marks, f"{part.node}_counted"))

    # -- scattered: any events may stand between those of a match ------------------------------------------------------

    def scattered(self) -> Written:
        """The whole tree where any events may stand between those of a match."""
        return run(self._awaited(self.plain.form.root, ALL))

    def _awaited(self, number: int, after: Written) -> Call[Written]:
        """The events of a part, then the rest."""
        children, form = self.plain.children(number), self.plain.form
        match Op.EVENT if form.parts[number].op is Op.EVENT else self.plain.joined(number):
            case Op.ONE | Op.EVENT:
                return self._await(self.plain.events[number], after)
            case Op.ALL:
                rest = after if after == ALL else self.equations.called(after)
                parts = list[Written]()
                for child in children:
                    part = yield self._awaited(child, rest)
                    parts.append(part)
                return join(AND, parts)
            case Op.SEQUENCE | Op.CONDITION:
                for child in reversed(children):
                    after = yield self._awaited(child, after)
                return after
            case Op.AT_LEAST:
                raise AssertionError("no vote is left in a plain tree under `scattered`")
            case never:
                assert_never(never)

    def _await(self, occurrences: int, after: Written) -> Written:
        """Any number of other events, one of these, then the rest."""
        wanted = self._types(occurrences)
        hint = f"not_{self.tree.occurrences[next(bits(occurrences))]}"
        other = self.letters.types.neither(wanted, hint)
        return self.equations.shallow(then(around(named(other), "*"), join(OR, map(named, wanted)), after))
