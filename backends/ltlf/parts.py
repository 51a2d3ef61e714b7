"""A tree in normal form: what has to be observed, and in which order, without nodes and labels.

A gate with an event is a sequence (under `top_down` its event, then its body), a leaf without an event is nothing to observe
(`ALL` of no parts), what can never be observed is a choice without alternatives (`ONE` of no parts). Parts are numbered, the parts of a
part smaller than itself; a part that several others share is one number, since it is resolved and observed once.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from enum import Enum, auto
from typing import Final

from rvaft.model.guards import Guard, holds
from rvaft.model.guards import variables as guard_variables
from rvaft.model.nodes import Causality, Gate, Node
from rvaft.model.tree import RVAFT


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


# What every scenario of a part contains; sets of parts are bits.


def always_in(part: Part, inner: Sequence[int]) -> int:
    """What every scenario of a part contains, given what every scenario of each of its parts contains."""
    return _in_at_least(inner, _missable(part))


def _missable(part: Part) -> int:
    """In how many of its parts a thing has to be so that it is in every scenario."""
    match part.op:
        case Op.ONE:
            return len(part.parts)
        case Op.AT_LEAST:
            return len(part.parts) - part.need + 1
        case _:
            return 1


def _in_at_least(sets: Sequence[int], count: int) -> int:
    """What is in at least that many of the sets."""
    if not sets or count > len(sets):
        return 0
    reached = [0] * (count + 1)
    reached[0] = -1
    for members in sets:
        for size in range(count, 0, -1):
            reached[size] |= reached[size - 1] & members
    return reached[count]


# The same scenarios in fewer parts.


def simplified(parts: Parts, *, monotone: bool) -> Parts:
    """The same scenarios in fewer parts: only what is kept, no empty parts, nothing nested that need not be. Guards are dropped.

    `monotone`: a match may be found inside a larger one (any positions may be used), so that more than was asked for is never needed.
    """
    kept = parts.kept()
    users: dict[int, list[int]] = {}
    for number in kept:
        for part in parts.rows[number].parts:
            users.setdefault(part, []).append(number)
    made = _Simplified(monotone)
    numbers: dict[int, int] = {}
    for number in kept:
        row = parts.rows[number]
        using = [parts.rows[user].op for user in users.get(number, [])]
        inner = tuple(numbers[p] for p in row.parts)
        numbers[number] = made.add(replace(row, parts=inner), once=len(using) <= 1, open_later=using == [row.op])
    return _renumbered(made.rows, numbers[parts.root])


class _Simplified:
    """Simple parts, built from parts to wholes."""

    def __init__(self, monotone: bool) -> None:
        self.rows: list[Part] = []
        self._monotone = monotone
        self._always: list[int] = []
        """Of each part itself and what every scenario of it contains."""
        self._once: list[bool] = []
        """Whether a part is used once, so that its choices may be made where it is used."""

    def add(self, part: Part, *, once: bool, open_later: bool) -> int:
        """The number of the simple form; `open_later`: the only user is of the same kind and takes the parts over anyway."""
        simple = self._simple(part, open_later=open_later)
        if isinstance(simple, Part):
            self.rows.append(simple)
            inner = [self._always[number] for number in simple.parts]
            self._always.append(1 << len(self._always) | always_in(simple, inner))
            self._once.append(True)
            simple = len(self.rows) - 1
        self._once[simple] = self._once[simple] and once
        return simple

    def _simple(self, part: Part, *, open_later: bool = False) -> Part | int:
        """The simple form of a part whose parts are simple, or the number of the part that it equals."""
        empty = [number for number in part.parts if self.rows[number] == EMPTY]
        rest = [number for number in part.parts if self.rows[number] != EMPTY]
        match part.op:
            case Op.EVENT:
                return part
            case Op.ALL:
                flat = rest if open_later else self._needed(self._opened(rest, Op.ALL))
                return _unless_single(Part(Op.ALL, tuple(flat)))
            case Op.SEQUENCE:
                sequence = rest if open_later else self._opened(rest, Op.SEQUENCE)
                return _unless_single(Part(Op.SEQUENCE, tuple(sequence))) if sequence else EMPTY
            case Op.ONE:
                if empty and (self._monotone or not rest):
                    return EMPTY
                choices = rest if open_later else self._opened(rest, Op.ONE)
                return _unless_single(Part(Op.ONE, tuple(dict.fromkeys([*choices, *empty[:1]]))))
            case Op.AT_LEAST:
                need = max(part.need - len(empty), 0)
                if not rest or (self._monotone and need == 0):
                    return EMPTY
                if need == len(rest):
                    return self._simple(Part(Op.ALL, tuple(rest)))
                if self._monotone and need == 1:
                    return self._simple(Part(Op.ONE, tuple(rest)))
                return Part(Op.AT_LEAST, tuple(rest), need)

    def _needed(self, numbers: Sequence[int]) -> list[int]:
        """The parts of an `ALL`, each once, without those that every scenario of another one contains anyway."""
        once = twice = 0
        unique = list(dict.fromkeys(numbers))
        for number in unique:
            twice |= once & self._always[number]
            once |= self._always[number]
        return [number for number in unique if not twice >> number & 1]

    def _opened(self, numbers: Sequence[int], op: Op) -> list[int]:
        """The numbers, those of the same kind replaced by their parts; a choice that is used elsewhere too stays one."""
        found: list[int] = []
        todo = list(reversed(numbers))
        while todo:
            number = todo.pop()
            row = self.rows[number]
            if row.op is op and row.parts and (op is not Op.ONE or self._once[number]):
                todo.extend(reversed(row.parts))
            else:
                found.append(number)
        return found


def _unless_single(part: Part) -> Part | int:
    return part.parts[0] if len(part.parts) == 1 else part


def _renumbered(rows: Sequence[Part], root: int) -> Parts:
    whole = Parts(tuple(rows[: root + 1]))
    kept = whole.kept()
    numbers = {number: index for index, number in enumerate(kept)}
    return Parts(tuple(replace(rows[n], parts=tuple(numbers[p] for p in rows[n].parts)) for n in kept))
