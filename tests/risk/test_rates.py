"""Rates from logs: what is counted, and whether the intervals have the rates with which logs were drawn."""

import json
from pathlib import Path
from random import Random

import pytest

import rvaft
from rvaft.risk.model import of_tree
from rvaft.risk.rates import Rate, RateEstimate
from tests.cli.runs import run

pytest.importorskip("scipy")

TREE = "event e(k, u) = {k: k, u: u}; time t as s; top and a b; a on e(1, _); b on e(2, _);"


def rates(text: str, *logs: list[dict[str, object]]) -> dict[str, Rate]:
    tree = rvaft.loads(text)
    estimate = RateEstimate(tree, of_tree(tree))
    for log in logs:
        estimate.add(log)
    return {one.leaf: one for one in estimate.rates()}


def event(k: int, t: float, u: str = "x") -> dict[str, object]:
    return {"k": k, "t": t, "u": u}


def test_the_event_that_begins_a_log_is_not_counted() -> None:
    found = rates(TREE, [event(1, 0), event(1, 5), event(2, 8), event(1, 10)])
    assert (found["a"].events, found["a"].rate, found["b"].rate) == (2, 0.2, 0.1)


def test_a_failure_is_observed_until_it_happens() -> None:
    logs = [event(9, 0), event(1, 4), event(1, 6), event(9, 10)], [event(9, 0), event(9, 20)]
    found = rates(TREE.replace("a on e(1, _)", "a on e(1, _) once=yes"), *logs)
    assert (found["a"].events, found["a"].seconds) == (1, 24.0)


def test_instances_are_observed_from_their_first_event() -> None:
    text = TREE.replace("e(1, _)", "e(1, User)").replace("e(2, _)", "e(2, User)")
    log = [event(1, 0), event(1, 10, "y"), event(1, 15), event(9, 20)]
    found = rates(text, log)
    assert (found["a"].events, found["a"].seconds) == (1, 20.0 + 10.0)
    failing = rates(text.replace("a on e(1, User)", "a on e(1, User) once=yes"), log)
    assert failing["a"].left_out


@pytest.mark.parametrize("own", [True, False])
def test_the_interval_has_the_rate_as_often_as_it_says(own: bool) -> None:
    random, inside, score, trials = Random(5), 0, 0.0, 300
    for _ in range(trials):
        log, t = ([] if own else [event(9, 0)]), 0.0
        while len(log) < 12:
            t += random.expovariate(0.5 if own else 1.0)
            log.append(event(1 if own or random.random() < 0.5 else 9, t))
        one = rates(TREE, log)["a"]
        inside += one.low <= 0.5 <= one.high
        score += (one.events - 0.5 * one.seconds) / (0.5 * one.seconds) ** 0.5
    assert inside / trials > 0.92
    assert abs(score / trials**0.5) < 3


def test_rates_are_written_as_a_tree_that_can_be_read(tmp_path: Path) -> None:
    (tmp_path / "t.rvaft").write_text(TREE)
    log = [event(9, 0), event(1, 1800), event(9, 3600)]
    (tmp_path / "l.jsonl").write_text("".join(f"{json.dumps(one)}\n" for one in log))
    done = run("rates", tmp_path / "t.rvaft", tmp_path / "l.jsonl", "--format", "tree")
    assert done.stdout.splitlines()[0].startswith("a lambda=1/h;")
    tree = rvaft.loads(f"{TREE} {done.stdout}")
    assert dict(tree.nodes["a"].attributes)["lambda"] == "1/h"
