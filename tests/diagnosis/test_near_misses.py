"""Near misses: each is a detection of a tree with one condition less."""

import json
from itertools import islice
from pathlib import Path
from random import Random
from typing import Any

import pytest

import rvaft
from rvaft import Semantics, Verdict
from rvaft.diagnosis.near_misses import NearMissSearch, near_misses
from rvaft.diagnosis.relaxation import Lack
from rvaft.semantics import Reference
from tests.cli.runs import lines, run, written
from tests.engine.checking import small_valid_trees
from tests.engine.dense import SHAPES, trace_of, tree_of
from tests.tables import rows

FAILED = [{"t": 10 * n, "f": f"10.0.0.{n % 8}"} for n in range(40)]
BURST = [{"t": 400 + n, "f": "203.0.113.9"} for n in range(12)]
GUESSING = "time t as s; semantics scattered; event f(a) = { f: a }; top and x within 1 min; x on f(A) times 14;"


@pytest.mark.parametrize(("text", "log", "expected"), rows(__file__, "near_misses.txt"))
def test_the_closest_come_first(text: str, log: list[Any], expected: list[str]) -> None:
    tree, events = rvaft.loads(text), [{"event": one} if isinstance(one, str) else one for one in log]
    found = near_misses(tree, events).found
    assert [miss.line(tree, dict(enumerate(events, 1))) for miss in found] == expected


def test_each_is_a_detection_but_for_its_condition() -> None:
    """By the definition, the relaxed tree is detected in the log where the tree is not."""
    lacks = set[Lack]()
    for shape in SHAPES:
        random = Random(f"near {shape}")
        for tree in islice(small_valid_trees(lambda: tree_of(random, shape)), 2):  # noqa: B023 (used at once)
            events = trace_of(random, tree, shape, "scattered")
            missed = Verdict.TRUE not in rvaft.monitor(tree, semantics="scattered").run(events)
            for miss in near_misses(tree, events, semantics="scattered").found if missed else ():
                lacks.add(miss.lack)
                assert miss.text
                assert 0 <= miss.distance <= 1
                assert Verdict.TRUE in Reference(miss.tree, Semantics.SCATTERED).run(events)
    assert lacks >= {Lack.EVENT, Lack.ORDER, Lack.COUNT}


def test_groups_of_nodes_exclude_no_pair_that_is_found_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    compared = 0
    for shape in SHAPES:
        random = Random(f"groups {shape}")
        for tree in islice(small_valid_trees(lambda: tree_of(random, shape)), 3):  # noqa: B023 (used at once)
            events = trace_of(random, tree, shape, "scattered")[::3]
            if Verdict.TRUE in rvaft.monitor(tree, semantics="scattered").run(events):
                continue
            with monkeypatch.context() as patched:
                found = near_misses(tree, events, semantics="scattered")
                patched.setattr(NearMissSearch, "_is_monotone", False)
                one_by_one = near_misses(tree, events, semantics="scattered")
            if not found.skipped and not one_by_one.skipped:
                assert found.found == one_by_one.found
                compared += 1
    assert compared > 15


def test_the_closest_of_many_addresses_is_seen_at_once(tmp_path: Path) -> None:
    tree = written(tmp_path / "guessing.rvaft", GUESSING)
    log = written(tmp_path / "auth.jsonl", lines([*FAILED, *BURST]))
    line = '12 of 14 f(A); no more came: A = "203.0.113.9", events 41 to 52 (400 to 411)'
    found = run("monitor", tree, log, "--explain").output.splitlines()
    assert found[:3] == ["verdict unknown after 52 events", "near misses, closest first:", f"  {line}"]
    keyed = run("monitor", tree, log, "--explain", "--key", "f")
    assert keyed.output.splitlines()[1] == f'  f="203.0.113.9": {line}'
    page = run("report", tree, log)
    assert f'"near":[[{json.dumps(line)},0,52]' in page.output
    (miss, *_) = rvaft.near_misses(rvaft.loads(GUESSING), [*FAILED, *BURST]).found
    assert (miss.explanation.variables, miss.events) == ({"A": "203.0.113.9"}, [*range(41, 53)])


@pytest.mark.parametrize("more", ["", "--repeat", "--backend mfotl", "--template x", "--format jsonl"])
def test_of_a_detection_or_other_output_there_are_none(tmp_path: Path, more: str) -> None:
    tree = written(tmp_path / "guessing.rvaft", GUESSING)
    log = written(tmp_path / "auth.jsonl", lines(BURST if more else [*BURST, *BURST]))
    assert "near miss" not in run("monitor", tree, log, "--explain", *more.split()).output


def test_paths_through_shared_gates_are_not_enumerated() -> None:
    """Sixteen gates in a row, each with two ways to the next: 65,536 paths, and 496 pairs of nodes to leave out."""
    gates = [f"g{n} and a{n} b{n}; a{n} or g{n + 1} x; b{n} or g{n + 1} y;" for n in range(16)]
    tree = rvaft.loads("time t as s; semantics scattered; top and g0 z within 5 s; " + " ".join(gates))
    found = near_misses(tree, [{"event": "g16", "t": 1}, {"event": "z", "t": 20}])
    assert [miss.text for miss in found.found] == ["all but z", "all but g0", "top took 14 s longer than 5 s"]
    assert not found.skipped


@pytest.mark.ci
def test_what_takes_too_long_is_said() -> None:
    leaves = [f"l{n}" for n in range(60)]
    tree = rvaft.loads(f"semantics scattered; top sand {' '.join(leaves)};")
    events = [{"event": name} for name in leaves * 200 if name != "l0"] + [{"event": "l0"}]
    found = near_misses(tree, events)
    assert found.found
    assert found.skipped
