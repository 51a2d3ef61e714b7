"""The same scenarios in fewer parts."""

from collections.abc import Sequence
from dataclasses import replace

from backends.ltlf.inevitable import always_in
from backends.ltlf.parts import EMPTY, Op, Part, Parts


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
