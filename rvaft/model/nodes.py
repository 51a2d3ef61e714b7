"""The immutable parts of a tree: gates, nodes, event types, declarations and ROS topics.

Positions in a file (`Place`) are not compared: trees with the same content are equal.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from keyword import iskeyword
from typing import Final, NamedTuple, TypeAlias

from rvaft.errors import OptionError, TreeError, WrongType
from rvaft.model.guards import Guard, Operation
from rvaft.model.guards import variables as guard_variables
from rvaft.model.patterns import Anything, Literal, ObjectPattern, Pattern, Variable
from rvaft.support.terminal import visible


class Gate(StrEnum):
    """The gates; `VOT` is written K`of`N and means at least K.

    >>> Gate("sand").ordered, Gate.AND.ordered
    (True, False)
    """

    OR = "or"
    AND = "and"
    SAND = "sand"
    SAND_RL = "sand_rl"
    PAND = "pand"
    VOT = "vot"

    @property
    def ordered(self) -> bool:
        """Whether the order of the children matters."""
        return self in (Gate.SAND, Gate.SAND_RL, Gate.PAND)

    @property
    def counts(self) -> bool:
        """Whether the gate has a threshold."""
        return self is Gate.VOT


class Causality(StrEnum):
    """Whether a node's event precedes (top_down) or follows (bottom_up) those of its descendants.

    >>> import rvaft
    >>> rvaft.loads("causality bottom_up; top and a b;").causality
    <Causality.BOTTOM_UP: 'bottom_up'>
    """

    TOP_DOWN = "top_down"
    BOTTOM_UP = "bottom_up"


class Kind(StrEnum):
    """The kind of a node: fault or attack.

    >>> import rvaft
    >>> [kind.value for kind in next(rvaft.branches(rvaft.loads("top or a b; a attack;"))).kinds]
    ['attack']
    """

    FAULT = "fault"
    ATTACK = "attack"


class ValueType(StrEnum):
    """The declared type of a parameter (semantics, section 1.4)."""

    TEXT = "text"
    INTEGER = "integer"
    NUMBER = "number"
    BOOLEAN = "boolean"
    TIME = "time"
    ANY = "any"


class Assumption(StrEnum):
    """A property of logs that a tree states and translations rely on (semantics, section 1.4)."""

    TYPES = "types"
    PRESENT = "present"
    CASE = "case"
    EXACT = "exact"
    ORDER = "order"


class Place(NamedTuple):
    """A position in a text; line and column start at 1."""

    file: str = "<code>"
    line: int = 1
    column: int = 1

    def __str__(self) -> str:
        return f"{self.file}:{self.line}:{self.column}"


@dataclass(frozen=True, slots=True)
class EventType:
    """`event NAME(parameters) = pattern;`, where the parameters are variables of the pattern.

    `types` are the declared types of the parameters; it is empty if none is declared.

    >>> import rvaft
    >>> event = rvaft.loads("event at(place: text) = { at: place }; top on at(Place);").events["at"]
    >>> event.parameters, event.type_of("place").value
    (('place',), 'text')
    """

    name: str
    parameters: tuple[str, ...]
    pattern: Pattern
    place: Place = field(default=Place(), compare=False)
    types: tuple[ValueType, ...] = ()

    def __post_init__(self) -> None:
        if all(one is ValueType.ANY for one in self.types):
            object.__setattr__(self, "types", ())
        elif len(self.types) != len(self.parameters):
            count = f"{len(self.types)} types for {len(self.parameters)} parameters"
            raise TreeError(f"event {self.name} has {count}", rule="event-arity")

    def type_of(self, parameter: str) -> ValueType:
        """Return the declared type of a parameter, or ANY."""
        return self.types[self.parameters.index(parameter)] if self.types else ValueType.ANY


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

    @property
    def variables(self) -> tuple[str, ...]:
        """The variables among the arguments, in order."""
        return tuple([argument.name for argument in self.arguments if isinstance(argument, Variable)])


class Side(StrEnum):
    """Where the events of a `without` are looked for, relative to the events of a node's part.

    >>> [side.value for side in Side]
    ['during', 'after', 'before']
    """

    DURING = "during"
    AFTER = "after"
    BEFORE = "before"


@dataclass(frozen=True, slots=True)
class Without:
    """`without on [when guard] [[for D] after | before]`: no such event (semantics, section 1.5).

    `duration` is the D in nanoseconds; only BEFORE may have none, and DURING has none. A variable
    that no node's event binds is local.

    >>> import rvaft
    >>> tree = rvaft.loads("event beat() = { beat: 1 }; time t as s; lost on beat() without beat() for 2 s after;")
    >>> [(clause.side.value, clause.duration) for clause in tree.nodes["lost"].without]
    [('after', 2000000000)]
    """

    on: On
    when: Guard | None = None
    side: Side = Side.DURING
    duration: int | None = None
    place: Place = field(default=Place(), compare=False)

    def __post_init__(self) -> None:
        if self.side.__class__ is not Side:
            object.__setattr__(self, "side", Side(self.side))

    @property
    def variables(self) -> tuple[str, ...]:
        """The variables of the event and the guard, each once."""
        return tuple(dict.fromkeys((*self.on.variables, *guard_variables(self.when))))


@dataclass(frozen=True, slots=True)
class Ignore:
    """`ignore on when guard;`: such events are never relevant; the variables are local.

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
    """`topic NAME type TYPE from PUBLISHERS;`: the source of events in ROS, which no verdict
    depends on.

    `type` is the message type as Python imports it, `package.msg.Name`. `publishers` are ROS nodes.

    >>> import rvaft
    >>> topic = 'topic "/goal" type "geometry_msgs.msg.Point"; event goal() = { topic: "/goal" };'
    >>> tree = rvaft.loads(f"{topic} top on goal();")
    >>> tree.topics["/goal"].type
    'geometry_msgs.msg.Point'
    """

    name: str
    type: str
    publishers: tuple[str, ...] = ()
    place: Place = field(default=Place(), compare=False)


@dataclass(frozen=True, slots=True)
class Node:
    """One node of a tree; `threshold` is the K of a VOT gate.

    `times` is the number of events of a leaf, `within` the window of a gate in nanoseconds, and
    `without` has the events that must be absent. The variables `distinct` and `each` have a value of
    their own in each of the events that a leaf counts; the values of `distinct` are different.
    `declared` is False for a child without a statement, `made` is True for a node of a translation of
    Galileo's gates. `places` has the positions of `name`,
    `gate`, `on`, `when`, `kind` and `label`. A gate and a kind may be strings, and the children a
    list.

    >>> Node("top", "or", ["a", "b"]) == Node("top", Gate.OR, ("a", "b"))
    True

    Raises `WrongType` for a part of the wrong type, and `OptionError` for an unknown gate or kind.
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
    times: int = 1
    within: int | None = None
    without: tuple[Without, ...] = ()
    distinct: tuple[str, ...] = ()
    each: tuple[str, ...] = ()
    declared: bool = field(default=True, compare=False)
    made: bool = field(default=False, compare=False, repr=False)
    places: Mapping[str, Place] = field(default_factory=dict, compare=False, hash=False, repr=False)

    def __post_init__(self) -> None:
        def expect(what: str, value: object, kind: type | tuple[type, ...], expected: str) -> None:
            if not isinstance(value, kind):
                raise WrongType(what.format(self.name), value, expected)

        expect("the name of a node", self.name, str, "a str")
        for part, value, words in (("gate", self.gate, Gate), ("kind", self.kind, Kind)):
            if value is None or value.__class__ is words:
                continue
            expect(f"the {part} of {{}}", value, str, f"a {words.__name__} or its name")
            try:
                object.__setattr__(self, part, words(value))
            except ValueError:
                raise OptionError(f"unknown {part} {value!r} of {self.name}; known: {', '.join(words)}") from None
        if self.children.__class__ is not tuple:
            expect("the children of {}", self.children, list, "a tuple of names")
            object.__setattr__(self, "children", tuple(self.children))
        for child in self.children:
            expect("a child of {}", child, str, "the name of a node, a str")
        for what, names in (("distinct", self.distinct), ("each", self.each)):
            if names.__class__ is not tuple:
                expect(f"the variables of `{what}` of {{}}", names, list, "a tuple of names")
                object.__setattr__(self, what, tuple(names))
        if self.without.__class__ is not tuple:
            expect("the absent events (`without`) of {}", self.without, list, "a tuple of Without")
            object.__setattr__(self, "without", tuple(self.without))
        for clause in self.without:
            expect("an absent event (`without`) of {}", clause, Without, "a Without")
        for what, stated, kind, expected in (
            ("the threshold of {}", self.threshold, int, "an int"),
            ("how many events {} observes (`times`)", self.times, int, "an int"),
            ("the window (`within`) of {}", self.within, int, "nanoseconds, an int"),
            ("the event (`on`) of {}", self.on, On, "an On"),
            ("the guard (`when`) of {}", self.when, (Literal, Variable, Operation), "a guard"),
        ):
            if stated is not None:
                expect(what, stated, kind, expected)

    def place(self, part: str = "name") -> Place:
        """Return the position of a part of the node, or of its name if unknown."""
        return self.places.get(part) or self.places.get("name") or Place()

    @property
    def own_values(self) -> tuple[str, ...]:
        """The variables with a value of their own in each counted event."""
        return (*self.distinct, *self.each)

    @property
    def leaf(self) -> bool:
        """Whether the node has no gate."""
        return self.gate is None

    @property
    def has_event(self) -> bool:
        """Whether the node has a runtime event, its own or the default event of a leaf without a
        guard.
        """
        return self.on is not None or (self.gate is None and self.when is None)


@dataclass(frozen=True, slots=True)
class Relevant:
    """One entry of a tree's alphabet: a node's event, with the guard if the event binds its
    variables.
    """

    node: str
    pattern: Pattern
    when: Guard | None = None


_NAME: Final = re.compile(r"/?[A-Za-z_][A-Za-z0-9_]*(?:/[A-Za-z0-9_]+)*")


def absolute(name: str) -> str:
    """Return an absolute ROS name: `command` becomes `/command`."""
    return name if name.startswith("/") else f"/{name}"


def wrong_name(name: str) -> str | None:
    """Return why this is no valid name of a ROS topic or node, or None if it is."""
    if _NAME.fullmatch(name):
        return None
    return f'"{visible(name)}" is not a valid ROS name: use letters, digits and _, with / between words'


def wrong_type(type_: str) -> str | None:
    """Return why this is no message type as Python imports it, or None if it is."""
    if _importable(type_.split(".")):
        return None
    words = [word for word in re.split(r"[./:]+", type_) if word]
    words = [words[0], "msg", words[1]] if len(words) == 2 else words
    meant = ".".join(words) if _importable(words) else "package.msg.Name"
    return f'"{visible(type_)}" is not a message type: write it as Python imports it, "{meant}"'


def by_name(topics: Iterable[Topic]) -> dict[str, Topic]:
    """Return topics by absolute name; raises `TreeError` for duplicates, invalid names or types."""
    found: dict[str, Topic] = {}
    for topic in topics:
        name = absolute(topic.name)
        if name in found:
            raise TreeError(f"topic {name} is declared twice", rule="duplicate-topic")
        wrong = [wrong_type(topic.type), *map(wrong_name, (topic.name, *topic.publishers))]
        for message in filter(None, wrong):
            raise TreeError(message, rule="malformed-topic")
        found[name] = topic
    return found


def _importable(words: list[str]) -> bool:
    return len(words) > 2 and all(word.isascii() and word.isidentifier() and not iskeyword(word) for word in words)


def topic_of(pattern: Pattern) -> Pattern | None:
    """Return the pattern of the field `topic`, or None."""
    fields = pattern.fields if isinstance(pattern, ObjectPattern) else ()
    return next((inner for name, inner in fields if name == "topic"), None)
