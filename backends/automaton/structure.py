"""A tree as a graph of parts: single events, single guards, and four ways to put parts together.

Causality becomes sequence (a gate's event, then what is below it; the other way round under `bottom_up`), a constant guard
disappears or takes its node with it, and parts that are nested for no reason are flattened, so that a chain of thousands
of gates is one sequence. A node that several parents share stays one part.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum, auto
from typing import TypeAlias, assert_never

from rvaft.guards import Guard, holds, variables
from rvaft.model import Causality, Gate, Node
from rvaft.patterns import Pattern, rigid_variables
from rvaft.tree import RVAFT

Part: TypeAlias = int
"""A part is known by its index in `Structure.parts`."""


class How(Enum):
    """What becomes of the children: all in any order, all in sequence, exactly one, at least K."""

    ALL = auto()
    SEQUENCE = auto()
    ONE = auto()
    SOME = auto()


@dataclass(frozen=True, slots=True)
class Event:
    """One occurrence; `atom` is the index of its pattern in `Structure.patterns`."""

    node: str
    atom: int


@dataclass(frozen=True, slots=True)
class Condition:
    """One guard over variables; `guard` is its index in `Structure.guards`."""

    guard: int


@dataclass(frozen=True, slots=True)
class Group:
    """Parts put together; `least` is the K of SOME."""

    how: How
    children: tuple[Part, ...]
    least: int = 0


Content: TypeAlias = Event | Condition | Group


@dataclass(frozen=True, slots=True)
class Structure:
    """The parts, children before parents, and the tables of patterns and guards they refer to.

    `root` is None when constant guards leave no feasible scenario; `names` gives, for each pattern, a node that has it.
    """

    root: Part | None
    parts: tuple[Content, ...]
    patterns: tuple[Pattern, ...]
    names: tuple[str, ...]
    guards: tuple[Guard, ...]

    def binders(self) -> tuple[frozenset[int], ...]:
        """For each guard the atoms with one of its variables."""
        bound = [set(rigid_variables(pattern)) for pattern in self.patterns]
        return tuple(
            frozenset(atom for atom, names in enumerate(bound) if names & set(variables(guard)))
            for guard in self.guards
        )


def structure(tree: RVAFT) -> Structure:
    """The parts of a tree."""
    return _Builder(tree).build()


class _Builder:
    """Builds parts bottom-up; a node whose every scenario is infeasible has no part."""

    def __init__(self, tree: RVAFT) -> None:
        self.tree = tree
        self.parts: list[Content] = []
        self.shared: set[Part] = set()
        self.patterns: dict[Pattern, int] = {}
        self.names: list[str] = []
        for name in tree.occurrences:
            pattern = tree.pattern(name)
            if pattern is not None and pattern not in self.patterns:
                self.patterns[pattern] = len(self.patterns)
                self.names.append(name)
        guards = (node.when for node in tree.top_down() if node.when is not None and variables(node.when))
        self.guards = {guard: number for number, guard in enumerate(dict.fromkeys(guards))}

    def build(self) -> Structure:
        of: dict[str, Part | None] = {}
        for node in self.tree.bottom_up():
            part = self._node(node, [of[child] for child in node.children])
            of[node.name] = part
            if part is not None and node.name in self.tree.shared:
                self.shared.add(part)
        return Structure(
            of[self.tree.root], tuple(self.parts), tuple(self.patterns), tuple(self.names), tuple(self.guards)
        )

    def _node(self, node: Node, children: Sequence[Part | None]) -> Part | None:
        below = None if node.gate is None else self._gate(node, children)
        if node.gate is not None and below is None:
            return None
        sequence = [part for part in (self._event(node), below) if part is not None]
        if self.tree.causality is Causality.BOTTOM_UP:
            sequence.reverse()
        match node.when:
            case None:
                return self._group(How.SEQUENCE, sequence)
            case guard if not variables(guard):
                return self._group(How.SEQUENCE, sequence) if holds(guard, {}) else None
            case guard:
                condition = self._new(Condition(self.guards[guard]))
                return self._group(How.SEQUENCE, [condition, *sequence])

    def _event(self, node: Node) -> Part | None:
        pattern = self.tree.pattern(node.name)
        return None if pattern is None else self._new(Event(node.name, self.patterns[pattern]))

    def _gate(self, node: Node, children: Sequence[Part | None]) -> Part | None:
        feasible = [part for part in children if part is not None]
        assert node.gate is not None
        match node.gate:
            case Gate.OR:
                return self._group(How.ONE, feasible) if feasible else None
            case Gate.VOT:
                return self._vote(feasible, node.threshold or 0)
            case Gate.AND | Gate.SAND | Gate.SAND_RL if len(feasible) < len(children):
                return None
            case Gate.AND:
                return self._group(How.ALL, feasible)
            case Gate.SAND:
                return self._group(How.SEQUENCE, feasible)
            case Gate.SAND_RL:
                return self._group(How.SEQUENCE, feasible[::-1])
            case _:
                assert_never(node.gate)

    def _vote(self, feasible: list[Part], least: int) -> Part | None:
        if len(feasible) < least:
            return None
        if len(feasible) == least:
            return self._group(How.ALL, feasible)
        return self._new(Group(How.SOME, tuple(feasible), least))

    def _group(self, how: How, children: Iterable[Part]) -> Part:
        flat: list[Part] = []
        for child in children:
            content = self.parts[child]
            if isinstance(content, Group) and content.how is how and child not in self.shared:
                flat.extend(content.children)
            else:
                flat.append(child)
        if how is not How.SEQUENCE:
            flat = list(dict.fromkeys(flat))
        return flat[0] if len(flat) == 1 else self._new(Group(how, tuple(flat)))

    def _new(self, content: Content) -> Part:
        self.parts.append(content)
        return len(self.parts) - 1


def below(content: Content) -> tuple[Part, ...]:
    """The children of a part."""
    return content.children if isinstance(content, Group) else ()


def reachable(root: Part, parts: Mapping[Part, Content] | Sequence[Content]) -> list[Part]:
    """The parts reachable from the root, parents before children and first children first."""
    order: list[Part] = []
    state: dict[Part, bool] = {}
    todo = [(root, False)]
    while todo:
        part, left = todo.pop()
        if left:
            order.append(part)
        elif part not in state:
            state[part] = True
            todo.append((part, True))
            todo.extend((child, False) for child in below(parts[part]) if child not in state)
    order.reverse()
    return order
