"""Formulas of LTL on finite traces, and Boolean functions: two hash-consed graphs, in which equal things are the same number.

A number is the index of a row, and what a row is made of has smaller numbers than the row itself. So every walk is a loop, and no
depth is too deep. The core of LTLf is small: constants, atoms, `!`, `&`, `|`, the strong next `X[!]`, `F` and `U`.
"""

from collections.abc import Hashable, Iterable, Mapping
from enum import Enum
from functools import cache
from hashlib import blake2b
from itertools import chain
from typing import Final, NamedTuple

from rvaft.errors import TooLarge

TRUE: Final = 0
FALSE: Final = 1


class Connective(Enum):
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


JUNCTIONS: Final = frozenset({Connective.AND, Connective.OR})


class Subformula(NamedTuple):
    """An operator with its operands; `name` is that of an atom, else empty."""

    op: Connective
    operands: tuple[int, ...] = ()
    name: str = ""


class Formulas:
    """The formulas made so far. `limit` bounds how many there may be; beyond it `TooLarge` is raised.

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

    def atom(self, name: str) -> int:
        """An atomic proposition."""
        return self._make(Connective.ATOM, (), name)

    def negation(self, formula: int) -> int:
        """`!f`."""
        if formula in (TRUE, FALSE):
            return FALSE if formula == TRUE else TRUE
        row = self.rows[formula]
        return row.operands[0] if row.op is Connective.NOT else self._make(Connective.NOT, (formula,))

    def conjunction(self, operands: Iterable[int]) -> int:
        """`f & g & …`: each operand once, in order; of none it is true."""
        return self.junction(Connective.AND, operands)

    def disjunction(self, operands: Iterable[int]) -> int:
        """`f | g | …`: each operand once, in order; of none it is false."""
        return self.junction(Connective.OR, operands)

    def junction(self, op: Connective, operands: Iterable[int]) -> int:
        """One of the two above."""
        neutral, absorbing = (TRUE, FALSE) if op is Connective.AND else (FALSE, TRUE)
        unique = dict.fromkeys(operand for operand in operands if operand != neutral)
        if absorbing in unique:
            return absorbing
        return self._make(op, tuple(unique)) if len(unique) > 1 else next(iter(unique), neutral)

    def next(self, formula: int) -> int:
        """`X[!] f`: there is a next position, and f holds there; so `X[!] 1` is not `1`."""
        return FALSE if formula == FALSE else self._make(Connective.NEXT, (formula,))

    def eventually(self, formula: int) -> int:
        """`F f`."""
        return formula if formula in (TRUE, FALSE) else self._make(Connective.EVENTUALLY, (formula,))

    def until(self, left: int, right: int) -> int:
        """`f U g`."""
        if right in (TRUE, FALSE):
            return right
        return self.eventually(right) if left == TRUE else self._make(Connective.UNTIL, (left, right))

    def reachable(self, formula: int, *, now: bool = False) -> list[int]:
        """The distinct subformulas, the formula itself included, operands first; `now`: not what only the next position decides."""
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
        """How many distinct subformulas there are as people and other tools count them, the formula itself included.

        `&` and `|` have any number of operands, in any order: `a & (b & c)` has four, and `b & c` is none of them.
        """
        reachable = self.reachable(root)
        last = {operand: formula for formula in reachable for operand in self.rows[formula].operands}
        numbers: dict[Hashable, int] = {}
        own: dict[int, int] = {}
        flat: dict[int, tuple[Connective, set[int], int]] = {}
        """Of a junction the operands, nested ones opened, and the sum of their digests."""
        counted: set[int] = set()
        for formula in reachable:
            op, made_of, name = self.rows[formula]
            nested = [flat[operand] for operand in made_of if operand in flat and flat[operand][0] is op]
            kept = [own[operand] for operand in made_of if operand not in flat or flat[operand][0] is not op]
            key: Hashable = (op, name, *kept)
            if op in JUNCTIONS:
                nested.sort(key=lambda junction: len(junction[1]))
                _, largest, total = nested.pop() if nested else (op, set(), 0)
                operands = set(largest)
                for number in chain(kept, *(others for _, others, _ in nested)):
                    if number not in operands:
                        operands.add(number)
                        total += int.from_bytes(blake2b(b"%d" % number, digest_size=16).digest())
                key = (op, total)
                flat[formula] = (op, operands, total)
            if op in JUNCTIONS and len(operands) == 1:  # all of them are the same
                own[formula] = own[made_of[0]]
                flat.pop(formula)
                flat.update({formula: flat[made_of[0]]} if made_of[0] in flat else {})
            else:
                counted.update(kept)
                own[formula] = numbers.setdefault(key, len(numbers))
            for operand in made_of:
                if last[operand] == formula:
                    flat.pop(operand, None)  # its operands may be many
        return len(counted | {own[root]})


# Boolean functions.

BOTTOM: Final = 0
TOP: Final = 1
_CONSTANT: Final = -1
"""The variable of the constants: below all others."""


class Diagrams:
    """Reduced ordered binary decision diagrams: Boolean functions in canonical form. More than `limit` nodes raise `TooLarge`.

    Plain loops instead of recursion, since there may be thousands of variables. The variable with the largest number is on top, and
    nothing is ever thrown away. After Bryant, Graph-Based Algorithms for Boolean Function Manipulation (IEEE Transactions on
    Computers, 1986).
    """

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self.nodes = [(_CONSTANT, BOTTOM, BOTTOM), (_CONSTANT, TOP, TOP)]
        """Variable, function where it is false, function where it is true."""
        self._index: dict[tuple[int, int, int], int] = {}
        self._choices: dict[tuple[int, int, int], int] = {}
        self.support = cache(self._support)

    def variable(self, number: int) -> int:
        """The function that is that variable."""
        return self._node(number, BOTTOM, TOP)

    def negation(self, f: int) -> int:
        """Not f."""
        return self.choice(f, BOTTOM, TOP)

    def conjunction(self, f: int, g: int) -> int:
        """F and g."""
        return self.choice(f, g, BOTTOM)

    def disjunction(self, f: int, g: int) -> int:
        """F or g."""
        return self.choice(f, TOP, g)

    def implies(self, f: int, g: int) -> bool:
        """Whether f is true only where g is."""
        return self.choice(f, g, TOP) == TOP

    def _node(self, variable: int, low: int, high: int) -> int:
        if low == high:
            return low
        key = (variable, low, high)
        found = self._index.get(key)
        if found is None:
            found = self._index[key] = len(self.nodes)
            if found > self._limit:
                raise TooLarge("the residual formulas have more nodes", limit=self._limit)
            self.nodes.append(key)
        return found

    def choice(self, f: int, g: int, h: int) -> int:
        """If f then g else h."""
        nodes, known = self.nodes, self._choices
        todo: list[tuple[int, int, int, int]] = [(f, g, h, _CONSTANT)]
        done: list[int] = []
        while todo:
            f, g, h, variable = todo.pop()
            if variable != _CONSTANT:  # both halves are done
                high, low = done.pop(), done.pop()
                known[f, g, h] = self._node(variable, low, high)
                done.append(known[f, g, h])
            elif f <= TOP or g == h:
                done.append(h if f == BOTTOM else g)
            elif g == TOP and h == BOTTOM:
                done.append(f)
            elif (f, g, h) in known:
                done.append(known[f, g, h])
            else:
                variable = max(nodes[f][0], nodes[g][0], nodes[h][0])
                (f0, f1), (g0, g1), (h0, h1) = (
                    nodes[part][1:] if nodes[part][0] == variable else (part, part) for part in (f, g, h)
                )
                todo += [(f, g, h, variable), (f1, g1, h1, _CONSTANT), (f0, g0, h0, _CONSTANT)]
        return done.pop()

    def _support(self, f: int) -> list[int]:
        """The variables that f depends on, from the top."""
        return sorted({self.nodes[node][0] for node in self._below(f)}, reverse=True)

    def _below(self, f: int) -> list[int]:
        """The inner nodes of f, each before those above it."""
        seen = {BOTTOM, TOP}
        todo = [f]
        while todo:
            node = todo.pop()
            if node not in seen:
                seen.add(node)
                todo.extend(self.nodes[node][1:])
        return sorted(seen)[2:]

    def compose(self, f: int, by: Mapping[int, int]) -> int:
        """F with every variable replaced by a function."""
        made = {BOTTOM: BOTTOM, TOP: TOP}
        for node in self._below(f):
            variable, low, high = self.nodes[node]
            low, high, new = made[low], made[high], by[variable]
            if self.nodes[new] == (variable, BOTTOM, TOP) and variable > max(self.nodes[low][0], self.nodes[high][0]):
                made[node] = self._node(variable, low, high)  # the common case, in one step
            else:
                made[node] = self.choice(new, high, low)
        return made[f]

    def evaluate(self, f: int, by: Mapping[int, bool]) -> bool:
        """The value of f under an assignment."""
        while f > TOP:
            variable, low, high = self.nodes[f]
            f = high if by[variable] else low
        return f == TOP
