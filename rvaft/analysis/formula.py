"""The property of a branch as people read it: events in sequence, events in any order, conditions, windows of time.

For display only; nothing is run from it. A node that several parents share stands wherever it is used, though it is one
occurrence.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import takewhile
from typing import Final, Literal, TypeAlias

from rvaft.analysis.normal_form import NormalForm, Op, normal_form
from rvaft.errors import TooLarge
from rvaft.model.expressions import PLAIN, Style, event_text, guard_text
from rvaft.model.guards import time_points
from rvaft.model.nodes import Gate, Node
from rvaft.model.tree import RVAFT

DEFAULT_LIMIT: Final = 100_000


@dataclass(frozen=True, slots=True, eq=False)
class Leaf:
    """The runtime event of a node, or its guard; `named` where another guard asks for the time of this event."""

    op: Literal[Op.EVENT, Op.CONDITION]
    node: Node
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
    """Parts one after the other, in any order, at least `threshold` of them in any order, one of them, or each ending before the next."""

    join: Join
    parts: tuple["Formula", ...]
    threshold: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """A part that lasts no longer than so many nanoseconds."""

    part: "Formula"
    within: int


@dataclass(frozen=True, slots=True, eq=False)
class Named:
    """A part that guards ask for the start or the end of."""

    part: "Formula"
    name: str


Formula: TypeAlias = Leaf | Joined | Window | Named


@dataclass(frozen=True, slots=True)
class Notation:
    """How a formula is written: in which style its leaves, and what precedes k of n parts.

    `number` is what stands behind an event that is counted, `window` around a part that has one, `label` behind the name of what guards ask for.
    """

    style: Style
    joins: Mapping[Join, str]
    at_least: str
    number: Callable[[int], str]
    window: tuple[str, str]
    label: str = ": "
    condition: Callable[[str], str] = "[{}]".format
    whole: frozenset[Join] = frozenset({Join.SEQUENCE})
    """The joins that need no brackets where they join the whole formula."""


def formula(tree: RVAFT, choices: Mapping[str, str] | None = None) -> Formula:
    """The property of a tree, or of the branch that makes these choices."""
    form = normal_form(tree, choices, as_written=True)
    done: list[Formula] = []
    asked = _asked(form, tree)
    spread: dict[int, list[Formula]] = {}  # what stands in a sequence for a choice
    for number, part in enumerate(form.parts):
        inner = tuple(done[inside] for inside in part.parts)
        match part.op:
            case Op.EVENT | Op.CONDITION:
                node = tree.nodes[part.node]
                named = ("at", node.name) in asked or (node.leaf and {("start", node.name), ("end", node.name)} & asked)
                done.append(Leaf(part.op, node, part.op is Op.EVENT and node.on is not None and bool(named)))
            case Op.ONE:
                spread[number] = _choice(inner)
                done.append(_joined(Join.SEQUENCE, spread[number]))
            case Op.AT_LEAST:
                done.append(Joined(Join.AT_LEAST, inner, part.need))
            case Op.ALL:
                ends = part.node in tree.nodes and tree.nodes[part.node].gate is Gate.PAND
                done.append(_joined(Join.ENDS if ends else Join.ANY_ORDER, inner))
            case Op.SEQUENCE:
                row: list[Formula] = []
                for inside in part.parts:
                    own = form.parts[inside].node == part.node
                    row += spread.get(inside, [done[inside]]) if own else [done[inside]]
                done.append(_joined(Join.SEQUENCE, row))
        whole = tree.nodes[part.node] if part.node and form.whole[part.node] == number else None
        if whole is not None and whole.within is not None:
            done[number] = Window(done[number], whole.within)
        if whole is not None and not whole.leaf and {("start", whole.name), ("end", whole.name)} & asked:
            done[number] = Named(done[number], whole.name)
    return done[form.root]


def _asked(form: NormalForm, tree: RVAFT) -> set[tuple[str, str]]:
    """The time points of nodes that guards ask for."""
    conditions = (tree.nodes[part.node].when for part in form.parts if part.op is Op.CONDITION)
    return {(one.point, one.node) for guard in conditions for one in time_points(guard)}


def _choice(parts: tuple[Formula, ...]) -> list[Formula]:
    """One of the parts; what all of them start or end with, because they share those nodes, stands once."""
    rows = [
        part.parts if isinstance(part, Joined) and part.join is Join.SEQUENCE and len(parts) > 1 else (part,)
        for part in parts
    ]
    most = min(map(len, rows)) - 1  # of each part something is left to choose
    first = _common(rows, range(most))
    last = _common(rows, range(-1, -1 - (most - len(first)), -1))[::-1]
    middle = [row[len(first) : len(row) - len(last)] for row in rows]
    return [*first, _joined(Join.CHOICE, tuple(_joined(Join.SEQUENCE, row) for row in middle)), *last]


def _common(rows: Sequence[tuple[Formula, ...]], places: Iterable[int]) -> list[Formula]:
    """The formulas that stand at these places in every row, up to the first place where they differ."""
    same = takewhile(lambda place: all(row[place] is rows[0][place] for row in rows), places)
    return [rows[0][place] for place in same]


def _joined(join: Join, parts: Sequence[Formula]) -> Formula:
    return parts[0] if len(parts) == 1 else Joined(join, tuple(parts))


def write(term: Formula, notation: Notation, *, limit: int = DEFAULT_LIMIT) -> str:
    """A formula in a notation; raises `TooLarge` beyond `limit` pieces (shared nodes multiply)."""
    return "".join(breakable(term, notation, limit=limit))


def breakable(term: Formula, notation: Notation, *, limit: int = DEFAULT_LIMIT) -> Iterator[str]:
    """The same in pieces between which a line may be broken; in every notation a formula has the same pieces.

    Each but the first starts with a sign, where the sign is no comma. Raises `TooLarge`.
    """
    pieces: list[str] = []
    written, style = 0, notation.style
    outer = None if isinstance(term, Joined) and term.join in notation.whole else Join.SEQUENCE
    todo: list[str | tuple[Formula, Join | None] | None] = [(term, outer)]  # None is where a line may end
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
            case (Leaf(Op.EVENT, node, named), _):
                pieces.append(f"{style.node(node.name)}{notation.label}" if named else "")
                pieces.append(event_text(node, style) + (notation.number(node.times) if node.times > 1 else ""))
            case (Leaf(_, node), _):
                pieces.append(notation.condition(guard_text(node.when, style)) if node.when is not None else "")
            case (Named(part, name), _):
                todo += [(part, Join.AT_LEAST), f"{style.node(name)}{notation.label}"]
                continue
            case (Window(part, within), _):
                todo += [notation.window[1].format(style.duration(within)), (part, None), notation.window[0]]
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
"""Plain text: `a ; b` in sequence, `a & b` in any order, `a | b` one of them, `a pand b` ending in this order, `a^3` three times,
conditions in brackets, `(a & b) within 5 min`, and `name: a` where a guard asks for its time."""
