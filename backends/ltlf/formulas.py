"""Formulas of LTL on finite traces as one hash-consed graph: equal formulas are the same number.

A formula is the index of its row in `Formulas`; operands have smaller numbers than the formula itself, so every walk is a loop and no depth is
too deep. The core is small: constants, atoms, `!`, `&`, `|`, the strong next `X[!]`, `F` and `U`; other operators are written with it.
"""

from array import array
from collections import Counter
from collections.abc import Iterable
from enum import Enum
from hashlib import blake2b
from typing import Final, NamedTuple

from rvaft.errors import TooLarge

TRUE: Final = 0
FALSE: Final = 1


class Op(Enum):
    """The operators of the core; the value is how Spot writes them."""

    TRUE = "1"
    FALSE = "0"
    ATOM = "atom"
    NOT = "!"
    AND = "&"
    OR = "|"
    NEXT = "X[!]"
    EVENTUALLY = "F"
    UNTIL = "U"


class Row(NamedTuple):
    """An operator with its operands; `name` is that of an atom, else empty."""

    op: Op
    operands: tuple[int, ...] = ()
    name: str = ""


class Formulas:
    """The formulas made so far. `limit` bounds how many there may be; beyond it `TooLarge` is raised."""

    def __init__(self, limit: int | None = None) -> None:
        self._limit = limit
        self.rows: list[Row] = [Row(Op.TRUE), Row(Op.FALSE)]
        self._index: dict[Row, int] = {row: number for number, row in enumerate(self.rows)}

    def _make(self, row: Row) -> int:
        found = self._index.get(row)
        if found is None:
            found = len(self.rows)
            if self._limit is not None and found > self._limit:
                raise TooLarge("the LTLf formula has more distinct subformulas", limit=self._limit)
            self._index[row] = found
            self.rows.append(row)
        return found

    def atom(self, name: str) -> int:
        """An atomic proposition."""
        return self._make(Row(Op.ATOM, (), name))

    def negation(self, formula: int) -> int:
        """`!f`."""
        if formula in (TRUE, FALSE):
            return FALSE if formula == TRUE else TRUE
        row = self.rows[formula]
        return row.operands[0] if row.op is Op.NOT else self._make(Row(Op.NOT, (formula,)))

    def conjunction(self, operands: Iterable[int]) -> int:
        """`f & g & …`: each operand once, in order; of none it is true."""
        return self._junction(Op.AND, operands, neutral=TRUE, absorbing=FALSE)

    def disjunction(self, operands: Iterable[int]) -> int:
        """`f | g | …`: each operand once, in order; of none it is false."""
        return self._junction(Op.OR, operands, neutral=FALSE, absorbing=TRUE)

    def _junction(self, op: Op, operands: Iterable[int], *, neutral: int, absorbing: int) -> int:
        unique = dict.fromkeys(operand for operand in operands if operand != neutral)
        if absorbing in unique:
            return absorbing
        if len(unique) <= 1:
            return next(iter(unique), neutral)
        return self._make(Row(op, tuple(unique)))

    def next(self, formula: int) -> int:
        """`X[!] f`: there is a next position, and f holds there; so `X[!] 1` is not `1`."""
        return FALSE if formula == FALSE else self._make(Row(Op.NEXT, (formula,)))

    def eventually(self, formula: int) -> int:
        """`F f`."""
        return formula if formula in (TRUE, FALSE) else self._make(Row(Op.EVENTUALLY, (formula,)))

    def until(self, left: int, right: int) -> int:
        """`f U g`."""
        if right in (TRUE, FALSE):
            return right
        return self.eventually(right) if left == TRUE else self._make(Row(Op.UNTIL, (left, right)))

    def reachable(self, formula: int) -> list[int]:
        """The distinct subformulas, the formula itself included, operands first."""
        seen = {formula}
        todo = [formula]
        while todo:
            for operand in self.rows[todo.pop()].operands:
                if operand not in seen:
                    seen.add(operand)
                    todo.append(operand)
        return sorted(seen)


# How many distinct subformulas a formula has, as people and other tools count them: `&` and `|` have any number of operands, in any order.

_JUNCTIONS: Final = frozenset({Op.AND, Op.OR})


class _Flat(NamedTuple):
    """A formula without nested junctions: its operator, its number, and for a junction the numbers of its operands."""

    op: Op
    number: int
    operands: tuple[int, ...] = ()


def subformulas(formulas: Formulas, root: int) -> int:
    """The distinct subformulas, the formula itself included: of `a & (b & c)` there are four, and `b & c` is none of them."""
    reachable = formulas.reachable(root)
    waiting = Counter(operand for formula in reachable for operand in formulas.rows[formula].operands)
    numbers: dict[bytes, int] = {}
    counted: set[int] = set()
    flat: dict[int, _Flat] = {}
    for formula in reachable:
        row = formulas.rows[formula]
        inner = [flat[operand] for operand in row.operands]
        for operand in row.operands:
            waiting[operand] -= 1
            if not waiting[operand]:
                flat.pop(operand)  # its operands may be many
        kept = [one.number for one in inner if one.op is not row.op or row.op not in _JUNCTIONS]
        operands = tuple(kept)
        if row.op in _JUNCTIONS:
            opened = (number for one in inner if one.op is row.op for number in one.operands)
            operands = tuple(sorted({*kept, *opened}))
            if len(operands) == 1:
                flat[formula] = inner[0]
                continue
        counted.update(kept)
        key = f"{row.op.name} {row.name} ".encode() + array("L", operands).tobytes()
        number = numbers.setdefault(blake2b(key, digest_size=16).digest(), len(numbers))
        flat[formula] = _Flat(row.op, number, operands)
    return len(counted | {flat[root].number})
