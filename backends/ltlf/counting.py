"""How many distinct subformulas a formula has, as people and other tools count them: `&` and `|` have any number of operands, in any order."""

from array import array
from collections import Counter
from hashlib import blake2b
from typing import Final, NamedTuple

from backends.ltlf.formulas import Formulas, Op

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
