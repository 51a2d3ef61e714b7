"""The engine against the reference on trees whose parts are followed separately and joined."""

from collections.abc import Iterator
from random import Random
from typing import Any, Final

import pytest

from rvaft.engine import Engine
from rvaft.language.parser import parse
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Verdict
from tests.engine.checking import compare, small_and_valid
from tests.tables import part_and_whole, sampled

LETTERS: Final = "abcdefgh"
UNITS: Final = ("{}", "{}", "sand {} {}", "and {} {}", "sand {} {} within 3 s", "and {} {} within 2 s", "pand {} {}")
JOINTS: Final = ("and {} {}", "and {} {} {}", "sand {} {}", "sand {} {} {}", "and {} {}")
VALUES: Final = ((0, 1), (0, 1, 2), (0, 1.0, 1, "a"), (0, None, float("nan"), 1))


def _tree(random: Random) -> str:
    """A text of units below AND and SAND; each leaf has a letter of its own, mostly."""
    choosing = random.choice((0.95, 0.5))
    lines, leaves, names = list[str](), list[str](), random.choice((["P"], ["P", "Q"], ["P", "Q", "R"], ["P", "_"]))

    def leaf() -> str:
        name = f"l{len(leaves)}"
        letter = random.choice(LETTERS) if random.random() < 0.05 else LETTERS[len(leaves) % len(LETTERS)]
        times = " times 2" if random.random() < 0.05 else ""
        leaves.append(name)
        lines.append(f'{name} on e("{letter}", {random.choice(names)}){times}{_guard(random, names)};')
        return name

    def gate(shape: str, below: list[str]) -> str:
        name = f"g{len(lines)}"
        lines.append(f"{name} {shape.format(*below)}{_guard(random, names) if random.random() < 0.2 else ''};")
        return name

    def unit() -> str:
        shape = random.choice(UNITS if random.random() < choosing else ("or {} {}", "1of2 {} {}"))
        below = [leaf() for _ in range(shape.count("{}"))]
        return below[0] if shape == "{}" else gate(shape, below)

    def joint(depth: int) -> str:
        shape = random.choice(JOINTS)
        below = [joint(depth - 1) if depth and random.random() < 0.3 else unit() for _ in range(shape.count("{}"))]
        if random.random() < 0.15 and names != ["_"]:
            lines.append(f"c{len(lines)}{_guard(random, names, always=True)};")
            below.append(lines[-1].split()[0])
        return gate(shape + " {}" * (len(below) - shape.count("{}")), below)

    top = joint(2)
    late = random.choice(("", "", " late 0 s", " late 1 s"))
    return f"time t as s{late}; event e(n, v) = {{ e: n, v: v }}; top and {top}; {' '.join(lines)}"


def _guard(random: Random, names: list[str], *, always: bool = False) -> str:
    bound = [name for name in names if name != "_"]
    if not bound or (not always and random.random() > 0.15):
        return ""
    operator = random.choice(("==", "!=", "<", ">="))
    return f" when {random.choice(bound)} {operator} {random.choice([*bound, *bound, '1'])}"


def trees(random: Random) -> Iterator[RVAFT]:
    """Valid trees, without end."""
    while True:
        text = _tree(random)
        if text.count(" on e(") <= 7:
            try:
                tree = parse(text).build()
            except ValueError:
                continue
            if small_and_valid(tree, 20):
                yield tree


def trace(random: Random, tree: RVAFT) -> list[dict[str, Any]]:
    """Events of the tree's letters, whose times sometimes go back."""
    letters = LETTERS[: sum(node.on is not None for node in tree.nodes.values())]
    values, time, events = random.choice(VALUES), 0, list[dict[str, Any]]()
    for _ in range(random.randint(4, 14)):
        time += random.choice((-1, 0, 0, 1, 1, 1))
        events.append({"e": random.choice(letters), "v": random.choice(values), "t": time})
    return events


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 12))])
@pytest.mark.parametrize("count", part_and_whole(30, 120))
def test_parts_are_joined_as_defined(seed: int, count: int) -> None:
    """Verdicts, explanations, and copies, which are in the same state and wait for the same."""
    random, detected, joined = Random(f"parts {seed}"), 0, 0
    found = trees(random)
    for _ in range(count):
        tree = next(found)
        for _ in range(3):
            events = trace(random, tree)
            engine = compare(tree, events, "scattered")
            detected += engine is not None and engine.verdict is Verdict.TRUE
        monitor = Engine(tree, "scattered")
        joined += bool(getattr(monitor._strategy, "_components", ()))
        for event in events:
            twin = monitor.fork()
            assert twin.step(event) == monitor.step(event)
            assert (twin.state, twin.pending()) == (monitor.state, monitor.pending())
            if monitor.verdict.final:
                break
    assert detected > count // 6
    assert joined > count // 6


CHOOSING: Final = {
    "both": "top and x y; x or a b; y or c d;",
    "both, and others": "top and x y; x and a z; z or b f; y and c w; w or d f;",
    "both, in order": "top sand x y; x and a z; z or b f; y and c w; w or d f;",
    "the first, in order": "top sand x y; x and a z; z or b f; y and c d;",
    "one": "top and x y; x and a z; z or b f; y and c d;",
}


@pytest.mark.parametrize("name", sampled(CHOOSING, 3))
def test_branches_of_choosing_parts(name: str) -> None:
    """The branch depends on all choices: a later match of a part may have a lower one."""
    used = {"a": "P", "b": "P", "c": "Q", "d": "Q", "f": "P" if "z or b f" in CHOOSING[name] else "Q"}
    leaves = "".join(f'{leaf} on e("{leaf}", {used[leaf]}); ' for leaf in used if f" {leaf}" in CHOOSING[name])
    leaves = leaves.replace('f on e("f", P)', 'f on e("f", R)') if CHOOSING[name].count(" f;") > 1 else leaves
    tree = parse(f"event e(n, v) = {{ e: n, v: v }}; {CHOOSING[name]} {leaves}").build()
    random, detected = Random(name), 0
    for _ in range(100):
        events = [{"e": random.choice("abcdf"), "v": random.choice((0, 1))} for _ in range(10)]
        engine = compare(tree, events, "scattered")
        detected += engine is not None and engine.verdict is Verdict.TRUE
    assert detected > 20
