"""Spares that gates share, translated exactly for observed failures.

A spare gate uses its first part. When the part that it uses fails, it takes the first of its spares that has not failed
and that no gate has taken; if there is none, the gate fails. A taken spare stays taken. So the order of failures
determines which gate takes a spare, if no two parts can fail at the same time.

With one spare S and the first parts P and Q, the gate of P fails when P and S have failed, or when P fails after Q,
whose gate has the spare. With more spares, a gate fails in the orders that end with its failure. If every order that
has one of these fails, too, the gate is a union of the least ones; otherwise it is refused.
"""

from collections.abc import Iterable, Iterator, Sequence
from itertools import combinations
from math import factorial
from typing import Final, NamedTuple, TypeAlias

from rvaft.errors import LanguageError
from rvaft.language.draft import Draft, DraftNode, GateUse, Located, Reading
from rvaft.language.priority_and import FaultGate, FaultTree
from rvaft.model.nodes import Gate, Place
from rvaft.support.wording import listing

_MOST_PARTS: Final = 7
"""The maximum number of parts of gates that share several spares: all their orders are tried."""
_MOST_NODES: Final = 2_000
"""The maximum number of new nodes."""
_LONGEST: Final = 60
"""The maximum length of the name of a new node, before it is cut."""

Order: TypeAlias = tuple[str, ...]


class SpareGate(NamedTuple):
    """A spare gate: its name, its word, its position, and whether its spares are cold."""

    name: str
    word: str
    place: Place
    cold: bool


def pools(gates: Sequence[tuple[str, Sequence[str]]]) -> list[list[str]]:
    """Return the gates that share spares, in groups: of names with their parts, of which the first one is no spare.

    >>> pools([("A", ["p", "s"]), ("B", ["q", "t"]), ("C", ["r", "s"])])
    [['A', 'C']]
    """
    groups = {name: [name] for name, _ in gates}
    for spare in dict.fromkeys(part for _, parts in gates for part in parts[1:]):
        first, *others = [name for name, parts in gates if spare in parts]
        for other in others:
            one, two = groups[first], groups[other]
            if one is not two:
                one += two
                groups.update(dict.fromkeys(two, one))
    return list({id(group): group for group in groups.values() if len(group) > 1}.values())


def read_shared_spares(draft: Draft, groups: Iterable[Sequence[SpareGate]]) -> None:
    """Translate the gates of each group that share spares, and record them in `dynamic_gates`.

    Raises `LanguageError` if failures do not determine which gate takes a spare.
    """
    tree = FaultTree(draft, {})
    if not tree.valid():
        return
    written = [node for group in groups for node in _Pool(draft, tree, group).translated()]
    for name, shape in written:
        _write(draft, name, shape)


class _Pool:
    """Gates that share spares."""

    def __init__(self, draft: Draft, tree: FaultTree, gates: Sequence[SpareGate]) -> None:
        self.draft = draft
        self.tree = tree
        self.gates = {gate.name: gate for gate in gates}
        self.parts = {name: tree.shapes[name].children for name in self.gates}
        self.firsts: dict[str, str] = {}
        for name, (first, *_) in self.parts.items():
            self.firsts.setdefault(first, name)
        self.spares = list(dict.fromkeys(spare for parts in self.parts.values() for spare in parts[1:]))
        self.cold = next(iter(self.gates.values())).cold
        self.made: dict[object, str] = {}
        self.new: dict[str, FaultGate] = {}
        self.gate = next(iter(self.gates.values()))
        """The gate that is translated."""

    def translated(self) -> Iterator[tuple[str, FaultGate]]:
        """Yield the translation of each gate, and the new nodes of it."""
        self._check()
        fails = {} if len(self.spares) == 1 else self._orders()
        for name, gate in self.gates.items():
            self.gate = gate
            ways = self._by_one_spare(name) if len(self.spares) == 1 else self._union(self._least(name, fails))
            shape = FaultGate(Gate.OR, tuple(ways)) if len(ways) > 1 else self.new.pop(ways[0])
            others = [
                other
                for other in self.gates
                if other != name and not set(self.parts[other]).isdisjoint(self.parts[name][1:])
            ]
            shared = [spare for spare in self.parts[name][1:] if any(spare in self.parts[other] for other in others)]
            how = f"the first gate that needs a spare takes it, and {listing(others)} can take {listing(shared)}"
            sentence = f"`{gate.word}` of {name} is read with the order of failures: {how}"
            self.draft.dynamic_gates.append(Reading(gate.place, sentence, (name,)))
            yield name, shape
        yield from self.new.items()

    def _error(self, why: str) -> LanguageError:
        names = listing(list(self.gates))
        what = f"{names} share the {'spares' if len(self.spares) > 1 else 'spare'} {listing(self.spares)}"
        message = f"{what}, and failures do not determine which gate takes it: {why}; give each its own"
        place = self.gate.place
        return LanguageError(message, file=place.file, line=place.line, column=place.column)

    def _check(self) -> None:
        """Raise `LanguageError` unless the order of failures determines which gate takes a spare."""
        for name, (first, *_) in self.parts.items():
            self.gate = self.gates[name]
            if first in self.spares:
                raise self._error(f"{first} is also the first part of {name}")
            if self.firsts[first] != name:
                raise self._error(f"{first} is the first part of {self.firsts[first]} and {name}")
            if self.gate.cold != self.cold:
                raise self._error("they are cold in one gate, and not in another one")
        parts = [*self.firsts, *self.spares]
        for one in parts:
            node = self.draft.nodes.get(one) or DraftNode(one)
            if (
                node.counts
                or node.withins
                or node.withouts
                or (node.gates and node.ons)
                or (node.whens and not node.ons)
            ):
                raise self._error(f"{one} is more than a gate or one event")
            if self.cold and one in self.tree.shapes and one in self.spares:
                raise self._error(f"the cold spare {one} is a gate, of which parts may fail before it is taken")
        for one, two in combinations(self.firsts if len(self.spares) == 1 else parts, 2):
            if together := self.tree.facts(one).last & self.tree.facts(two).last:
                raise self._error(f"{one} and {two} can fail together, by {min(together)}")

    # One spare

    def _by_one_spare(self, name: str) -> list[str]:
        [spare] = self.spares
        first = self.parts[name][0]
        both = self._before(first, spare) if self.cold else self._node(f"{first} and {spare}", Gate.AND, (first, spare))
        others = tuple(other for other in self.firsts if other != first)
        return [both, self._before(self._any(others), first)]

    # Several spares

    def _orders(self) -> dict[Order, frozenset[str]]:
        """Return which gates have failed after each order of failed parts."""
        parts = [*self.firsts, *self.spares]
        if len(parts) > _MOST_PARTS:
            raise self._error(f"they have {len(parts)} parts, and orders of more than {_MOST_PARTS} are not tried")
        start = {name: of[0] for name, of in self.parts.items()}
        found: dict[Order, frozenset[str]] = {}
        todo: list[tuple[Order, frozenset[str], dict[str, str]]] = [((), frozenset(), start)]
        while todo:
            order, gone, uses = todo.pop()  # `gone` have failed or are taken
            found[order] = frozenset(self.gates.keys() - uses)
            for part in parts:
                if part not in order:
                    gone_then, uses_then = self._after(part, gone, uses)
                    todo.append(((*order, part), gone_then, uses_then))
        return found

    def _after(self, part: str, gone: frozenset[str], uses: dict[str, str]) -> tuple[frozenset[str], dict[str, str]]:
        """Return the parts that are gone, and those that gates use, after the failure of a part."""
        user = next((name for name, used in uses.items() if used == part), None)
        if user is None:
            return (gone if self.cold else gone | {part}), uses
        left = {name: used for name, used in uses.items() if name != user}
        spare = next((one for one in self.parts[user][1:] if one not in gone and one != part), None)
        if spare is None:
            return gone | {part}, left
        return gone | {part, spare}, {**left, user: spare}

    def _least(self, name: str, fails: dict[Order, frozenset[str]]) -> frozenset[Order]:
        """Return the least orders in which a gate fails; raises `LanguageError` if others have them and do not fail."""
        found = set[Order]()
        for order, gates in fails.items():
            shorter = any(name in fails[order[:place] + order[place + 1 :]] for place in range(len(order)))
            if name in gates and not shorter:
                found.add(order)
            elif name not in gates and shorter:
                raise self._error(f"after {listing(order)}, {name} works because a part of another gate failed before")
        return frozenset(found)

    def _union(self, orders: frozenset[Order]) -> list[str]:
        """Return nodes of which one holds when parts have failed in one of these orders."""
        by_parts: dict[frozenset[str], list[Order]] = {}
        for order in sorted(orders):
            by_parts.setdefault(frozenset(order), []).append(order)
        ways, by_last = list[str](), dict[str, set[Order]]()
        for together in by_parts.values():
            if len(together) == factorial(len(together[0])):  # in any order
                names = together[0]
                ways.append(names[0] if len(names) == 1 else self._node(" and ".join(names), Gate.AND, names))
                continue
            for order in together:
                by_last.setdefault(order[-1], set()).add(order[:-1])
        for last, before in by_last.items():
            ways.append(self._before(self._any(tuple(self._union(frozenset(before)))), last))
        return ways

    # Nodes

    def _any(self, names: Order) -> str:
        return names[0] if len(names) == 1 else self._node(" or ".join(names), Gate.OR, names)

    def _before(self, first: str, last: str) -> str:
        """Return a node for the failure of `last` after that of `first`."""
        gate = Gate.SAND
        if last in self.tree.shapes:
            gate = Gate.PAND  # is exact if the failure of `last` is the end of each match
            if not self.tree.facts(last).fixed:
                raise self._error(f"{last} can fail in several ways, and its first failure counts")
        return self._node(f"{first} before {last}", gate, (first, last))

    def _node(self, title: str, gate: Gate, names: Order) -> str:
        key = gate, names
        if key not in self.made:
            title = title if len(title) <= _LONGEST else f"{title[:_LONGEST]}..."
            name, number = title, 1
            while name in self.draft.nodes or name in self.tree.leaves:
                number += 1
                name = f"{title} ({number})"
            self.made[key] = name
            self.draft.nodes[name] = DraftNode(name, statements=[self.gate.place], made=True)
            self.new[name] = FaultGate(gate, names)
            if len(self.new) > _MOST_NODES:
                raise self._error(f"the translation has more than {_MOST_NODES:,} nodes")
        return self.made[key]


def _write(draft: Draft, name: str, shape: FaultGate) -> None:
    node = draft.nodes[name]
    place = node.gates[0].place if node.gates else node.place
    node.gates = [Located(GateUse(shape.gate, tuple([Located(child, place) for child in shape.children])), place)]
