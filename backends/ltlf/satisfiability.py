"""Whether a residual can still be satisfied, or still be violated: a lazy search for one continuation.

Nothing is translated to an automaton. The search goes through sets of obligations (formulas that the rest must satisfy or must not),
tries first whether the rest can be a single event, then each way to go on, nearest fulfilment first, and remembers what
it found. All letters count, also those that no event can produce.
"""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final, TypeAlias

from backends.ltlf.bdd import FALSE, TRUE, Diagrams
from backends.ltlf.formulas import Formulas, Op
from rvaft.errors import TooLarge

SEARCH_LIMIT: Final = 1_000_000

Obligations: TypeAlias = frozenset[int]
"""Formulas that the rest must satisfy; the complement ~f stands for "must not satisfy f"."""

Item: TypeAlias = tuple[int, bool]
"""An obligation, and whether it is about the next position (then the trace goes on)."""


@dataclass(slots=True)
class _Branch:
    """A position under construction: what is still to be looked at, the letter, what comes next, the open choices."""

    pending: list[Item]
    letter: dict[int, bool] = field(default_factory=dict)
    later: set[int] = field(default_factory=set)
    choices: list[list[list[Item]]] = field(default_factory=list)

    def with_items(self, items: list[Item]) -> "_Branch":
        return _Branch(list(items), dict(self.letter), set(self.later), list(self.choices))


class Liveness:
    """Answers about the residuals of some formulas."""

    def __init__(self, formulas: Formulas, diagrams: Diagrams) -> None:
        self._formulas = formulas
        self._diagrams = diagrams
        self._answers: dict[int, bool] = {TRUE: True, FALSE: False}
        self._live: set[Obligations] = set()
        self._recent: deque[Obligations] = deque(maxlen=4)
        """Obligations that could be met: fewer of them can be met too."""
        self._dead: set[Obligations] = set()

    def satisfiable(self, residual: int) -> bool:
        """Whether some continuation by one event or more satisfies it."""
        if residual not in self._answers:
            self._answers[residual] = self._search(self._cubes(residual))
        return self._answers[residual]

    def valid(self, residual: int) -> bool:
        """Whether every continuation by one event or more satisfies it."""
        return not self.satisfiable(self._diagrams.negation(residual))

    def _cubes(self, residual: int) -> Iterator[Obligations]:
        """Sets of obligations, one of which has to be met. Where a function is monotone in a variable one sign suffices."""
        todo: list[tuple[int, tuple[object, ...]]] = [(residual, ())]
        while todo:
            f, chosen = todo.pop()
            if f == TRUE:
                yield _collected(chosen)
            elif f != FALSE:
                variable, low, high = self._diagrams.nodes[f]
                if self._diagrams.implies(low, high):
                    todo += [(high, (variable, chosen)), (low, chosen)]
                elif self._diagrams.implies(high, low):
                    todo += [(low, (~variable, chosen)), (high, chosen)]
                else:
                    todo += [(high, (variable, chosen)), (low, (~variable, chosen))]

    def _search(self, starts: Iterator[Obligations]) -> bool:
        path: list[Obligations] = []
        ways = [starts]
        visited: set[Obligations] = set()
        while ways:
            current = next(ways[-1], None)
            if current is None:
                ways.pop()
                if path:
                    path.pop()
                continue
            if current in visited or current in self._dead:
                continue
            if current in self._live or any(current <= live for live in self._recent) or self._may_end(current):
                self._live.update([*path, current])
                self._recent.append(path[0] if path else current)
                return True
            visited.add(current)
            if len(visited) > SEARCH_LIMIT:
                raise TooLarge("the search for a continuation meets more sets of obligations", limit=SEARCH_LIMIT)
            path.append(current)
            ways.append(self._continued(current, last=False))
        self._dead |= visited
        return False

    def _may_end(self, obligations: Obligations) -> bool:
        return next(self._continued(obligations, last=True), None) is not None

    def _continued(self, obligations: Obligations, *, last: bool) -> Iterator[Obligations]:
        """The obligations for the rest after one event that the obligations allow; `last`: only whether there is such an event."""
        seen: set[Obligations] = set()
        branches = [_Branch([(obligation, False) for obligation in sorted(obligations, reverse=True)])]
        while branches:
            branch = branches.pop()
            if not self._settle(branch, last=last):
                continue
            if branch.choices:
                first, *branch.choices = branch.choices
                branches.extend(branch.with_items(items) for items in reversed(first))
                continue
            found = frozenset(branch.later)
            if found not in seen:
                seen.add(found)
                yield found

    def _settle(self, branch: _Branch, *, last: bool) -> bool:
        """Follow what is forced; False on a contradiction. Afterwards every open choice has two ways or more."""
        while True:
            while branch.pending:
                if not self._look(branch, *branch.pending.pop(), last=last):
                    return False
            choices, branch.choices = branch.choices, []
            for ways in choices:
                possible = [items for items in ways if self._possible(branch, items, last=last)]
                if not possible:
                    return False
                if any(self._holds(branch, items) for items in possible):
                    continue
                if len(possible) == 1:
                    branch.pending.extend(possible[0])
                else:
                    branch.choices.append(possible)
            if not branch.pending:
                return True

    def _literal(self, obligation: int) -> tuple[int, bool] | None:
        positive = obligation >= 0
        formula = obligation if positive else ~obligation
        row = self._formulas.rows[formula]
        if row.op is Op.NOT:
            formula, positive = row.operands[0], not positive
            row = self._formulas.rows[formula]
        return (formula, positive) if row.op is Op.ATOM else None

    def _possible(self, branch: _Branch, items: list[Item], *, last: bool) -> bool:
        for obligation, later in items:
            if later:
                if last and obligation >= 0:
                    return False
            else:
                literal = self._literal(obligation)
                if literal is not None and branch.letter.get(literal[0], literal[1]) is not literal[1]:
                    return False
        return True

    def _holds(self, branch: _Branch, items: list[Item]) -> bool:
        literals = [None if later else self._literal(obligation) for obligation, later in items]
        return all(literal is not None and branch.letter.get(literal[0]) is literal[1] for literal in literals)

    def _look(self, branch: _Branch, obligation: int, later: bool, *, last: bool) -> bool:
        positive = obligation >= 0
        formula = obligation if positive else ~obligation
        if later:
            branch.later.add(obligation)
            return not (last and positive)
        row = self._formulas.rows[formula]
        match row.op:
            case Op.TRUE:
                return positive
            case Op.FALSE:
                return not positive
            case Op.ATOM:
                return branch.letter.setdefault(formula, positive) is positive
            case Op.NOT:
                branch.pending.append((_signed(row.operands[0], not positive), False))
            case Op.NEXT:
                branch.pending.append((_signed(row.operands[0], positive), True))
            case Op.AND | Op.OR:
                items = [(_signed(operand, positive), False) for operand in row.operands]
                if (row.op is Op.AND) is positive:
                    branch.pending.extend(reversed(items))
                else:
                    branch.choices.append([[item] for item in items])
            case Op.EVENTUALLY:
                self._eventually(branch, formula, positive=positive)
            case Op.UNTIL:
                self._until(branch, formula, positive=positive)
        return True

    def _eventually(self, branch: _Branch, formula: int, *, positive: bool) -> None:
        inner = self._formulas.rows[formula].operands[0]
        now, rest = (_signed(inner, positive), False), (_signed(formula, positive), True)
        if positive:
            branch.choices.append([[now], [rest]])
        else:
            branch.pending += [rest, now]

    def _until(self, branch: _Branch, formula: int, *, positive: bool) -> None:
        left, right = self._formulas.rows[formula].operands
        now, rest = (_signed(right, positive), False), (_signed(formula, positive), True)
        stay = (_signed(left, positive), False)
        if positive:
            branch.choices.append([[now], [stay, rest]])
        else:
            branch.pending.append(now)
            branch.choices.append([[stay], [rest]])


def _signed(formula: int, positive: bool) -> int:
    return formula if positive else ~formula


def _collected(chosen: tuple[object, ...]) -> Obligations:
    """The obligations of a linked list."""
    found: list[int] = []
    while chosen:
        obligation, chosen = chosen  # type: ignore[assignment]
        assert isinstance(obligation, int)
        found.append(obligation)
    return frozenset(found)
