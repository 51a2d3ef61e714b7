"""Branches: the unit that properties are extracted from (semantics, section 2).

A branch resolves the `or` gates and keeps `KofN`. Branches are enumerated lazily, in the order of their numbers: the digits of
a branch are the choices of the `or` gates in breadth-first order from the root, the first varying fastest; a gate that
the branch does not reach has digit 0. The search goes from the slowest digit to the fastest and carries the choices that
digits above 0 force upon the gates nearer the root, so it never enters a dead end.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from typing import Final, NamedTuple

from rvaft.errors import TooLarge, TreeError
from rvaft.model.formula import TEXT, formula, write
from rvaft.model.nodes import Gate, Kind
from rvaft.model.tree import RVAFT, reachable

DEFAULT_LIMIT = 20_000


@dataclass(frozen=True)
class Branch:
    """One branch; `choices` maps each `or` gate it reaches to the child it keeps."""

    tree: RVAFT
    number: int
    choices: Mapping[str, str]

    @cached_property
    def nodes(self) -> tuple[str, ...]:
        """Its nodes, parents before children."""
        kept = set(reachable(self.tree.root, self.children))
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
    for number, digits in enumerate(search.branches(), 1):
        yield Branch(tree, number, search.choices(digits))


def branch(tree: RVAFT, number: int) -> Branch:
    """The branch of that number; raises `TreeError` where there is none."""
    search = _Search(tree)
    count = 0
    for count, digits in enumerate(islice(search.branches(), max(number, 0)), 1):
        if count == number:
            return Branch(tree, number, search.choices(digits))
    has = f"has {count}" if number >= 1 else "counts them from 1"
    raise TreeError(f"there is no branch {number}: the tree {has}", rule="no-branch")


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


class _Digits(NamedTuple):
    """The digits of some gates: every gate has a bit per child, of which `bits` holds the one of the child it keeps.

    Integers, so that comparing the digits of all gates is one step.
    """

    bits: int
    gates: int
    """All the bits of those gates."""

    def agree(self, other: "_Digits") -> bool:
        """Whether no gate has one digit here and another there."""
        return self.bits & other.gates == other.bits & self.gates

    def join(self, other: "_Digits") -> "_Digits":
        """The digits here and there."""
        return _Digits(self.bits | other.bits, self.gates | other.gates)


_NONE: Final = _Digits(0, 0)


class _Search:
    """The enumeration of the digits of all branches of one tree.

    A *way* is the digits of the gates on a path from the root to a node, or on one path to each gate whose digit is above 0:
    a gate with a digit there is reached.
    """

    def __init__(self, tree: RVAFT) -> None:
        self.tree = tree
        self.gates = [name for name in _breadth_first(tree) if tree.nodes[name].gate is Gate.OR]
        self._first: dict[str, int] = {}
        self._all: dict[str, int] = {}
        width = 0
        for name in self.gates:
            children = len(tree.nodes[name].children)
            self._first[name], self._all[name] = width, (1 << children) - 1 << width
            width += children
        self._ways = {tree.root: [_NONE]}

    def choices(self, digits: int) -> dict[str, str]:
        """The choices of the `or` gates that a branch reaches."""

        def kept(name: str) -> tuple[str, ...]:
            children = self.tree.nodes[name].children
            if name not in self._first:
                return children
            own = (digits & self._all[name]) >> self._first[name]
            return (children[own.bit_length() - 1],)

        return {name: kept(name)[0] for name in reachable(self.tree.root, kept) if name in self._first}

    def branches(self) -> Iterator[int]:
        """The digits of all branches in the order of their numbers: the last gate's varies slowest."""
        if not self.gates:
            yield 0
            return
        # One level per gate, slowest first: its digits that are left, each with the digits so far and the ways they need.
        levels = [self._options(self.gates[-1], _NONE, [_NONE])]
        while levels:
            option = next(levels[-1], None)
            if option is None:
                levels.pop()
            elif len(levels) == len(self.gates):
                yield option[0].bits
            else:
                levels.append(self._options(self.gates[-1 - len(levels)], *option))

    def _options(self, gate: str, slower: _Digits, ways: list[_Digits]) -> Iterator[tuple[_Digits, list[_Digits]]]:
        """The digits that a gate can have when the slower ones are given, and the ways left then, at least one."""
        group = self._all[gate]
        lowest = 1 << self._first[gate]
        possible = 0
        for way in ways:
            possible |= way.bits & group or group
        while possible:
            bit = possible & -possible
            possible ^= bit
            digit = _Digits(bit, group)
            allowed = [way for way in ways if way.agree(digit)]
            if bit != lowest:  # The gate must be reached, as it is where a way goes through it.
                allowed = self._reaching(gate, slower, allowed)
            if allowed:
                yield slower.join(digit), allowed

    def _reaching(self, gate: str, slower: _Digits, ways: list[_Digits]) -> list[_Digits]:
        """The ways extended so that they also reach a gate."""
        group = self._all[gate]
        there = [way for way in ways if way.gates & group]
        if len(there) == len(ways):
            return there
        paths = [path for path in self._paths(gate) if path.agree(slower)]
        extended = (way.join(path) for way in ways if not way.gates & group for path in paths if way.agree(path))
        return _shortest([*there, *extended], gate)

    def _paths(self, name: str) -> list[_Digits]:
        """The ways to reach a node."""
        todo = [name]
        while todo:
            node = todo[-1]
            parents = self.tree.parents(node)
            unknown = [parent for parent in parents if parent not in self._ways]
            todo += unknown
            if not unknown:
                paths = (self._step(parent, node, way) for parent in parents for way in self._ways[parent])
                self._ways.setdefault(node, _shortest(paths, node))
                todo.pop()
        return self._ways[name]

    def _step(self, parent: str, child: str, way: _Digits) -> _Digits:
        if parent not in self._first:
            return way
        place = self._first[parent] + self.tree.nodes[parent].children.index(child)
        return way.join(_Digits(1 << place, self._all[parent]))


def _shortest(ways: Iterable[_Digits], name: str) -> list[_Digits]:
    """The ways that no other one is a part of; raises `TooLarge`."""
    found: dict[_Digits, None] = {}
    for way in ways:
        found[way] = None
        if len(found) > DEFAULT_LIMIT:
            raise TooLarge(f"ways to reach {name}", limit=DEFAULT_LIMIT)
    least: list[_Digits] = []
    for way in sorted(found, key=lambda way: way.bits.bit_count()):
        if not any(part.bits & way.bits == part.bits for part in least):
            least.append(way)
    return least


def _breadth_first(tree: RVAFT) -> list[str]:
    order, seen = [tree.root], {tree.root}
    for name in order:
        for child in tree.nodes[name].children:
            if child not in seen:
                seen.add(child)
                order.append(child)
    return order
