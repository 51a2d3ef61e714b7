"""The formula of a part, composed from those of its children, or by the general form.

The formula of a part is followed strictly later by `after`:

    event              p & X[!] after                          scattered: F(p & X[!] after)
    choice             the disjunction
    sequence           from the last part to the first, each with the next as its `after`
    AND, VOT           scattered: conjunction and threshold, if no event can serve two of the parts;
                       strict and projected: a window over single events, under the same condition
    otherwise          the general sum over the events that may come next

The sum ranges over sets of residuals (`rvaft.core.residual`), possibly exponentially many.
"""

from collections.abc import Callable, Iterable, Sequence
from itertools import chain
from typing import assert_never

from backends.ltlf.formulas import FALSE, TRUE, Formulas
from backends.ltlf.parts import Anatomy
from rvaft.core.part_numbers import NumberedPart, NumberedParts
from rvaft.core.property import PartKind
from rvaft.core.residual import Residual, ResidualSpace
from rvaft.model.verdict import Semantics
from rvaft.support.bits import union
from rvaft.support.budget import Call, Work, run


class Composer:
    """Translates parts.

    `event_of` returns the formula of an EVENT part; `relevant` is the atom of relevant positions
    (`projected`, `consecutive`). A formula is true at a position if the part is matched from there
    on:

    - `scattered`: by some later events; the formula is *monotone*, true at every earlier position too.
    - `strict`: by exactly the next events.
    - `projected`: by exactly the next relevant events, from a relevant position.
    - `consecutive`: as `projected`, from any relevant position.
    """

    def __init__(
        self,
        formulas: Formulas,
        anatomy: Anatomy,
        event_of: Callable[[int], int],
        *,
        semantics: Semantics,
        relevant: int,
        work: Work,
    ) -> None:
        self._formulas = formulas
        self._anatomy = anatomy
        self._event_of = event_of
        self._monotone = semantics is Semantics.SCATTERED
        self._relative = semantics.projects
        self._anywhere = semantics is Semantics.CONSECUTIVE
        self._relevant = relevant
        self._work = work
        self._known: dict[tuple[int, int], int] = {}
        self._free: set[int] = set()
        """Descendants of a separable part, translated separately although they share occurrences.
        """
        self._residuals: dict[tuple[int, ...], ResidualSpace] = {}

    def whole(self) -> int:
        """Return the formula of the root from the first position; `consecutive`: `F(rel & f)`."""
        formula = run(self._of(self._anatomy.root, TRUE))
        if self._anywhere and formula != TRUE:
            return self._formulas.eventually(self._formulas.conjunction([self._relevant, formula]))
        return self._begin(formula)

    # Positions: only these methods depend on the semantics.

    def _begin(self, formula: int) -> int:
        """Return the formula at the first relevant position; `projected`: `!rel U (rel & f)`."""
        f = self._formulas
        if not self._relative or formula == TRUE:
            return formula
        return f.until(f.negation(self._relevant), f.conjunction([self._relevant, formula]))

    def _later(self, formula: int) -> int:
        """Return the formula at the next relevant position; TRUE requires no position."""
        return TRUE if formula == TRUE else self._formulas.next(self._begin(formula))

    def _steps(self, ways: Iterable[tuple[int, int]]) -> int:
        f = self._formulas
        found = f.disjunction(f.conjunction([event, self._later(after)]) for event, after in ways)
        return f.eventually(found) if self._monotone else found

    def _window(self, events: Sequence[int], need: int, after: int) -> int:
        """Return: at least `need` of the events (disjunctions of atoms) at distinct positions, then
        `after`.

        No event may serve two of them. The formula requires one of the events at each of exactly j
        positions (`need` ≤ j ≤ n), and none of the events twice. It is polynomial; unrolling is
        factorial. Without `after`, j = `need` suffices.
        """
        f = self._formulas
        some = f.disjunction(events)
        found = []
        for length in [need] if after == TRUE else range(need, len(events) + 1):
            whole = after
            for _ in range(length):
                whole = f.conjunction([some, self._later(whole)])
            demands = [whole]
            for event in events if length else ():
                once, twice = event, FALSE  # of the last positions
                for _ in range(length - 1):
                    later = self._later(once)
                    twice = f.disjunction([f.conjunction([event, later]), self._later(twice)])
                    once = f.disjunction([event, later])
                demands.append(f.negation(twice))
            found.append(f.conjunction(demands))
        return f.disjunction(found)

    # Parts.

    def _of(self, number: int, after: int) -> Call[int]:
        if after == FALSE:
            return FALSE
        key = (number, after)
        if key not in self._known:
            self._known[key] = yield self._made(number, after)
        return self._known[key]

    def _made(self, number: int, after: int) -> Call[int]:
        part, anatomy, formulas = self._anatomy.parts[number], self._anatomy, self._formulas
        found: int = after
        if number not in self._free and anatomy.is_entangled(number):
            if not self._monotone or not anatomy.is_separable(number):
                found = yield self._sum([number], after)
                return found
            self._free.update(anatomy.below(number))
        units = [anatomy.unit[inner] for inner in part.parts]
        match part.op:
            case PartKind.EVENT:
                found = self._steps([(self._event_of(number), after)])
            case PartKind.SEQUENCE:
                for inner in reversed(part.parts):
                    found = yield self._of(inner, found)
            case PartKind.ALL if self._monotone:
                each: list[int] = []
                for group in self._rival_groups(number):
                    alone = len(group) == 1
                    each += [(yield self._of(group[0], after) if alone else self._sum(group, after))]
                found = formulas.conjunction(each) if each else after
            case PartKind.ALL | PartKind.AT_LEAST if (
                not self._monotone and None not in units and anatomy.rivals_apart(number)
            ):
                events = [formulas.disjunction(map(self._event_of, unit or ())) for unit in units]
                found = self._window(events, part.need, after) if events else after
            case PartKind.ALL | PartKind.AT_LEAST if not self._monotone or not anatomy.rivals_apart(number):
                found = yield self._sum([number], after)
            case PartKind.ALL | PartKind.AT_LEAST | PartKind.ONE:
                each = []
                for inner in part.parts:
                    each += [(yield self._of(inner, after))]
                found = formulas.disjunction(each) if part.op is PartKind.ONE else self._threshold(each, part.need)
            case PartKind.CONDITION:
                raise AssertionError(part)
            case _:
                assert_never(part.op)
        return found

    def _threshold(self, formulas: Sequence[int], need: int) -> int:
        """Return: at least `need` of the formulas, by T(i, j) = f_i & T(i+1, j-1) | T(i+1, j)."""
        f = self._formulas
        row = [TRUE]
        for formula in reversed(formulas):
            rest = [*row, FALSE]
            counts = range(1, min(len(row), need) + 1)
            row = [TRUE, *(f.disjunction([f.conjunction([formula, rest[j - 1]]), rest[j]]) for j in counts)]
        return row[need]

    def _rival_groups(self, number: int) -> list[list[int]]:
        """Return the children, grouped so that no event serves parts of two groups."""
        groups: list[tuple[list[int], int]] = []
        """Parts, and their events."""
        seen = 0
        for part in self._anatomy.parts[number].parts:
            events, rivals = self._anatomy.events[part], self._anatomy.rivals[part]
            meeting = [group for group in groups if group[1] & rivals] if rivals & seen else []
            seen |= events
            if meeting:
                groups = [group for group in groups if not group[1] & rivals]
            members = [member for group, _ in reversed(meeting) for member in group]
            groups.append(([*members, part], events | union(theirs for _, theirs in meeting)))
        return [members for members, _ in groups]

    # The general form.

    def _sum(self, some: Sequence[int], after: int) -> Call[int]:
        """Return the general form of some parts in any order that share no occurrence with other
        parts.

        Each set of residuals has one shared formula G: `after` if a residual is complete, or one of
        the next events, followed by G of the residuals after it. Merging residuals after equal
        events would give fewer formulas for some trees, but exponentially many for others.
        """
        key, disjunction = tuple(some), self._formulas.disjunction
        if key not in self._residuals:
            parts = (*self._anatomy.parts[: max(key) + 1], NumberedPart(PartKind.ALL, key, len(key)))
            self._residuals[key] = ResidualSpace(
                NumberedParts(parts), self._event_of, at_least=not self._monotone, work=self._work
            )
        residuals = self._residuals[key]
        known: dict[frozenset[Residual], int] = {}

        def of(left: frozenset[Residual]) -> Call[int]:
            if left not in known:
                ends = any(map(residuals.is_complete, left))
                if ends and (after == TRUE or self._monotone):  # a longer match adds nothing
                    known[left] = after
                    return after
                following: dict[int, dict[int, set[Residual]]] = {}
                for move in chain.from_iterable(map(residuals.moves, sorted(left))):
                    following.setdefault(move.label, {}).setdefault(move.event, set()).add(move.target)
                    self._work.step(20)
                ways: list[tuple[int, int]] = []
                for event in sorted(following):
                    rests = []
                    for targets in dict.fromkeys(map(frozenset, following[event].values())):
                        rests += [(yield of(targets))]
                    ways.append((event, disjunction(sorted(rests))))
                known[left] = disjunction([after if ends else FALSE, self._steps(ways)])
            return known[left]

        found: int = yield of(frozenset(residuals.starts))
        return found
