"""The core form of a tree: a closed set of parts that every backend and the engine are written for.

A part says what has to be observed. Parts share parts: the same part below two others is observed, and resolved, once.
Parts are hash-consed: two parts with the same content are the same object, so they are compared by identity.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Final, NamedTuple, Self, TypeAlias
from weakref import WeakValueDictionary

from rvaft.model.event_time import EventTime
from rvaft.model.guards import Guard, time_points
from rvaft.model.nodes import Kind, Relevant
from rvaft.model.patterns import Pattern
from rvaft.model.tree import RVAFT, sorted_topologically


class Source(NamedTuple):
    """What a part comes from: a node of the tree, and a number.

    Of an event, `number` is the occurrence at that node, from 1. Of any other part it is 0, or, where a pass has made
    several copies of the node's part, the number of the copy.
    """

    node: str
    number: int = 0


class _HashConsed(type):
    """Makes each part once: a part that is made again is the one that is there."""

    _known: Final[WeakValueDictionary[tuple[object, ...], Any]] = WeakValueDictionary()

    def __call__(cls, *args: Any, **kwargs: Any) -> Any:
        made = super().__call__(*args, **kwargs)
        content = (cls, *(getattr(made, name) for name in cls.__match_args__))  # type: ignore[attr-defined]
        return _HashConsed._known.setdefault(content, made)


class _Part(metaclass=_HashConsed):
    """What all parts have in common."""

    __slots__ = ("__weakref__",)


class _Leaf(_Part):
    """A part without parts inside."""

    __slots__ = ()

    @property
    def parts(self) -> tuple["Part", ...]:
        """No parts."""
        return ()


@dataclass(frozen=True, slots=True, eq=False)
class Event(_Leaf):
    """One event that matches a pattern; `source.number` is the occurrence at the node."""

    source: Source
    pattern: Pattern


@dataclass(frozen=True, slots=True, eq=False)
class Times(_Leaf):
    """As many events that match a pattern, one after the other."""

    source: Source
    pattern: Pattern
    count: int


@dataclass(frozen=True, slots=True, eq=False)
class Condition(_Leaf):
    """A guard that has to hold; it observes no event.

    `written` is the guard as the user wrote it, where a pass has rewritten its time points. `window` is the duration of
    a `within`, in nanoseconds, where a pass has written one as a guard.
    """

    source: Source
    guard: Guard
    written: Guard | None = None
    window: int | None = None


@dataclass(frozen=True, slots=True, eq=False)
class All(_Part):
    """All parts, in any order."""

    source: Source | None
    parts: tuple["Part", ...]


@dataclass(frozen=True, slots=True, eq=False)
class Sequence(_Part):
    """All parts, every event of a part before every event of the later parts."""

    source: Source | None
    parts: tuple["Part", ...]


@dataclass(frozen=True, slots=True, eq=False)
class One(_Part):
    """Exactly one of the parts; without a source the parts are alternatives that a pass has made."""

    source: Source | None
    parts: tuple["Part", ...]


@dataclass(frozen=True, slots=True, eq=False)
class AtLeast(_Part):
    """`need` of the parts or more, in any order."""

    source: Source
    parts: tuple["Part", ...]
    need: int


@dataclass(frozen=True, slots=True, eq=False)
class EndInOrder(_Part):
    """All parts, the last event of each before the last event of the next; a part without events orders nothing."""

    source: Source
    parts: tuple["Part", ...]


@dataclass(frozen=True, slots=True, eq=False)
class Within(_Part):
    """One part whose events all lie in a window of `duration` nanoseconds."""

    source: Source
    parts: tuple["Part", ...]
    duration: int


Part: TypeAlias = Event | Times | Condition | All | Sequence | One | AtLeast | EndInOrder | Within
"""Everything that a property is made of; a `match` over it ends in `assert_never`."""

PARTS: Final[tuple[type[Part], ...]] = (Event, Times, Condition, All, Sequence, One, AtLeast, EndInOrder, Within)
NOTHING: Final = All(None, ())
"""Nothing to observe."""
IMPOSSIBLE: Final = One(None, ())
"""A choice without alternatives: it is never observed."""


def chooses(part: Part) -> bool:
    """Whether scenarios differ in which of the parts directly inside they keep."""
    match part:
        case One(parts=parts):
            return len(parts) > 1
        case AtLeast(parts=parts, need=need):
            return need < len(parts)
        case _:
            return False


def fewest(part: Part) -> int:
    """The number of parts directly inside that a scenario keeps at the least."""
    match part:
        case One():
            return 1
        case AtLeast(need=need):
            return need
        case _:
            return len(part.parts)


def parts_below(root: Part) -> tuple[Part, ...]:
    """The part itself and all parts below it, each once, inner parts first; reversed, they are in
    the order of the tree.
    """
    seen: dict[Part, tuple[Part, ...]] = {}
    agenda = [root]
    while agenda:
        part = agenda.pop()
        if part not in seen:
            seen[part] = part.parts
            agenda.extend(reversed(part.parts))
    return tuple(sorted_topologically(seen))[::-1]


class Ignored(NamedTuple):
    """Events that are never relevant; the variables are its own."""

    pattern: Pattern
    when: Guard | None


@dataclass(frozen=True, eq=False)
class Property:
    """A part with all that is needed to monitor it: which events are relevant, and where an event has its time.

    `tree` is where the property comes from, for names and messages. `wholes` gives, for each node
    and copy, the part that the time points `start` and `end` are of. `branch` and `kind` are what
    the property was restricted to, if anything.
    """

    root: Part
    tree: RVAFT
    alphabet: tuple[Relevant, ...]
    ignored: tuple[Ignored, ...]
    time: EventTime | None
    wholes: Mapping[Source, Part] = field(default_factory=dict)
    branch: int | None = None
    kind: Kind | None = None
    asked: RVAFT | None = None
    """The tree as it was given, with its restriction to a branch or kind."""
    resolved: bool = False
    """Whether a pass has made all choices: the property, or each of its alternatives, is of one branch."""

    @cached_property
    def parts(self) -> tuple[Part, ...]:
        """All parts, each once, inner parts first; reversed, they are in the order of the tree."""
        return parts_below(self.root)

    @cached_property
    def events(self) -> tuple[Event, ...]:
        """The events, in the order of the tree."""
        rank = {name: place for place, name in enumerate(self.tree.order)}
        found = (part for part in reversed(self.parts) if isinstance(part, Event))
        return tuple(sorted(found, key=lambda event: (rank[event.source.node], event.source.number)))

    @cached_property
    def shared(self) -> frozenset[Part]:
        """The parts that stand in more than one place."""
        seen, shared = set[Part](), set[Part]()
        for part in self.parts:
            for inner in part.parts:
                (shared if inner in seen else seen).add(inner)
        return frozenset(shared)

    @cached_property
    def timed(self) -> bool:
        """Whether a window or a time point asks for the times of events."""
        return any(
            isinstance(one, Within) or (isinstance(one, Condition) and time_points(one.guard)) for one in self.parts
        )

    @property
    def feasible(self) -> bool:
        """Whether the part is not known to be impossible."""
        return self.root is not IMPOSSIBLE

    @property
    def alternatives(self) -> tuple[Self, ...]:
        """The properties of which one has to be observed, where a pass has made alternatives; else
        the property alone.
        """
        if isinstance(self.root, One) and self.root.source is None:
            return tuple(replace(self, root=part) for part in self.root.parts)
        return (self,)

    def rewritten(self, change: Callable[[Part, tuple[Part, ...]], Part]) -> Self:
        """The property with each part replaced, inner parts first.

        `change` gets a part and what the parts directly inside have become.
        """
        made = rewrite([self.root, *self.wholes.values()], change)
        wholes = {source: made[part] for source, part in self.wholes.items()}
        return replace(self, root=made[self.root], wholes=wholes)

    def with_root(self, root: Part) -> Self:
        """The same property of another part, which no `start` or `end` refers to."""
        return replace(self, root=root, wholes={})


def rewrite(roots: Iterable[Part], change: Callable[[Part, tuple[Part, ...]], Part]) -> dict[Part, Part]:
    """What each part below these becomes, inner parts first."""
    made: dict[Part, Part] = {}
    for root in roots:
        if root not in made:
            for part in parts_below(root):
                if part not in made:
                    made[part] = change(part, tuple(made[inner] for inner in part.parts))
    return made


def with_parts(part: Part, parts: tuple[Part, ...]) -> Part:
    """The part with other parts directly inside."""
    if isinstance(part, Event | Times | Condition) or parts == part.parts:
        return part
    if isinstance(part, All):  # parts that have become the same are observed once
        parts = tuple(dict.fromkeys(parts))
    return replace(part, parts=parts)
