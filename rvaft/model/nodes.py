"""The parts of a tree: gates, nodes, event types, declarations. All immutable values.

Places in a file (`Place`) never take part in equality: two trees that say the same are equal wherever they were written.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from types import UnionType
from typing import NamedTuple, TypeAlias

from rvaft.errors import OptionError, WrongType
from rvaft.model.guards import Guard, Operation
from rvaft.model.patterns import Anything, Literal, Pattern, Variable


class Gate(StrEnum):
    """The gates; `VOT` is written K`of`N and means at least K.

    >>> Gate("sand").ordered, Gate.AND.ordered
    (True, False)
    """

    OR = "or"
    AND = "and"
    SAND = "sand"
    SAND_RL = "sand_rl"
    VOT = "vot"

    @property
    def ordered(self) -> bool:
        """Whether the gate orders the parts of its children."""
        return self in (Gate.SAND, Gate.SAND_RL)

    @property
    def counts(self) -> bool:
        """Whether the gate has a threshold."""
        return self is Gate.VOT


class Causality(StrEnum):
    """Whether a node's event comes before (top_down) or after (bottom_up) those of its descendants.

    >>> import rvaft
    >>> rvaft.loads("causality bottom_up; top and a b;").causality
    <Causality.BOTTOM_UP: 'bottom_up'>
    """

    TOP_DOWN = "top_down"
    BOTTOM_UP = "bottom_up"


class Kind(StrEnum):
    """What a node is, where it is one of the two.

    >>> import rvaft
    >>> [kind.value for kind in next(rvaft.loads("top or a b; a attack;").branches()).kinds]
    ['attack']
    """

    FAULT = "fault"
    ATTACK = "attack"


class Place(NamedTuple):
    """Where something stands in a text; line and column count from 1."""

    file: str = "<code>"
    line: int = 1
    column: int = 1

    def __str__(self) -> str:
        return f"{self.file}:{self.line}:{self.column}"


@dataclass(frozen=True, slots=True)
class EventType:
    """`event NAME(parameters) = pattern;` — in the pattern the parameters are variables.

    >>> import rvaft
    >>> rvaft.loads("event at(place) = { at: place }; top on at(Place);").events["at"].parameters
    ('place',)
    """

    name: str
    parameters: tuple[str, ...]
    pattern: Pattern
    place: Place = field(default=Place(), compare=False)


Argument: TypeAlias = Literal | Variable | Anything


@dataclass(frozen=True, slots=True)
class On:
    """An event type applied to arguments: `radiation(Value, T1)`.

    >>> import rvaft
    >>> rvaft.loads("event at(place) = { at: place }; top on at(Place);").nodes["top"].on
    On(event='at', arguments=(Variable(name='Place'),))
    """

    event: str
    arguments: tuple[Argument, ...]


@dataclass(frozen=True, slots=True)
class Ignore:
    """`ignore on when guard;` — such events are never relevant; its variables are its own.

    >>> import rvaft
    >>> tree = rvaft.loads("event level(v) = { level: v }; top on level(V); ignore level(X) when X < 250;")
    >>> [ignore.on.event for ignore in tree.ignores]
    ['level']
    """

    on: On
    when: Guard | None = None
    place: Place = field(default=Place(), compare=False)


@dataclass(frozen=True, slots=True)
class Topic:
    """`topic NAME type TYPE from PUBLISHERS;` — where events come from in ROS; no verdict depends on it.

    `type` is the message type as Python imports it, `package.msg.Name`; `publishers` are ROS nodes, not nodes of the tree.

    >>> import rvaft
    >>> tree = rvaft.loads('topic "/goal" type "geometry_msgs.msg.Point"; event goal() = { topic: "/goal" }; top on goal();')
    >>> tree.topics["/goal"].type
    'geometry_msgs.msg.Point'
    """

    name: str
    type: str
    publishers: tuple[str, ...] = ()
    place: Place = field(default=Place(), compare=False)


def _expect(what: str, value: object, kind: type | UnionType, expected: str) -> None:
    if not isinstance(value, kind):
        raise WrongType(what, value, expected)


def _member(what: str, value: object, words: type[StrEnum], node: str) -> StrEnum:
    """The member of an enumeration that a word names."""
    if not isinstance(value, str):
        raise WrongType(f"the {what} of {node}", value, f"a {words.__name__} or its name")
    try:
        return words(value)
    except ValueError:
        raise OptionError(f"unknown {what} {value!r} of {node}; known: {', '.join(words)}") from None


@dataclass(frozen=True, slots=True)
class Node:
    """One node. A leaf has neither gate nor children; `threshold` is the K of a VOT gate.

    `declared` is False for a child that no statement defines. `places` holds where the parts `name`, `gate`, `on`,
    `when`, `kind`, `label` stand. A gate and a kind may be given by their words, the children as a list.

    >>> Node("top", "or", ["a", "b"]) == Node("top", Gate.OR, ("a", "b"))
    True

    Raises `WrongType` for a part of a type that it cannot have, and `OptionError` for a word that is no gate or kind.
    """

    name: str
    gate: Gate | None = None
    children: tuple[str, ...] = ()
    threshold: int | None = None
    on: On | None = None
    when: Guard | None = None
    kind: Kind | None = None
    label: str | None = None
    attributes: tuple[tuple[str, str], ...] = ()
    declared: bool = field(default=True, compare=False)
    places: Mapping[str, Place] = field(default_factory=dict, compare=False, hash=False, repr=False)

    def __post_init__(self) -> None:
        _expect("the name of a node", self.name, str, "a str")
        if self.gate.__class__ is not Gate and self.gate is not None:
            object.__setattr__(self, "gate", _member("gate", self.gate, Gate, self.name))
        if self.children.__class__ is not tuple:
            _expect(f"the children of {self.name}", self.children, list, "a tuple of names")
            object.__setattr__(self, "children", tuple(self.children))
        for child in self.children:
            _expect(f"a child of {self.name}", child, str, "the name of a node, a str")
        if self.kind is not None:
            object.__setattr__(self, "kind", _member("kind", self.kind, Kind, self.name))
        _expect(f"the threshold of {self.name}", self.threshold, int | None, "an int")
        _expect(f"the event (`on`) of {self.name}", self.on, On | None, "an On")
        _expect(f"the guard (`when`) of {self.name}", self.when, Literal | Variable | Operation | None, "a guard")

    @classmethod
    def choice(cls, name: str, children: tuple[str, ...]) -> "Node":
        """A node of which one child has to happen."""
        return cls(name, Gate.OR, children)

    def place(self, part: str = "name") -> Place:
        """Where a part of the node stands, or, where that is not known, its name."""
        return self.places.get(part) or self.places.get("name") or Place()

    @property
    def leaf(self) -> bool:
        """Whether the node has no gate."""
        return self.gate is None

    @property
    def has_event(self) -> bool:
        """Whether the node has a runtime event, its own or, for a leaf with neither event nor guard, the default one."""
        return self.on is not None or (self.gate is None and self.when is None)


@dataclass(frozen=True, slots=True)
class Relevant:
    """One entry of a tree's alphabet: a node's event, and its own guard where the event binds all its variables."""

    node: str
    pattern: Pattern
    when: Guard | None = None
