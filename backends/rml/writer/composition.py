r"""The translation gate by gate, for plain trees: a term of the size of the tree.

strict, projected: `or` is `\/`, `and` is `|`, `sand` is juxtaposition; VOT is a shuffle of optional parts, of which at least K must be taken:
`(a? | b? | c?) /\ (any any any*)`, or `/\ (any any)` where nothing can follow. (The monitor in ROSMonitoring does not know `any{2}`.)
scattered: an event is awaited with `not_a* a` and followed by the rest; `and` awaits each child on its own and joins with `/\`.
"""

from collections.abc import Generator, Iterable
from functools import reduce
from itertools import pairwise
from operator import or_
from typing import Any, TypeAlias

from backends.rml.writer.conditions import Every, when_true
from backends.rml.writer.determinise import Letter, Letters
from backends.rml.writer.observations import overlaps, pattern
from backends.rml.writer.scenarios import bits, constant, impossible
from backends.rml.writer.terms import (
    ALL,
    ANY,
    Equations,
    Join,
    Name,
    Operator,
    Term,
    both,
    either,
    filtered,
    optional,
    shuffle,
    star,
    then,
)
from rvaft.model.guards import variables as guard_variables
from rvaft.model.nodes import Causality, Gate, Node
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics

# When a tree can be written gate by gate, and what is needed to do so.
#
# A tree is *plain* where its parts can be told apart by the events alone:
# - no variable is remembered and no node is shared; guards hold always or speak of their own node's event only;
# - a part has an event in each of its scenarios, or has none at all and is left out (under a choice it may not be left out).
# Then a gate can be written by its operator under these conditions, `overlap` meaning that one event might match both patterns:
# - under `strict` and `projected`: `or`, no first events of two children overlap; `and` and VOT, no events of two children overlap;
#   VOT, no event of it overlaps with one that may come next after it, and its children can be counted: each has *marks*, events of which
#   every scenario of it has exactly one, and no mark overlaps with another event of the same child;
# - under `scattered`: `or` over parts that are one event in each scenario; `and`, no events of two children overlap; VOT is like `or` for K = 1 and like
#   `and` for K = n, otherwise not.
# Where K children end the whole match at once (*decided*), `strict` and `projected` have exactly K of them too.
# RML commits to the left operand that can take an event; under these conditions no other one could have.


class Plain:
    """What a translation gate by gate looks at; sets of occurrences are integers. `possible` says whether there is one."""

    def __init__(self, tree: RVAFT, letters: Letters, semantics: Semantics) -> None:
        self.tree = tree
        self.letters: list[Letter] = []
        self.index = {name: i for i, name in enumerate(tree.occurrences)}
        self.part: dict[str, int] = {}
        self.first: dict[str, int] = {}
        self.marks: dict[str, int] = {}
        self.follow: dict[str, int] = {}
        self._single: dict[str, bool] = {}
        self._last: set[str] = set()
        """The nodes whose children end the whole match: nothing may come after these or beside them."""
        self._touched: dict[str, int] = {}
        self._touched_first: dict[str, int] = {}
        self._touched_marks: dict[str, int] = {}
        self._scattered = semantics is Semantics.SCATTERED
        self.possible = self._prepared(letters) and all(self._gate_fits(node) for node in tree.top_down())

    def children(self, node: Node) -> tuple[str, ...]:
        """The children with events, in the order of time where the gate gives one."""
        kept = tuple(child for child in node.children if self.part[child])
        return kept[::-1] if node.gate is Gate.SAND_RL else kept

    def single_events(self, node: Node) -> bool:
        """Whether each child is one event in each scenario, so that events are counted where children are."""
        return all(self._single[child] for child in self.children(node))

    def decided(self, node: Node) -> bool:
        """Whether the match ends with the event that makes enough children of the gate: one more can never be needed."""
        return node.name in self._last and self.single_events(node)

    def _prepared(self, letters: Letters) -> bool:
        if letters.observations.remembered or self.tree.shared:
            return False
        for node in self.tree.top_down():
            own = node.has_event and node.when is not None and set(guard_variables(node.when)) <= _own(node)
            if impossible(node) or not (node.when is None or constant(node) or own):
                return False
        for name, i in self.index.items():
            guarded = self.tree.nodes[name].when is not None and not constant(self.tree.nodes[name])
            letter = letters.letter(i, {}, [name] if guarded else [])
            if letter is None:
                return False
            self.letters.append(letter)
        self._overlap = overlaps([pattern(self.tree, letter.call) for letter in self.letters])
        for node in self.tree.bottom_up():
            self._look_below(node)
        self._look_behind()
        return True

    def _look_below(self, node: Node) -> None:
        own = 1 << self.index[node.name] if node.name in self.index else 0
        self.part[node.name] = own
        for child in node.children:
            self.part[node.name] |= self.part[child]
        children = self.children(node)
        firsts = 0
        for child in children[:1] if node.gate is not None and node.gate.ordered else children:
            firsts |= self.first[child]
        choice = len(children) == 1 or self.joined(node) is Gate.OR
        self._single[node.name] = not children if own else choice and self.single_events(node)
        top_down = self.tree.causality is Causality.TOP_DOWN
        self.first[node.name] = own if own and (top_down or not firsts) else firsts
        # what overlaps with a part or its first events; kept per node, for a set of bits is slow to walk
        touched = self._overlap[self.index[node.name]] if own else 0
        touched_first = 0
        for child in children:
            if self.first[child] & self.first[node.name]:
                touched_first |= self._touched_first[child]
        self._touched_first[node.name] = touched if self.first[node.name] == own else touched_first
        for child in children:
            touched |= self._touched[child]
        self._touched[node.name] = touched
        marks, touched_marks = (own, self._overlap[self.index[node.name]]) if own else self._marked(node)
        self.marks[node.name], self._touched_marks[node.name] = marks, touched_marks

    def _marked(self, node: Node) -> tuple[int, int]:
        """The marks of a gate without an event, none where there are none, and what they overlap with."""
        marked = [(self.marks[c], self._touched_marks[c]) for c in self.children(node)]
        match self.joined(node):
            case Gate.OR if all(marks for marks, _ in marked):
                return reduce(or_, (marks for marks, _ in marked)), reduce(or_, (touched for _, touched in marked))
            case Gate.OR | Gate.VOT:
                return 0, 0
            case _:
                return next((pair for pair in marked if pair[0]), (0, 0))

    def _look_behind(self) -> None:
        """Which events may come right after a part, and which parts are the last."""
        self.follow[self.tree.root] = 0
        self._last.add(self.tree.root)
        for node in self.tree.top_down():
            bottom_up = self.tree.causality is Causality.BOTTOM_UP
            after = self.follow[node.name]
            if bottom_up and node.name in self.index:
                after = 1 << self.index[node.name]
                self._last.discard(node.name)
            children = self.children(node)
            ordered = node.gate is not None and node.gate.ordered
            self.follow.update(dict.fromkeys(node.children, after))
            for child, following in pairwise(children):
                if ordered:
                    self.follow[child] = self.first[following]
            if node.name in self._last:
                match self.joined(node):
                    case Gate.OR:
                        self._last.update(children)
                    case Gate.AND | Gate.VOT:
                        pass  # any child may be the last one
                    case _:
                        self._last.update(children[-1:])

    def _gate_fits(self, node: Node) -> bool:
        children = self.children(node)
        if node.gate in (Gate.OR, Gate.VOT) and 0 < len(children) < len(node.children):
            return False
        match self.joined(node):
            case Gate.OR if self._scattered:
                return self.single_events(node)
            case Gate.OR:
                return _apart((self._touched_first[child], self.first[child]) for child in children)
            case Gate.AND:
                return _apart((self._touched[child], self.part[child]) for child in children)
            case Gate.VOT:
                return (
                    not self._scattered
                    and _apart((self._touched[child], self.part[child]) for child in children)
                    and not any(self._touched[c] & self.follow[c] for c in children)
                    and all(self.marks[c] for c in children)
                    and not any(self._touched_marks[c] & self.part[c] & ~self.marks[c] for c in children)
                )
            case _:
                return True

    def joined(self, node: Node) -> Gate | None:
        """The gate that decides how the children are written; None where there is at most one."""
        count = len(self.children(node))
        if count < 2:
            return None
        if node.gate is Gate.VOT and node.threshold == count:
            return Gate.AND
        if node.gate is Gate.VOT and node.threshold == 1 and (self._scattered or self.decided(node)):
            return Gate.OR
        return node.gate


def _apart(parts: Iterable[tuple[int, int]]) -> bool:
    """Whether no events of two parts overlap; of each what it overlaps with and its events."""
    seen = 0
    for touched, part in parts:
        if touched & seen:
            return False
        seen |= part
    return True


def _own(node: Node) -> set[str]:
    return {a.name for a in node.on.arguments if hasattr(a, "name")} if node.on is not None else set()


Steps: TypeAlias = Generator["Steps", Any, Term]
"""A computation that yields the computations it needs and is sent their results: recursion without a deep stack."""


class Composition:
    """Terms for the parts of a plain tree; `equations` holds what was given a name."""

    def __init__(self, plain: Plain, letters: Letters) -> None:
        self.plain = plain
        self.tree = plain.tree
        self.letters = letters
        self.equations = Equations("P")
        self.types = [self._type(index) for index in range(len(plain.letters))]

    # -- strict and projected -----------------------------------------------------------------------------------------

    def contiguous(self) -> Term:
        """The whole tree where the events of a match follow one another."""
        done: dict[str, Term] = {}
        for node in self.tree.bottom_up():
            if self.plain.part[node.name]:
                parts = [done[child] for child in self.plain.children(node)]
                body = [self._joined(node, parts)] if parts else []
                own = [self._event(node.name)] if node.has_event else []
                in_time = [*own, *body] if self.tree.causality is Causality.TOP_DOWN else [*body, *own]
                done[node.name] = self.equations.shallow(self._sequence(in_time))
        return then(done[self.tree.root], ALL)

    def _sequence(self, parts: list[Term]) -> Term:
        """The parts one after the other; a shuffle behind a name gets a name, for `a (b | c)` is an event type with a pattern."""
        whole = then(*parts)
        if not (isinstance(whole, Join) and whole.operator is Operator.THEN):
            return whole
        first, *others = whole.parts
        return then(first, *(self.equations.named(part) if _is_shuffle(part) else part for part in others))

    def _joined(self, node: Node, parts: list[Term]) -> Term:
        match self.plain.joined(node):
            case Gate.OR:
                return either(parts)
            case Gate.AND:
                return shuffle(parts)
            case Gate.VOT:
                return both([shuffle(optional(part) for part in parts), self._enough(node)])
            case _:
                return self._sequence(parts)

    def _enough(self, node: Node) -> Term:
        """At least K parts are taken: of single events any may be counted, else one of each part is. Exactly K where that is the end."""
        least = then(*[ANY] * (node.threshold or 0))
        if self.plain.decided(node):
            return least
        enough = then(least, star(ANY))
        if self.plain.single_events(node):
            return enough
        marks = [self.types[i] for child in self.plain.children(node) for i in bits(self.plain.marks[child])]
        return filtered(self.letters.types.union(marks, f"{node.name}_counted"), enough)

    # -- scattered ----------------------------------------------------------------------------------------------------

    def scattered(self) -> Term:
        """The whole tree where any events may stand between those of a match."""
        return _run(self._awaited(self.tree.nodes[self.tree.root], ALL))

    def _awaited(self, node: Node, after: Term) -> Steps:
        """The events of a part, then the rest."""
        if not self.plain.part[node.name]:
            return after
        own = [self.plain.index[node.name]] if node.has_event else []
        if self.tree.causality is Causality.BOTTOM_UP:
            after = self._await(own, after)
            body: Term = yield self._body(node, after)
            return body
        body = yield self._body(node, after)
        return self._await(own, body)

    def _body(self, node: Node, after: Term) -> Steps:
        children = self.plain.children(node)
        match self.plain.joined(node):
            case Gate.OR:
                return self._await([i for child in children for i in bits(self.plain.part[child])], after)
            case Gate.AND:
                rest = after if after == ALL else self.equations.named(after)
                parts = []
                for child in children:
                    part = yield self._awaited(self.tree.nodes[child], rest)
                    parts.append(part)
                return both(parts)
            case _:
                for child in reversed(children):
                    after = yield self._awaited(self.tree.nodes[child], after)
                return after

    def _await(self, occurrences: list[int], after: Term) -> Term:
        """Any number of other events, one of these, then the rest."""
        if not occurrences:
            return after
        wanted = [self.types[i] for i in occurrences]
        hint = f"not_{self.tree.occurrences[occurrences[0]]}"
        other = self.letters.types.neither(wanted, hint)
        return self.equations.shallow(then(star(Name(other)), either(Name(text) for text in wanted), after))

    # -- events -------------------------------------------------------------------------------------------------------

    def _event(self, name: str) -> Term:
        return Name(self.types[self.plain.index[name]])

    def _type(self, index: int) -> str:
        """One event type for an occurrence, its own guard folded in."""
        letter = self.plain.letters[index]
        texts = self.letters.texts(letter)
        if len(texts) == 1:
            return texts[0]
        name = self.tree.occurrences[index]
        condition = Every(tuple(when_true(guard) for guard in letter.guards))
        return self.letters.types.union(self.letters.types.checked(letter.call, condition, name), name)


def _is_shuffle(term: Term) -> bool:
    return isinstance(term, Join) and term.operator is Operator.SHUFFLE


def _run(steps: Steps) -> Term:
    stack = [steps]
    result: Term | None = None
    while stack:
        try:
            stack.append(stack[-1].send(result))
            result = None
        except StopIteration as stop:
            stack.pop()
            result = stop.value
    assert result is not None
    return result
