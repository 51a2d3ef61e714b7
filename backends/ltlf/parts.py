"""A tree in normal form: what has to be observed, and in which order, without nodes and labels.

A gate with an event is a sequence (under `top_down` its event, then its body), a leaf without an event is nothing to observe
(`ALL` of no parts), what can never be observed is a choice without alternatives (`ONE` of no parts). Parts are numbered, the parts of a
part smaller than itself; a part that several others share is one number, since it is resolved and observed once.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from enum import Enum, auto
from typing import Final

from rvaft.guards import Guard, holds
from rvaft.guards import variables as guard_variables
from rvaft.model import Causality, Gate, Node
from rvaft.tree import RVAFT


class Op(Enum):
    """What a part asks for."""

    EVENT = auto()
    ALL = auto()
    ONE = auto()
    SEQUENCE = auto()
    AT_LEAST = auto()


@dataclass(frozen=True, slots=True)
class Part:
    """One part; `need` belongs to AT_LEAST, `node` to EVENT."""

    op: Op
    parts: tuple[int, ...] = ()
    need: int = 0
    node: str = ""

    @property
    def chooses(self) -> bool:
        """Whether scenarios differ in what they keep of it."""
        return (self.op is Op.ONE and len(self.parts) > 1) or (self.op is Op.AT_LEAST and self.need < len(self.parts))


EMPTY: Final = Part(Op.ALL)
IMPOSSIBLE: Final = Part(Op.ONE)


@dataclass(frozen=True, slots=True)
class Parts:
    """All parts, the root last, and for the parts of nodes with a guard over variables that guard."""

    rows: tuple[Part, ...]
    guards: tuple[tuple[int, Guard], ...] = ()

    @property
    def root(self) -> int:
        """The number of the whole."""
        return len(self.rows) - 1

    def kept(self) -> list[int]:
        """The parts that the root reaches, parts before wholes."""
        seen = bytearray(len(self.rows))
        seen[self.root] = 1
        for number in range(self.root, -1, -1):
            if seen[number]:
                for part in self.rows[number].parts:
                    seen[part] = 1
        return [number for number in range(len(self.rows)) if seen[number]]

    def resolve(self, number: int, chosen: Iterable[int]) -> "Parts":
        """The same with one choice made: exactly the chosen parts of that part."""
        rows = list(self.rows)
        rows[number] = replace(rows[number], op=Op.ALL, parts=tuple(chosen), need=0)
        return replace(self, rows=tuple(rows))


def parts_of(tree: RVAFT) -> Parts:
    """The tree in normal form. What a false guard without variables makes infeasible is left out."""
    rows: list[Part] = []
    guards: list[tuple[int, Guard]] = []
    numbers: dict[str, int] = {}

    def add(part: Part) -> int:
        rows.append(_possible(part, rows))
        return len(rows) - 1

    for node in tree.bottom_up():
        body = add(_body(node, [numbers[child] for child in node.children])) if node.children else None
        if node.has_event:
            event = add(Part(Op.EVENT, node=node.name))
            pair = [event] if body is None else [event, body]
            in_time = pair if tree.causality is Causality.TOP_DOWN else pair[::-1]
            body = event if body is None else add(Part(Op.SEQUENCE, tuple(in_time)))
        elif body is None:
            body = add(EMPTY)
        if node.when is not None:
            if guard_variables(node.when):
                guards.append((body, node.when))
            elif not holds(node.when, {}):
                rows[body] = IMPOSSIBLE
        numbers[node.name] = body
    assert numbers[tree.root] == len(rows) - 1
    return Parts(tuple(rows), tuple(reversed(guards)))


def _body(node: Node, parts: Sequence[int]) -> Part:
    match node.gate:
        case Gate.OR:
            return Part(Op.ONE, tuple(parts))
        case Gate.SAND:
            return Part(Op.SEQUENCE, tuple(parts))
        case Gate.SAND_RL:
            return Part(Op.SEQUENCE, tuple(reversed(parts)))
        case Gate.VOT:
            assert node.threshold is not None
            everything = node.threshold == len(parts)
            return Part(Op.ALL, tuple(parts)) if everything else Part(Op.AT_LEAST, tuple(parts), node.threshold)
        case _:
            return Part(Op.ALL, tuple(parts))


def _possible(part: Part, rows: Sequence[Part]) -> Part:
    """The part without what can never be observed."""
    possible = tuple(number for number in part.parts if rows[number] != IMPOSSIBLE)
    match part.op:
        case Op.EVENT:
            return part
        case Op.ONE:
            return replace(part, parts=possible)
        case Op.AT_LEAST:
            return replace(part, parts=possible) if len(possible) >= part.need else IMPOSSIBLE
        case Op.ALL | Op.SEQUENCE:
            return part if len(possible) == len(part.parts) else IMPOSSIBLE
