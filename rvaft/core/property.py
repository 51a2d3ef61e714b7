"""The core form of a tree: a closed set of parts, which all backends and the engine read.

Parts form a DAG: a shared part is observed and resolved once. Parts are hash-consed: parts with
equal content are the same object and are compared by identity.
"""

from collections import abc
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from enum import Enum, auto
from functools import cached_property
from itertools import chain, combinations
from typing import Any, Final, NamedTuple, Self, TypeAlias, TypeVar, assert_never
from weakref import WeakValueDictionary

from rvaft.errors import OptionError
from rvaft.model.event_time import EventTime
from rvaft.model.guards import Guard, time_points, variables
from rvaft.model.nodes import Assumption, Kind, Relevant, Side
from rvaft.model.patterns import Pattern, rigid_variables
from rvaft.model.patterns import variables as pattern_variables
from rvaft.model.tree import RVAFT, reachable, sorted_topologically
from rvaft.model.verdict import Semantics
from rvaft.support.wording import did_you_mean

T = TypeVar("T")


class Source(NamedTuple):
    """The node that a part comes from, and a number.

    For an event it is the occurrence at the node, from 1; for a copy that a pass has made, the
    number of the copy; else 0.
    """

    node: str
    number: int = 0


class PartKind(Enum):
    """The kind of a part after the passes that remove windows, counted events and ends in order."""

    EVENT = auto()
    CONDITION = auto()
    ALL = auto()
    SEQUENCE = auto()
    ONE = auto()
    AT_LEAST = auto()


class _HashConsed(type):
    """A metaclass that returns the existing part with the same content, if any."""

    _known: Final[WeakValueDictionary[tuple[object, ...], Any]] = WeakValueDictionary()

    def __call__(cls, *args: Any, **kwargs: Any) -> Any:
        made = super().__call__(*args, **kwargs)
        content = (cls, *(getattr(made, name) for name in cls.__match_args__))  # type: ignore[attr-defined]
        return _HashConsed._known.setdefault(content, made)


class _Part(metaclass=_HashConsed):
    __slots__ = ("__weakref__",)


class _Leaf(_Part):
    __slots__ = ()

    @property
    def parts(self) -> tuple["Part", ...]:
        return ()


@dataclass(frozen=True, slots=True, eq=False)
class Event(_Leaf):
    """One event that matches a pattern; `source.number` is the occurrence at the node."""

    source: Source
    pattern: Pattern


@dataclass(frozen=True, slots=True, eq=False)
class Times(_Leaf):
    """`count` events that match a pattern, one after the other.

    The variables `own` of the pattern have a value of their own in each event; they are local, and so
    are those of them in `distinct`, whose values are pairwise different.
    """

    source: Source
    pattern: Pattern
    count: int
    own: tuple[str, ...] = ()
    distinct: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Condition(_Leaf):
    """A guard that must hold; it consumes no event.

    `written` is the guard before a pass rewrote its time points. `window` is the duration in
    nanoseconds of a `within` that a pass rewrote as this guard.
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
    """All parts; every event of a part precedes every event of the later parts."""

    source: Source | None
    parts: tuple["Part", ...]


@dataclass(frozen=True, slots=True, eq=False)
class One(_Part):
    """Exactly one of the parts; without a source, they are alternatives made by a pass."""

    source: Source | None
    parts: tuple["Part", ...]


@dataclass(frozen=True, slots=True, eq=False)
class AtLeast(_Part):
    """At least `need` of the parts, in any order."""

    source: Source
    parts: tuple["Part", ...]
    need: int


@dataclass(frozen=True, slots=True, eq=False)
class EndInOrder(_Part):
    """All parts; the last event of each precedes the last event of the next.

    A part without events orders nothing.
    """

    source: Source
    parts: tuple["Part", ...]


@dataclass(frozen=True, slots=True, eq=False)
class Within(_Part):
    """One part, with all its events in a window of `duration` nanoseconds."""

    source: Source
    parts: tuple["Part", ...]
    duration: int


@dataclass(frozen=True, slots=True, eq=False)
class WithoutEvent(_Part):
    """One part, and no event of a pattern beside it (semantics, section 1.5).

    `own` are the local variables of pattern and guard; the others are those of the property.
    `number` distinguishes the clauses of a node.
    """

    source: Source
    parts: tuple["Part", ...]
    pattern: Pattern
    guard: Guard | None
    own: frozenset[str]
    side: Side
    duration: int | None
    number: int

    @property
    def shared(self) -> tuple[str, ...]:
        """The variables that the events of a match bind, in order."""
        names = dict.fromkeys((*rigid_variables(self.pattern), *variables(self.guard)))
        return tuple(name for name in names if name not in self.own)


Part: TypeAlias = Event | Times | Condition | All | Sequence | One | AtLeast | EndInOrder | Within | WithoutEvent
"""A `match` over the parts ends in `assert_never`."""
Kept: TypeAlias = Mapping[Part, tuple[Part, ...]]
"""The parts of a scenario, each with the direct subparts that it keeps, in tree order."""

PARTS: Final[tuple[type[Part], ...]] = (
    Event,
    Times,
    Condition,
    All,
    Sequence,
    One,
    AtLeast,
    EndInOrder,
    Within,
    WithoutEvent,
)
NOTHING: Final = All(None, ())
"""The part without events or conditions."""
IMPOSSIBLE: Final = One(None, ())
"""A choice without alternatives, which is never observed."""


def chooses(part: Part) -> bool:
    """Whether scenarios differ in which direct subparts they keep."""
    match part:
        case One(parts=parts):
            return len(parts) > 1
        case AtLeast(parts=parts, need=need):
            return need < len(parts)
        case _:
            return False


def fewest(part: Part) -> int:
    """Return the minimum number of direct subparts that a scenario keeps."""
    match part:
        case One():
            return 1
        case AtLeast(need=need):
            return need
        case _:
            return len(part.parts)


def kept_ways(options: abc.Sequence[T], least: int, most: int) -> Iterator[tuple[T, ...]]:
    """Iterate over the ways to keep from `least` to `most` of some options, fewer ones first."""
    return chain.from_iterable(combinations(options, size) for size in range(least, most + 1))


def _all_parts(part: Part) -> tuple[Part, ...]:
    return part.parts


def parts_below(root: Part, inner: Callable[[Part], tuple[Part, ...]] = _all_parts) -> tuple[Part, ...]:
    """Return the part and all parts below it, each once, inner parts first.

    `inner` returns the direct subparts to include. The reverse is the order of the tree.
    """
    return tuple(sorted_topologically({part: inner(part) for part in reachable(root, inner)}))[::-1]


def variables_in(part: Part) -> tuple[str, ...]:
    """Return the variables of a part itself, without those of its subparts."""
    match part:
        case Event() | Times():
            return pattern_variables(part.pattern)
        case Condition():
            return variables(part.guard)
        case WithoutEvent():
            return (*pattern_variables(part.pattern), *variables(part.guard))
        case All() | Sequence() | One() | AtLeast() | EndInOrder() | Within():
            return ()
        case _:
            assert_never(part)


def unrepeatable(variable: str, why: str) -> str:
    """Return the sentence that matches cannot be repeated by a variable."""
    return f"matches cannot be repeated by {variable}: {why}; a match has one {variable} from its first event on"


class Ignored(NamedTuple):
    """A pattern of events that are never relevant; its variables are local."""

    pattern: Pattern
    when: Guard | None


@dataclass(frozen=True, eq=False)
class Property:
    """A part with the data that a monitor of it needs: the relevant events and the time field.

    `tree` is the source, for names and messages. `wholes` maps each node and copy to the part that
    its time points `start` and `end` refer to. `branch` and `kind` are the restriction, if any.
    """

    root: Part
    tree: RVAFT
    alphabet: tuple[Relevant, ...]
    ignored: tuple[Ignored, ...]
    time: EventTime | None
    wholes: Mapping[Source, Part] = field(default_factory=dict)
    branch: int | None = None
    kind: Kind | None = None
    requested: RVAFT | None = None
    """The tree as given, with its restriction to a branch or kind."""
    assumes: frozenset[Assumption] = frozenset()
    """The assumptions that a text may rely on."""
    extensions: tuple[str, ...] = ()
    """The extensions of the language that a text needs."""

    @cached_property
    def parts(self) -> tuple[Part, ...]:
        """All parts, as `parts_below` returns them."""
        return parts_below(self.root)

    @cached_property
    def events(self) -> tuple[Event, ...]:
        """The events, in the order of the tree."""
        rank = self.tree.rank
        found = (part for part in reversed(self.parts) if isinstance(part, Event))
        return tuple(sorted(found, key=lambda event: (rank[event.source.node], event.source.number)))

    @cached_property
    def shared(self) -> frozenset[Part]:
        """The parts that have several parents."""
        seen, shared = set[Part](), set[Part]()
        for part in self.parts:
            for inner in part.parts:
                (shared if inner in seen else seen).add(inner)
        return frozenset(shared)

    @property
    def remedy(self) -> str:
        """How partial matches come to expire, where conditions on time could rule them out."""
        timed = any(node.within is not None or time_points(node.when) for node in self.tree.top_down())
        if not timed or self.tree.time is None or self.tree.time.late is not None:
            return ""
        return "an older event may still come; `late 0 s` after the format of `time` says that none does"

    @cached_property
    def timed(self) -> bool:
        """Whether a window or a time point depends on the times of events."""
        return any(
            isinstance(part, Within) or (isinstance(part, Condition) and time_points(part.guard)) for part in self.parts
        )

    def lacking(self, variable: str) -> Iterator[tuple[str, str]]:
        """Yield the nodes whose events do not bind a variable to one value for the match, each with the reason."""
        for part in reversed(self.parts):
            if isinstance(part, Event | Times) and variable not in rigid_variables(part.pattern):
                node = part.source.node
                own = variable in self.tree.nodes[node].own_values
                yield node, f"each event of {node} has its own" if own else f"the event of {node} does not bind it"

    def require_shared(self, name: str, semantics: Semantics) -> None:
        """Raise `OptionError` unless every event binds a variable, under `scattered`."""
        if semantics is not Semantics.SCATTERED:
            raise OptionError(f"repetition by {name} needs the semantics scattered, not {semantics}")
        tree = self.tree if self.tree.part_of is None else self.tree.part_of.tree
        if name not in (*tree.variables, *(one for node in tree.top_down() for one in node.own_values)):
            guess = did_you_mean(name, tree.variables) or ": no event of a node binds it"
            raise OptionError(
                f"matches cannot be repeated by {name or 'an empty name'}, no variable of the tree{guess}"
            )
        for _, why in self.lacking(name):
            raise OptionError(unrepeatable(name, why))

    @cached_property
    def absences(self) -> tuple[WithoutEvent, ...]:
        """The events that must be absent."""
        return tuple(part for part in self.parts if isinstance(part, WithoutEvent))

    @property
    def times_absences(self) -> bool:
        """Whether an event must be absent for a duration."""
        return any(one.duration is not None for one in self.absences)

    @property
    def feasible(self) -> bool:
        """Whether the root is not known to be impossible."""
        return self.root is not IMPOSSIBLE

    @property
    def alternatives(self) -> tuple[Self, ...]:
        """The alternatives made by a pass, each as a property, else only this property."""
        if not (isinstance(self.root, One) and self.root.source is None):
            return (self,)
        found = list[Self]()
        for part in self.root.parts:
            below = set(parts_below(part)) if self.wholes else ()
            wholes = {source: whole for source, whole in self.wholes.items() if whole in below}
            found.append(replace(self, root=part, wholes=wholes))
        return tuple(found)

    @property
    def variables(self) -> frozenset[str]:
        """The variables of all parts."""
        return frozenset(name for part in self.parts for name in variables_in(part))

    def rewritten(self, change: Callable[[Part, tuple[Part, ...]], Part]) -> Self:
        """Return the property with each part replaced, inner parts first.

        `change` receives a part and the replacements of its subparts.
        """
        made = rewrite([self.root, *self.wholes.values()], change)
        wholes = {source: made[part] for source, part in self.wholes.items()}
        return replace(self, root=made[self.root], wholes=wholes)

    def with_root(self, root: Part) -> Self:
        """Return the property with another root, to which no `start` or `end` refers."""
        return replace(self, root=root, wholes={})


def rewrite(roots: Iterable[Part], change: Callable[[Part, tuple[Part, ...]], Part]) -> dict[Part, Part]:
    """Return the replacement of each part below the roots, inner parts first."""
    made: dict[Part, Part] = {}
    for root in roots:
        if root not in made:
            for part in parts_below(root):
                if part not in made:
                    made[part] = change(part, tuple(made[inner] for inner in part.parts))
    return made


def with_parts(part: Part, parts: tuple[Part, ...]) -> Part:
    """Return the part with other direct subparts."""
    if isinstance(part, Event | Times | Condition) or parts == part.parts:
        return part
    if isinstance(part, All):  # equal parts are observed once
        parts = tuple(dict.fromkeys(parts))
    return replace(part, parts=parts)
