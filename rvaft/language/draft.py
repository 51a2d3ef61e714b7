"""The tree while it is being written: everything that was said and where, contradictions included.

An `RVAFT` cannot be wrong, a `Draft` can: it keeps each setting of each node in a list, so that `rvaft.rules` reports
all that is wrong with a file and not only the first. `Draft.build` makes the immutable tree of a draft without errors.
"""

import gc
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Final, Generic, NamedTuple, TypeVar, assert_never

from rvaft.errors import TreeError
from rvaft.model.event_time import EventTime
from rvaft.model.guards import Guard
from rvaft.model.nodes import Causality, EventType, Gate, Ignore, Kind, Node, On, Place, Topic, absolute
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics

T_co = TypeVar("T_co", covariant=True)


class Said(NamedTuple, Generic[T_co]):
    """A value and where it was said."""

    value: T_co
    place: Place


DYNAMIC_GATES: Final[Mapping[str, Gate]] = {
    "pand": Gate.PAND,
    "seq": Gate.SAND,
    "csp": Gate.SAND,
    "wsp": Gate.AND,
    "hsp": Gate.AND,
    "spare": Gate.AND,
    "fdep": Gate.OR,
    "pdep": Gate.OR,
}
"""The dynamic gates of Galileo that are read, and as what.

`galileo.py` makes good where that depends on more than the word.
"""


class GateUse(NamedTuple):
    """A gate with its children; `threshold` is the K of a VOT gate, `out_of` the N of K`of`N (None for `votK`).

    `dynamic` is the word of Galileo, such as `wsp` or `pdep=1`, where the gate was written as one.
    """

    gate: Gate
    children: tuple[Said[str], ...]
    threshold: int | None = None
    out_of: int | None = None
    dynamic: str = ""

    @classmethod
    def of(cls, word: str, children: tuple[Said[str], ...], threshold: int | None, out_of: int | None) -> "GateUse":
        """The use of a gate that is written as this word, with the numbers in it."""
        if threshold is not None:
            return cls(Gate.VOT, children, threshold, out_of)
        known = DYNAMIC_GATES.get(word.partition("=")[0].strip())
        return cls(Gate(word), children) if known is None else cls(known, children, dynamic=word)

    @property
    def is_dependency(self) -> bool:
        """Whether it says that the first child brings about the others (Galileo's `fdep` and `pdep`)."""
        return self.dynamic.startswith(("fdep", "pdep"))


@contextmanager
def no_collections() -> Iterator[None]:
    """Without searches for circles of garbage: a large tree has none, and each search looks at all of it again."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


UNMENTIONED: Final = "no statement mentions it"


class DynamicGate(NamedTuple):
    """How a dynamic gate of Galileo was read, in a sentence, and the nodes that it is about."""

    place: Place
    said: str
    nodes: tuple[str, ...]


class BrokenPrune(NamedTuple):
    """A `prune` that cannot be carried out, and why: `pruned` was pruned at `place`.

    `node` is the gate that suffers, if any.
    """

    why: str
    pruned: str
    place: Place
    node: str | None = None


_SETTINGS: Final = ("gate", "on", "when", "kind", "label", "times", "within")


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
    counts: list[Said[int]] = field(default_factory=list)
    withins: list[Said[int]] = field(default_factory=list)
    attributes: list[Said[tuple[str, str]]] = field(default_factory=list)

    @property
    def place(self) -> Place:
        """Where the node was first stated."""
        return self.statements[0]

    def settings(self) -> dict[str, list[Place]]:
        """Where each part that a node has at most once was set, of those that were.

        `gate`, `on`, `when`, `kind` and so on.
        """
        parts: list[Sequence[Said[object]]]
        parts = [self.gates, self.ons, self.whens, self.kinds, self.labels, self.counts, self.withins]
        return {word: [said.place for said in part] for word, part in zip(_SETTINGS, parts, strict=True) if part}

    def children(self) -> list[Said[str]]:
        """The children of all gate settings, in the order of the text, duplicates included."""
        return [child for gate in self.gates for child in gate.value.children]

    def build(self) -> Node:
        """The node, with the first that was said of each part."""
        places = {"name": self.place, **{part: where[0] for part, where in self.settings().items()}}
        use = _first(self.gates)
        return Node(
            self.name,
            use and use.gate,
            tuple([child.value for child in use.children]) if use else (),
            use and use.threshold,
            _first(self.ons),
            _first(self.whens),
            _first(self.kinds),
            _first(self.labels),
            tuple([said.value for said in self.attributes]),
            _first(self.counts) or 1,
            _first(self.withins),
            places=places,
        )


def _first(settings: list[Said[T_co]]) -> T_co | None:
    return settings[0].value if settings else None


class DraftTopic(NamedTuple):
    """One `topic` statement."""

    name: Said[str]
    type: Said[str]
    publishers: tuple[Said[str], ...]


@dataclass(slots=True)
class Draft:
    """All that was said of one tree, in all its files; imports are resolved and prunes carried out.

    `file` is the file that was asked for. `toplevels` are those that count: an importing file's own, else those of
    what it imports; they contradict each other when they name different nodes. `causalities` are all settings.

    >>> from rvaft.language.parser import parse
    >>> draft = parse("top or a b; a fault; a attack;")
    >>> [said.value.value for said in draft.nodes["a"].kinds], [said.value for said in draft.undeclared()]
    (['fault', 'attack'], ['b'])
    """

    file: str = "<text>"
    nodes: dict[str, DraftNode] = field(default_factory=dict)
    events: list[EventType] = field(default_factory=list)
    ignores: list[Ignore] = field(default_factory=list)
    topics: list[DraftTopic] = field(default_factory=list)
    toplevels: list[Said[str]] = field(default_factory=list)
    causalities: list[Said[Causality]] = field(default_factory=list)
    semantics: list[Said[Semantics]] = field(default_factory=list)
    times: list[Said[EventTime]] = field(default_factory=list)
    parameters: list[Said[str]] = field(default_factory=list)
    prunes: list[Said[str]] = field(default_factory=list)
    broken_prunes: list[BrokenPrune] = field(default_factory=list)
    dynamic_gates: list[DynamicGate] = field(default_factory=list)

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
        return [node for name, node in self.nodes.items() if name not in children]

    @property
    def root(self) -> str | None:
        """The root: what `toplevel` names, else the only node without a parent; None where neither says one name."""
        names = {said.value for said in self.toplevels} or {node.name for node in self.parentless()}
        return names.pop() if len(names) == 1 else None

    @no_collections()
    def build(self) -> RVAFT:
        """The tree of a draft in which `rvaft.rules` finds no error; raises `TreeError` for what is no tree."""
        root = self.root
        if root is None:
            raise TreeError("the tree has no root: say which node is `toplevel`", rule="no-root")
        nodes = [node.build() for node in self.nodes.values()]
        nodes += [Node(c.value, declared=False, places={"name": c.place}) for c in self.undeclared()]
        topics: dict[tuple[str, str], Topic] = {}  # one per name and type, with the publishers of all its statements
        for topic in self.topics:
            key = absolute(topic.name.value), topic.type.value
            first = topics.get(key, Topic(topic.name.value, topic.type.value, place=topic.name.place))
            named = dict.fromkeys([*first.publishers, *(publisher.value for publisher in topic.publishers)])
            topics[key] = replace(first, publishers=tuple(named))
        return RVAFT(
            root,
            nodes,
            self.events,
            ignores=self.ignores,
            topics=topics.values(),
            causality=_first(self.causalities) or Causality.TOP_DOWN,
            time=_first(self.times),
            semantics=_first(self.semantics),
        )

    def settings(self) -> dict[str, Sequence[Said[object]]]:
        """The settings of what a tree has at most once, by the words of their statements."""
        return {"causality": self.causalities, "semantics": self.semantics, "time": self.times}

    def carry_out_prunes(self) -> None:
        """Drop the pruned nodes and what only they reach; what cannot be dropped stays, and is
        noted in `broken_prunes`.
        """
        if not self.prunes:
            return
        pruned: dict[str, Place] = {}
        for name, place in self.prunes:
            pruned.setdefault(name, place)
        parents = Counter(name for node in self.nodes.values() for name in {child.value for child in node.children()})
        for name in [name for name in pruned if name not in self.nodes and name not in parents]:
            self.broken_prunes.append(BrokenPrune(UNMENTIONED, name, pruned.pop(name)))
        kept = {said.value for said in self.toplevels}
        roots = kept or {node.name for node in self.parentless()}
        gone = self._unreached(set(pruned), kept, parents)
        if roots <= gone:
            root = min(roots & pruned.keys(), key=lambda name: pruned[name])
            self.broken_prunes.append(BrokenPrune("it is the root", root, pruned[root]))
            return
        self.nodes = {name: node for name, node in self.nodes.items() if name not in gone}
        for node in self.nodes.values():
            node.gates = [Said(self._without(said.value, gone, node.name, pruned), said.place) for said in node.gates]

    def _unreached(self, pruned: set[str], kept: set[str], parents: Counter[str]) -> set[str]:
        """The pruned nodes, and those that have lost all their parents to them (but never a toplevel)."""
        left, gone, todo = parents.copy(), set(pruned), list(pruned)
        while todo:
            node = self.nodes.get(todo.pop())
            for name in {child.value for child in node.children()} if node else ():
                left[name] -= 1
                if left[name] == 0 and name not in gone and name not in kept:
                    gone.add(name)
                    todo.append(name)
        return gone

    def _without(self, use: GateUse, gone: set[str], name: str, pruned: dict[str, Place]) -> GateUse:
        """A gate without the children that are gone, or as it is where it cannot do without them."""
        left = tuple(child for child in use.children if child.value not in gone)
        if len(left) == len(use.children):
            return use
        if use.is_dependency:  # without its trigger it says nothing
            return use._replace(children=left if left[:1] == use.children[:1] and len(left) > 1 else ())
        match use.gate:
            case Gate.OR | Gate.AND | Gate.SAND | Gate.SAND_RL | Gate.PAND:  # fewer children ask for nothing new
                if left:
                    return use._replace(children=left)
                why = f"the gate {name} would have no child left; prune {name} too"
            case Gate.VOT:
                why = f"the KofN gate {name} would lose a child; prune {name} too, or rewrite it"
            case _ as never:
                assert_never(never)
        lost = next(child.value for child in use.children if child.value in gone)
        self.broken_prunes.append(BrokenPrune(why, lost, pruned[lost], name))
        return use
