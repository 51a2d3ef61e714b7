"""Shrinking: planted faults shrink to pairs known in advance, and every result disagrees, is valid,
minimal and smaller.
"""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from random import Random
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cross_check.generate.traces import random_trace
from cross_check.generate.trees import Shape, random_tree
from cross_check.shrink import NotReproduced, shrink
from rvaft import RVAFT, Gate, Node, NotExpressible, OptionError, TreeError, Verdict, dumps, load, loads
from rvaft.core.restriction import restrict
from rvaft.engine import Engine
from rvaft.errors import unwritten
from rvaft.model.guards import time_points
from rvaft.model.patterns import Literal
from rvaft.model.values import Json
from rvaft.rules.validity import require_valid
from tests.faults.wrong_trees import MISTAKES, rebuilt
from tests.tables import rows

Trace = list[Json]


def differ(wrong: str, semantics: str = "projected") -> Callable[[RVAFT, Trace], bool]:
    """Whether the wrong reading and the right one give different verdicts after some prefix."""

    def disagrees(tree: RVAFT, trace: Trace) -> bool:
        changed = MISTAKES[wrong](tree)
        require_valid(changed)
        return list(Engine(tree, semantics).run(trace)) != list(Engine(changed, semantics).run(trace))

    return disagrees


def word(text: str) -> Trace:
    return [{"event": name} for name in text.split()]


LARGE = Path(__file__).with_name("large.rvaft")


@pytest.mark.parametrize("planted", rows(__file__, "planted.txt"), ids=lambda row: f"{row[0]}, {row[1]}")
def test_a_planted_fault_shrinks_to_its_core(planted: list[Any]) -> None:
    wrong, semantics, text, trace, smallest, left = planted
    tree, found = shrink(load(LARGE) if text == "large" else loads(text), trace, differ(wrong, semantics))
    assert (dumps(tree), found) == (smallest, left)


SEEDS = st.integers(0, 2**32)
SEMANTICS = st.sampled_from(["strict", "projected", "scattered"])
FAULTS = st.sampled_from(
    ["K+1 for K", "a sand reversed", "a sand_rl from left to right", "an or that wants all", "no guard on an event"]
)
"""Those that random trees show often, under every semantics."""
SETTINGS = settings(max_examples=7)
SHAPE = Shape(max_nodes=7, sharing=0.4, guards=0.4, ignores=0.4)


def found(seed: int, wrong: str, semantics: str) -> tuple[RVAFT, Trace, Callable[[RVAFT, Trace], bool]]:
    """A random tree and trace on which the wrong reading shows."""
    random, disagrees = Random(seed), differ(wrong, semantics)
    while True:
        tree = random_tree(random, SHAPE)
        trace = random_trace(random, tree)
        with suppress(TreeError):
            if disagrees(tree, trace):
                return tree, trace, disagrees


@pytest.mark.ci
@SETTINGS
@given(SEEDS, FAULTS, SEMANTICS)
def test_every_result_disagrees_is_valid_and_minimal(seed: int, wrong: str, semantics: str) -> None:
    tree, trace, disagrees = found(seed, wrong, semantics)
    before = repr(trace)
    smaller, left = shrink(tree, trace, disagrees)
    assert repr(trace) == before
    require_valid(smaller)
    assert disagrees(smaller, left)
    assert len(left) <= len(trace)
    assert loads(dumps(smaller)) == smaller
    for less, events in one_less(smaller, left):
        with suppress(TreeError):
            require_valid(less)
            assert not disagrees(less, events)
    again = shrink(smaller, left, disagrees)
    assert (dumps(again[0]), repr(again[1])) == (dumps(smaller), repr(left))


def test_a_guard_about_times_stays_one_that_can_be_written() -> None:
    tree = loads("time t as s; event e() = {}; top on e() when at(top) - start(top) > 1 ms;")
    smaller, _ = shrink(tree, [{"t": 0}], lambda less, _: any(time_points(node.when) for node in less.nodes.values()))
    assert loads(dumps(smaller)) == smaller


def one_less(tree: RVAFT, trace: Trace) -> Iterator[tuple[RVAFT, Trace]]:
    """The pair without one thing: an event, a field, the part below a gate, an edge, a guard, a
    runtime event, an annotation.
    """
    for index, event in enumerate(trace):
        yield tree, [*trace[:index], *trace[index + 1 :]]
        for field in event:
            left = {name: value for name, value in event.items() if name != field}
            yield tree, [*trace[:index], left, *trace[index + 1 :]]
    for node in tree.nodes.values():
        bare = {"kind": None, "label": None, "attributes": ()}
        changes: list[dict[str, Any]] = [{"on": None}, {"when": None}, bare]
        if node.gate:
            changes.append({"gate": None, "children": (), "threshold": None})
        for child in node.children if len(node.children) > 1 else ():
            rest = tuple(name for name in node.children if name != child)
            changes.append({"children": rest, "threshold": node.threshold and min(node.threshold, len(rest))})
        for less in (replace(node, **change) for change in changes):
            if less != node:
                with suppress(TreeError):
                    yield rebuilt(tree, [less if other is node else other for other in tree.nodes.values()]), trace


@SETTINGS
@given(SEEDS, FAULTS, st.integers(1, 40))
def test_the_steps_are_all_that_is_asked_and_nothing_is_asked_twice(seed: int, wrong: str, steps: int) -> None:
    tree, trace, disagrees = found(seed, wrong, "projected")
    asked: list[str] = []

    def counted(candidate: RVAFT, events: Trace) -> bool:
        require_valid(candidate)
        asked.append(dumps(candidate) + repr(events))
        return disagrees(candidate, events)

    smaller, left = shrink(tree, trace, counted, steps=steps)
    assert len(set(asked)) == len(asked) <= steps
    assert disagrees(smaller, left)
    if steps == 1:
        assert (smaller, left) == (tree, trace)


def test_a_long_log_takes_few_steps() -> None:
    log = [{"event": "noise", "number": number} for number in range(1000)]
    log[17], log[500], log[940] = word("a b c")
    asked: list[str] = []

    def detected(tree: RVAFT, trace: Trace) -> bool:
        asked.append(dumps(tree) + repr(trace))
        return list(Engine(tree, "scattered").run(trace))[-1:] == [Verdict.TRUE] and len(tree.nodes) == 4

    smaller, left = shrink(loads("top sand a b c;"), log, detected)
    assert (dumps(smaller), left) == ("toplevel top;\ntop or a b c;\na;\nb;\nc;\n", word("c"))
    assert len(asked) == len(set(asked)) < 200


UNTIDY = """
event x(p) = { x: p }; event y(p) = { y: p }; event z(p) = { z: p }; event w(p) = { w: p };
ignore w(1);
toplevel top;
top and p q r; p or a b on x(V) lambda=1; q 2of3 b c d when V < 5; r sand_rl d a; other or b e; e on y(2);
"""


def way() -> list[tuple[str, Trace]]:
    """All that is asked on the way to the smallest pair."""
    asked: list[tuple[str, Trace]] = []

    def detected(tree: RVAFT, trace: Trace) -> bool:
        asked.append((dumps(tree), trace))
        return len(tree.nodes) > 2 and list(Engine(tree, "scattered").run(trace))[-1:] == [Verdict.TRUE]

    shrink(loads(UNTIDY), [{"noise": 1}, {"x": 1, "y": 2}, *word("b c a d")], detected)
    return asked


@pytest.mark.ci
def test_the_way_does_not_depend_on_hashing() -> None:
    asked = way()
    seed = "2" if os.environ.get("PYTHONHASHSEED") == "1" else "1"
    again = [sys.executable, "-c", f"from {__name__} import way; print(way())"]
    env = {**os.environ, "PYTHONHASHSEED": seed}
    done = subprocess.run(again, env=env, cwd=Path(__file__).parents[2], capture_output=True, text=True, check=True)
    assert done.stdout == f"{asked}\n"
    assert len(asked) > 30


def test_errors_of_rvaft_are_no_disagreement_and_others_come_through() -> None:
    def only_large(tree: RVAFT, _trace: Trace) -> bool:
        if len(tree.nodes) < 3:
            raise NotExpressible(unwritten("too small"), backend="none", semantics="strict")
        return True

    tree, trace = shrink(loads("top sand a b c d;"), word("a b"), only_large)
    assert (dumps(tree), trace) == ("toplevel top;\ntop or a c;\na;\nc;\n", [])
    for never in (only_large, lambda _tree, _trace: False):
        with pytest.raises(NotReproduced, match="no disagreement"):
            shrink(loads("a;"), word("a"), never)
    with pytest.raises(ZeroDivisionError):
        shrink(loads("a;"), word("a b"), lambda _tree, trace: 1 // (len(trace) - 1) > 0)


SILENT = RVAFT("a", [Node("a", Gate.OR, ("b",)), Node("b", when=Literal(True))])


@pytest.mark.parametrize(
    ("tree", "steps", "error", "said"),
    [
        (loads("a;"), 0, OptionError, "not 0"),
        (restrict(loads("top or a b;"), branch=1), 9, OptionError, "whole tree"),
        (SILENT, 9, TreeError, ""),
    ],
)
def test_what_is_no_whole_valid_tree_is_refused(tree: RVAFT, steps: int, error: type[Exception], said: str) -> None:
    with pytest.raises(error, match=said or None):
        shrink(tree, word("a"), lambda _tree, _trace: True, steps=steps)


def test_a_disagreement_of_a_part_shrinks_the_whole() -> None:
    def disagrees(tree: RVAFT, trace: Trace) -> bool:
        right, wrong = (restrict(one, kind="attack") for one in (tree, MISTAKES["a sand reversed"](tree)))
        return list(Engine(right).run(trace)) != list(Engine(wrong).run(trace))

    large = loads('top or p q; p sand a b fault; q sand c d attack; c label "see";')
    tree, trace = shrink(large, word("n c d"), disagrees)
    assert (dumps(tree), trace) == ("toplevel q;\nq sand c d attack;\nc;\nd;\n", word("c"))
