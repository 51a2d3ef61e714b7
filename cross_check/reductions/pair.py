"""A tree taken apart, with a trace: what reductions make smaller, and how small it is.

A candidate is cheap: it becomes a tree, or is found to be none, only when it is tried.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from hashlib import blake2b
from typing import TypeAlias

from cross_check.reductions.sizes import Measure, measure
from rvaft.model import Causality, EventType, Ignore, Node, Place
from rvaft.patterns import match
from rvaft.tree import RVAFT
from rvaft.values import Json

Trace: TypeAlias = tuple[Json, ...]


@dataclass(frozen=True, eq=False)
class Pair:
    """The parts of a tree, and a trace. No part remembers its place in a file."""

    root: str
    nodes: Mapping[str, Node]
    events: Mapping[str, EventType]
    ignores: tuple[Ignore, ...]
    causality: Causality
    trace: Trace

    @classmethod
    def of(cls, tree: RVAFT, trace: Iterable[Json]) -> "Pair":
        """Take a whole tree apart."""
        return cls(
            tree.root,
            {name: replace(node, declared=True, places={}) for name, node in tree.nodes.items()},
            {name: replace(event, place=Place()) for name, event in tree.events.items()},
            tuple(replace(ignore, place=Place()) for ignore in tree.ignores),
            tree.causality,
            tuple(trace),
        )

    @cached_property
    def tree(self) -> RVAFT:
        """The tree; raises `TreeError` where the parts make none."""
        return RVAFT(
            self.root, self.nodes.values(), self.events.values(), ignores=self.ignores, causality=self.causality
        )

    @cached_property
    def measure(self) -> Measure:
        """How large the pair is; see `sizes`."""
        return measure(self.root, self.nodes, self.events, self.ignores, causality=self.causality, trace=self.trace)

    @cached_property
    def key(self) -> bytes:
        """Equal for pairs that are written the same way (so 1 and 1.0 differ)."""
        parts = (self.root, *self.nodes.values(), *self.events.values(), self.ignores, self.causality, self.trace)
        return blake2b(repr(parts).encode("utf-8", "backslashreplace"), digest_size=16).digest()

    @property
    def order(self) -> tuple[str, ...]:
        """The reachable nodes, parents first."""
        return self.tree.order

    def with_node(self, *nodes: Node) -> "Pair":
        """With these nodes in place of those of the same name, and without what is then unreachable."""
        return self.at(self.root, {**self.nodes, **{node.name: node for node in nodes}})

    def at(self, root: str, nodes: Mapping[str, Node]) -> "Pair":
        """With this root and, of these nodes, those that it reaches."""
        reached: set[str] = set()
        agenda = [root]
        while agenda:
            name = agenda.pop()
            if name not in reached:
                reached.add(name)
                agenda.extend(nodes[name].children)
        return replace(self, root=root, nodes={name: node for name, node in nodes.items() if name in reached})

    def with_trace(self, trace: Iterable[Json]) -> "Pair":
        """With another trace."""
        return replace(self, trace=tuple(trace))

    def with_event_at(self, index: int, event: Json) -> "Pair":
        """With another event at one place."""
        return self.with_trace([*self.trace[:index], event, *self.trace[index + 1 :]])

    def without_event_at(self, index: int) -> "Pair":
        """Without one event."""
        return self.with_trace([*self.trace[:index], *self.trace[index + 1 :]])

    def served_by(self, name: str) -> list[int]:
        """Where the trace has events that the runtime event of a node matches by itself."""
        pattern = self.tree.pattern(name)
        return [] if pattern is None else [i for i, e in enumerate(self.trace) if match(pattern, e, {}) is not None]


Reduction: TypeAlias = Callable[[Pair], Iterator[Pair]]
"""Candidates to go on with instead of a pair, in a fixed order. Those that are not smaller, or no trees, are not tried."""
