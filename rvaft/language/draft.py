"""The mutable form of a tree: all statements with their positions, including contradictory ones.

An `RVAFT` is always valid. A `Draft` keeps all errors, so that `rvaft.rules` can report them.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final, Generic, NamedTuple, TypeVar, assert_never

from rvaft.errors import TreeError
from rvaft.model.event_time import EventTime, TextFormat
from rvaft.model.guards import Guard
from rvaft.model.nodes import (
    Assumption,
    Causality,
    EventType,
    Gate,
    Ignore,
    Kind,
    Node,
    On,
    Place,
    Topic,
    Without,
    absolute,
)
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics
from rvaft.support.collector import no_collections

T_co = TypeVar("T_co", covariant=True)


class Located(NamedTuple, Generic[T_co]):
    """A value with its position."""

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
    "por": Gate.OR,
    "mutex": Gate.OR,
    "sor": Gate.OR,
}
"""The dynamic gates of Galileo, with the gate in their place.

`galileo.py` handles those that depend on more than the word, and refuses `por` and `mutex`, which
only analyses of risk read.
"""


class GateUse(NamedTuple):
    """A gate with its children: `threshold` and `out_of` are the numbers of K`of`N (`votK` has
    one).

    `dynamic` is a word of Galileo, such as `wsp` or `pdep=1`.
    """

    gate: Gate
    children: tuple[Located[str], ...]
    threshold: int | None = None
    out_of: int | None = None
    dynamic: str = ""

    @classmethod
    def of(cls, word: str, children: tuple[Located[str], ...], threshold: int | None, out_of: int | None) -> "GateUse":
        """Return the gate with this word and its numbers."""
        if threshold is not None:
            return cls(Gate.VOT, children, threshold, out_of)
        known = DYNAMIC_GATES.get(word.partition("=")[0].strip())
        return cls(Gate(word), children) if known is None else cls(known, children, dynamic=word)

    @property
    def is_dependency(self) -> bool:
        """Whether it is a functional dependency (Galileo's `fdep` and `pdep`)."""
        return self.dynamic.startswith(("fdep", "pdep"))


class Count(NamedTuple):
    """`times number [distinct X, Y] [each Z]`."""

    number: int
    distinct: tuple[str, ...] = ()
    each: tuple[str, ...] = ()


UNMENTIONED: Final = "no statement mentions it"


class Reading(NamedTuple):
    """How a dynamic gate, or a part of a tree in another format, is read: a sentence, and its nodes."""

    place: Place
    sentence: str
    nodes: tuple[str, ...]


class BrokenPrune(NamedTuple):
    """A `prune` of the node `pruned` that fails, with the reason and the affected gate, if any."""

    reason: str
    pruned: str
    place: Place
    node: str | None = None


_SETTINGS: Final = ("gate", "on", "when", "kind", "label", "times", "within")


@dataclass(slots=True)
class DraftNode:
    """All statements about one node, in the order of the text; each list may have duplicates.

    `statements` are the positions of its own statements (never empty). A node of a translation is `made`.
    """

    name: str
    statements: list[Place] = field(default_factory=list)
    gates: list[Located[GateUse]] = field(default_factory=list)
    ons: list[Located[On]] = field(default_factory=list)
    whens: list[Located[Guard]] = field(default_factory=list)
    kinds: list[Located[Kind]] = field(default_factory=list)
    labels: list[Located[str]] = field(default_factory=list)
    counts: list[Located[Count]] = field(default_factory=list)
    withins: list[Located[int]] = field(default_factory=list)
    withouts: list[Located[Without]] = field(default_factory=list)
    attributes: list[Located[tuple[str, str]]] = field(default_factory=list)
    made: bool = False

    @property
    def place(self) -> Place:
        """The position of the node's first statement."""
        return self.statements[0]

    def settings(self) -> dict[str, list[Place]]:
        """Return the positions of each setting that a node may have once, such as `gate`."""
        parts: list[Sequence[Located[object]]]
        parts = [self.gates, self.ons, self.whens, self.kinds, self.labels, self.counts, self.withins]
        return {word: [setting.place for setting in part] for word, part in zip(_SETTINGS, parts, strict=True) if part}

    def children(self) -> list[Located[str]]:
        """Return the children of all gates, in the order of the text, with duplicates."""
        return [child for gate in self.gates for child in gate.value.children]

    def build(self) -> Node:
        """Return the node, with the first of duplicate settings."""
        count = _first(self.counts) or Count(1)
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
            tuple([attribute.value for attribute in self.attributes]),
            count.number,
            _first(self.withins),
            tuple([replace(clause, place=place) for clause, place in self.withouts]),
            count.distinct,
            tuple(name for name in count.each if name not in count.distinct),
            made=self.made,
            places=places,
        )


def _first(settings: list[Located[T_co]]) -> T_co | None:
    return settings[0].value if settings else None


class DraftTopic(NamedTuple):
    """One `topic` statement."""

    name: Located[str]
    type: Located[str]
    publishers: tuple[Located[str], ...]


@dataclass(slots=True)
class Draft:
    """All statements of one tree, in all its files; imports are resolved and prunes applied.

    `toplevels` are those of the main file, or otherwise those of its imports; they are
    contradictory if they name different nodes. `year` is for a format of times that has none.

    >>> from rvaft.language.parser import parse
    >>> draft = parse("top or a b; a fault; a attack;")
    >>> [kind.value.value for kind in draft.nodes["a"].kinds], [child.value for child in draft.undeclared()]
    (['fault', 'attack'], ['b'])
    """

    file: str = "<text>"
    nodes: dict[str, DraftNode] = field(default_factory=dict)
    events: list[EventType] = field(default_factory=list)
    ignores: list[Ignore] = field(default_factory=list)
    topics: list[DraftTopic] = field(default_factory=list)
    toplevels: list[Located[str]] = field(default_factory=list)
    causalities: list[Located[Causality]] = field(default_factory=list)
    semantics: list[Located[Semantics]] = field(default_factory=list)
    times: list[Located[EventTime]] = field(default_factory=list)
    assumes: list[Located[Assumption]] = field(default_factory=list)
    orders: list[Located[int]] = field(default_factory=list)
    shows: list[Located[str]] = field(default_factory=list)
    repeats: list[Located[str]] = field(default_factory=list)
    parameters: list[Located[str]] = field(default_factory=list)
    prunes: list[Located[str]] = field(default_factory=list)
    broken_prunes: list[BrokenPrune] = field(default_factory=list)
    dynamic_gates: list[Reading] = field(default_factory=list)
    readings: list[Reading] = field(default_factory=list)
    """How parts of files in other formats than Galileo's are read."""
    persistent: bool = False
    """Whether a file is a fault tree, whose failures persist: `scattered` where no semantics is stated."""
    year: int | None = None

    def undeclared(self) -> list[Located[str]]:
        """Return the children without a statement, each once, at their first use."""
        found: dict[str, Located[str]] = {}
        for node in self.nodes.values():
            for child in node.children():
                if child.value not in self.nodes:
                    found.setdefault(child.value, child)
        return list(found.values())

    def parentless(self) -> list[DraftNode]:
        """Return the nodes without a parent, in the order of the text."""
        children = {child.value for node in self.nodes.values() for child in node.children()}
        return [node for name, node in self.nodes.items() if name not in children]

    @property
    def root(self) -> str | None:
        """The node of `toplevel`, else the only node without a parent; None if ambiguous."""
        names = {toplevel.value for toplevel in self.toplevels} or {node.name for node in self.parentless()}
        return names.pop() if len(names) == 1 else None

    @property
    def time(self) -> EventTime | None:
        """The time of events, with the lateness of `assume order` if that states it."""
        time, order = _first(self.times), _first(self.orders)
        if time is not None and isinstance(time.format, TextFormat) and time.format.needs_year:
            time = replace(time, format=replace(time.format, year=self.year))
        return time if time is None or order is None else replace(time, late=order)

    @no_collections()
    def build(self) -> RVAFT:
        """Return the tree; raises `TreeError` if the draft is no tree."""
        root = self.root
        if root is None:
            raise TreeError("the tree has no root: declare it with `toplevel NAME;`", rule="no-root")
        nodes = [node.build() for node in self.nodes.values()]
        nodes += [Node(c.value, declared=False, places={"name": c.place}) for c in self.undeclared()]
        topics: dict[tuple[str, str], Topic] = {}  # one per name and type, with all publishers
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
            time=self.time,
            semantics=_first(self.semantics) or (Semantics.SCATTERED if self.persistent else None),
            assumes=[said.value for said in self.assumes],
            shows=[shown.value for shown in self.shows],
            repeat_by=_first(self.repeats),
            translated=bool(self.dynamic_gates),
        )

    def settings(self) -> dict[str, Sequence[Located[object]]]:
        """Return the settings that a tree may have once, by their keywords."""
        orders = [*(Located(one.late, place) for one, place in self.times if one.late is not None), *self.orders]
        once: dict[str, Sequence[Located[object]]]
        once = {"causality": self.causalities, "semantics": self.semantics, "time": self.times}
        return {**once, "assume order": orders, "repeat by": self.repeats}

    def carry_out_prunes(self) -> None:
        """Remove the pruned nodes and those reachable only through them; record `broken_prunes`."""
        if not self.prunes:
            return
        pruned: dict[str, Place] = {}
        for name, place in self.prunes:
            pruned.setdefault(name, place)
        parents = Counter(name for node in self.nodes.values() for name in {child.value for child in node.children()})
        for name in [name for name in pruned if name not in self.nodes and name not in parents]:
            self.broken_prunes.append(BrokenPrune(UNMENTIONED, name, pruned.pop(name)))
        kept = {toplevel.value for toplevel in self.toplevels}
        roots = kept or {node.name for node in self.parentless()}
        gone = self._unreached(set(pruned), kept, parents)
        if roots <= gone:
            root = min(roots & pruned.keys(), key=lambda name: pruned[name])
            self.broken_prunes.append(BrokenPrune("it is the root", root, pruned[root]))
            return
        self.nodes = {name: node for name, node in self.nodes.items() if name not in gone}
        for node in self.nodes.values():
            node.gates = [
                Located(self._without(gate.value, gone, node.name, pruned), gate.place) for gate in node.gates
            ]

    def _unreached(self, pruned: set[str], kept: set[str], parents: Counter[str]) -> set[str]:
        """Return the pruned nodes, and those with only pruned parents (but never a toplevel)."""
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
        left = tuple(child for child in use.children if child.value not in gone)
        if len(left) == len(use.children):
            return use
        if use.is_dependency:  # without its trigger it has no effect
            return use._replace(children=left if left[:1] == use.children[:1] and len(left) > 1 else ())
        match use.gate:
            # with fewer children the meaning is the same
            case Gate.OR | Gate.AND | Gate.SAND | Gate.SAND_RL | Gate.PAND:
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
