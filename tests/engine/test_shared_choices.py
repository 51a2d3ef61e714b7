"""Choices that several gates share: resolved once, and never one way after the other."""

from collections.abc import Iterator
from random import Random
from typing import Any

import pytest

import rvaft
from rvaft.core.branches import branches, number_of
from rvaft.engine import Engine
from rvaft.language.parser import parse
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Verdict
from tests.engine.checking import compare, small_and_valid

SEMANTICS = ("strict", "projected", "consecutive", "scattered")
COUNT = 20
CHOICES = " ".join(f"c{i}" for i in range(COUNT))
LADDER = " ".join(f"c{i} or l{i} m{i}; l{i} sand c{i + 1} a{i}; m{i} sand c{i + 1} b{i};" for i in range(COUNT))
EACH = " ".join(f"c{i} or a{i} b{i};" for i in range(COUNT))
MANY = {
    "two ands": (f"top and x y; x and {CHOICES}; y and {CHOICES}; {EACH}", 1),
    "two sequences": (f"top and x y; x sand {CHOICES}; y sand {CHOICES}; {EACH}", 1),
    "a sequence and an and": (f"top and x y; x and {CHOICES}; y sand {CHOICES}; {EACH}", 1),
    "alternatives in sequence": (f"top or x y; x sand {CHOICES} u; y sand {CHOICES} w; {EACH}", 1),
    "a ladder": (f"top and c0; {LADDER}", -1),
}


@pytest.mark.parametrize("semantics", SEMANTICS)
@pytest.mark.parametrize("name", MANY)
def test_twenty_shared_choices(name: str, semantics: str) -> None:
    """With a limit that a monitor would be beyond that looks at one way to choose after the other;
    the branch has its number.
    """
    text, direction = MANY[name]
    monitor = Engine(rvaft.loads(text), semantics, limit=1_500)
    events = [f"{'b' if i % 3 else 'a'}{i}" for i in range(COUNT)][::direction]
    if name == "a ladder":
        events.insert(0, f"c{COUNT}")
    if name == "alternatives in sequence":
        events.append("w")
    if semantics == "scattered":
        events = [one for event in events for one in (event, event.replace("a", "b"))]
    verdicts = [monitor.step({"event": event}) for event in events]
    assert verdicts[-1] is Verdict.TRUE
    assert {*verdicts[:-1]} == {Verdict.UNKNOWN} or semantics == "scattered"
    assert monitor.explanation is not None
    assert (
        monitor.explanation.branch == sum(1 << i for i in range(COUNT) if i % 3) + 1
        or name == "alternatives in sequence"
    )


@pytest.mark.parametrize("gate", ["and", "sand"])
def test_partial_matches_that_come_to_the_same_are_one(gate: str) -> None:
    """Where a variable ties events together, too: which child a choice kept matters no more once
    that is complete, but for the branch.
    """
    choices, count = " ".join(f"c{i}" for i in range(6)), 6
    leaves = " ".join(f'c{i} or a{i} b{i}; a{i} on e("a{i}", X); b{i} on e("b{i}", X);' for i in range(count))
    text = f"event e(n, v) = {{ n: n, v: v }}; top and x y; x {gate} {choices}; y {gate} {choices}; {leaves}"
    monitor = Engine(rvaft.loads(text), "scattered", limit=2 * count + 2)  # it raises beyond the limit
    for number in range(count):
        for child in "ba":
            assert monitor.step({"n": f"{child}{number}", "v": 1}) is Verdict.UNKNOWN or number == count - 1
    assert monitor.explanation is not None
    assert monitor.explanation.branch == (1 << count - 1) + 1
    assert [one.node[0] for one in monitor.explanation.matched] == [*"aaaaab"]


LETTERS = "abcdefgh"


def shared_choices(random: Random) -> str:
    """Some choices below gates that share them, with silent leaves, events of gates and choices among choices."""
    gates, leaves, pool = list[str](), list[str](), list[str]()
    kinds = random.choice(("_", "_", "_XX", "XY"))

    def leaf() -> str:
        name = f"l{len(leaves)}"
        guard = " when X != 1" if kinds == "_XX" and random.random() < 0.2 else ""
        value = random.choice(kinds)
        silent = random.random() < 0.07
        letter = LETTERS[len(leaves) % 8] if random.random() < 0.8 else random.choice(LETTERS)
        leaves.append(f"{name} when 1 == 1;" if silent else f'{name} on e("{letter}", {value}){guard};')
        return name

    for number in range(random.randint(2, 4)):
        children = [random.choice(pool) if pool and random.random() < 0.2 else leaf() for _ in range(2)]
        gate = random.choice(("or", "or", "or", "1of2", "sand")) if len({*children}) == 2 else "or"
        gates.append(f"c{number} {gate} {' '.join(dict.fromkeys(children))};")
        pool.append(f"c{number}")
    parents = [f"p{number}" for number in range(random.randint(2, 3))]
    for name in parents:
        children = random.sample(pool, random.randint(1, len(pool))) + [leaf() for _ in range(random.randint(0, 1))]
        event = f' on e("{random.choice(LETTERS)}", _)' if random.random() < 0.1 else ""
        gates.append(f"{name} {random.choice(('and', 'sand', 'sand', 'sand_rl', 'or'))} {' '.join(children)}{event};")
    causality = random.choice(("", "causality bottom_up; "))
    top = random.choice(("and", "and", "sand", "or"))
    return (
        f"{causality}event e(n, v) = {{ e: n, v: v }}; toplevel top; top {top} {' '.join(parents)}; "
        f"{' '.join(gates + leaves)}"
    )


def trees(random: Random, count: int) -> Iterator[RVAFT]:
    while count:
        tree = parse(shared_choices(random)).build()
        if small_and_valid(tree, 40):
            count -= 1
            yield tree


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 10))])
def test_shared_choices_are_those_of_the_definition(seed: int) -> None:
    """Verdicts, explanations and the numbers of branches."""
    random, detected = Random(f"shared choices {seed}"), 0
    for tree in trees(random, 25):
        found = list(branches(tree))
        assert [number_of(tree, one.choices) for one in found] == [one.number for one in found]
        for semantics in SEMANTICS:
            letters = [*LETTERS] if random.random() < 0.5 else random.choices(LETTERS, k=9)
            events: list[dict[str, Any]] = [{"e": letter, "v": random.choice((0, 0, 1))} for letter in letters]
            monitor = compare(tree, events, semantics)
            detected += monitor is not None and monitor.verdict is Verdict.TRUE
    assert detected > 10


def test_a_tree_without_a_feasible_scenario_is_no_monitor() -> None:
    """Also where the rules reach their limit before they find that the ends cannot be in order."""
    text = 'toplevel "t"; "t" pand g k x y; "g" wsp h k; "h" and z y; "k" and x w;'
    with pytest.raises(rvaft.TreeError, match="no feasible scenario"):
        rvaft.monitor(parse(text, "tree.dft").build())
