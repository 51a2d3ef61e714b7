"""Branches of a tree and their numbers (semantics, section 2).

The digits of a branch are the choices of the `or` gates in breadth-first order, the first varying
fastest; a gate outside the branch has digit 0. Enumeration is lazy and has no dead ends: a digit
above 0 requires that its gate is reached, and this is propagated.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import islice
from typing import Final, NamedTuple, cast

from rvaft.core.build import build
from rvaft.core.property import One
from rvaft.errors import TooLarge, TreeError
from rvaft.model.nodes import Kind, Node
from rvaft.model.tree import RVAFT, reachable
from rvaft.support.bits import bits, union
from rvaft.support.plugins import display

DEFAULT_LIMIT = 20_000
_MOST: Final = 10**9
"""The greatest branch number that is computed."""
_EFFORT: Final = 20_000_000
"""The maximum number of counting steps."""
_SHARED_EFFORT: Final = 1_000_000
"""Beyond this number of steps, branches with shared nodes are enumerated instead of counted."""


@dataclass(frozen=True)
class Branch:
    """One branch; `choices` maps each `or` gate in the branch to the child that it keeps.

    >>> import rvaft
    >>> [(branch.number, branch.formula) for branch in branches(rvaft.loads("top or a both; both sand b c;"))]
    [(1, 'a'), (2, 'b ; c')]
    """

    tree: RVAFT
    number: int
    choices: Mapping[str, str]

    @cached_property
    def nodes(self) -> tuple[str, ...]:
        """The nodes, parents before children."""
        return tuple(sorted(reachable(self.tree.root, self.children), key=self.tree.rank.__getitem__))

    @cached_property
    def kinds(self) -> frozenset[Kind]:
        """The kinds of the nodes."""
        return frozenset(kind for name in self.nodes if (kind := self.tree.nodes[name].kind) is not None)

    @cached_property
    def formula(self) -> str:
        """The property as text: `;` sequence, `&` any order, `|` choice, conditions in brackets."""
        return cast("str", display("branch")(self))

    def children(self, name: str) -> tuple[str, ...]:
        """Return the children of a node that the branch keeps."""
        return (self.choices[name],) if name in self.choices else self.tree.nodes[name].children


def branches(tree: RVAFT) -> Iterator[Branch]:
    """Iterate lazily over all branches by number, from 1."""
    search = _Search(tree)
    for number, digits in enumerate(search.branches(), 1):
        yield Branch(tree, number, search.choices(digits))


def branch(tree: RVAFT, number: int) -> Branch:
    """Return the branch with this number; raises `TreeError` if there is none."""
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
    """Return the lowest number of a branch with these choices and this kind; None beyond the
    limits.

    With a kind, branches are enumerated up to `limit`; otherwise they are counted per gate.
    """
    if tree.shared and kind is None:
        with suppress(TooLarge):
            return _number_among_shared(tree, choices)
    if tree.shared or kind is not None:
        for candidate in islice(branches(tree), limit):
            made = all(candidate.choices.get(name) == child for name, child in choices.items())
            if made and (kind is None or kind in candidate.kinds):
                return candidate.number
        return None
    gates = or_gates(tree)
    choosing = frozenset(gates)
    digits: dict[str, range] = {}  # the allowed digits of a gate; all if absent
    # ways to resolve the part below a node; `idle`: one of them avoids the node
    ways: dict[str, int] = {}
    idle: dict[str, bool] = {}
    number, effort = 1, 0

    def count(node: Node) -> bool:
        nonlocal effort
        effort += 1 + len(node.children)
        before = ways.get(node.name), idle.get(node.name)
        busy = [child for child in node.children if not idle[child]]
        if node.name in choosing:
            own = digits.get(node.name, range(len(node.children)))
            possible = (node.children[digit] for digit in own)
            found = sum(ways[child] for child in possible if all(other == child for other in busy))
            idle[node.name] = not busy and 0 in own
        else:
            found = 1
            for child in node.children:
                found = min(found * ways[child], _MOST)
            idle[node.name] = not busy
        ways[node.name] = min(found, _MOST)
        return before != (ways[node.name], idle[node.name])

    def fix(name: str, own: range) -> bool:
        """Restrict a gate's digits; False if a required node has no resolution left."""
        digits[name] = own
        above: tuple[str, ...] = (name,)
        while above and count(tree.nodes[above[0]]):
            if not ways[above[0]] and not idle[above[0]]:
                return False
            above = tree.parents(above[0])
        return True

    for node in tree.bottom_up():
        count(node)
    for name in reversed(gates):
        digit = tree.nodes[name].children.index(choices[name]) if name in choices else 0
        if digit and fix(name, range(digit)):
            number += ways[tree.root]
        fix(name, range(digit, digit + 1))
        if number > _MOST or effort > _EFFORT:
            return None
    return number


def or_gates(tree: RVAFT) -> list[str]:
    """Return the reachable `or` gates in breadth-first order."""
    return list(_or_gates(tree))


@lru_cache(maxsize=64)
def _or_gates(tree: RVAFT) -> tuple[str, ...]:
    choosing = {part.source.node for part in build(tree).parts if isinstance(part, One) and part.source is not None}
    order, seen = [tree.root], {tree.root}
    for name in order:
        new = [child for child in tree.nodes[name].children if child not in seen]
        seen.update(new)
        order.extend(new)
    return tuple(name for name in order if name in choosing)


def _number_among_shared(tree: RVAFT, choices: Mapping[str, str]) -> int | None:
    """Return the number of a branch if nodes are shared; raises `TooLarge`."""
    gates = or_gates(tree)
    place = {name: number for number, name in enumerate(_depth_first(tree, gates))}
    reached: dict[str, int] = {}
    for node in tree.bottom_up():
        reached[node.name] = 1 << place[node.name] if node.name in place else union(reached[c] for c in node.children)
    ways = [[reached[child] for child in tree.nodes[name].children] for name in place]
    free = [range(len(way)) for way in ways]
    effort = 0

    def count(digits: Sequence[range]) -> int:
        nonlocal effort
        found = {reached[tree.root]: 1}
        for gate, own in enumerate(digits):
            following: dict[int, int] = {}
            for ahead, number in found.items():
                effort += len(own)
                if not ahead >> gate & 1:
                    if 0 in own:
                        following[ahead] = following.get(ahead, 0) + number
                    continue
                for digit in own:
                    after = (ahead | ways[gate][digit]) & -(2 << gate)
                    following[after] = following.get(after, 0) + number
            if effort > _SHARED_EFFORT:
                raise TooLarge("steps to count branches", limit=_SHARED_EFFORT)
            found = following
        return sum(found.values())

    number = 1
    for name in reversed(gates):
        digit = tree.nodes[name].children.index(choices[name]) if name in choices else 0
        own = place[name]
        if digit:
            free[own] = range(digit)
            number += count(free)
        if number > _MOST:
            return None
        free[own] = range(digit, digit + 1)
    return number


def _depth_first(tree: RVAFT, gates: Iterable[str]) -> list[str]:
    """Order gates parents first, and as close to their descendants as possible."""
    done: dict[str, None] = {}
    agenda = [(tree.root, reversed(tree.nodes[tree.root].children))]
    while agenda:
        name, children = agenda[-1]
        child = next((node for node in children if node not in done), None)
        if child is not None:
            agenda.append((child, reversed(tree.nodes[child].children)))
        else:
            done[name] = None
            agenda.pop()
    wanted = set(gates)
    return [name for name in reversed(done) if name in wanted]


class _Digits(NamedTuple):
    """Digits of some gates: the bits of kept children, and all bits of the gates (`gates`)."""

    bits: int = 0
    gates: int = 0

    def agree(self, other: "_Digits") -> bool:
        return self.bits & other.gates == other.bits & self.gates

    def join(self, other: "_Digits") -> "_Digits":
        return _Digits(self.bits | other.bits, self.gates | other.gates)


class _Search:
    """The enumeration of the digits of branches.

    A *way* holds the digits on a path from the root to a node, or to all gates with a digit above
    0.
    """

    def __init__(self, tree: RVAFT) -> None:
        self.tree = tree
        self.gates = or_gates(tree)
        self._bits: dict[str, range] = {}
        self._all: dict[str, int] = {}
        width = 0
        for name in self.gates:
            self._bits[name] = range(width, width := width + len(tree.nodes[name].children))
            self._all[name] = (1 << width) - (1 << self._bits[name].start)
        self._ways = {tree.root: [_Digits()]}

    def choices(self, digits: int) -> dict[str, str]:

        def kept(name: str) -> tuple[str, ...]:
            children = self.tree.nodes[name].children
            if name not in self._bits:
                return children
            return (children[((digits & self._all[name]) >> self._bits[name].start).bit_length() - 1],)

        return {name: kept(name)[0] for name in reachable(self.tree.root, kept) if name in self._bits}

    def branches(self) -> Iterator[int]:
        # One level per gate, slowest first: its remaining digits, all digits so far, and their
        # ways.
        levels = [iter([(_Digits(), [_Digits()])])]
        while levels:
            option = next(levels[-1], None)
            if option is None:
                levels.pop()
            elif len(levels) > len(self.gates):
                yield option[0].bits
            else:
                levels.append(self._options(self.gates[-len(levels)], *option))

    def _options(self, gate: str, slower: _Digits, ways: list[_Digits]) -> Iterator[tuple[_Digits, list[_Digits]]]:
        group, lowest = self._all[gate], self._bits[gate].start
        for number in bits(union(way.bits & group or group for way in ways)):
            digit = _Digits(1 << number, group)
            allowed = [way for way in ways if way.agree(digit)]
            there = [way for way in allowed if way.gates & group]
            if number != lowest and len(there) < len(allowed):  # a digit above 0 requires that the gate is reached
                paths = [path for path in self._paths(gate) if path.agree(slower)]
                elsewhere = (way for way in allowed if not way.gates & group)
                extended = (way.join(path) for way in elsewhere for path in paths if way.agree(path))
                allowed = _shortest([*there, *extended], gate)
            if allowed:
                yield slower.join(digit), allowed

    def _paths(self, name: str) -> list[_Digits]:
        todo = [name]
        while todo:
            node = todo[-1]
            parents = self.tree.parents(node)
            unknown = [parent for parent in parents if parent not in self._ways]
            todo += unknown
            if not unknown:
                steps = {parent: self._step(parent, node) for parent in parents}
                paths = (way.join(step) for parent, step in steps.items() for way in self._ways[parent])
                self._ways.setdefault(node, _shortest(paths, node))
                todo.pop()
        return self._ways[name]

    def _step(self, parent: str, child: str) -> _Digits:
        if parent not in self._bits:
            return _Digits()
        return _Digits(1 << self._bits[parent][self.tree.nodes[parent].children.index(child)], self._all[parent])


def _shortest(ways: Iterable[_Digits], name: str) -> list[_Digits]:
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
