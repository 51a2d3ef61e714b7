r"""The translation gate by gate, for plain trees: a term of the size of the tree.

strict, projected: `or` is `\/`, `and` is `|`, `sand` is juxtaposition; VOT is a shuffle of optional parts, of which at least K must be taken:
`(a? | b? | c?) /\ (any any any*)`, or `/\ (any any)` where nothing can follow. (The monitor in ROSMonitoring does not know `any{2}`.)
scattered: an event is awaited with `not_a* a` and followed by the rest; `and` awaits each child on its own and joins with `/\`.
"""

from collections.abc import Generator
from typing import Any, TypeAlias

from backends.rml.translation.conditions import Every, when_true
from backends.rml.translation.letters import Letters
from backends.rml.translation.plain import Plain
from backends.rml.translation.scenarios import bits
from backends.rml.translation.terms import (
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
from rvaft.model import Causality, Gate, Node

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
