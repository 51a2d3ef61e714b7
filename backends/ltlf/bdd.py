"""Reduced ordered binary decision diagrams: Boolean functions in canonical form, equal functions the same number.

Plain loops instead of recursion, since there may be thousands of variables. The variable with the largest number is on top, and
nothing is ever thrown away. After Bryant, Graph-Based Algorithms for Boolean Function Manipulation (IEEE Transactions on
Computers, 1986).
"""

from collections.abc import Mapping
from typing import Final

from rvaft.errors import TooLarge

FALSE: Final = 0
TRUE: Final = 1
_BOTTOM: Final = -1
"""The variable of the constants: below all others."""


class Diagrams:
    """The functions made so far; more than `limit` nodes raise `TooLarge`."""

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self.nodes: list[tuple[int, int, int]] = [(_BOTTOM, FALSE, FALSE), (_BOTTOM, TRUE, TRUE)]
        """Variable, function where it is false, function where it is true."""
        self._index: dict[tuple[int, int, int], int] = {}
        self._choices: dict[tuple[int, int, int], int] = {}
        self._supports: dict[int, tuple[int, ...]] = {}

    def variable(self, number: int) -> int:
        """The function that is that variable."""
        return self._node(number, FALSE, TRUE)

    def negation(self, f: int) -> int:
        """Not f."""
        return self.choice(f, FALSE, TRUE)

    def conjunction(self, f: int, g: int) -> int:
        """F and g."""
        return self.choice(f, g, FALSE)

    def disjunction(self, f: int, g: int) -> int:
        """F or g."""
        return self.choice(f, TRUE, g)

    def implies(self, f: int, g: int) -> bool:
        """Whether f is true only where g is."""
        return self.choice(f, g, TRUE) == TRUE

    def _node(self, variable: int, low: int, high: int) -> int:
        if low == high:
            return low
        key = (variable, low, high)
        found = self._index.get(key)
        if found is None:
            found = len(self.nodes)
            if found > self._limit:
                raise TooLarge("the residual formulas have more nodes", limit=self._limit)
            self._index[key] = found
            self.nodes.append(key)
        return found

    def choice(self, f: int, g: int, h: int) -> int:
        """If f then g else h."""
        nodes, known = self.nodes, self._choices
        todo: list[tuple[int, int, int, int]] = [(f, g, h, -1)]
        done: list[int] = []
        while todo:
            f, g, h, variable = todo.pop()
            if variable >= 0:  # both halves are done
                high, low = done.pop(), done.pop()
                known[f, g, h] = self._node(variable, low, high)
                done.append(known[f, g, h])
            elif f <= TRUE or g == h:
                done.append(h if f == FALSE else g)
            elif g == TRUE and h == FALSE:
                done.append(f)
            elif (f, g, h) in known:
                done.append(known[f, g, h])
            else:
                variable = max(nodes[f][0], nodes[g][0], nodes[h][0])
                halves = [node[1:] if node[0] == variable else None for node in (nodes[f], nodes[g], nodes[h])]
                parts = [half or (own, own) for half, own in zip(halves, (f, g, h), strict=True)]
                todo.append((f, g, h, variable))
                todo.append((parts[0][1], parts[1][1], parts[2][1], -1))
                todo.append((parts[0][0], parts[1][0], parts[2][0], -1))
        return done.pop()

    def support(self, f: int) -> tuple[int, ...]:
        """The variables that f depends on, in order."""
        if f not in self._supports:
            self._supports[f] = tuple(sorted({self.nodes[node][0] for node in self._below(f)}, reverse=True))
        return self._supports[f]

    def _below(self, f: int) -> list[int]:
        """The inner nodes of f, each before those above it."""
        seen: set[int] = set()
        todo = [f]
        while todo:
            node = todo.pop()
            if node > TRUE and node not in seen:
                seen.add(node)
                todo.extend(self.nodes[node][1:])
        return sorted(seen)

    def compose(self, f: int, by: Mapping[int, int]) -> int:
        """F with every variable replaced by a function."""
        made = {FALSE: FALSE, TRUE: TRUE}
        for node in self._below(f):
            variable, low, high = self.nodes[node]
            low, high, new = made[low], made[high], by[variable]
            if self.nodes[new] == (variable, FALSE, TRUE) and variable > max(self.nodes[low][0], self.nodes[high][0]):
                made[node] = self._node(variable, low, high)  # the common case, in one step
            else:
                made[node] = self.choice(new, high, low)
        return made[f]

    def evaluate(self, f: int, by: Mapping[int, bool]) -> bool:
        """The value of f under an assignment."""
        while f > TRUE:
            variable, low, high = self.nodes[f]
            f = high if by[variable] else low
        return f == TRUE
