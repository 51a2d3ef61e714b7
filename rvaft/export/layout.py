"""Which part of a tree is drawn, where subtrees are left out."""

import json
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from enum import Enum, auto
from functools import cached_property
from typing import Final, NamedTuple

import networkx as nx

from rvaft.analysis.branches import branch
from rvaft.errors import OptionError
from rvaft.export.line_breaks import wrapped, wrapped_code
from rvaft.model.expressions import guard_text, on_text
from rvaft.model.nodes import Gate, Kind, Node
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.monitors import Explanation
from rvaft.support.terminal import visible

# What a drawing of a tree says about one match, or one branch: which nodes and edges it is made of, and where its events are.

LONGEST: Final = 120
"""Characters of a value; what is longer is cut, and a sign says so."""
_SHOWN_FIELDS: Final = ("time", "topic")
"""What is shown of an event beside its number, where it has them."""


@dataclass(frozen=True, slots=True)
class Marks:
    """A match on a tree: the scenario's nodes with the children they keep, what stands at a node, and what below the tree.

    `meaning` is what it means to be marked. Texts are not escaped for any format.
    """

    kept: Mapping[str, frozenset[str]]
    notes: Mapping[str, tuple[str, ...]]
    below: tuple[str, ...]
    meaning: str = "detected"

    def edge(self, parent: str, child: str) -> bool:
        """Whether the scenario keeps this child of this node."""
        return child in self.kept.get(parent, ())


def marks(tree: RVAFT, explanation: Explanation, events: Mapping[int, Json]) -> Marks:
    """The marks of a match; of an event that is not among `events` only the number is known."""
    scenario = {name: frozenset(children) for name, children in explanation.scenario.items()}
    kept = {**dict.fromkeys(explanation.matched, frozenset[str]()), **scenario}
    notes = {name: _note(number, events.get(number)) for name, number in explanation.matched.items()}
    return Marks(kept, notes, tuple(_below(tree, explanation)))


def branch_marks(tree: RVAFT, number: int) -> Marks:
    """The marks of the branch of that number; raises `TreeError` where there is none."""
    found = branch(tree, number)
    kept = {name: frozenset(found.children(name)) for name in found.nodes}
    return Marks(kept, {}, (_title(number, found.kinds),), f"branch {number}")


def _note(number: int, event: Json) -> tuple[str, ...]:
    shown = [field for field in _SHOWN_FIELDS if field in event] if isinstance(event, Mapping) else []
    return f"event {number}", *(f"{field} {_bare(event[field])}" for field in shown)


def _below(tree: RVAFT, explanation: Explanation) -> Iterator[str]:
    """The branch with its kinds, then the variables in the order of the tree."""
    if title := _title(explanation.branch, explanation.kinds):
        yield title
    order = {name: place for place, name in enumerate(tree.variables)}
    for name in sorted(explanation.variables, key=lambda name: order.get(name, len(order))):
        yield f"{name} = {_written(explanation.variables[name])}"


def _title(number: int | None, kinds: Collection[Kind]) -> str:
    words = ("" if number is None else f"branch {number}", ", ".join(sorted(kind.value for kind in kinds)))
    return ": ".join(word for word in words if word)


def _bare(value: Json) -> str:
    """A value as text, a string without its quotes."""
    return _cut(value) if isinstance(value, str) else _written(value)


def _written(value: Json) -> str:
    try:
        return _cut(json.dumps(value, ensure_ascii=False, default=repr))
    except ValueError:  # an integer of more digits than Python writes
        return "…"


def _cut(text: str) -> str:
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}…"


# What a drawing shows of a tree: the choices that are the same for every format.

WIDTH: Final = 14
"""Columns of text in a box: so narrow that a tree of the size that papers print is still readable in one column."""

NARROWEST: Final = 4
"""Columns of text that a box has at least."""


@dataclass(frozen=True, slots=True)
class Look:
    """How a tree is drawn. `collapse` names nodes, of which what is below is left out; `depth` counts levels below the root.

    `events` are runtime events and guards, `names` those of nodes that have a label as well; `wrap` is in columns of text.
    With `stagger` every other child of a gate, where it is a leaf, stands one level lower: Graphviz then draws a narrower tree.
    """

    events: bool = False
    names: bool = True
    wrap: int = WIDTH
    depth: int | None = None
    collapse: tuple[str, ...] = ()
    marks: Marks | None = None
    legend: bool = False
    stagger: bool = False

    @property
    def code_width(self) -> int:
        """Columns of an event or a guard: a quarter more than of a label, as these do not break as well as words."""
        return self.wrap + self.wrap // 4


PLAIN: Final = Look()
TERMINAL: Final = Look(events=True)
"""What a terminal shows where nothing else is asked for: there is room."""


def looking(
    tree: RVAFT,
    *,
    events: bool = False,
    names: bool = True,
    wrap: int | None = None,
    depth: int | None = None,
    collapse: Iterable[str] = (),
    branch: int | None = None,
    legend: bool = False,
    stagger: bool = False,
) -> Look:
    """The look at a tree with a branch marked; raises `OptionError`, and `TreeError` where there is no such branch."""
    if wrap is not None and wrap < NARROWEST:
        raise OptionError(f"a box has at least {NARROWEST} columns of text, not {wrap}")
    if isinstance(collapse, str):
        collapse = (collapse,)
    marks = None if branch is None else branch_marks(tree, branch)
    return Look(events, names, WIDTH if wrap is None else wrap, depth, tuple(collapse), marks, legend, stagger)


@dataclass(frozen=True)
class View:
    """The nodes that are drawn, parents first; of a folded one the children are left out.

    `folded` counts the nodes below that are drawn nowhere else.
    """

    nodes: tuple[Node, ...]
    folded: Mapping[str, int]

    def children(self, node: Node) -> tuple[str, ...]:
        """The children that are drawn as such."""
        return () if node.name in self.folded else node.children

    @cached_property
    def shared(self) -> frozenset[str]:
        """The nodes that are drawn as children of several others."""
        parents = Counter(child for node in self.nodes for child in self.children(node))
        return frozenset(name for name, count in parents.items() if count > 1)

    @cached_property
    def numbered(self) -> frozenset[str]:
        """The SAND gates below which something is shared: no layout can promise that their children stand in order.

        What is below them and shared may have to stand elsewhere, as other parents want it.
        """
        loose: set[str] = set()  # shared, or above something that is
        found: set[str] = set()
        for node in reversed(self.nodes):
            if any(child in loose for child in self.children(node)):
                loose.add(node.name)
                if node.gate is not None and node.gate.ordered:
                    found.add(node.name)
            if node.name in self.shared:
                loose.add(node.name)
        return frozenset(found)


def view(tree: RVAFT, look: Look) -> View:
    """The part that a look shows; raises `OptionError` for a node to collapse that the tree does not have, or a negative depth.

    A node is as deep as its shortest path from the root. At the last level a node is folded if a child of it is left out.
    """
    for name in look.collapse:
        _check_known(tree, name)
    if look.depth is not None and look.depth < 0:
        raise OptionError(f"the depth of a drawing is 0 or more, not {look.depth}")
    drawn = _drawn(tree, frozenset(look.collapse), look.depth)
    nodes = tuple(node for node in tree.top_down() if node.name in drawn)
    return View(nodes, {node.name: _hidden(tree, node, drawn) for node in nodes if _folded(node, look, drawn)})


def _folded(node: Node, look: Look, drawn: Collection[str]) -> bool:
    return bool(node.children) and (node.name in look.collapse or not all(child in drawn for child in node.children))


def _drawn(tree: RVAFT, collapse: frozenset[str], depth: int | None) -> frozenset[str]:
    drawn = {tree.root}
    level, reached = [tree.root], 0
    while level and (depth is None or reached < depth):
        below = [child for name in level if name not in collapse for child in tree.nodes[name].children]
        level = [child for child in dict.fromkeys(below) if child not in drawn]
        drawn.update(level)
        reached += 1
    return frozenset(drawn)


def _hidden(tree: RVAFT, node: Node, drawn: Collection[str]) -> int:
    return sum(name not in drawn for name in nx.descendants(tree.graph, node.name))


def _check_known(tree: RVAFT, name: str) -> None:
    if name in tree.order:
        return
    if name in tree.nodes:
        raise OptionError(f"cannot collapse {visible(name)}: the root does not lead to it")
    close = get_close_matches(name, tree.order, n=1, cutoff=0.4)
    hint = f"; did you mean {visible(close[0])}?" if close else ""
    raise OptionError(f"cannot collapse {visible(name)}: the tree has no such node{hint}")


# The words of a drawing: what stands at a node, the same in every format.


@dataclass(frozen=True, slots=True)
class Caption:
    """What is written at a node; a part that the node lacks is None. Texts are not escaped for any format."""

    name: str
    gate: str | None
    kind: Kind | None
    label: str | None
    on: str | None
    when: str | None


def caption(node: Node) -> Caption:
    """The words at a node. A default event is not among them: it says no more than the name."""
    return Caption(
        node.name,
        gate_text(node),
        node.kind,
        node.label,
        None if node.on is None else on_text(node.on),
        None if node.when is None else guard_text(node.when),
    )


def gate_text(node: Node) -> str | None:
    """The short form of a gate, with the direction of a SAND and the k/n of a VOT."""
    match node.gate:
        case None:
            return None
        case Gate.SAND:
            return "SAND →"
        case Gate.SAND_RL:
            return "SAND ←"
        case Gate.VOT:
            return f"VOT {node.threshold}/{len(node.children)}"
        case Gate.AND | Gate.OR:
            return node.gate.value.upper()


# What stands in the box of a node, row by row, before any format makes it its own.


class Role(Enum):
    """What a row is there for."""

    PLAIN = auto()
    BOLD = auto()
    EVENT = auto()
    GUARD = auto()


class Row(NamedTuple):
    """The lines of a row. They are not escaped for any format."""

    role: Role
    lines: list[str]


def rows(node: Node, look: Look) -> Iterator[Row]:
    """Name, label, event, guard and notes, as far as the look has them; the first row tells which node it is."""
    words, width = caption(node), look.wrap
    if not words.label:
        yield Row(Role.PLAIN, wrapped(words.name, width))
    elif look.names:
        yield Row(Role.BOLD, wrapped(words.name, width))
    if words.label:
        yield Row(Role.PLAIN, wrapped(words.label, width))
    if look.events and (event := words.on or _default(node)) is not None:
        yield Row(Role.EVENT, wrapped_code(event, look.code_width))
    if look.events and words.when is not None:
        yield Row(Role.GUARD, wrapped_code(f"when {words.when}", look.code_width))
    for place, part in enumerate(() if look.marks is None else look.marks.notes.get(node.name, ())):
        yield Row(Role.PLAIN if place else Role.BOLD, wrapped(part, width))


def _default(node: Node) -> str | None:
    """The event of a leaf that states nothing: the field that it asks for, with the leaf's name."""
    return f"event: {json.dumps(node.name, ensure_ascii=False)}" if node.leaf and node.when is None else None


# What the signs of a drawing mean: those that are in it, in a fixed order.


class Sign(Enum):
    """How the sample of an entry is drawn."""

    FAULT = "fault"
    ATTACK = "attack"
    CONDITION = "condition"
    GATE = "gate"
    FOLDED = "folded"
    AGAIN = "again"
    ORDER = "order"
    MARKED = "marked"


@dataclass(frozen=True, slots=True)
class Entry:
    """A sample and what it means; the sample of a gate has that gate's outline."""

    sign: Sign
    sample: str
    meaning: str
    gate: Gate | None = None


_MEANINGS = {
    Gate.OR: "one of them",
    Gate.AND: "all, in any order",
    Gate.SAND: "all, from left to right",
    Gate.SAND_RL: "all, from right to left",
}


def entries(view: View, marks: Marks | None, *, graph: bool) -> Iterator[Entry]:
    """The entries for what a drawing has.

    A `graph` has a shared node once and numbers children that may stand out of order, other formats draw a tree and refer.
    """
    kinds = {node.kind for node in view.nodes}
    if Kind.FAULT in kinds:
        yield Entry(Sign.FAULT, "fault", "caused by a fault")
    if Kind.ATTACK in kinds:
        yield Entry(Sign.ATTACK, "attack", "caused by an attack")
    if any(is_condition(node) for node in view.nodes):
        yield Entry(Sign.CONDITION, "condition", "holds, without an event")
    gates = {node.gate: node for node in view.nodes if view.children(node)}
    for gate, meaning in _MEANINGS.items():
        if gate in gates:
            yield Entry(Sign.GATE, gate_text(gates[gate]) or "", meaning, gate)
    if Gate.VOT in gates:
        yield Entry(Sign.GATE, "VOT k/n", "at least k of the n", Gate.VOT)
    if any(view.folded.values()):
        yield Entry(Sign.FOLDED, "+n", "n nodes not drawn")
    if not all(view.folded.values()):
        yield Entry(Sign.FOLDED, "…", "nodes drawn elsewhere")
    if view.shared and not graph:
        yield Entry(Sign.AGAIN, "name", "drawn in full elsewhere")
    if graph and view.numbered:
        yield Entry(Sign.ORDER, "1, 2", "the order under a SAND")
    if marks is not None:
        yield Entry(Sign.MARKED, "bold", marks.meaning)


def is_condition(node: Node) -> bool:
    """Whether a node is a leaf with a guard alone."""
    return node.leaf and node.on is None and node.when is not None
