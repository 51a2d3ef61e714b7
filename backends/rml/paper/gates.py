r"""The gates of section 3.2: from a branch to a term over its occurrences.

OR   a \/ b \/ c                     (resolved before: the branches are joined by \/)
VOT  (a T_bc) \/ (b T_ac) \/ (c T_ab)   with one equation for each set of children that is left
AND  a | b | c
SAND a b c, or c b a
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import combinations, product
from math import comb
from typing import Final

from rvaft.errors import TooLarge
from rvaft.model import Causality, Gate, Node
from rvaft.tree import RVAFT

OR = " \\/ "
Choices = dict[str, str]
SYMBOLS: Final = 10
"""How many symbols of unrolled VOT gates the limit allows for each term it allows: few terms may have very many options."""
_AROUND: Final = 4
"""The symbols of an option `(a T_bc) \\/` beside those of its child."""


@dataclass
class Writer:
    """Writes terms; `occurrence` names the event of a node in the branch at hand, `equations` are those of the VOT gates."""

    limit: int
    equations: dict[str, str] = field(default_factory=dict)
    written: int = 0
    symbols: int = 0

    def count(self, terms: int = 1, *, symbols: int = 0) -> None:
        """That many more terms, and symbols of VOT gates; raises `TooLarge` beyond the limit."""
        self.written += terms
        self.symbols += symbols
        if self.written > self.limit:
            raise TooLarge("terms of the paper's translation", limit=self.limit)
        if self.symbols > SYMBOLS * self.limit:
            raise TooLarge(f"symbols of the paper's VOT, {SYMBOLS} allowed for each term", limit=self.limit)

    def branch(self, tree: RVAFT, choices: Choices, occurrence: Callable[[str], str | None], prefix: str) -> str:
        """The term of a branch; the empty text for one without occurrences."""
        done: dict[str, str] = {}
        for node in tree.bottom_up():
            self.count()
            children = (choices[node.name],) if node.name in choices else node.children
            if all(child in done for child in children):
                event = occurrence(node.name)
                body = self._gate(node, [done[child] for child in children if done[child]], f"{prefix}{len(done)}")
                parts = [event or "", body]
                in_order = parts if tree.causality is Causality.TOP_DOWN else parts[::-1]
                done[node.name] = _sequence(part for part in in_order if part)
        return done[tree.root]

    def _gate(self, node: Node, parts: list[str], name: str) -> str:
        if len(parts) < 2 and node.gate is not Gate.VOT:
            return "".join(parts)
        match node.gate:
            case Gate.AND:
                return f"({' | '.join(parts)})"
            case Gate.SAND:
                return _sequence(parts)
            case Gate.SAND_RL:
                return _sequence(reversed(parts))
            case Gate.VOT:
                missing = len(node.children) - len(parts)  # children without occurrences count as observed
                return self._unrolled(parts, max((node.threshold or 0) - missing, 0), name)
            case Gate.OR | None:
                return OR.join(parts)

    def _unrolled(self, parts: list[str], k: int, name: str) -> str:
        """The hierarchy of terms that counts down from k: an equation for each set of children that is left, larger sets first."""
        if k == 0:
            return ""
        once = sum(_AROUND + len(part.split()) for part in parts)
        for gone in range(k):
            self.count(comb(len(parts), gone), symbols=comb(len(parts) - 1, gone) * once)

        def named(left: Sequence[int]) -> str:
            return f"{name}_{'_'.join(map(str, left))}"

        everything = range(len(parts))
        for gone in range(k):
            for removed in combinations(everything, gone):
                left = [i for i in everything if i not in removed]
                rest = {i: f" {named([j for j in left if j != i])}" if gone < k - 1 else "" for i in left}
                self.equations[named(left)] = OR.join(f"({parts[i]}{rest[i]})" for i in left)
        return named(everything)


def _sequence(parts: Iterable[str]) -> str:
    """The parts one after the other; a name before a parenthesis is set apart, since RML would read a call."""
    written = ""
    for part in parts:
        if written and part.startswith("(") and written[-1] != ")":
            written = f"({written})"
        written = f"{written} {part}".strip()
    return written


def branches(tree: RVAFT, limit: int) -> Iterator[Choices]:
    """The branches in the order of their numbers: the `or` nearest the root varies fastest."""
    ring, seen = [tree.root], {tree.root}
    for name in ring:
        fresh = [child for child in tree.nodes[name].children if child not in seen]
        seen.update(fresh)
        ring += fresh
    ors = [name for name in ring if tree.nodes[name].gate is Gate.OR]
    written: set[tuple[tuple[str, str], ...]] = set()
    options = [tree.nodes[name].children for name in reversed(ors)]
    for number, picked in enumerate(product(*options)):
        if number >= limit:
            raise TooLarge("branches of the paper's translation", limit=limit)
        choices = dict(zip(reversed(ors), picked, strict=True))
        reached = _reached(tree, choices)
        kept = {name: child for name, child in choices.items() if name in reached}
        key = tuple(sorted(kept.items()))
        if key not in written:
            written.add(key)
            yield kept


def _reached(tree: RVAFT, choices: Choices) -> set[str]:
    reached, todo = set[str](), [tree.root]
    while todo:
        name = todo.pop()
        if name not in reached:
            reached.add(name)
            todo.extend((choices[name],) if name in choices else tree.nodes[name].children)
    return reached


def reading_order(tree: RVAFT, choices: Choices) -> list[str]:
    """The occurrences of a branch in the order in which its term is written: the last one that binds a variable checks guards."""
    order: list[str] = []
    todo: list[tuple[str, bool]] = [(tree.root, False)]
    while todo:
        name, closing = todo.pop()
        node = tree.nodes[name]
        if closing:
            order.append(name)
            continue
        children = (choices[name],) if name in choices else node.children
        children = children[::-1] if node.gate is Gate.SAND_RL else children
        if tree.causality is Causality.TOP_DOWN:
            order.append(name)
        else:
            todo.append((name, True))
        todo.extend((child, False) for child in reversed(children))
    last = {name: index for index, name in enumerate(order)}
    return [name for index, name in enumerate(order) if last[name] == index and tree.nodes[name].has_event]
