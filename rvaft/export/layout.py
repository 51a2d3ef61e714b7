"""What a drawing shows of a tree, the same in every format: which nodes, what stands in the box of each, what is marked, what signs mean.

The renderers `text`, `dot` and `tikz` make it their own; no text here is escaped for any of them.
"""

import json
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from enum import Enum, auto
from functools import cached_property
from typing import Final, NamedTuple, assert_never

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

LONGEST: Final = 120
"""Characters of a value; what is longer is cut, and a sign says so."""
WIDTH: Final = 14
"""Columns of text in a box: so narrow that a tree of the size that papers print is still readable in one column."""
NARROWEST: Final = 4
"""Columns of text that a box has at least."""


@dataclass(frozen=True, slots=True)
class Marks:
    """A match on a tree: the scenario's nodes with the children they keep, what stands at a node, and what below the tree.

    `meaning` is what it means to be marked.
    """

    kept: Mapping[str, frozenset[str]]
    notes: Mapping[str, tuple[str, ...]]
    below: tuple[str, ...]
    meaning: str = "detected"

    def edge(self, parent: str | None, child: str) -> bool:
        """Whether the scenario keeps this child of this node."""
        return parent is not None and child in self.kept.get(parent, ())


def marks(tree: RVAFT, explanation: Explanation, events: Mapping[int, Json]) -> Marks:
    """The marks of a match; of an event that is not among `events` only the number is known."""
    scenario = {name: frozenset(children) for name, children in explanation.scenario.items()}
    kept = {**dict.fromkeys(explanation.matched, frozenset[str]()), **scenario}
    notes = {name: tuple(_note(number, events.get(number))) for name, number in explanation.matched.items()}
    order = {name: place for place, name in enumerate(tree.variables)}
    values = sorted(explanation.variables.items(), key=lambda item: order.get(item[0], len(order)))
    title = _title(explanation.branch, explanation.kinds)
    below = [title] * bool(title) + [f"{name} = {_written(value)}" for name, value in values]
    return Marks(kept, notes, tuple(below))


def branch_marks(tree: RVAFT, number: int) -> Marks:
    """The marks of the branch of that number; raises `TreeError` where there is none."""
    found = branch(tree, number)
    kept = {name: frozenset(found.children(name)) for name in found.nodes}
    return Marks(kept, {}, (_title(number, found.kinds),), f"branch {number}")


def _note(number: int, event: Json) -> Iterator[str]:
    """What is shown of an event: its number, and its time and topic where it has them."""
    yield f"event {number}"
    for field in ("time", "topic"):
        if isinstance(event, Mapping) and field in event:
            value = event[field]
            yield f"{field} {_cut(value) if isinstance(value, str) else _written(value)}"


def _title(number: int | None, kinds: Collection[Kind]) -> str:
    words = ("" if number is None else f"branch {number}", ", ".join(sorted(kind.value for kind in kinds)))
    return ": ".join(word for word in words if word)


def _written(value: Json) -> str:
    try:
        return _cut(json.dumps(value, ensure_ascii=False, default=repr))
    except ValueError:  # an integer of more digits than Python writes
        return "…"


def _cut(text: str) -> str:
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}…"


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
        loose = set(self.shared)  # shared, or above something that is
        found: set[str] = set()
        for node in reversed(self.nodes):
            if not loose.isdisjoint(self.children(node)):
                loose.add(node.name)
                if node.gate is not None and node.gate.ordered:
                    found.add(node.name)
        return frozenset(found)


def view(tree: RVAFT, look: Look) -> View:
    """The part that a look shows; raises `OptionError` for a node to collapse that the tree does not have, or a negative depth.

    A node is as deep as its shortest path from the root. At the last level a node is folded if a child of it is left out.
    """
    for name in look.collapse:
        _check_known(tree, name)
    if look.depth is not None and look.depth < 0:
        raise OptionError(f"the depth of a drawing is 0 or more, not {look.depth}")
    drawn, level, reached = {tree.root}, [tree.root], 0
    while level and (look.depth is None or reached < look.depth):
        below = [child for name in level if name not in look.collapse for child in tree.nodes[name].children]
        level = [child for child in dict.fromkeys(below) if child not in drawn]
        drawn.update(level)
        reached += 1
    nodes = tuple(node for node in tree.top_down() if node.name in drawn)
    cut = [node.name for node in nodes if not drawn.issuperset(node.children)]
    cut += [name for name in look.collapse if tree.nodes[name].children and name in drawn]
    return View(nodes, {name: len(nx.descendants(tree.graph, name) - drawn) for name in cut})


def _check_known(tree: RVAFT, name: str) -> None:
    if name in tree.order:
        return
    if name in tree.nodes:
        raise OptionError(f"cannot collapse {visible(name)}: the root does not lead to it")
    close = get_close_matches(name, tree.order, n=1, cutoff=0.4)
    hint = f"; did you mean {visible(close[0])}?" if close else ""
    raise OptionError(f"cannot collapse {visible(name)}: the tree has no such node{hint}")


def gate_text(node: Node) -> str:
    """The short form of a gate, with the direction of a SAND and the k/n of a VOT; nothing for a leaf."""
    match node.gate:
        case None:
            return ""
        case Gate.SAND:
            return "SAND →"
        case Gate.SAND_RL:
            return "SAND ←"
        case Gate.VOT:
            return f"VOT {node.threshold}/{len(node.children)}"
        case Gate.AND | Gate.OR:
            return node.gate.value.upper()
        case _:
            assert_never(node.gate)


def is_condition(node: Node) -> bool:
    """Whether a node is a leaf with a guard alone."""
    return node.leaf and node.on is None and node.when is not None


class Role(Enum):
    """What a row of a box is there for."""

    PLAIN = auto()
    BOLD = auto()
    EVENT = auto()
    GUARD = auto()


class BoxRow(NamedTuple):
    """The lines of a row."""

    role: Role
    lines: list[str]


def rows(node: Node, look: Look) -> Iterator[BoxRow]:
    """What stands in the box of a node: name, label, event, guard and notes, as far as the look has them; the first tells which node it is."""
    width = look.wrap
    code_width = width + width // 4  # events and guards do not break as well as words
    if not node.label:
        yield BoxRow(Role.PLAIN, wrapped(node.name, width))
    elif look.names:
        yield BoxRow(Role.BOLD, wrapped(node.name, width))
    if node.label:
        yield BoxRow(Role.PLAIN, wrapped(node.label, width))
    if look.events and node.has_event:
        event = on_text(node.on) if node.on else f"event: {json.dumps(node.name, ensure_ascii=False)}"
        yield BoxRow(Role.EVENT, wrapped_code(event, code_width))
    if look.events and node.when is not None:
        yield BoxRow(Role.GUARD, wrapped_code(f"when {guard_text(node.when)}", code_width))
    for place, part in enumerate(look.marks.notes.get(node.name, ()) if look.marks else ()):
        yield BoxRow(Role.PLAIN if place else Role.BOLD, wrapped(part, width))


def said(node: Node, *, events: bool = True) -> str:
    """A node in one line: its gate, kind, event, guard and label. A default event says no more than the name."""
    parts = [
        gate_text(node),
        f"[{node.kind.value}]" if node.kind else "",
        f"on {on_text(node.on)}" if node.on and events else "",
        f"when {guard_text(node.when)}" if node.when is not None and events else "",
        json.dumps(node.label, ensure_ascii=False) if node.label else "",
    ]
    return visible("  ".join(part for part in parts if part))


class Sign(Enum):
    """How the sample of an entry of the legend is drawn."""

    FAULT = "fault"
    ATTACK = "attack"
    CONDITION = "condition"
    GATE = "gate"
    FOLDED = "folded"
    AGAIN = "again"
    ORDER = "order"
    MARKED = "marked"


class LegendEntry(NamedTuple):
    """A sample and what it means; the sample of a gate has that gate's outline."""

    sign: Sign
    sample: str
    meaning: str
    gate: Gate | None = None


def _meaning(gate: Gate) -> str:
    match gate:
        case Gate.OR:
            return "one of them"
        case Gate.AND:
            return "all, in any order"
        case Gate.SAND:
            return "all, from left to right"
        case Gate.SAND_RL:
            return "all, from right to left"
        case Gate.VOT:
            return "at least k of the n"
        case _:
            assert_never(gate)


def entries(view: View, marks: Marks | None, *, graph: bool) -> Iterator[LegendEntry]:
    """The entries for what a drawing has, in a fixed order.

    A `graph` has a shared node once and numbers children that may stand out of order, other formats draw a tree and refer.
    """
    kinds = {node.kind for node in view.nodes}
    if Kind.FAULT in kinds:
        yield LegendEntry(Sign.FAULT, "fault", "caused by a fault")
    if Kind.ATTACK in kinds:
        yield LegendEntry(Sign.ATTACK, "attack", "caused by an attack")
    if any(is_condition(node) for node in view.nodes):
        yield LegendEntry(Sign.CONDITION, "condition", "holds, without an event")
    gates = {node.gate: node for node in view.nodes if view.children(node)}
    for gate in Gate:
        if gate in gates:
            sample = "VOT k/n" if gate is Gate.VOT else gate_text(gates[gate])
            yield LegendEntry(Sign.GATE, sample, _meaning(gate), gate)
    if any(view.folded.values()):
        yield LegendEntry(Sign.FOLDED, "+n", "n nodes not drawn")
    if not all(view.folded.values()):
        yield LegendEntry(Sign.FOLDED, "…", "nodes drawn elsewhere")
    if view.shared and not graph:
        yield LegendEntry(Sign.AGAIN, "name", "drawn in full elsewhere")
    if graph and view.numbered:
        yield LegendEntry(Sign.ORDER, "1, 2", "the order under a SAND")
    if marks is not None:
        yield LegendEntry(Sign.MARKED, "bold", marks.meaning)
