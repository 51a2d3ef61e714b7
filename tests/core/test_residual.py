"""The residuals of a property against its scenarios, one by one: the same words of events are complete."""

from collections.abc import Mapping, Set
from random import Random
from typing import Final, TypeAlias

import pytest

from rvaft.core.build import build
from rvaft.core.part_numbers import numbered
from rvaft.core.property import Condition, Part, Property
from rvaft.core.residual import Residual, ResidualSpace
from rvaft.core.scenarios import Scenario, scenarios
from rvaft.language.parser import parse
from rvaft.model.guards import Guard, variables
from rvaft.model.patterns import rigid_variables
from rvaft.support.bits import mask_of
from rvaft.support.budget import Work
from tests.core.trees import is_plain, random_tree
from tests.tables import sampled

LABELS: Final = 3
Labels: TypeAlias = Mapping[Part, int]
Partial: TypeAlias = tuple[int, int]
"""A scenario, and the events of it that have happened."""


class ByScenario:
    """Partial matches of the scenarios without a false guard on a variable of their events."""

    def __init__(self, prop: Property, labels: Labels, false: Set[Guard], *, skipping: bool) -> None:
        self.labels, self.skipping = labels, skipping
        self.found = [one for one in scenarios(prop, minimal=skipping) if not self.is_broken(one, false)]
        self.start = frozenset((number, 0) for number in range(len(self.found)))

    def is_broken(self, scenario: Scenario, false: Set[Guard]) -> bool:
        bound = {name for event in scenario.events for name in rigid_variables(event.pattern)}
        return any(one.guard in false and bound & {*variables(one.guard)} for one in scenario.conditions)

    def after(self, some: frozenset[Partial], label: int) -> frozenset[Partial]:
        found = set(some) if self.skipping else set()
        for number, done in some:
            for index, event in enumerate(self.found[number].events):
                free = not (done >> index & 1 or self.found[number].before[index] & ~done)
                found.update([(number, done | 1 << index)] if free and self.labels[event] == label else [])
        return frozenset(found)

    def is_complete(self, some: frozenset[Partial]) -> bool:
        return any(done == (1 << len(self.found[number].events)) - 1 for number, done in some)


class ByResidual:
    """Sets of residuals; where events may be skipped, without those that another one dominates."""

    def __init__(self, prop: Property, labels: Labels, false: Set[Guard], *, skipping: bool) -> None:
        form, self.skipping = numbered(prop), skipping
        conditions = (part for part in prop.parts if isinstance(part, Condition))
        guards = {guard: place for place, guard in enumerate(dict.fromkeys(one.guard for one in conditions))}
        self.holding = mask_of(place for guard, place in guards.items() if guard not in false)
        self.residuals = ResidualSpace(
            form, lambda number: labels[form.parts[number].event], guards, at_least=not skipping, work=Work(10**6)
        )
        self.start = frozenset(self.residuals.starts)

    def after(self, some: frozenset[Residual], label: int) -> frozenset[Residual]:
        moves = [move for one in some for move in self.residuals.moves(one) if move.label == label]
        found = {self.residuals.breaking(move, self.holding) for move in moves if not move.needed & ~self.holding}
        kept: list[Residual] = []
        for one in sorted(found | some) if self.skipping else found:
            if not self.skipping or not any(self.residuals.dominates(other, one) for other in kept):
                kept = [other for other in kept if not (self.skipping and self.residuals.dominates(one, other))]
                kept.append(one)
        return frozenset(kept)

    def is_complete(self, some: frozenset[Residual]) -> bool:
        return any(map(self.residuals.is_complete, some))


def agree(prop: Property, labels: Labels, false: Set[Guard] = frozenset(), *, skipping: bool) -> int:
    """Compare all words; return how many sets of partial matches were complete."""
    expected = ByScenario(prop, labels, false, skipping=skipping)
    found = ByResidual(prop, labels, false, skipping=skipping)
    agenda, complete = [(expected.start, found.start)], 0
    seen = set(agenda)
    for partials, residuals in agenda:
        assert found.is_complete(residuals) == expected.is_complete(partials), prop.tree
        complete += expected.is_complete(partials)
        pairs = {(expected.after(partials, label), found.after(residuals, label)) for label in set(labels.values())}
        agenda += pairs - seen
        seen |= pairs
    return complete


@pytest.mark.parametrize("skipping", [True, False])
@pytest.mark.parametrize("seed", sampled(range(4), 4))
def test_random_properties(seed: int, skipping: bool) -> None:
    """Few labels, so that parts are alike; guards hold always or never."""
    random, complete = Random(f"residual {seed}"), 0
    for tree in (random_tree(random, guards=random.choice((0, 0.4)), constants=0) for _ in range(100)):
        if is_plain(tree):
            prop = build(tree)
            labels: Labels = {event: random.randrange(LABELS) for event in prop.events}
            false = {part.guard for part in prop.parts if isinstance(part, Condition) and random.random() < 0.3}
            complete += agree(prop, labels, false, skipping=skipping)
    assert complete > 100


@pytest.mark.parametrize(
    "text",
    [
        "t and x y z; x and a1 b1; y and a2 b2; z and a3 b3;",
        "t sand v c1; v 2of3 x y z; x sand a1 b1; y sand a2 b2; z sand a3 b3;",
        "t and x y; x 1of3 a1 b1 c1; y 2of3 a2 b2 c2;",
        "t and x y; x 2of4 a1 b1 c1 d1; y 3of4 a2 b2 c2 d2;",
        "t and x y; x sand s1 a1; y sand s1 a2;",
        "t and x y z; x sand s1 a1; y sand s1 a2; z sand a1 a2 a3;",
        "t and x y z; x or s1 a1; y or s1 a2; z sand s1 a3;",
        "t or x y; x sand a1 b1; y sand a2 b2;",
        (
            "t or x y; x and x1 x2; x1 sand g a1; x2 sand g b1; g and p1 q1;"
            "y and y1 y2; y1 sand h a2; y2 sand k b2; h and p2 q2; k and p3 q3;"
        ),
        (
            "event e(p) = {e: p}; t or x y; x and a1 b1 when X > 1; y and a2 b2;"
            "a1 on e(X); a2 on e(X); b1 on e(X); b2 on e(X);"
        ),
        "event e(p) = {e: p}; t and k v m1 m2; k or a1 c1; v or u w; u and d1 when X > 1; w and e1; a1 on e(X);",
        "t and x y; x 2of3 u1 u2 c1; y 2of3 w1 w2 c2; u1 or a1 b1; u2 or a2 b2; w1 or a3 b3; w2 or a4 b4;",
    ],
)
@pytest.mark.parametrize("skipping", [True, False])
def test_alike_parts(text: str, skipping: bool) -> None:
    """The label of an event is the first letter of its name; guards never hold."""
    prop = build(parse(text).build())
    labels: Labels = {event: ord(event.source.node[0]) for event in prop.events}
    false = {part.guard for part in prop.parts if isinstance(part, Condition)}
    assert agree(prop, labels, skipping=skipping)
    assert agree(prop, labels, false, skipping=skipping)
