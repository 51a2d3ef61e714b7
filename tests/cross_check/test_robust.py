"""`rvaft robust`: lost, doubled and swapped events, and what `scattered` promises of them."""

import json
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from random import Random
from typing import Any

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import rvaft
from cross_check.commands.robust import Edit, Trials
from cross_check.generate.strategies import trees_with_guided_traces
from cross_check.generate.traces import some_event
from cross_check.generate.trees import Shape
from cross_check.generate.values import interesting_values
from rvaft import RVAFT, Semantics, Verdict
from rvaft.model.values import Json
from rvaft.semantics import Reference
from tests.cli.runs import LOGS, PRUNED, SAND, TREES, failed, lines, run, written
from tests.trees import shipped

THIRD = LOGS / "table2_row3.jsonl"
DOCS = Path(__file__).parents[2] / "docs"
RICH = Shape(max_nodes=6, times=0.6, counted=0.2, pand=0.4, guards=0.4)


def report(*args: object, **options: Any) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(run("robust", *args, "--format", "json", **options).stdout)
    assert (found.pop("format"), found.pop("version")) == ("rvaft-robust", 1)
    return found


@pytest.mark.parametrize(
    ("semantics", "lost", "twice", "swapped"),
    [("projected", "⊥⊥⊥⊥?", "⊥⊥⊥⊥⊤", "⊥⊥⊥⊥"), ("scattered", "?????", "⊤⊤⊤⊤⊤", "????")],
)
def test_the_third_trace_of_the_paper(semantics: str, lost: str, twice: str, swapped: str) -> None:
    (log,) = report(PRUNED, THIRD, "--semantics", semantics)["logs"]
    assert (log["verdict"], log["decided"], log["untried"]) == ("⊤", 5, 0)
    assert (log["lost"], log["twice"], log["swapped"]) == (lost, twice, swapped)


def test_the_report_says_what_happens_to_each_node() -> None:
    result = run("robust", PRUNED, THIRD)
    assert (result.exit_code, result.stderr) == (1, "")
    shown = [line.split() for line in result.stdout.splitlines()]
    assert shown[:2] == [["under", "projected:"], [f"{THIRD}:", "⊤", "at", "event", "5", "of", "5"]]
    assert ["ev4", "lost", "1", "1", "0", "1"] in shown
    assert ["ev4", "swapped", "2", "2", "0", "2"] in shown  # with the event before it, and with the next one
    assert ["ev9", "twice", "1", "0", "0", "0"] in shown
    assert result.stdout.splitlines()[-3:] == [
        "  lost: 5 of 5 hide a detection (100 %), 0 of 0 forge one, 4 end detection for good",
        "  twice: 4 of 5 hide a detection (80 %), 0 of 0 forge one, 4 end detection for good",
        "  swapped: 4 of 4 hide a detection (100 %), 0 of 0 forge one, 4 end detection for good",
    ]


def test_an_edit_may_forge_a_detection_and_events_after_the_verdict_do_not_count(tmp_path: Path) -> None:
    tree = written(tmp_path / "tree.rvaft", "semantics scattered; top sand a b; a times 2;")
    log = written(tmp_path / "log.jsonl", lines([{"event": name} for name in "axbx"]))
    (answer,) = report(tree, log)["logs"]
    assert [answer[edit] for edit in ("lost", "twice", "swapped")] == ["????", "⊤???", "???"]
    detected = written(tmp_path / "more.jsonl", lines([{"event": name} for name in "aabaab"]))
    found = report(tree, detected)
    assert {one["edit"]: (one["tried"], one["hidden"]) for one in found["totals"]} == {
        "lost": (3, 0),
        "twice": (3, 0),
        "swapped": (3, 0),
    }
    assert run("robust", tree, detected).exit_code == 0
    assert run("robust", tree, log).exit_code == 1


def test_logs_are_generated_and_are_those_of_traces(tmp_path: Path) -> None:
    found = report(SAND, "-n", 2, "--seed", 3, "--semantics", "projected,scattered")
    assert [(one["log"], one["semantics"]) for one in found["logs"]] == [
        (name, semantics)
        for semantics in ("projected", "scattered")
        for name in ("detect-1", "detect-2", "near-miss-1", "near-miss-2")
    ]
    assert [one["verdict"] for one in found["logs"][:2]] == ["⊤", "⊤"]
    run("traces", SAND, "-o", tmp_path, "-n", 1, "--seed", 3)
    (same,) = report(SAND, tmp_path / "detect-1.jsonl")["logs"]
    assert {**same, "log": "detect-1"} == found["logs"][0]


def test_the_effort_is_limited_and_the_report_says_so(tmp_path: Path) -> None:
    log = written(tmp_path / "log.jsonl", lines([{"event": "a"}] * 300))
    limited = "--semantics", "scattered", "--steps", 30_000
    result = run("robust", SAND, log, *limited)
    assert re.fullmatch(
        rf"rvaft: warning: {log}: \d+ edits tried under scattered, and \d+ not: --steps allows more\n", result.stderr
    )
    (answer,) = report(SAND, log, *limited)["logs"]
    assert answer["lost"] == "?----" * 60
    assert answer["untried"] == 240 + 240 + 239
    assert run("robust", SAND, log, "--semantics", "scattered").stderr == ""


def test_refusals(tmp_path: Path) -> None:
    broken = written(tmp_path / "broken.jsonl", '{"event": "a"}\n{')
    failed(run("robust", SAND, THIRD, "-n", 2), "-n and --seed are for generated logs")
    failed(run("robust", SAND, "--input", "csv"), "name a LOG for --input")
    failed(run("robust", SAND, "mqtt://localhost/x"), "only rvaft monitor and rvaft view")
    result = run("robust", SAND, tmp_path / "*.log", broken, written(tmp_path / "good.jsonl", '{"event": "a"}'))
    assert result.exit_code == 2
    none, malformed = result.stderr.splitlines()
    assert "no file matches the pattern" in none
    assert f"{broken}:2: not JSON" in malformed
    assert "good.jsonl: ? of 1" in result.stdout
    joined = written(
        tmp_path / "t",
        "event e(x) = { n: x }; event f(x, y) = { m: x, k: y }; semantics scattered; "
        "top sand a b c; a on e(X); b on f(X, Y); c on e(Y);",
    )
    many = written(tmp_path / "many.jsonl", lines([{"n": n} for n in range(9)]))
    failed(run("robust", joined, many, "--max-configurations", 2), "in ", "--max-configurations allows more")


# -- agreement with a monitor of each edited log ----------------------------------------------------------------------


def edited(events: Sequence[Json]) -> Iterator[tuple[Edit, int, list[Json]]]:
    """Yield each edit by hand."""
    for place in range(len(events)):
        before, event, after = [*events[:place]], events[place], [*events[place + 1 :]]
        yield Edit.LOST, place, before + after
        yield Edit.TWICE, place, [*before, event, event, *after]
        if after:
            yield Edit.SWAPPED, place, [*before, after[0], event, *after[1:]]


def verdict(tree: RVAFT, semantics: Semantics, events: Sequence[Json]) -> Verdict:
    reference = Reference(tree, semantics)
    return [Verdict.UNKNOWN, *map(reference.step, events)][-1]


@pytest.mark.ci
@given(trees_with_guided_traces(RICH))
def test_every_edit_has_the_verdict_of_the_reference(case: tuple[RVAFT, Semantics, list[Json]]) -> None:
    tree, semantics, events = case
    trials = Trials(tree, semantics, limit=100_000, steps=1_000_000)
    answer = trials.answer("log", events, lambda: None)
    for edit, place, log in edited(events):
        expected = answer.verdict if place >= (answer.decided or len(events)) else verdict(tree, semantics, log)
        assert answer.verdicts[edit][place] == expected.symbol, (edit, place)


@pytest.mark.ci
@given(trees_with_guided_traces(RICH), st.randoms(use_true_random=False))
def test_under_scattered_an_added_event_hides_no_detection(
    case: tuple[RVAFT, Semantics, list[Json]], random: Random
) -> None:
    """Theorems of `proofs/Monotone.v`, about trees without absent events: with `late` this holds for an event that
    does not move the maximum time on.
    """
    tree, _, events = case
    assume(not tree.absences)
    late = tree.time is not None and tree.time.late is not None
    before = verdict(tree, Semantics.SCATTERED, events)
    for edit, _, log in edited(events):
        after = verdict(tree, Semantics.SCATTERED, log)
        assert edit is not Edit.TWICE or before is not Verdict.TRUE or after is Verdict.TRUE
        assert late or edit is not Edit.LOST or after is not Verdict.TRUE or before is Verdict.TRUE
    place, added = random.randint(0, len(events)), some_event(random, tree, interesting_values(tree))
    if before is Verdict.TRUE and not late:
        assert verdict(tree, Semantics.SCATTERED, [*events[:place], added, *events[place:]]) is Verdict.TRUE


def test_with_late_an_event_far_ahead_hides_a_detection() -> None:
    tree = rvaft.loads("time t as s late 5 s; semantics scattered; top sand a b;")
    events: list[Json] = [{"event": "a", "t": 1}, {"event": "x", "t": 99}, {"event": "b", "t": 2}]
    answer = Trials(tree, Semantics.SCATTERED, limit=100, steps=100).answer("log", events, lambda: None)
    assert (answer.verdict, answer.verdicts[Edit.LOST]) == (Verdict.UNKNOWN, "?⊤?")  # a loss forges one


@pytest.mark.slow
def test_the_table_of_the_documentation_is_measured() -> None:
    totals: dict[tuple[str, str], Counter[str]] = {}
    for name in shipped.names():
        tree = TREES / f"{name}.rvaft"
        logs = sorted(tree.with_suffix(".traces").iterdir())
        for one in report(tree, *logs, "--semantics", "all")["totals"]:
            counts = {effect: one[effect] for effect in ("detected", "hidden", "forged")}
            totals.setdefault((one["edit"], one["semantics"]), Counter()).update(counts)
    shares = {
        edit: [f"{100 * totals[edit, one]['hidden'] / totals[edit, one]['detected']:.0f} %" for one in Semantics]
        for edit in Edit
    }
    text = (DOCS / "how-to" / "live.md").read_text(encoding="utf-8")
    rows = {cells[0]: cells[1:] for line in text.splitlines() if (cells := line.strip("| ").split(" | "))[0] in shares}
    assert rows == shares
