"""The tree while it is being written: everything that was said and where, contradictions included.

An `RVAFT` cannot be wrong, a `Draft` can: it keeps each setting of each node in a list, so that `rvaft.rules` reports
all that is wrong with a file and not only the first. `Draft.build` makes the immutable tree of a draft without errors.
"""

from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Generic, TypeVar

from rvaft.errors import TreeError
from rvaft.model.guards import Guard
from rvaft.model.nodes import Causality, EventType, Gate, Ignore, Kind, Node, On, Place, Topic
from rvaft.model.topics import absolute
from rvaft.model.tree import RVAFT

T_co = TypeVar("T_co", covariant=True)


@dataclass(frozen=True, slots=True)
class Said(Generic[T_co]):
    """A value and where it was said."""

    value: T_co
    place: Place


@dataclass(frozen=True, slots=True)
class GateUse:
    """A gate with its children; `threshold` is the K of a VOT gate, `out_of` the N of K`of`N (None for `votK`)."""

    gate: Gate
    children: tuple[Said[str], ...]
    threshold: int | None = None
    out_of: int | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the children, in order, as often as they were written."""
        return tuple(child.value for child in self.children)


class PruneFault(StrEnum):
    """What can be wrong with a `prune`."""

    UNKNOWN = "unknown"
    """No statement mentions the pruned name."""
    ROOT = "root"
    """The pruned node is the root."""
    VOTE = "vote"
    """A KofN gate that stays would lose a child."""
    EMPTY = "empty"
    """A gate that stays would lose all its children."""


@dataclass(frozen=True, slots=True)
class BrokenPrune:
    """A `prune` that cannot be carried out: `pruned` was pruned at `place`; `node` is the gate that suffers, if any."""

    fault: PruneFault
    pruned: str
    place: Place
    node: str | None = None


@dataclass(slots=True)
class DraftNode:
    """All that was said of one node, in the order of the text; more than one entry in a list is a duplicate setting.

    `statements` are the places of the node's name in its own statements (never empty). `attributes` keep every pair.
    """

    name: str
    statements: list[Place] = field(default_factory=list)
    gates: list[Said[GateUse]] = field(default_factory=list)
    ons: list[Said[On]] = field(default_factory=list)
    whens: list[Said[Guard]] = field(default_factory=list)
    kinds: list[Said[Kind]] = field(default_factory=list)
    labels: list[Said[str]] = field(default_factory=list)
    attributes: list[Said[tuple[str, str]]] = field(default_factory=list)

    @property
    def place(self) -> Place:
        """Where the node was first stated."""
        return self.statements[0]

    def settings(self) -> dict[str, list[Place]]:
        """Where each part that a node has at most once was set: `gate`, `on`, `when`, `kind`, `label`."""
        return {
            "gate": [said.place for said in self.gates],
            "on": [said.place for said in self.ons],
            "when": [said.place for said in self.whens],
            "kind": [said.place for said in self.kinds],
            "label": [said.place for said in self.labels],
        }

    def children(self) -> list[Said[str]]:
        """The children of all gate settings, in the order of the text, duplicates included."""
        return [child for gate in self.gates for child in gate.value.children]

    def build(self) -> Node:
        """The node; raises `TreeError` where a part is set twice or the children are not as many as K`of`N says."""
        places = {"name": self.place}
        for part, where in self.settings().items():
            if len(where) > 1:
                message = f"{where[1]}: the {part} of {self.name} is set twice"
                raise TreeError(message, rule="duplicate-setting", nodes=[self.name])
            if where:
                places[part] = where[0]
        use = self.gates[0].value if self.gates else None
        if use is not None and use.out_of not in (None, len(use.children)):
            message = f"{places['gate']}: {self.name} has {len(use.children)} children, not {use.out_of}"
            raise TreeError(message, rule="threshold", nodes=[self.name])
        return Node(
            self.name,
            use.gate if use else None,
            use.names if use else (),
            use.threshold if use else None,
            self.ons[0].value if self.ons else None,
            self.whens[0].value if self.whens else None,
            self.kinds[0].value if self.kinds else None,
            self.labels[0].value if self.labels else None,
            tuple(said.value for said in self.attributes),
            places=places,
        )


@dataclass(frozen=True, slots=True)
class DraftTopic:
    """One `topic` statement."""

    name: Said[str]
    type: Said[str]
    publishers: tuple[Said[str], ...]


@dataclass(slots=True)
class Draft:
    """All that was said of one tree, in all its files; imports are resolved and prunes carried out.

    `file` is the file that was asked for. `toplevels` are those that count: an importing file's own, else those of
    what it imports; they contradict each other when they name different nodes. `causalities` are all settings.
    """

    file: str = "<text>"
    nodes: dict[str, DraftNode] = field(default_factory=dict)
    events: list[EventType] = field(default_factory=list)
    ignores: list[Ignore] = field(default_factory=list)
    topics: list[DraftTopic] = field(default_factory=list)
    toplevels: list[Said[str]] = field(default_factory=list)
    causalities: list[Said[Causality]] = field(default_factory=list)
    parameters: list[Said[str]] = field(default_factory=list)
    prunes: list[Said[str]] = field(default_factory=list)
    broken_prunes: list[BrokenPrune] = field(default_factory=list)

    def undeclared(self) -> list[Said[str]]:
        """The children that no statement defines, each once, where first named."""
        found: dict[str, Said[str]] = {}
        for node in self.nodes.values():
            for child in node.children():
                if child.value not in self.nodes:
                    found.setdefault(child.value, child)
        return list(found.values())

    def parentless(self) -> list[DraftNode]:
        """The nodes that are nobody's child, in the order of the text."""
        children = {child.value for node in self.nodes.values() for child in node.children()}
        return [node for node in self.nodes.values() if node.name not in children]

    @property
    def root(self) -> str | None:
        """The root: what `toplevel` names, else the only node without a parent; None where neither says one name."""
        said = [toplevel.value for toplevel in self.toplevels]
        names = set(said or (node.name for node in self.parentless()))
        return names.pop() if len(names) == 1 else None

    def build(self) -> RVAFT:
        """The tree; raises `TreeError` for what is wrong with its structure (the first thing found)."""
        root = self.root
        if root is None:
            raise TreeError("the tree has no root: say which node is `toplevel`", rule="no-root")
        if self.broken_prunes:
            broken = self.broken_prunes[0]
            raise TreeError(f"{broken.place}: cannot prune {broken.pruned}", rule="prune", nodes=[broken.pruned])
        _once([event.name for event in self.events], "event type")
        nodes = [node.build() for node in self.nodes.values()]
        nodes += [Node(c.value, declared=False, places={"name": c.place}) for c in self.undeclared()]
        causality = self.causalities[0].value if self.causalities else Causality.TOP_DOWN
        if any(said.value is not causality for said in self.causalities):
            raise TreeError("`causality` is set twice", rule="duplicate-setting")
        topics = _merged(self.topics)
        return RVAFT(root, nodes, self.events, ignores=self.ignores, topics=topics, causality=causality)


def _once(names: list[str], what: str) -> None:
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise TreeError(f"{what} {twice} is declared twice", rule="duplicate-setting")


def _merged(said: list[DraftTopic]) -> list[Topic]:
    """One topic per name and type, with the publishers of all its statements."""
    found: dict[tuple[str, str], Topic] = {}
    for topic in said:
        key = absolute(topic.name.value), topic.type.value
        first = found.get(key, Topic(topic.name.value, topic.type.value, place=topic.name.place))
        nodes = dict.fromkeys([*first.publishers, *(publisher.value for publisher in topic.publishers)])
        found[key] = replace(first, publishers=tuple(nodes))
    return list(found.values())


# Carrying out `prune`: drop the named nodes and what only they reach (step 3 of the method: parts nobody will monitor).


def carry_out_prunes(draft: Draft) -> None:
    """Drop what is pruned from the draft; what cannot be dropped stays, and is noted in `broken_prunes`."""
    if not draft.prunes:
        return
    pruned: dict[str, Place] = {}
    for said in draft.prunes:
        pruned.setdefault(said.value, said.place)
    parents = _parent_counts(draft)
    roots = {said.value for said in draft.toplevels} or {node.name for node in draft.parentless()}
    for name, place in list(pruned.items()):
        if name not in draft.nodes and name not in parents:
            draft.broken_prunes.append(BrokenPrune(PruneFault.UNKNOWN, name, place))
            del pruned[name]
    gone = _unreached(draft, set(pruned), {said.value for said in draft.toplevels}, parents)
    if roots <= gone:
        root = min(roots & pruned.keys(), key=lambda name: pruned[name])
        draft.broken_prunes.append(BrokenPrune(PruneFault.ROOT, root, pruned[root]))
        return
    for name in gone & draft.nodes.keys():
        del draft.nodes[name]
    for node in draft.nodes.values():
        node.gates = [_without(gate, gone, node.name, pruned, draft.broken_prunes) for gate in node.gates]


def _parent_counts(draft: Draft) -> dict[str, int]:
    counts: dict[str, int] = {}
    for node in draft.nodes.values():
        for name in {child.value for child in node.children()}:
            counts[name] = counts.get(name, 0) + 1
    return counts


def _unreached(draft: Draft, pruned: set[str], kept: set[str], parents: dict[str, int]) -> set[str]:
    """The pruned nodes, and those that have lost all their parents to them (but never a toplevel)."""
    left = dict(parents)
    gone = set(pruned)
    todo = list(pruned)
    while todo:
        node = draft.nodes.get(todo.pop())
        for name in {child.value for child in node.children()} if node else ():
            left[name] -= 1
            if left[name] == 0 and name not in gone and name not in kept:
                gone.add(name)
                todo.append(name)
    return gone


def _without(
    gate: Said[GateUse], gone: set[str], name: str, pruned: dict[str, Place], broken: list[BrokenPrune]
) -> Said[GateUse]:
    use = gate.value
    left = tuple(child for child in use.children if child.value not in gone)
    if len(left) == len(use.children):
        return gate
    lost = next(child.value for child in use.children if child.value in gone)
    if use.gate is Gate.VOT or not left:
        fault = PruneFault.VOTE if use.gate is Gate.VOT else PruneFault.EMPTY
        broken.append(BrokenPrune(fault, lost, pruned[lost], name))
        return gate
    return Said(GateUse(use.gate, left), gate.place)
