"""The contents of a drawing in every format: the nodes, the rows of their boxes, marks and legend.

The renderers `text`, `svg`, `dot` and `tikz` escape the texts.
"""

import json
import re
import unicodedata
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from typing import Final, NamedTuple, assert_never

from rvaft.core.branches import branch as branch_of
from rvaft.errors import OptionError
from rvaft.model.event_time import duration_text
from rvaft.model.expressions import guard_text, on_text, without_text
from rvaft.model.guards import COMPARISONS
from rvaft.model.nodes import Gate, Kind, Node
from rvaft.model.tree import RVAFT, reachable
from rvaft.model.values import Json
from rvaft.monitors import Explanation
from rvaft.support.terminal import cut, readable_json, visible
from rvaft.support.wording import did_you_mean

LONGEST: Final = 120
WIDTH: Final = 14
"""Width of text in a box, in columns."""
_LISTED: Final = 5
NARROWEST: Final = 4
"""Minimum width of a box, in columns."""

_GATES: Final[Mapping[Gate, tuple[str, str]]] = {
    Gate.OR: ("OR", "one of them"),
    Gate.AND: ("AND", "all, in any order"),
    Gate.SAND: ("SAND →", "all, from left to right"),
    Gate.SAND_RL: ("SAND ←", "all, from right to left"),
    Gate.PAND: ("PAND →", "all, each ending after the one to its left"),
    Gate.VOT: ("VOT k/n", "at least k of the n"),
}
assert set(_GATES) == set(Gate), "every gate has a text"


def turn(node: Node, place: int) -> int:
    """Return the position of a child, from 1, in the order of the gate."""
    match node.gate:
        case Gate.SAND_RL:
            return len(node.children) - place
        case None | Gate.OR | Gate.AND | Gate.SAND | Gate.PAND | Gate.VOT:
            return place + 1
        case _:
            assert_never(node.gate)


@dataclass(frozen=True, slots=True)
class Marks:
    """A match on a tree: kept children by node, notes at nodes, lines below the tree.

    `meaning` explains the marks in the legend.
    """

    kept: Mapping[str, frozenset[str]]
    notes: Mapping[str, tuple[str, ...]]
    below: tuple[str, ...]
    meaning: str = "detected"

    def edge(self, parent: str | None, child: str) -> bool:
        """Whether the scenario keeps this child."""
        return parent is not None and child in self.kept.get(parent, ())


def marks(tree: RVAFT, explanation: Explanation, events: Mapping[int, Json]) -> Marks:
    """Return the marks of a match."""
    scenario = {name: frozenset(children) for name, children in explanation.scenario.items()}
    notes: dict[str, tuple[str, ...]] = {}
    for name, numbers in explanation.events.items():
        shown = map(str, numbers if len(numbers) <= _LISTED else [*numbers[: _LISTED - 1], "…", numbers[-1]])
        several = (f"events {', '.join(shown)}",)
        notes[name] = several if len(numbers) > 1 else tuple(_note(numbers[0], events.get(numbers[0]), tree))
    kept = {**dict.fromkeys(notes, frozenset[str]()), **scenario}
    title = _title(explanation.branch, explanation.kinds)
    absent = [cut(absence.text, 2 * LONGEST) for absence in explanation.absences]
    values = [f"{name} = {_written(value)}" for name, value in explanation.bound(tree).items()]
    below = [title] * bool(title) + absent + values
    return Marks(kept, notes, tuple(below))


def branch_marks(tree: RVAFT, number: int) -> Marks:
    """Return the marks of a branch; raises `TreeError`."""
    found = branch_of(tree, number)
    kept = {name: frozenset(found.children(name)) for name in found.nodes}
    return Marks(kept, {}, (_title(number, found.kinds),), f"branch {number}")


def set_marks(tree: RVAFT, leaves: Collection[str], title: str) -> Marks:
    """Return the marks of the nodes that a set of leaves brings about, as far as the root needs them.

    Raises `ValueError` if the set does not bring the root about.
    """
    there: set[str] = set()
    for node in tree.bottom_up():
        found = sum(child in there for child in node.children)
        if node.name in leaves or (node.children and found >= _needed(node)):
            there.add(node.name)
    if tree.root not in there:
        raise ValueError(f"{', '.join(leaves)} does not bring {tree.root} about")
    kept: dict[str, frozenset[str]] = {}
    waiting = [tree.root]
    while waiting:
        name = waiting.pop()
        if name not in kept:
            kept[name] = frozenset(child for child in tree.nodes[name].children if child in there)
            waiting += kept[name]
    return Marks(kept, {}, (title,), title)


def _needed(node: Node) -> int:
    """Return how many children a gate needs."""
    match node.gate:
        case Gate.OR:
            return 1
        case Gate.VOT:
            return node.threshold or 1
        case None | Gate.AND | Gate.SAND | Gate.SAND_RL | Gate.PAND:
            return len(node.children)
        case _:
            assert_never(node.gate)


def _note(number: int, event: Json, tree: RVAFT) -> Iterator[str]:
    yield f"event {number}"
    fields = {field: event[field] for field in ("time", "topic") if isinstance(event, Mapping) and field in event}
    if tree.time is not None and (written := tree.time.written(event)) is not None:
        fields = {**fields, "time": written}
    for field, value in sorted(fields.items()):
        yield f"{field} {cut(value, LONGEST) if isinstance(value, str) else _written(value)}"


def _title(number: int | None, kinds: Collection[Kind]) -> str:
    words = ("" if number is None else f"branch {number}", ", ".join(sorted(kind.value for kind in kinds)))
    return ": ".join(filter(None, words))


def _written(value: Json) -> str:
    try:
        return cut(json.dumps(value, ensure_ascii=False, default=repr), LONGEST)
    except ValueError:  # more digits than Python converts
        return "…"


@dataclass(frozen=True, slots=True)
class Look:
    """How a tree is drawn.

    `collapse` names nodes whose children are hidden; `depth` is the number of levels below the
    root. `events` shows runtime events and guards, `names` the names of labelled nodes; `wrap` is
    in columns. `stagger` draws some leaves one level lower, for a narrower tree.
    `symbols` draws the symbols of fault trees below the boxes; without, gates are texts. `values` are
    short texts in the boxes of nodes, such as probabilities.
    """

    events: bool = False
    names: bool = True
    wrap: int = WIDTH
    depth: int | None = None
    collapse: tuple[str, ...] = ()
    marks: Marks | None = None
    legend: bool = False
    stagger: bool = False
    symbols: bool = True
    values: Mapping[str, str] | None = None


PLAIN: Final = Look()
TERMINAL: Final = Look(events=True)


def looking(
    tree: RVAFT,
    *,
    wrap: int | None = None,
    depth: int | None = None,
    collapse: Iterable[str] = (),
    branch: int | None = None,
    **shown: bool,
) -> Look:
    """Return the look with a marked branch; raises `OptionError` and `TreeError`."""
    if wrap is not None and wrap < NARROWEST:
        raise OptionError(f"a box has at least {NARROWEST} columns of text, not {wrap}")
    collapsed = (collapse,) if isinstance(collapse, str) else tuple(collapse)
    marked = None if branch is None else branch_marks(tree, branch)
    width = WIDTH if wrap is None else wrap
    return Look(wrap=width, depth=depth, collapse=collapsed, marks=marked, values=None, **shown)


@dataclass(frozen=True)
class View:
    """The drawn nodes, parents first; `folded` counts hidden nodes."""

    nodes: tuple[Node, ...]
    folded: Mapping[str, int]

    def children(self, node: Node) -> tuple[str, ...]:
        """Return the drawn children."""
        return () if node.name in self.folded else node.children

    @cached_property
    def shared(self) -> frozenset[str]:
        """The nodes drawn below several nodes."""
        parents = Counter(child for node in self.nodes for child in self.children(node))
        return frozenset(name for name, count in parents.items() if count > 1)

    @cached_property
    def numbered(self) -> frozenset[str]:
        """SAND and PAND gates whose children need numbers: a layout may draw shared nodes out of
        order.
        """
        loose = set(self.shared)
        for node in reversed(self.nodes):
            if not loose.isdisjoint(self.children(node)):
                loose.add(node.name)
        above = [node for node in self.nodes if not loose.isdisjoint(self.children(node))]
        return frozenset(node.name for node in above if node.gate is not None and node.gate.ordered)


def view(tree: RVAFT, look: Look) -> View:
    """Return the part of a tree that a look shows; raises `OptionError`.

    The depth of a node is its shortest path from the root. A node at the last level with a hidden
    child is folded.
    """
    for name in look.collapse:
        if name not in tree.order:
            reason = "the root does not lead to it" if name in tree.nodes else "the tree has no such node"
            hint = "" if name in tree.nodes else did_you_mean(name, tree.order, cutoff=0.4)
            raise OptionError(f"cannot collapse {visible(name)}: {reason}{visible(hint)}")
    if look.depth is not None and look.depth < 0:
        raise OptionError(f"the depth of a drawing is 0 or more, not {look.depth}")
    drawn, level, reached = {tree.root}, [tree.root], 0
    while level and (look.depth is None or reached < look.depth):
        below = [child for name in level if name not in look.collapse for child in tree.nodes[name].children]
        level = [child for child in dict.fromkeys(below) if child not in drawn]
        drawn.update(level)
        reached += 1
    nodes = tuple(node for node in tree.top_down() if node.name in drawn)
    folded = [node.name for node in nodes if not drawn.issuperset(node.children)]
    folded += [name for name in look.collapse if tree.nodes[name].children and name in drawn]
    return View(
        nodes, {name: len(set(reachable(name, lambda above: tree.nodes[above].children)) - drawn) for name in folded}
    )


def gate_text(node: Node) -> str:
    """Return a gate with its direction or k/n; "" for a leaf."""
    if node.gate is None:
        return ""
    return _GATES[node.gate][0].replace("k/n", f"{node.threshold}/{len(node.children)}")


def is_condition(node: Node) -> bool:
    """Whether a node is a leaf with a guard alone."""
    return node.leaf and node.on is None and node.when is not None


Role = Enum("Role", "PLAIN BOLD EVENT GUARD")


def rows(node: Node, look: Look) -> Iterator[tuple[Role, list[str]]]:
    """Yield the rows in the box of a node; the first identifies it.

    Numbers of events and windows are always shown.
    """
    width = look.wrap
    code_width = width + width // 4
    if look.names or not node.label:
        yield Role.BOLD if node.label else Role.PLAIN, wrapped(node.name, width)
    if node.label:
        yield Role.PLAIN, wrapped(node.label, width)
    if look.events and node.has_event:
        event = on_text(node.on) if node.on else f"event: {readable_json(node.name)}"
        yield Role.EVENT, wrapped_code(f"{event} {_number(node)}".rstrip(), code_width)
    elif node.times > 1:
        yield Role.EVENT, [_number(node)]
    if look.events and node.when is not None:
        yield Role.GUARD, wrapped_code(f"when {guard_text(node.when)}", code_width)
    if node.within is not None:
        yield Role.GUARD, [_window(node)]
    for clause in node.without if look.events else ():
        yield Role.GUARD, wrapped_code(without_text(clause), code_width)
    if look.values and node.name in look.values:
        yield Role.BOLD, [look.values[node.name]]
    for place, part in enumerate(look.marks.notes.get(node.name, ()) if look.marks else ()):
        yield Role.PLAIN if place else Role.BOLD, wrapped(part, width)


def _number(node: Node) -> str:
    return f"×{node.times}" if node.times > 1 else ""


def _window(node: Node) -> str:
    return "" if node.within is None else f"within {duration_text(node.within)}"


def node_line(node: Node, *, events: bool = True, value: str = "") -> str:
    """Return a node in one line: gate, window, kind, event, number, guard, label and value."""
    parts = [
        gate_text(node),
        _window(node),
        f"[{node.kind.value}]" if node.kind else "",
        f"on {on_text(node.on)} {_number(node)}".rstrip() if node.on and events else _number(node),
        f"when {guard_text(node.when)}" if node.when is not None and events else "",
        *(without_text(clause) for clause in node.without if events),
        readable_json(node.label) if node.label else "",
        value,
    ]
    return visible("  ".join(filter(None, parts)))


class Sign(Enum):
    """Entries of the legend besides gates: sample and meaning."""

    FAULT = "fault", "caused by a fault"
    ATTACK = "attack", "caused by an attack"
    EVENT = "", "an event"
    CONDITION = "condition", "holds, without an event"
    FOLDED = "+n", "n nodes not drawn"
    FOLDED_SHARED = "…", "nodes drawn elsewhere"
    ORDER = "1, 2", "the order of children"
    MARKED = "bold", ""


def legend(view: View, marks: Marks | None, *, symbols: bool) -> Iterator[tuple[Sign | Gate, str, str]]:
    """Yield the constructs in a drawing: sign, sample and meaning; `symbols` are those of leaves."""
    kinds = {node.kind for node in view.nodes}
    gates = {node.gate for node in view.nodes if view.children(node)}
    there: dict[Sign | Gate, bool] = {
        Sign.FAULT: Kind.FAULT in kinds,
        Sign.ATTACK: Kind.ATTACK in kinds,
        Sign.EVENT: symbols and any(node.leaf and not is_condition(node) for node in view.nodes),
        Sign.CONDITION: any(map(is_condition, view.nodes)),
        **{gate: gate in gates for gate in Gate},
        Sign.FOLDED: any(view.folded.values()),
        Sign.FOLDED_SHARED: not all(view.folded.values()),
        Sign.ORDER: bool(view.numbered),
        Sign.MARKED: marks is not None,
    }
    for sign in (one for one, shown in there.items() if shown):
        sample, meaning = _GATES[sign] if isinstance(sign, Gate) else sign.value
        yield sign, sample, marks.meaning if marks is not None and sign is Sign.MARKED else meaning


_WORD: Final = re.compile(r"(\s*)(\S+)")
_PART: Final = re.compile(r"[^/_.:,;\s-]*[/_.:,;\s-]+|[^/_.:,;\s-]+")
_TOKEN: Final = re.compile(
    r"""(\s*)(?=\S)(\[?not\s+\(+|[0-9][0-9.eE+-]*\ (?:ns|us|ms|s|min|h|d)\b\)*"""
    r"""|(?:"(?:[^"\\]|\\.)*"?|[^\s"(]+)?[^\s"(]*\(*)"""
)
_STRING: Final = re.compile(r'"(?:[^"\\]|\\.)*"?')
_INSIDE: Final = 3
"""The break rank inside a comparison."""


def wrapped(text: str, width: int) -> list[str]:
    """Return the lines of a text of at most `width` columns, or 1.5 times that for a single word.

    Line ends are kept; other control characters are shown as escapes.

    >>> wrapped("to the decontamination waypoint", 12)
    ['to the', 'decontamination', 'waypoint']
    """

    def lay(line: str, lines: "_LineFiller") -> None:
        for blank, word in _WORD.findall(line):
            lines.add(blank, word, room=width + width // 2)

    return _filled(text, width, lay)


def wrapped_code(text: str, width: int) -> list[str]:
    """Return the lines of an event or guard of at most `width` columns, without changing strings.

    Lines break at the outermost level first: at `;`, `and` and `or`, then commas, `when`, and
    comparisons. A comparison or a single word or string may be 1.5 times as wide.

    >>> wrapped_code("when A >= 1 and (B < 2 or C > 3)", 24)
    ['when A >= 1', 'and (B < 2 or C > 3)']
    """
    return _filled(text, width, lambda line, lines: _lay(list(_tokens(line)), lines))


def _filled(text: str, width: int, lay: Callable[[str, "_LineFiller"], object]) -> list[str]:
    found: list[str] = []
    for line in text.splitlines():
        lines = _LineFiller(width)
        lay(visible(line.replace("\t", " ")).rstrip(), lines)
        found += map("".join, lines.pieces)
    return found


def text_columns(text: str) -> int:
    """Return the width in columns: two for wide characters, none for combining ones."""
    if text.isascii():
        return len(text)
    return sum(1 + (unicodedata.east_asian_width(one) in "WF") for one in text if not unicodedata.combining(one))


class _LineFiller:
    """Fills lines with text, without leading blanks."""

    def __init__(self, width: int) -> None:
        self.width = width
        self.pieces: list[list[str]] = [[]]
        self._used = 0

    def add(self, blank: str, text: str, *, room: int) -> None:
        """Add a piece; break one wider than `room` after blanks and signs, or anywhere."""
        whole = text_columns(text) <= room
        for part in [text] if whole else [one for piece in _PART.findall(text) for one in self._cut(piece)]:
            columns = text_columns(part)
            if self.pieces[-1] and self._used + len(blank) + columns > self.width:
                self.pieces.append([])
                self._used = 0
            kept = blank if self.pieces[-1] else ""
            self.pieces[-1] += [kept, part]
            self._used += len(kept) + columns
            blank = ""

    def _cut(self, text: str) -> Iterator[str]:
        start = used = 0
        for place, character in enumerate(text):
            columns = text_columns(character)
            if used + columns > self.width and place > start:
                yield text[start:place]
                start, used = place, 0
            used += columns
        yield text[start:]


class _CodeToken(NamedTuple):
    """A token, preceding blanks, and break rank: bracket depth, then kind of place."""

    blank: str
    text: str
    rank: tuple[int, int]


def _tokens(text: str) -> Iterator[_CodeToken]:
    depth, before = 0, ""
    for blank, word in _TOKEN.findall(text):
        if before.endswith(";") or word in ("and", "or"):
            kind = 0
        elif before.endswith(",") or before == "when":
            kind = 1 if before.endswith(",") else 2
        elif not blank or before == "not":
            kind = 5
        else:
            kind = _INSIDE if word in COMPARISONS else 4
        yield _CodeToken(blank, word, (depth, kind))
        signs = _STRING.sub("", word)
        depth += sum(signs.count(sign) for sign in "([{") - sum(signs.count(sign) for sign in ")]}")
        before = word


def _lay(tokens: Sequence[_CodeToken], lines: _LineFiller) -> None:
    """Add tokens as one piece, else in parts at the lowest rank."""
    if not tokens:
        return
    blank = tokens[0].blank
    text = "".join(token.blank + token.text for token in tokens).removeprefix(blank)
    first = min((token.rank for token in tokens[1:]), default=(0, 0))
    room = lines.width + (lines.width // 2 if first[1] >= _INSIDE or len(tokens) == 1 else 0)
    if len(tokens) == 1 or text_columns(text) <= room:
        lines.add(blank, text, room=room)
        return
    breaks = [place for place, token in enumerate(tokens) if place and token.rank == first]
    for start, end in zip([0, *breaks], [*breaks, len(tokens)], strict=True):
        _lay(tokens[start:end], lines)
