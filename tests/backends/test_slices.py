"""Slices of variables, held against a search that forgets nothing."""

from collections.abc import Iterator
from random import Random

import pytest

from backends import slices
from rvaft.errors import TooLarge
from rvaft.language.parser import parse_guard, parse_pattern
from rvaft.model.guards import Guard, variables
from rvaft.model.patterns import Binding, Pattern, match, rigid, rigid_variables
from rvaft.model.values import Json
from rvaft.model.verdict import Verdict

PATTERNS = [parse_pattern(text) for text in ("{x: X}", "{y: X}", "{y: Y}", "{x: X, y: Y}", "{x: 1}", "{y: _}")]
GUARDS = [parse_guard(text) for text in ("X < Y", "X != 1", "true", "X == Y")]
EVENTS: list[Json] = [{name: value} for name in "xy" for value in (1, 1.0, 2, "a")] + [{"x": 1, "y": 2}, {}]


class Sequence:
    """Waits for one pattern after the other, and under `strict` for no other event; its states are how many have come."""

    def __init__(self, steps: list[tuple[Pattern, Guard]], *, strict: bool) -> None:
        self.steps = steps
        self.strict = strict
        self.event: Json = {}

    def extensions(self, state: int, binding: Binding) -> Iterator[Binding]:
        found = match(self.steps[state][0], self.event, binding)
        if found is not None:
            yield rigid(found)

    def step(self, state: int, binding: Binding) -> tuple[Verdict, int]:
        pattern, guard = self.steps[state]
        ready = all(name in binding for name in rigid_variables(pattern)) and match(pattern, self.event, binding)
        if ready is None or ready is False or not slices.passes(guard, binding):
            return (Verdict.FALSE if self.strict else Verdict.UNKNOWN), state
        return (Verdict.TRUE if state + 1 == len(self.steps) else Verdict.UNKNOWN), state + 1

    def matter(self, state: int) -> set[str]:
        return {
            name for pattern, guard in self.steps[state:] for name in (*rigid_variables(pattern), *variables(guard))
        }


def everything(machine: Sequence, trace: list[Json]) -> Iterator[Verdict]:
    """The verdicts when all assignments are kept, one for each event until one is final."""
    alive: list[tuple[int, Binding]] = [(0, {})]
    for machine.event in trace:
        after = [
            (*machine.step(state, option), option)
            for state, bound in alive
            for option in (bound, *machine.extensions(state, bound))
        ]
        alive = [(to, option) for verdict, to, option in after if verdict is Verdict.UNKNOWN]
        detected = any(verdict is Verdict.TRUE for verdict, _, _ in after)
        yield Verdict.TRUE if detected else Verdict.UNKNOWN if alive else Verdict.FALSE
        if detected or not alive:
            return


def test_what_is_dropped_changes_no_verdict() -> None:
    seen = set()
    for seed in range(1000):
        random = Random(seed)
        steps = [(random.choice(PATTERNS), random.choice(GUARDS)) for _ in range(random.randint(1, 4))]
        machine = Sequence(steps, strict=random.random() < 0.5)
        trace = random.choices(EVENTS, k=5)
        kept: slices.Slices | None = slices.start(0)
        for event, expected in zip(trace, [*everything(machine, trace)], strict=False):
            assert kept is not None
            machine.event = event
            forget = machine.matter if seed % 2 else None
            kept = slices.advance(kept, machine.extensions, machine.step, matter=forget)
            assert expected is (Verdict.TRUE if kept is None else Verdict.UNKNOWN if kept else Verdict.FALSE), seed
            seen.add(expected)
    assert seen == set(Verdict)


def test_one_slice_for_each_value_and_no_more_than_allowed() -> None:
    machine = Sequence([(PATTERNS[0], GUARDS[2]), (PATTERNS[1], GUARDS[2])], strict=False)
    kept = slices.start(0)
    for value in (1, 2, 1, 1.0, "1"):  # arithmetic may tell 1 from 1.0
        machine.event = {"x": value}
        kept = slices.advance(kept, machine.extensions, machine.step, limit=5) or {}
    found = sorted(repr(dict(binding)) for binding in kept.values())
    assert found == ["{'X': '1'}", "{'X': 1.0}", "{'X': 1}", "{'X': 2}", "{}"]
    machine.event = {"x": "more"}
    with pytest.raises(TooLarge, match="slices, one for each assignment of X"):
        slices.advance(kept, machine.extensions, machine.step, limit=5)


def test_what_has_bound_more_in_the_same_state_is_dropped_and_what_does_not_matter_forgotten() -> None:
    bound: Binding = {"X": 1}
    kept = slices.advance(slices.start(0), lambda *_: [bound, bound], lambda *_: (Verdict.UNKNOWN, 1))
    assert kept == {(frozenset(), 1): {}}
    kept = slices.advance(
        slices.start(0), lambda *_: [bound], lambda _, now: (Verdict.UNKNOWN, len(now)), matter=lambda _: set()
    )
    assert kept == {(frozenset(), 0): {}, (frozenset(), 1): {}}
