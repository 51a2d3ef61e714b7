"""LTLf formulas as a hash-consed graph: equal formulas have the same number, their row index.

Operands have smaller numbers than their formulas, so every traversal is a loop without recursion.
The core operators are constants, atoms, `!`, `&`, `|`, the strong next `X[!]`, `F` and `U`.
"""

from collections.abc import Hashable, Iterable
from enum import Enum
from functools import cache
from hashlib import blake2b
from typing import Final, NamedTuple

from rvaft.errors import TooLarge

TRUE: Final = 0
FALSE: Final = 1


class Connective(Enum):
    """The core operators, with their spelling in Spot."""

    TRUE = "1"
    FALSE = "0"
    ATOM = "atom"
    NOT = "!"
    AND = "&"
    OR = "|"
    NEXT = "X[!]"
    EVENTUALLY = "F"
    UNTIL = "U"


JUNCTIONS: Final = frozenset({Connective.AND, Connective.OR})


class Subformula(NamedTuple):
    """An operator with its operands; `name` is the name of an atom, else empty."""

    op: Connective
    operands: tuple[int, ...] = ()
    name: str = ""


class Formulas:
    """The formulas made so far; raises `TooLarge` beyond `limit`.

    >>> f = Formulas()
    >>> a, b = f.atom("a"), f.atom("b")
    >>> f.conjunction([a, b, a]) == f.conjunction([a, b]), f.negation(f.negation(a)) == a
    (True, True)
    """

    def __init__(self, limit: int | None = None) -> None:
        self._limit = limit
        self.rows = [Subformula(Connective.TRUE), Subformula(Connective.FALSE)]
        self._index = {row: number for number, row in enumerate(self.rows)}

    def _make(self, op: Connective, operands: tuple[int, ...] = (), name: str = "") -> int:
        row = Subformula(op, operands, name)
        found = self._index.setdefault(row, len(self.rows))
        if found == len(self.rows):
            if self._limit is not None and found > self._limit:
                raise TooLarge("the LTLf formula has more distinct subformulas", limit=self._limit)
            self.rows.append(row)
        return found

    def _junction(self, op: Connective, operands: Iterable[int], neutral: int, absorbing: int) -> int:
        unique = dict.fromkeys(operand for operand in operands if operand != neutral)
        if absorbing in unique:
            return absorbing
        return self._make(op, tuple(unique)) if len(unique) > 1 else next(iter(unique), neutral)

    def atom(self, name: str) -> int:
        """Return an atomic proposition."""
        return self._make(Connective.ATOM, (), name)

    def negation(self, formula: int) -> int:
        """Return `!f`."""
        if formula in (TRUE, FALSE):
            return FALSE if formula == TRUE else TRUE
        row = self.rows[formula]
        return row.operands[0] if row.op is Connective.NOT else self._make(Connective.NOT, (formula,))

    def conjunction(self, operands: Iterable[int]) -> int:
        """Return `f & g & …` without duplicates, in order; TRUE without operands."""
        return self._junction(Connective.AND, operands, TRUE, FALSE)

    def disjunction(self, operands: Iterable[int]) -> int:
        """Return `f | g | …` without duplicates, in order; FALSE without operands."""
        return self._junction(Connective.OR, operands, FALSE, TRUE)

    def next(self, formula: int) -> int:
        """Return `X[!] f`: a next position exists and satisfies f. `X[!] 1` is not `1`."""
        return FALSE if formula == FALSE else self._make(Connective.NEXT, (formula,))

    def eventually(self, formula: int) -> int:
        """Return `F f`."""
        return formula if formula in (TRUE, FALSE) else self._make(Connective.EVENTUALLY, (formula,))

    def until(self, left: int, right: int) -> int:
        """Return `f U g`."""
        if right in (TRUE, FALSE):
            return right
        return self.eventually(right) if left == TRUE else self._make(Connective.UNTIL, (left, right))

    def atoms(self, formula: int, *, now: bool = False) -> list[str]:
        """Return the names of the atoms of a formula; `now`: those that the current position
        decides.
        """
        rows = (self.rows[number] for number in self.reachable(formula, now=now))
        return [row.name for row in rows if row.op is Connective.ATOM]

    def reachable(self, formula: int, *, now: bool = False) -> list[int]:
        """Return the distinct subformulas, operands first; `now`: without those below a next."""
        seen = {formula}
        todo = [formula]
        while todo:
            row = self.rows[todo.pop()]
            if not (now and row.op is Connective.NEXT):
                fresh = [operand for operand in row.operands if operand not in seen]
                seen.update(fresh)
                todo.extend(fresh)
        return sorted(seen)

    def size(self, root: int) -> int:
        """Return the number of distinct subformulas, the formula included.

        `&` and `|` are flat and unordered: `a & (b & c)` counts four.
        """
        reachable = self.reachable(root)
        last = {operand: formula for formula in reachable for operand in self.rows[formula].operands}
        digest = cache(lambda number: int.from_bytes(blake2b(b"%d" % number, digest_size=16).digest()))
        numbers: dict[Hashable, int] = {}
        own: dict[int, int] = {}
        flat: dict[int, tuple[Connective, frozenset[int]]] = {}
        """Flattened operands of junctions; dropped after their last use to save memory."""
        counted: set[int] = set()
        for formula in reachable:
            op, operands, name = self.rows[formula]
            nested = [flat[operand][1] for operand in operands if operand in flat and flat[operand][0] is op]
            kept = [own[operand] for operand in operands if operand not in flat or flat[operand][0] is not op]
            members = frozenset(kept).union(*nested)
            if op in JUNCTIONS and len(members) == 1:  # all operands are equal
                own[formula] = own[operands[0]]
                if operands[0] in flat:
                    flat[formula] = flat[operands[0]]
            else:
                key = (op, sum(map(digest, members))) if op in JUNCTIONS else (op, name, *kept)
                own[formula] = numbers.setdefault(key, len(numbers))
                counted.update(kept)
                if op in JUNCTIONS:
                    flat[formula] = (op, members)
            for operand in operands:
                if last[operand] == formula:
                    flat.pop(operand, None)
        return len(counted | {own[root]})
