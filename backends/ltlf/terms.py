"""States of the general form for parts that share no occurrence: what is left to observe, as a term.

A term is a number, equal terms equal numbers. Its steps are the events that may come next, each with what is then left (partial
derivatives): of parts in any order one makes a step, of alternatives one is taken, of a sequence the next part begins when
those before may be over. Parts that ask for the same events are the same term, so symmetric states fall together.
"""

from collections.abc import Iterable, Sequence
from typing import Final, NamedTuple

from backends.ltlf.budget import Budget
from backends.ltlf.parts import Op, Part

DONE: Final = 0


class _Row(NamedTuple):
    op: Op
    inner: tuple[int, ...] = ()
    number: int = 0
    """The event (a formula) of EVENT, the count of AT_LEAST."""


class Terms:
    """The terms made so far; a sequence is its first part and the rest, so that the rests of long ones are shared."""

    def __init__(self, limit: int) -> None:
        self._budget = Budget(
            "the states of the sum over all orders of the events take more than the limit allows", limit
        )
        self._rows: list[_Row] = [_Row(Op.SEQUENCE)]
        self._index: dict[_Row, int] = {self._rows[0]: DONE}
        self._over: list[bool] = [True]
        self._steps: dict[int, tuple[tuple[int, int], ...]] = {DONE: ()}

    def over(self, term: int) -> bool:
        """Whether nothing more need be observed."""
        return self._over[term]

    def part(self, part: Part, inner: list[int]) -> int:
        """The term of a part whose own parts have these terms."""
        match part.op:
            case Op.SEQUENCE:
                return self._sequence(inner)
            case Op.ALL:
                return self._all(inner)
            case Op.ONE:
                return self._one(inner)
            case _:
                return self._at_least(part.need, inner)

    def all_of(self, terms: list[int]) -> int:
        """The term of several in any order."""
        return self._all(terms)

    def event(self, event: int) -> int:
        """The term of an event."""
        return self._make(_Row(Op.EVENT, (), event))

    def _make(self, row: _Row) -> int:
        found = self._index.get(row)
        if found is None:
            found = len(self._rows)
            self._budget.spend(1 + len(row.inner))
            self._index[row] = found
            self._rows.append(row)
            self._over.append(self._may_end(row))
        return found

    def _may_end(self, row: _Row) -> bool:
        match row.op:
            case Op.EVENT:
                return False
            case Op.ONE:
                return any(self._over[term] for term in row.inner)
            case Op.AT_LEAST:
                return sum(self._over[term] for term in row.inner) >= row.number
            case _:
                return all(self._over[term] for term in row.inner)

    def _sequence(self, inner: Sequence[int]) -> int:
        parts: list[int] = []
        for term in inner[:-1]:
            row, left = self._rows[term], term
            while row.op is Op.SEQUENCE and row.inner:
                parts.append(row.inner[0])
                left = row.inner[1]
                row = self._rows[left]
            if left != DONE:
                parts.append(left)
        rest = inner[-1] if inner else DONE
        for part in reversed(parts):
            rest = part if rest == DONE else self._make(_Row(Op.SEQUENCE, (part, rest)))
        return rest

    def _all(self, inner: Iterable[int]) -> int:
        flat = sorted(part for term in inner if term != DONE for part in self._opened(term, Op.ALL))
        if len(flat) <= 1:
            return flat[0] if flat else DONE
        return self._make(_Row(Op.ALL, tuple(flat)))

    def _one(self, inner: Iterable[int]) -> int:
        unique = sorted(set(inner))
        return unique[0] if len(unique) == 1 else self._make(_Row(Op.ONE, tuple(unique)))

    def _at_least(self, need: int, inner: Iterable[int]) -> int:
        terms = sorted(inner)
        rest = [term for term in terms if term != DONE]
        need = max(need - (len(terms) - len(rest)), 0)
        if need == len(rest):
            return self._all(rest)
        return self._make(_Row(Op.AT_LEAST, tuple(rest), need))

    def _opened(self, term: int, op: Op) -> tuple[int, ...]:
        row = self._rows[term]
        return row.inner if row.op is op else (term,)

    def steps(self, term: int) -> tuple[tuple[int, int], ...]:
        """The events that may come next, each with the term that is then left."""
        todo = [term]
        while todo:
            current = todo[-1]
            missing = [inner for inner in self._first(current) if inner not in self._steps]
            if missing:
                todo.extend(missing)
            else:
                todo.pop()
                if current not in self._steps:
                    self._steps[current] = tuple(dict.fromkeys(self._made(current)))
        return self._steps[term]

    def _first(self, term: int) -> list[int]:
        row = self._rows[term]
        if row.op is not Op.SEQUENCE:
            return list(row.inner)
        first: list[int] = []
        for inner in row.inner:
            first.append(inner)
            if not self._over[inner]:
                break
        return first

    def _made(self, term: int) -> Iterable[tuple[int, int]]:
        row = self._rows[term]
        if row.op is Op.EVENT:
            yield row.number, DONE
            return
        for index, inner in enumerate(self._first(term)):
            others = (*row.inner[:index], *row.inner[index + 1 :])
            for event, left in self._steps[inner]:
                match row.op:
                    case Op.SEQUENCE:
                        yield event, self._sequence([left, *row.inner[index + 1 :]])  # the rest begins, or goes on
                    case Op.ALL:
                        yield event, self._all([left, *others])
                    case Op.ONE:
                        yield event, left
                    case _:
                        yield event, self._all([left, self._at_least(row.number - 1, others)])
