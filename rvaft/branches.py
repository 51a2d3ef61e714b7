"""Branches: the unit that properties are extracted from (semantics, section 2).

A branch resolves the `or` gates and keeps `KofN`. Branches are enumerated lazily, in the order of their numbers: the digits of
a branch are the choices of the `or` gates in breadth-first order from the root, the first varying fastest; a gate that
the branch does not reach has digit 0. The search goes from the slowest digit to the fastest and carries the choices that
digits above 0 force upon the gates nearer the root, so it never enters a dead end.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import islice

from rvaft.errors import TooLarge, TreeError
from rvaft.formulas import TEXT, formula, write
from rvaft.model import Gate, Kind
from rvaft.tree import RVAFT

DEFAULT_LIMIT = 20_000

Digits = dict[int, int]


@dataclass(frozen=True)
class Branch:
    """One branch; `choices` maps each `or` gate it reaches to the child it keeps."""

    tree: RVAFT
    number: int
    choices: Mapping[str, str]

    @cached_property
    def nodes(self) -> tuple[str, ...]:
        """Its nodes, parents before children."""
        kept = _kept(self.tree, self.choices)
        return tuple(name for name in self.tree.order if name in kept)

    @cached_property
    def kinds(self) -> frozenset[Kind]:
        """The kinds of its nodes."""
        return frozenset(kind for name in self.nodes if (kind := self.tree.nodes[name].kind) is not None)

    @cached_property
    def formula(self) -> str:
        """The property as text: `;` in sequence, `&` in any order, `|` a choice, conditions in brackets."""
        return write(formula(self.tree, self.nodes, self.children), TEXT)

    def children(self, name: str) -> tuple[str, ...]:
        """The children of a node that the branch keeps."""
        return (self.choices[name],) if name in self.choices else self.tree.nodes[name].children


def branches(tree: RVAFT) -> Iterator[Branch]:
    """All branches of a tree in the order of their numbers, from 1; lazily, since there may be very many."""
    search = _Search(tree)
    for number, digits in enumerate(search.vectors(), 1):
        yield Branch(tree, number, search.choices(digits))


def branch(tree: RVAFT, number: int) -> Branch:
    """The branch of that number; raises `TreeError` where there is none."""
    found = next(islice(branches(tree), number - 1, None), None) if number >= 1 else None
    if found is None:
        count = sum(1 for _ in islice(branches(tree), max(number, 0)))
        has = f"has {count}" if number >= 1 else "counts them from 1"
        raise TreeError(f"there is no branch {number}: the tree {has}", rule="no-branch")
    return found


def number_of(
    tree: RVAFT, choices: Mapping[str, str], *, kind: Kind | None = None, limit: int = DEFAULT_LIMIT
) -> int | None:
    """The lowest number of a branch that makes these choices (and has that kind), or None beyond `limit` branches."""
    for candidate in islice(branches(tree), limit):
        if all(candidate.choices.get(name) == child for name, child in choices.items()) and (
            kind is None or kind in candidate.kinds
        ):
            return candidate.number
    return None


def _kept(tree: RVAFT, choices: Mapping[str, str]) -> frozenset[str]:
    kept: set[str] = set()
    agenda = [tree.root]
    while agenda:
        name = agenda.pop()
        if name not in kept:
            kept.add(name)
            agenda.extend((choices[name],) if name in choices else tree.nodes[name].children)
    return frozenset(kept)


class _Search:
    """The enumeration of digit vectors for one tree."""

    def __init__(self, tree: RVAFT) -> None:
        self.tree = tree
        self.gates = [name for name in _breadth_first(tree) if tree.nodes[name].gate is Gate.OR]
        self.position = {name: index for index, name in enumerate(self.gates)}

    def choices(self, digits: Digits) -> dict[str, str]:
        """The choices of the `or` gates that a vector reaches."""
        picked = {name: self.tree.nodes[name].children[digits[i]] for i, name in enumerate(self.gates)}
        kept = _kept(self.tree, picked)
        return {name: child for name, child in picked.items() if name in kept}

    def vectors(self) -> Iterator[Digits]:
        """All vectors that are branches, the last gate's digit varying slowest."""
        if not self.gates:
            yield {}
            return
        digits: Digits = {}
        # One level per gate, slowest first: the options left there, and the sets of forced digits that each leads to.
        levels = [self._options(len(self.gates) - 1, digits, [{}])]
        while levels:
            index = len(self.gates) - len(levels)
            step = next(levels[-1], None)
            digits.pop(index, None)
            if step is None:
                levels.pop()
                continue
            digits[index], forced = step
            if index == 0:
                yield dict(digits)
            else:
                levels.append(self._options(index - 1, digits, forced))

    def _options(self, index: int, digits: Digits, forced: list[Digits]) -> Iterator[tuple[int, list[Digits]]]:
        for digit in range(len(self.tree.nodes[self.gates[index]].children)):
            allowed = [way for way in forced if way.get(index, digit) == digit]
            if digit and allowed:
                above = {i: d for i, d in digits.items() if i > index} | {index: digit}
                allowed = [
                    merged
                    for way in allowed
                    for context in self._contexts(self.gates[index])
                    if (merged := _merge(way, context)) is not None and _merge(merged, above) is not None
                ]
            if allowed:
                yield digit, allowed

    def _contexts(self, name: str) -> list[Digits]:
        """The ways to reach a gate: each the digits of the `or` gates on one path from the root."""
        ways: list[Digits] = []
        agenda: list[tuple[str, Digits]] = [(name, {})]
        while agenda:
            node, context = agenda.pop()
            if node == self.tree.root and context not in ways:
                ways.append(context)
            for parent in self.tree.parents(node):
                position = self.position.get(parent)
                if position is None:
                    agenda.append((parent, context))
                else:
                    digit = self.tree.nodes[parent].children.index(node)
                    agenda.append((parent, context | {position: digit}))
            if len(ways) > DEFAULT_LIMIT or len(agenda) > DEFAULT_LIMIT:
                raise TooLarge(f"ways to reach {name}", limit=DEFAULT_LIMIT)
        return ways


def _merge(left: Digits, right: Digits) -> Digits | None:
    if any(right.get(index, digit) != digit for index, digit in left.items()):
        return None
    return left | right


def _breadth_first(tree: RVAFT) -> list[str]:
    order, seen = [tree.root], {tree.root}
    for name in order:
        for child in tree.nodes[name].children:
            if child not in seen:
                seen.add(child)
                order.append(child)
    return order
