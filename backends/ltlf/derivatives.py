"""What is left to observe after some events, where no compositional form is sound: the states of a sum over what may come next.

Two kinds of states. Parts that share no occurrence are *terms*, whose steps are found part by part (partial derivatives). Where
occurrences are shared, a state is the set of the scenarios that are still possible, as partial orders. There may be exponentially many.
"""

from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from typing import Final, NamedTuple, TypeAlias, TypeVar, assert_never

from backends.ltlf.parts import ways
from rvaft.analysis.normal_form import Op, Part
from rvaft.support.bits import bits, mask_of
from rvaft.support.budget import CellBudget
from rvaft.support.trampoline import Call, run

State = TypeVar("State", bound=Hashable)


# Parts that share occurrences. A shared occurrence is observed once, wherever it is used, so that scenarios cannot be put together from
# those of the parts: they are written out, each as its remaining occurrences with those that must come before.

Order: TypeAlias = frozenset[tuple[int, int]]
"""Occurrences (parts) with the set (bits) of those that must come before."""


class Orders:
    """The scenarios of parts, and the steps that lead through them; `event_of` gives the formula of an occurrence."""

    def __init__(self, parts: Sequence[Part], event_of: Callable[[int], int], *, monotone: bool, limit: int) -> None:
        self._parts = parts
        self._event_of = event_of
        self._monotone = monotone
        self._budget = CellBudget(
            "the scenarios of parts that share occurrences take more than the limit allows", limit
        )

    def of(self, root: int) -> frozenset[Order]:
        """The feasible scenarios of a part."""
        found: set[Order] = set()
        for kept in self._resolutions(root):
            self._budget.spend(len(kept))
            order = self._order(kept)
            if _is_acyclic(order):
                found.add(order)
        return frozenset(found)

    def over(self, state: frozenset[Order]) -> bool:
        """Whether some scenario has nothing left."""
        return frozenset() in state

    def steps(self, state: frozenset[Order]) -> list[tuple[int, frozenset[Order]]]:
        """The occurrences that may come next, each with the scenarios that agree with it."""
        following: dict[int, set[Order]] = {}
        for order in state:
            for occurrence, before in order:
                if not before:
                    self._budget.spend(len(order))
                    gone = ~(1 << occurrence)
                    rest = ((other, earlier & gone) for other, earlier in order if other != occurrence)
                    following.setdefault(occurrence, set()).add(frozenset(rest))
        return [(self._event_of(occurrence), frozenset(following[occurrence])) for occurrence in sorted(following)]

    def _resolutions(self, root: int) -> Iterator[dict[int, tuple[int, ...]]]:
        """Every way to make the choices: the kept parts, each with its kept parts. A shared part is resolved once."""
        waiting: list[Iterator[dict[int, tuple[int, ...]]]] = [iter([{}])]
        while waiting:
            made = next(waiting[-1], None)
            if made is None:
                waiting.pop()
                continue
            kept: dict[int, tuple[int, ...]] = {}
            reached = 1 << root
            while reached:
                number = reached.bit_length() - 1  # wholes before parts: none is reached again once it is resolved
                if self._parts[number].chooses and number not in made:
                    waiting.append(self._chosen(made, number))
                    break
                kept[number] = made.get(number, self._parts[number].parts)
                reached = reached ^ 1 << number | mask_of(kept[number])
            else:
                yield kept

    def _chosen(self, made: dict[int, tuple[int, ...]], number: int) -> Iterator[dict[int, tuple[int, ...]]]:
        for way in ways(self._parts[number], monotone=self._monotone):
            yield {**made, number: way}

    def _order(self, kept: dict[int, tuple[int, ...]]) -> Order:
        inside: dict[int, int] = {}
        before: dict[int, int] = {}
        for number in sorted(kept):
            inside[number] = 0
            if self._parts[number].op is Op.EVENT:
                inside[number] = 1 << number
                before[number] = 0
            for part in kept[number]:
                if self._parts[number].op is Op.SEQUENCE and inside[number]:
                    for occurrence in bits(inside[part]):
                        before[occurrence] |= inside[number]
                inside[number] |= inside[part]
        return frozenset(before.items())


def _is_acyclic(order: Order) -> bool:
    left = dict(order)
    while left:
        there = mask_of(left)
        rest = {occurrence: before for occurrence, before in left.items() if before & there}
        if len(rest) == len(left):
            return False
        left = rest
    return True


# Parts that share no occurrence.

DONE: Final = 0


class DerivativeTerm(NamedTuple):
    """What has to be observed: an event, or something of other terms. `number` is the formula of EVENT, the count of AT_LEAST."""

    op: Op
    inner: tuple[int, ...] = ()
    number: int = 0


class DerivativeTerms:
    """The terms made so far, equal terms equal numbers; a sequence is its first part and the rest, so that the rests of long ones are shared.

    The steps of a term: of parts in any order one makes a step, of alternatives one is taken, of a sequence the next part begins when
    those before may be over. Parts that ask for the same events are the same term, so symmetric states fall together.
    """

    def __init__(self, limit: int) -> None:
        self._budget = CellBudget(
            "the states of the sum over all orders of the events take more than the limit allows", limit
        )
        self._rows = [DerivativeTerm(Op.SEQUENCE)]
        self._index = {self._rows[0]: DONE}
        self._over = [True]
        self._steps: dict[int, tuple[tuple[int, int], ...]] = {DONE: ()}

    def over(self, term: int) -> bool:
        """Whether nothing more need be observed."""
        return self._over[term]

    def event(self, event: int) -> int:
        """The term of an event."""
        return self._make(DerivativeTerm(Op.EVENT, (), event))

    def part(self, op: Op, inner: Sequence[int], need: int = 0) -> int:
        """The term of a part whose own parts have these terms."""
        match op:
            case Op.SEQUENCE:
                return self._sequence(inner)
            case Op.ALL:
                flat: list[int] = []
                for term in inner:
                    row = self._rows[term]
                    flat.extend(row.inner if row.op is Op.ALL else [term] if term != DONE else ())
                flat.sort()
                return self._make(DerivativeTerm(op, tuple(flat))) if len(flat) > 1 else flat[0] if flat else DONE
            case Op.ONE:
                unique = sorted(set(inner))
                return unique[0] if len(unique) == 1 else self._make(DerivativeTerm(op, tuple(unique)))
            case Op.AT_LEAST:
                rest = sorted(term for term in inner if term != DONE)
                need = max(need - (len(inner) - len(rest)), 0)
                return (
                    self.part(Op.ALL, rest) if need == len(rest) else self._make(DerivativeTerm(op, tuple(rest), need))
                )
            case Op.EVENT | Op.CONDITION:
                raise AssertionError(op)
            case _:
                assert_never(op)

    def _make(self, row: DerivativeTerm) -> int:
        found = self._index.get(row)
        if found is None:
            self._budget.spend(1 + len(row.inner))
            found = self._index[row] = len(self._rows)
            need = {Op.EVENT: 1, Op.ONE: 1, Op.AT_LEAST: row.number}.get(row.op, len(row.inner))
            self._rows.append(row)
            self._over.append(sum(self._over[term] for term in row.inner) >= need)
        return found

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
            rest = part if rest == DONE else self._make(DerivativeTerm(Op.SEQUENCE, (part, rest)))
        return rest

    def steps(self, term: int) -> tuple[tuple[int, int], ...]:
        """The events that may come next, each with the term that is then left."""
        return run(self._steps_of(term))

    def _steps_of(self, term: int) -> Call[tuple[tuple[int, int], ...]]:
        if term not in self._steps:
            for inner in reversed(self._first(term)):
                yield self._steps_of(inner)
            self._steps[term] = tuple(dict.fromkeys(self._made(term)))
        return self._steps[term]

    def _first(self, term: int) -> Sequence[int]:
        """The parts of a term that may make the next step: of a sequence those before which all may be over, and one more."""
        row = self._rows[term]
        if row.op is Op.SEQUENCE and row.inner:
            return row.inner if self._over[row.inner[0]] else row.inner[:1]
        return row.inner

    def _made(self, term: int) -> Iterable[tuple[int, int]]:
        op, parts, number = self._rows[term]
        if op is Op.EVENT:
            yield number, DONE
        previous = None
        for index, inner in enumerate(self._first(term)):
            if inner == previous and op is not Op.SEQUENCE:  # those that ask for the same make the same step
                continue
            previous = inner
            others = (*parts[:index], *parts[index + 1 :])
            for event, left in self._steps[inner]:
                match op:
                    case Op.SEQUENCE:  # the rest begins, or goes on
                        yield event, self._sequence([left, *parts[index + 1 :]])
                    case Op.ALL:
                        yield event, self.part(Op.ALL, [left, *others])
                    case Op.ONE:
                        yield event, left
                    case Op.AT_LEAST:
                        yield event, self.part(Op.ALL, [left, self.part(Op.AT_LEAST, others, number - 1)])
                    case Op.EVENT | Op.CONDITION:
                        raise AssertionError(op)
                    case _:
                        assert_never(op)
