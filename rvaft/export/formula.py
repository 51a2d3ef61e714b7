"""Properties as formulas for display: sequences, unordered events, conditions, windows.

A shared node is repeated wherever it is used, though it is one occurrence.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from collections.abc import Sequence as Several
from dataclasses import dataclass
from enum import Enum
from itertools import takewhile
from typing import Final, TypeAlias, assert_never

from rvaft.core.property import (
    All,
    AtLeast,
    Condition,
    EndInOrder,
    Event,
    One,
    Part,
    Property,
    Sequence,
    Source,
    Times,
    Within,
    WithoutEvent,
)
from rvaft.errors import TooLarge
from rvaft.model.expressions import PLAIN, Style, event_text, guard_text, without_text
from rvaft.model.guards import Guard, time_points
from rvaft.model.nodes import Causality, Node, Without

DEFAULT_LIMIT: Final = 100_000


@dataclass(frozen=True, slots=True, eq=False)
class Leaf:
    """An event, or a guard; `named` if a guard refers to the event's time."""

    node: Node
    guard: Guard | None = None
    named: bool = False


class Join(Enum):
    """How parts are joined."""

    SEQUENCE = "sequence"
    ANY_ORDER = "any order"
    AT_LEAST = "at least"
    CHOICE = "choice"
    ENDS = "ends in sequence"


@dataclass(frozen=True, slots=True, eq=False)
class Joined:
    """Joined parts; `threshold` is for `AT_LEAST`."""

    join: Join
    parts: tuple["Formula", ...]
    threshold: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """A part with a maximum duration in nanoseconds."""

    part: "Formula"
    within: int


@dataclass(frozen=True, slots=True, eq=False)
class Lacking:
    """A part with an event that must be absent."""

    part: "Formula"
    clause: Without


@dataclass(frozen=True, slots=True, eq=False)
class Named:
    """A part whose start or end a guard refers to."""

    part: "Formula"
    name: str


Formula: TypeAlias = Leaf | Joined | Window | Lacking | Named


@dataclass(frozen=True, slots=True)
class Notation:
    """How a formula is written: the style of leaves, and the signs between parts.

    `number` formats the count of a counted event, `window` surrounds a part with a duration,
    `label` follows the name of a `Named` part.
    """

    style: Style
    joins: Mapping[Join, str]
    at_least: str
    number: Callable[[int], str]
    window: tuple[str, str]
    label: str = ": "
    condition: Callable[[str], str] = "[{}]".format
    whole: frozenset[Join] = frozenset({Join.SEQUENCE})
    """The joins without brackets at the top level."""
    brackets: tuple[str, str] = ("(", ") ")
    """Around a part with an absent event."""


def formula(prop: Property) -> Formula:
    """Return the formula of a property from `build` or `restrict`.

    >>> import rvaft
    >>> from rvaft.core.build import build
    >>> write(formula(build(rvaft.loads("top sand a g; g or b c;"))), TEXT)
    'a ; (b | c)'
    """
    writer = _Writer(prop)
    for part in prop.parts:
        writer.done[part] = writer.named(part, writer.row(part))
    return writer.done[prop.root]


class _Writer:
    def __init__(self, prop: Property) -> None:
        self.done: dict[Part, Formula] = {}
        self._nodes = prop.tree.nodes
        self._own_first = prop.tree.causality is Causality.TOP_DOWN
        self._spread: dict[Part, list[Formula]] = {}
        guards = (part.guard for part in prop.parts if isinstance(part, Condition))
        self._guard_points = {
            (one.point, Source(one.node, one.number)) for guard in guards for one in time_points(guard)
        }
        self._names = {whole: source.node for source, whole in prop.wholes.items() if self._spans(source)}

    def _spans(self, source: Source) -> bool:
        return not {("start", source), ("end", source)}.isdisjoint(self._guard_points)

    def row(self, part: Part) -> Formula:
        """Return the formula of a part, without a name."""
        inside = [self.done[inner] for inner in part.parts]
        match part:
            case Event(source=source) | Times(source=source):
                return self._event(source.node)
            case Condition(source=source):
                return Leaf(self._nodes[source.node], part.written or part.guard)
            case All(parts=(inner, Condition() as condition)) if condition.source == part.source:
                return _joined(Join.SEQUENCE, self._guarded(inner, condition))
            case All():
                return _joined(Join.ANY_ORDER, inside)
            case Sequence():
                return _joined(Join.SEQUENCE, [one for inner in part.parts for one in self._in_sequence(part, inner)])
            case One():
                self._spread[part] = _choice(tuple(inside))
                return _joined(Join.SEQUENCE, self._spread[part])
            case AtLeast(need=need):
                return Joined(Join.AT_LEAST, tuple(inside), need)
            case EndInOrder():
                return _joined(Join.ENDS, inside)
            case Within(duration=duration):
                return Window(inside[0], duration)
            case WithoutEvent(source=source, number=number):
                return Lacking(inside[0], self._nodes[source.node].without[number - 1])
            case _:
                assert_never(part)

    def named(self, part: Part, term: Formula) -> Formula:
        """Add the name if a guard uses the start or end."""
        name = self._names.get(part)
        return term if name is None or self._nodes[name].leaf else Named(term, name)

    def _event(self, name: str) -> Leaf:
        node = self._nodes[name]
        used = ("at", Source(name)) in self._guard_points or (node.leaf and self._spans(Source(name)))
        return Leaf(node, named=node.on is not None and used)

    def _guarded(self, inner: Part, condition: Condition) -> list[Formula]:
        """Return the sequence of event and guard, then children (or reversed)."""
        parts = inner.parts if isinstance(inner, Sequence) and _is_own(inner) else (inner,)
        own: list[Formula] = [self.done[part] for part in parts if isinstance(part, Event | Times)]
        below = [one for part in parts if not isinstance(part, Event | Times) for one in self._in_sequence(inner, part)]
        own.append(self.done[condition])
        return [*own, *below] if self._own_first else [*below, *own]

    def _in_sequence(self, around: Part, part: Part) -> list[Formula]:
        """Return the formulas inside a sequence; a choice of the same node is spread."""
        same = around.source is not None and part.source is not None and around.source.node == part.source.node
        return self._spread.get(part, [self.done[part]]) if same else [self.done[part]]


def _is_own(sequence: Sequence) -> bool:
    """Whether a sequence is an event with the parts below its node."""
    return any(
        isinstance(part, Event | Times) and part.source.node == sequence.source.node
        for part in sequence.parts
        if sequence.source is not None
    )


def _choice(parts: tuple[Formula, ...]) -> list[Formula]:
    """Return a choice with common first and last parts factored out."""
    rows = [
        part.parts if isinstance(part, Joined) and part.join is Join.SEQUENCE and len(parts) > 1 else (part,)
        for part in parts
    ]
    most = min(map(len, rows)) - 1
    first = _common(rows, range(most))
    last = _common(rows, range(-1, -1 - (most - len(first)), -1))[::-1]
    middle = [row[len(first) : len(row) - len(last)] for row in rows]
    return [*first, _joined(Join.CHOICE, tuple(_joined(Join.SEQUENCE, row) for row in middle)), *last]


def _common(rows: Several[tuple[Formula, ...]], places: Iterable[int]) -> list[Formula]:
    """Return the formulas that all rows share, up to the first difference."""
    same = takewhile(lambda place: all(row[place] is rows[0][place] for row in rows), places)
    return [rows[0][place] for place in same]


def _joined(join: Join, parts: Several[Formula]) -> Formula:
    return parts[0] if len(parts) == 1 else Joined(join, tuple(parts))


def write(term: Formula, notation: Notation, *, limit: int = DEFAULT_LIMIT) -> str:
    """Return a formula in a notation; raises `TooLarge` beyond `limit` pieces."""
    return "".join(breakable(term, notation, limit=limit))


def breakable(term: Formula, notation: Notation, *, limit: int = DEFAULT_LIMIT) -> Iterator[str]:
    """Yield pieces between which a line may be broken; all notations have the same pieces.

    Each piece but the first starts with an operator, except commas. Raises `TooLarge`.
    """
    pieces: list[str] = []
    written, style = 0, notation.style
    outer = None if isinstance(term, Joined) and term.join in notation.whole else Join.SEQUENCE
    todo: list[str | tuple[Formula, Join | None] | None] = [(term, outer)]  # None allows a line break
    while todo:
        if written > limit:
            raise TooLarge("the written form of a branch", limit=limit)
        match todo.pop():
            case None:
                yield "".join(pieces)
                pieces.clear()
                continue
            case str() as sign:
                pieces.append(sign)
            case (Leaf(node, None, named), _):
                pieces.append(f"{style.node(node.name)}{notation.label}" if named else "")
                pieces.append(event_text(node, style) + (notation.number(node.times) if node.times > 1 else ""))
            case (Leaf(_, guard), _) if guard is not None:
                pieces.append(notation.condition(guard_text(guard, style)))
            case (Named(part, name), _):
                todo += [(part, Join.AT_LEAST), f"{style.node(name)}{notation.label}"]
                continue
            case (Window(part, within), _):
                todo += [notation.window[1].format(style.duration(within)), (part, None), notation.window[0]]
                continue
            case (Lacking(part, clause), _):
                todo += [f"{notation.brackets[1]}{without_text(clause, style)}", (part, None), notation.brackets[0]]
                continue
            case (Joined(join, parts, threshold), around):
                between = [notation.joins[join], None] if join is Join.AT_LEAST else [None, notation.joins[join]]
                inner: list[str | tuple[Formula, Join | None] | None] = []
                for part in parts:
                    inner += [*between, (part, join)] if inner else [(part, join)]
                if join is Join.AT_LEAST:
                    todo += [")", *reversed(inner), "(", notation.at_least.format(threshold, len(parts))]
                elif around is not None and (join is not around or join is Join.ENDS) and parts:
                    todo += [")", *reversed(inner), "("]
                else:
                    todo += reversed(inner)
                continue
        written += 1
    yield "".join(pieces)


TEXT: Final = Notation(
    PLAIN,
    {Join.SEQUENCE: " ; ", Join.ANY_ORDER: " & ", Join.AT_LEAST: ", ", Join.CHOICE: " | ", Join.ENDS: " pand "},
    "at least {} of ",
    "^{}".format,
    ("(", ") within {}"),
)
"""Plain text: `a ; b` sequence, `a & b` any order, `a | b` choice, `a pand b` ends in order, `a^3`
three times, `[guard]`, `(a & b) within 5 min`, `name: a` if a guard uses the time of `a`.
"""
