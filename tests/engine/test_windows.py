"""The engine against the reference where windows and ends in order are over choices."""

from random import Random
from typing import Any, Final

import pytest

from rvaft.engine import Engine
from rvaft.language.parser import parse
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics, Verdict
from tests.engine.checking import compare, small_and_valid
from tests.tables import sampled

FAMILIES: Final = (
    "top sand v l3; v 2of3 l0 l1 l2 W;",
    "top and v l3 W; v 1of3 l0 l1 l2 W;",
    "top and x y W; x or l0 l1 W; y 2of3 l2 l3 l4 W;",
    "top sand x y W; x or l0 p W; p and l1 l2; y 1of2 l3 l4 W;",
    "top 2of3 x y l4 W; x sand l0 l1; y or l2 l3 W;",
    "top and l0 l1 o within 2 s; o or l2 l3;",
    "top sand x l3 within 3 s; x and l0 l1 o; o 1of2 l2 l4;",
    "top sand_rl l4 v W; v 2of3 l0 s l3 W; s sand l1 l2;",
    "top and x y; x 2of3 l0 l1 s W; y or l2 s W; s or l3 l4;",
    "top 2of3 x y l4 W; x and l0 s W; y 1of2 l1 s W; s or l2 l3;",
    "top sand x y; x 2of3 l0 l1 s W; y 1of2 s l2 W; s 1of2 l3 l4;",
    "top and x y W; x or l0 s; y sand l1 s; s 1of2 l2 l3 W;",
    "top sand x l3; x and y s l4 within 1 s; y or l0 s; s 1of2 l1 l2;",
    "top pand x y z; x and l0 l1; y or l2 l3; z 1of2 l4 l5;",
    "top pand x y; x 1of3 l0 l1 l2; y 2of3 l3 l4 l5;",
    "top pand x y z; x or l0 l1; y and l2 l3; z 1of2 l4 l5;",
    "top sand p l5; p pand x y; x and l0 l1; y 1of3 l2 l3 l4 W;",
    "top sand p l4; p pand x y; x 1of2 l0 l1; y 1of2 l2 l3;",
    "top pand p q; p pand x y; x and l0 l1; y 1of2 l2 l3; q 1of2 l4 l5;",
    "top pand x y z; x and l0 l1; y or l2 g; g when 1 == 1; z and l3 l4;",
    "top pand x y z W; x 1of2 l0 l1 W; y 1of2 l2 g; g when 1 == 1; z 1of2 l3 l4 W;",
    "top and p l4; p pand x y; x and l0 l1; y 1of2 l2 l3;",
    "top 1of2 p l4 W; p pand x y W; x 1of2 l0 l1; y 1of2 l2 l3;",
    "top or a b; a pand x y W; x 1of2 l0 l1; y and l2 l3; b and l4 l5 W;",
    "top and v g l3; v 1of3 l0 l1 l2; g when end(v) - start(v) <= 2 s;",
    "top pand x y; x and l0 s; y 1of2 s l1; s or l2 l3;",
)
_ON: Final = " ".join(f'{name} on e("{name}", {value});' for name, value in zip("abcdf", "XXYYY", strict=True))
VALUES: Final = (
    f"top and p q W; p sand a b; q sand c o; o 1of2 d f; {_ON}",
    f"top pand p q; p and a b; q and c o; o 1of2 d f; {_ON}",
)
"""Parts with values of their own."""
LEAVES: Final = range(6)


def tree_of(random: Random, family: str) -> tuple[RVAFT, str]:
    """A tree of the family with random letters, values and durations, and its letters."""
    letters = "abcdf" if family in VALUES else random.choice(("ab", "abc", "abcd"))
    while "W" in family:
        family = family.replace("W", random.choice(("", "within 0 s", "within 1 s", "within 2 s", "within 4 s")), 1)
    names = random.choice(("____", "____", "XXXX", "XY__"))
    on = [f'l{n} on e("{random.choice(letters)}", {random.choice(names)});' for n in LEAVES if f"l{n}" in family]
    late = random.choice(("", "", " late 0 s", " late 2 s"))
    causality = random.choice(("", "causality bottom_up; "))
    text = f"{causality}time t as s{late}; event e(n, v) = {{ e: n, v: v }}; {family} {' '.join(on)}"
    return parse(text).build(), letters


def trace_of(random: Random, tree: RVAFT, letters: str, semantics: Semantics) -> list[dict[str, Any]]:
    """A trace that avoids a final verdict for as long as it easily can; times may go back or lack."""
    trace: list[dict[str, Any]] = []
    monitor, clock = Engine(tree, semantics), 0
    for _ in range(random.randint(3, 8 if semantics.ends else 12)):
        for _ in range(5):
            time = clock + random.choice((-2, -1, 0, 0, 1, 1, 2, 4))
            stamp = {"t": time} if random.random() < 0.97 else {}
            event = {"e": random.choice(letters), "v": random.choice((0, 0, 0, 0, 0, 1)), **stamp}
            ahead = monitor.fork()
            if not ahead.step(event).final:
                break
        trace.append(event)
        monitor, clock = ahead, max(clock, time)
        if monitor.verdict.final:
            break
    return trace


@pytest.mark.ci
@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 30))])
@pytest.mark.parametrize("semantics", sampled(Semantics, 4, ci=2))
def test_windows_and_ends_over_choices(semantics: Semantics, seed: int) -> None:
    random, told = Random(f"windows {semantics} {seed}"), dict.fromkeys(Verdict, 0)
    for family in (*FAMILIES, *VALUES):
        made = 0
        while made < 2:
            tree, letters = tree_of(random, family)
            if small_and_valid(tree):
                made += 1
                for _ in range(3):
                    found = compare(tree, trace_of(random, tree, letters, semantics), semantics)
                    told[found.verdict if found else Verdict.UNKNOWN] += 1
    assert told[Verdict.TRUE] > 3
    assert told[Verdict.FALSE] > 10 or not semantics.ends
