"""The property of a branch as people read it: events in sequence, events in any order, conditions.

For display only; nothing is run from it. A node that several parents share stands wherever it is used, though it is one
occurrence.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Final, TypeAlias

from rvaft.errors import TooLarge
from rvaft.language.expressions import guard_text, name_text, on_text
from rvaft.model import Causality, Gate, Node
from rvaft.tree import RVAFT

DEFAULT_LIMIT: Final = 100_000


@dataclass(frozen=True, slots=True, eq=False)
class Event:
    """The runtime event of a node."""

    node: Node


@dataclass(frozen=True, slots=True, eq=False)
class Condition:
    """The guard of a node."""

    node: Node


class Join(Enum):
    """How parts are joined."""

    SEQUENCE = "sequence"
    ANY_ORDER = "any order"
    AT_LEAST = "at least"
    CHOICE = "choice"


@dataclass(frozen=True, slots=True, eq=False)
class Joined:
    """Parts one after the other, in any order, at least `threshold` of them in any order, or one of them."""

    join: Join
    parts: tuple["Formula", ...]
    threshold: int = 0


Formula: TypeAlias = Event | Condition | Joined


@dataclass(frozen=True, slots=True)
class Notation:
    """How a formula is written; `event` and `condition` write the two kinds of leaves."""

    event: Callable[[Node], str]
    condition: Callable[[Node], str]
    joins: Mapping[Join, str]
    at_least: Callable[[int], str]
    open: str = "("
    close: str = ")"


def formula(tree: RVAFT, order: Iterable[str], children: Callable[[str], tuple[str, ...]]) -> Formula:
    """The property of the part of a tree that keeps these nodes (parents first) and these children of them."""
    done: dict[str, Formula] = {}
    for name in reversed(tuple(order)):
        node = tree.nodes[name]
        body = _body(node, tuple(done[child] for child in children(name)))
        own: list[Formula] = []
        if node.has_event:
            own.append(Event(node))
        if node.when is not None:
            own.append(Condition(node))
        first = own if tree.causality is Causality.TOP_DOWN else body
        last = body if tree.causality is Causality.TOP_DOWN else own
        done[name] = _joined(Join.SEQUENCE, (*first, *last))
    return done[tree.root]


def _body(node: Node, parts: tuple[Formula, ...]) -> list[Formula]:
    match node.gate:
        case None:
            return []
        case Gate.SAND:
            return [_joined(Join.SEQUENCE, parts)]
        case Gate.SAND_RL:
            return [_joined(Join.SEQUENCE, parts[::-1])]
        case Gate.AND:
            return [_joined(Join.ANY_ORDER, parts)]
        case Gate.OR:
            return [_joined(Join.CHOICE, parts)]
        case Gate.VOT:
            return [Joined(Join.AT_LEAST, parts, node.threshold or 0)]


def _joined(join: Join, parts: tuple[Formula, ...]) -> Formula:
    return parts[0] if len(parts) == 1 else Joined(join, parts)


def write(term: Formula, notation: Notation, *, limit: int = DEFAULT_LIMIT) -> str:
    """A formula in a notation; raises `TooLarge` beyond `limit` pieces (shared nodes multiply)."""
    pieces: list[str] = []
    todo: list[str | tuple[Formula, Join]] = [(term, Join.SEQUENCE)]
    while todo:
        item = todo.pop()
        if len(pieces) > limit:
            raise TooLarge("the written form of a branch", limit=limit)
        if isinstance(item, str):
            pieces.append(item)
            continue
        match item:
            case (Event(node), _):
                pieces.append(notation.event(node))
            case (Condition(node), _):
                pieces.append(notation.condition(node))
            case (Joined(join, parts, threshold), around):
                bare = join is around or len(parts) == 0
                sign = notation.joins[join]
                inner: list[str | tuple[Formula, Join]] = []
                for part in parts:
                    inner += [sign, (part, join)] if inner else [(part, join)]
                if join is Join.AT_LEAST:
                    inner = [notation.at_least(threshold), notation.open, *inner, notation.close]
                elif not bare:
                    inner = [notation.open, *inner, notation.close]
                todo.extend(reversed(inner))
    return "".join(pieces)


def _event(node: Node) -> str:
    return name_text(node.name) if node.on is None else on_text(node.on)


def _condition(node: Node) -> str:
    return "" if node.when is None else f"[{guard_text(node.when)}]"


TEXT: Final = Notation(
    _event,
    _condition,
    {Join.SEQUENCE: " ; ", Join.ANY_ORDER: " & ", Join.AT_LEAST: ", ", Join.CHOICE: " | "},
    "at least {} of ".format,
)
"""Plain text: `a ; b` in sequence, `a & b` in any order, `a | b` one of them, conditions in brackets."""
