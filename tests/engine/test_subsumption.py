"""Dropping partial matches that another can replace: what makes a guard monotone, and that nothing is lost."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from random import Random
from typing import Any, Final

import pytest

import rvaft
from rvaft.engine import Engine, stages
from rvaft.engine.scattered_general import ScatteredMatches
from rvaft.engine.subsumption import Ranking, scale, tendency
from rvaft.errors import TreeError
from rvaft.language.parser import parse_guard
from rvaft.model.guards import Guard, Operation, Operator, holds, variables
from rvaft.model.patterns import Literal, Variable
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Verdict
from tests.engine.checking import compare, small_and_valid

NUMBERS: Final = (
    *(0, 1, 2, 3, -1, 0.5, 2.5, -0.0, 10**16, 2**53, 2.0**53, 2**53 + 1, 1e16),
    *(1e100, -(10**100), 1e300, 1.7e308, 0.25, 0.75, 2**52 - 0.5, 2**53 + 3, 2**54 + 6),
)
VALUES: Final[tuple[Any, ...]] = (
    *(*NUMBERS, 10**101, 10**309, 2**1024 - 2**970 + 1, -1.7e308),
    *("", "a", "b", "é", True, False, None, [1], {}),
)


MONOTONE: Final = {
    1: "X - T2 > 0 - 10; 10 < X; not X < 10; -X < T2; 3 <= X or X > 1 and X > T2; T2 > 1 and X > T2 or 3 "
    "<= X; X > 1 and T2 == 1",
    -1: "T2 >= X + 10; T2 - X >= 10; X < 10; not (T2 > 1 and X > T2); T2 - X + 10 >= 0",
    0: "T2 > 1",
    None: "X > 1 and X > T2 or 3 <= X; not (X > 1 and T2 > 1); T2 - X + 0.5 >= 0; T2 - X - T3 >= 0; X > 1 "
    "and X < 3; X == 1; "
    "X != 1; 2 * X > 1; X / 2 > 1; X - X > 1; X > X; X; not X",
}


@pytest.mark.parametrize(("sign", "text"), [(sign, text) for sign in MONOTONE for text in MONOTONE[sign].split("; ")])
def test_which_guards_are_monotone(sign: int | None, text: str) -> None:
    assert tendency(parse_guard(text), "X") == sign


JOINED: Final = (Operator.AND, Operator.OR)
COMPARED: Final = (Operator.LT, Operator.LE, Operator.GT, Operator.GE, Operator.LT, Operator.GE, Operator.EQ)
COMPUTED: Final = (Operator.ADD, Operator.SUB, Operator.ADD, Operator.SUB, Operator.MUL)


def random_guard(random: Random, depth: int = 3) -> Guard:
    if depth and random.random() < 0.6:
        unary = random.random() < 0.2
        operands = tuple(random_guard(random, depth - 1) for _ in range(1 if unary else 2))
        return Operation(Operator.NOT if unary else random.choice(JOINED), operands)
    return Operation(random.choice(COMPARED), (random_term(random, 3), random_term(random, 3)))


def random_term(random: Random, depth: int) -> Guard:
    if not depth or random.random() < 0.4:
        return Variable(random.choice("XXYZ")) if random.random() < 0.6 else Literal(random.choice((*NUMBERS, "a")))
    unary = random.random() < 0.1
    operands = tuple(random_term(random, depth - 1) for _ in range(1 if unary else 2))
    return Operation(Operator.NEGATE if unary else random.choice(COMPUTED), operands)


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 20))])
def test_a_monotone_guard_that_holds_goes_on_to_hold(seed: int) -> None:
    """Whatever the other values, at the borders of rounding and of what is finite too."""
    random = Random(seed)
    pairs = [
        (one, other) for one in VALUES for other in VALUES if scale(one) is not None and scale(one) is scale(other)
    ]
    ordered = [(low, high) for low, high in pairs if low < high]
    held = 0
    for _ in range(2_000):
        guard = random_guard(random)
        sign = tendency(guard, "X")
        assert (sign == 0) == ("X" not in variables(guard))
        if not sign:
            continue
        for _ in range(15):
            low, high = random.choice(ordered)
            others = dict(zip("YZ", random.choices(VALUES, k=2), strict=True))
            worse, better = (low, high) if sign > 0 else (high, low)
            if holds(guard, {**others, "X": worse}):
                held += 1
                assert holds(guard, {**others, "X": better}), (guard, others, worse, better)
    assert held > 200


TYPES: Final = "event e(n, v) = { n: n, v: v }; event f(n, v, w) = { n: n, v: v, w: w }; "
GUARDS: Final = (
    "T3 >= T1 + 2",
    "T3 - T1 >= 2",
    "T2 > T1",
    "T1 > 1",
    "T1 < T2",
    "not T2 <= T1",
    "T2 >= T1 and T3 > T2",
    "T3 > 1 or T1 < 2",
    "T1 == T3",
    "T2 != T1",
    "U > T1",
    "U >= 2",
    "T1 * 2 < T3",
)


SHAPES: Final = (
    "top sand l0 l1 l2 x; x and g0 y; y or l3 g1;",
    "top sand l0 x l2 g0 l3; x or l1 y; y and l1 g1;",
    "top or x y; x sand l0 l1 l2 g0; y sand l0 l1 g1 l3 l2;",
    "top sand x l2; x or y z; y sand l0 l1 g0; z and l0 l1 g1 l3;",
    "top and l0 x l2; x 2of4 l1 l3 g0 g1;",
    "top and l0 l1 x l2; x or g0 l3 y; y and l3 g1;",
)
TIMES: Final = ((0, 1, 2, 3, 4, 5), (0.5, 1, 1.5, 2.0, 3), (1, "a", 2, "b", 3.0), (2**53, 2.0**53, 2**53 + 2, 5))


def trees(random: Random, count: int) -> Iterator[RVAFT]:
    """Valid trees over three or four events of ever new values, and guards over them."""
    while count:
        events = ['e("a", T1)', random.choice(('e("b", T2)', 'f("b", T2, U)', 'e("a", T2)')), 'e("c", T3)']
        events.append(random.choice(('e("d", _)', 'e("b", T1)', 'e("c", T3)')))
        leaves = "".join(f"l{i} on {event};" for i, event in enumerate(events))
        guards = "".join(f" g{i} when {random.choice(GUARDS)};" for i in range(2))
        with suppress(TreeError):  # a guard's variable is not bound in every branch
            tree = rvaft.loads(f"{TYPES}{random.choice(SHAPES)} {leaves}{guards}")
            if small_and_valid(tree):
                count -= 1
                yield tree


def random_event(random: Random, values: Sequence[Any]) -> dict[str, Any]:
    event = {"n": random.choice("aabbccd"), "v": random.choice(values)}
    return event | ({"w": random.choice(values)} if random.random() < 0.7 else {})


@pytest.mark.ci
@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 12))])
def test_nothing_is_lost(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Verdicts are those of the definition, and an explanation is a match of the lowest branch,
    where something was dropped.
    """
    random = Random(seed)
    dropped = detected = 0
    for tree in trees(random, 60):
        values = random.choice(TIMES)
        trace = [random_event(random, values) for _ in range(10)]
        lean, full = compare(tree, trace, "scattered"), Engine(tree, "scattered")
        with monkeypatch.context() as patch:
            patch.setattr(stages, "ranking", lambda _, sample: Ranking(tuple(sorted(sample.binding))))
            list(full.run(trace))
        assert lean is not None
        dropped += lean.state != full.state
        detected += lean.verdict is Verdict.TRUE
    assert dropped > 4
    assert detected > 4


LATE = 'top sand a b late; a on e("a", T1); b on e("b", T2); late when T2 >= T1 + 10;'


@pytest.mark.parametrize(("times", "matched"), [(range(1000), (1, 0)), (range(1000, 0, -1), (1000, 1))])
def test_of_ever_later_or_earlier_times_one_is_kept(times: Sequence[int], matched: tuple[int, int]) -> None:
    monitor = Engine(rvaft.loads(TYPES + LATE), "scattered", limit=5)
    position, time = matched
    assert set(monitor.run({"n": "a", "v": value} for value in times)) == {Verdict.UNKNOWN}
    assert isinstance(monitor._strategy, ScatteredMatches)
    for group in monitor._strategy._groups.values():  # what was dropped is found nowhere
        assert len(group.members) == 1
        assert sum(map(len, group._fronts.values())) <= 1
        lanes = [lane for index in group._ordered.values() for place in index.values() for lane in place.values()]
        assert sum(map(len, lanes)) <= 1
    verdicts = [monitor.step({"n": "b", "v": time + late}) for late in (9, 10)]
    assert verdicts == [Verdict.UNKNOWN, Verdict.TRUE]
    assert monitor.explanation is not None
    assert monitor.explanation.events == {"a": [position], "b": [1002]}
    assert monitor.explanation.variables == {"T1": time, "T2": time + 10}


@pytest.mark.parametrize("values", [(2**53, 2.0**53), (2.0**53, 2**53)])
def test_equal_values_of_two_types_can_do_the_same(values: tuple[float, float]) -> None:
    monitor = Engine(rvaft.loads(TYPES + LATE.replace("10", "11")), "scattered")
    list(monitor.run({"n": "a", "v": value} for value in values))
    assert monitor.step({"n": "b", "v": 2**53 + 11}) is Verdict.TRUE
