"""Whether a residual can still be satisfied, or still be violated: a lazy search for one continuation.

Nothing is translated to an automaton. The search goes through sets of obligations (formulas that the rest must satisfy or must not),
tries first whether the rest can be a single event, then each way to go on, nearest fulfilment first, and remembers what
it found. All letters count, also those that no event can produce.
"""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Final, TypeAlias, assert_never

from backends.ltlf.formulas import BOTTOM, TOP, Connective, Diagrams, Formulas
from rvaft.errors import TooLarge

SEARCH_LIMIT: Final = 1_000_000

Obligations: TypeAlias = frozenset[int]
"""Formulas that the rest must satisfy; the complement ~f stands for "must not satisfy f"."""

Item: TypeAlias = tuple[int, bool]
"""An obligation, and whether it is about the next position (then the trace goes on)."""


@dataclass(slots=True)
class _SearchBranch:
    """A position under construction: what is still to be looked at, the letter, what comes next, the open choices."""

    pending: list[Item]
    letter: dict[int, bool] = field(default_factory=dict)
    later: set[int] = field(default_factory=set)
    choices: list[list[list[Item]]] = field(default_factory=list)


class Liveness:
    """Answers about the residuals of some formulas."""

    def __init__(self, formulas: Formulas, diagrams: Diagrams) -> None:
        self._rows = formulas.rows
        self._diagrams = diagrams
        self._answers: dict[int, bool] = {TOP: True, BOTTOM: False}
        self._live: set[Obligations] = set()
        self._recent: deque[Obligations] = deque(maxlen=4)
        """Obligations that could be met: fewer of them can be met too."""
        self._dead: set[Obligations] = set()

    def is_satisfiable(self, residual: int) -> bool:
        """Whether some continuation by one event or more satisfies it."""
        if residual not in self._answers:
            self._answers[residual] = self._search(self._cubes(residual))
        return self._answers[residual]

    def is_valid(self, residual: int) -> bool:
        """Whether every continuation by one event or more satisfies it."""
        return not self.is_satisfiable(self._diagrams.negation(residual))

    def _cubes(self, residual: int) -> Iterator[Obligations]:
        """Sets of obligations, one of which has to be met. Where a function is monotone in a variable one sign suffices."""
        path: list[int] = []
        todo: list[tuple[int, int, tuple[int, ...]]] = [(residual, 0, ())]
        while todo:
            f, depth, sign = todo.pop()
            path[depth:] = sign
            if f == TOP:
                yield frozenset(path)
            elif f != BOTTOM:
                variable, low, high = self._diagrams.nodes[f]
                if self._diagrams.implies(low, high):
                    todo += [(high, len(path), (variable,)), (low, len(path), ())]
                elif self._diagrams.implies(high, low):
                    todo += [(low, len(path), (~variable,)), (high, len(path), ())]
                else:
                    todo += [(high, len(path), (variable,)), (low, len(path), (~variable,))]

    def _search(self, starts: Iterator[Obligations]) -> bool:
        path: list[Obligations] = []
        ways = [starts]
        visited: set[Obligations] = set()
        while ways:
            current = next(ways[-1], None)
            if current is None:
                ways.pop()
                del path[len(ways) - 1 :]
            elif current not in visited and current not in self._dead:
                if (
                    current in self._live
                    or any(current <= live for live in self._recent)
                    or next(self._continued(current, last=True), None) is not None
                ):
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

    def _continued(self, obligations: Obligations, *, last: bool) -> Iterator[Obligations]:
        """The obligations for the rest after one event that the obligations allow; `last`: only whether there is such an event."""
        seen: set[Obligations] = set()
        branches = [_SearchBranch([(obligation, False) for obligation in sorted(obligations, reverse=True)])]
        while branches:
            branch = branches.pop()
            if not self._settle(branch, last=last):
                continue
            if branch.choices:
                first, *rest = branch.choices
                for items in reversed(first):
                    letter, later = dict(branch.letter), set(branch.later)
                    branches.append(replace(branch, pending=list(items), letter=letter, later=later, choices=rest[:]))
                continue
            found = frozenset(branch.later)
            if found not in seen:
                seen.add(found)
                yield found

    def _settle(self, branch: _SearchBranch, *, last: bool) -> bool:
        """Follow what is forced; False on a contradiction. Afterwards every open choice has two ways or more."""
        while True:
            while branch.pending:
                if not self._look(branch, *branch.pending.pop(), last=last):
                    return False
            choices, branch.choices = branch.choices, []
            for ways in choices:
                truths = [(items, self._truth(branch, items, last=last)) for items in ways]
                possible = [items for items, truth in truths if truth is not False]
                if not possible:
                    return False
                if any(truth for _, truth in truths):
                    continue
                if len(possible) == 1:
                    branch.pending.extend(possible[0])
                else:
                    branch.choices.append(possible)
            if not branch.pending:
                return True

    def _truth(self, branch: _SearchBranch, items: list[Item], *, last: bool) -> bool | None:
        """Whether obligations are met or broken by the letter so far, None where that is open."""
        met = True
        for obligation, later in items:
            positive = obligation >= 0
            formula = obligation if positive else ~obligation
            if not later and self._rows[formula].op is Connective.NOT:
                formula, positive = self._rows[formula].operands[0], not positive
            known = None if later else branch.letter.get(formula)
            if (later and last and positive) or known is (not positive):
                return False
            met = met and known is not None
        return met or None

    def _look(self, branch: _SearchBranch, obligation: int, later: bool, *, last: bool) -> bool:
        """Take one obligation apart; False where it contradicts what is settled."""
        positive = obligation >= 0
        formula = obligation if positive else ~obligation
        if later:
            branch.later.add(obligation)
            return not (last and positive)
        op, operands, _ = self._rows[formula]
        signed = [operand if positive else ~operand for operand in operands]
        now, again = [(operand, False) for operand in signed], (obligation, True)
        match op:
            case Connective.TRUE | Connective.FALSE:
                return positive is (op is Connective.TRUE)
            case Connective.ATOM:
                return branch.letter.setdefault(formula, positive) is positive
            case Connective.NOT:
                branch.pending.append((~signed[0], False))
            case Connective.NEXT:
                branch.pending.append((signed[0], True))
            case Connective.AND | Connective.OR if (op is Connective.AND) is positive:
                branch.pending.extend(reversed(now))
            case Connective.AND | Connective.OR:
                branch.choices.append([[item] for item in now])
            case Connective.EVENTUALLY if positive:
                branch.choices.append([now, [again]])
            case Connective.EVENTUALLY:
                branch.pending += [again, *now]
            case Connective.UNTIL if positive:
                branch.choices.append([[now[1]], [now[0], again]])
            case Connective.UNTIL:
                branch.pending.append(now[1])
                branch.choices.append([[now[0]], [again]])
            case _:
                assert_never(op)
        return True
