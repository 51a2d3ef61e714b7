"""Reports: the same results as text, CSV, JSON, JUnit and Markdown, whatever names trees have."""

import csv
import json
from typing import Any
from xml.etree import ElementTree as ET

import pytest

from cross_check.results import (
    ComparisonTotals,
    Difference,
    Job,
    Result,
    Status,
    csv_text,
    difference_lines,
    exit_status,
    json_text,
    junit_text,
    markdown_text,
    result_lines,
    summary_lines,
    unable_lines,
)
from rvaft import Semantics, Verdict

HOSTILE = 'a|b <b>&"\'`*_[x](y)\n\x1b[31m\x00,;"'
DIFFERENCE = Difference(({"event": "a\n<x>"},), "reference", (Verdict.TRUE,), (Verdict.FALSE,))
TESTED: dict[str, Any] = {"traces": 5, "longest": 4, "verdicts": 5, "masked": 2, "masks": ("1.0",), "why": "variables"}


def results(name: str = "tree") -> list[Result]:
    job, other = Job(name, Semantics.STRICT), Job(name, Semantics.SCATTERED, branch=2)
    return [
        Result(job, "reference", Status.BASELINE, seconds=0.25, verdicts=10),
        Result(job, "engine", Status.PROVED, verdicts=10),
        Result(job, "rml", Status.DIFFERS, symbols=7, states=3, verdicts=4, difference=DIFFERENCE),
        Result(other, "reference", Status.BASELINE, verdicts=5),
        Result(other, "rml", Status.NOT_EXPRESSIBLE, why="no | pipes"),
        Result(other, "ltlf", Status.TESTED, **TESTED),
        Result(other, "automaton", Status.TIMEOUT, why="too slow"),
        Result(other, "other", Status.COULD_NOT_RUN, why="it died"),
    ]


def vacuous(name: str = "tree") -> list[Result]:
    """Two participants that give the same verdicts, none of which is a detection."""
    job = Job(name, Semantics.CONSECUTIVE)
    never: dict[str, Any] = {"why": "nothing was detected in any trace", "verdicts": 12}
    return [
        Result(job, "reference", Status.BASELINE, verdicts=12),
        Result(job, "engine", Status.VACUOUS, traces=4, longest=3, **never),
        Result(job, "rml", Status.VACUOUS, **never),
    ]


def test_traces_without_a_detection_are_no_agreement() -> None:
    assert [result.text for result in vacuous()] == [
        *("baseline", "vacuous: nothing was detected in 4 traces up to length 3"),
        "vacuous: nothing was detected in any trace",
    ]
    alone, beside = ComparisonTotals(vacuous()), ComparisonTotals([*results()[:2], *vacuous()])
    counted = "1 tree, 1 comparison, 0 verdicts, 0 proofs, 2 vacuous results"
    assert alone.headline == f"{counted}; nothing was detected, so nothing was compared"
    counted = "1 tree, 2 comparisons, 20 verdicts, 1 proof, 2 vacuous results"
    assert beside.headline == f"{counted}; no disagreement"
    assert [exit_status(some) for some in (vacuous(), [*results()[:2], *vacuous()], results()[:2])] == [2, 2, 0]
    assert exit_status(vacuous(), vacuous=True) == 2
    assert exit_status([*results()[:2], *vacuous()], vacuous=True) == 0
    assert exit_status([*results()[:2], *vacuous()], vacuous=True, failing=[Status.VACUOUS]) == 2
    root = ET.fromstring(junit_text(vacuous()))
    assert [suite.get("skipped") for suite in root] == ["2"]
    assert [one.get("message") for one in root.iter("skipped")] == [result.text for result in vacuous()[1:]]
    assert json.loads(json_text(vacuous()))["totals"]["vacuous"] == 2
    assert [row["exit_status"] for row in csv.DictReader(csv_text(vacuous()).splitlines())] == ["ok", *["vacuous"] * 2]
    assert "- engine: tree (consecutive): vacuous: nothing was detected" in markdown_text(vacuous())
    assert unable_lines(vacuous()[1:2])[1] == "engine        1            vacuous: nothing was detected in any trace"


def test_totals_and_words_that_are_not_blurred() -> None:
    totals = ComparisonTotals(results())
    assert list(totals.counts.values()) == [2, 2, 34, 1]
    assert [result.participant for result in totals.differing] == ["rml"]
    assert [result.participant for result in totals.unable] == ["rml", "automaton", "other"]
    assert (
        totals.headline
        == "2 trees, 2 comparisons, 34 verdicts, 1 proof, 2 masked traces; 1 disagreement, 1 could not run"
    )
    assert [result.text for result in results()] == [
        *("baseline", "proved", "differs after 1 event", "baseline", "not expressible: no | pipes"),
        "tested: 5 traces up to length 4, 2 masked (1.0) (variables)",
        *("timeout: too slow", "could not run: it died"),
    ]


def test_every_form_says_the_same() -> None:
    rows = list(csv.DictReader(csv_text(results()).splitlines()))
    assert [row["exit_status"] for row in rows] == [*["ok"] * 4, "not expressible", "ok", "timeout", "could not run"]
    assert [rows[2]["symbols"], rows[0]["symbols"], rows[3]["tree"], rows[0]["seconds"]] == [
        *("7", "", "tree branch 2", "0.250000")
    ]
    found = json.loads(json_text(results()))
    assert found["totals"] == {
        "trees": 2,
        "comparisons": 2,
        "verdicts": 34,
        "proofs": 1,
        "disagreements": 1,
        "vacuous": 0,
    }
    difference = {"trace": [{"event": "a\n<x>"}], "baseline": "reference", "expected": ["true"], "got": ["false"]}
    assert found["results"][2]["difference"] == difference
    assert (found["results"][5]["branch"], found["results"][5]["masked"]) == (2, 2)
    root = ET.fromstring(junit_text(results()))
    assert [suite.get("name") for suite in root] == ["tree (strict)", "tree branch 2 (scattered)"]
    counts = [tuple(suite.get(what) for what in ("tests", "failures", "errors", "skipped")) for suite in root]
    assert counts == [("3", "1", "0", "0"), ("5", "0", "1", "2")]
    (failure,) = root.iter("failure")
    assert "⊤" in str(failure.text)
    text = markdown_text(results())
    assert text.startswith("## rvaft cross-check\n\n2 trees, ")
    assert "| rml | differs 1 | not expressible 1 |" in text
    assert "### rml: tree (strict)" in text
    assert "- other: tree branch 2 (scattered): could not run: it died" in text


def test_what_was_not_compared_is_told_with_the_chief_reasons_and_every_failure() -> None:
    job, whys = Job("tree", Semantics.STRICT), ["no order", "no order", "no order", "no type", "no type", "a", "b"]
    skipped = [Result(job, "rml", Status.NOT_EXPRESSIBLE, why=why) for why in whys]
    failed = [Result(job, "ltlf", Status.COULD_NOT_RUN, why=why) for why in ("it died", "it died", "it ran away")]
    assert unable_lines([*skipped, *results()[:2], *results()[6:7], *failed]) == [
        "NOT COMPARED  COMPARISONS  BECAUSE",
        "rml           3            not expressible: no order",
        "              2            not expressible: no type",
        "              2            not expressible: 2 other reasons",
        "automaton     1            timeout: too slow",
        "ltlf on 2 comparisons: could not run: it died",
        "ltlf on tree under strict: could not run: it ran away",
    ]
    assert unable_lines(results()[:2]) == []


@pytest.mark.parametrize("name", [HOSTILE, "\ud800", "ünï 名", ""])
def test_names_never_break_out(name: str) -> None:
    every = results(name.encode("utf-8", "replace").decode())
    root = ET.fromstring(junit_text(every))
    assert len(list(root.iter("testcase"))) == len(every)
    assert len(list(csv.reader(csv_text(every).splitlines(keepends=True)))) == len(every) + 1
    table = [line for line in markdown_text(every).splitlines() if line.startswith("|")]
    assert {line.replace("\\|", "").count("|") for line in table} == {4}
    assert "<b>" not in markdown_text(every).replace("\\<", "")
    for line in [*result_lines(every), *summary_lines(ComparisonTotals(every)), *difference_lines(every[2])]:
        assert line.isprintable(), line


def test_what_could_not_run_never_ends_in_no_disagreement() -> None:
    job = Job("tree", Semantics.STRICT)
    run = [Result(job, "reference", Status.BASELINE, verdicts=1), Result(job, "rml", Status.TESTED, verdicts=1)]
    for status in (Status.COULD_NOT_RUN, Status.TOOL_MISSING):
        headline = ComparisonTotals([*run, Result(job, "eql", status, why="no")]).headline
        assert headline.endswith("; 1 could not run")
    assert ComparisonTotals(run).headline.endswith("; no disagreement")


def test_a_difference_outside_of_the_assumptions_is_a_remark_in_every_report() -> None:
    found = Result(Job("t", Semantics.STRICT), "eql", Status.TESTED, traces=1, verdicts=1, outside=DIFFERENCE)
    assert json.loads(json_text([found]))["results"][0]["outside"]["got"] == ["false"]
    assert "remark: it differs on a trace that breaks what the tree assumes" in markdown_text([found])
    assert ComparisonTotals([found]).headline.endswith("; no disagreement")
    assert exit_status([found]) == 0


def test_a_field_that_no_event_has_is_a_remark_in_every_report() -> None:
    found = Result(Job("t", Semantics.STRICT), "eql", Status.TESTED, traces=1, verdicts=1, unknown_fields=("a.b", "c"))
    assert json.loads(json_text([found]))["results"][0]["unknown_fields"] == ["a.b", "c"]
    assert "remark: the fields a.b and c are in no event of the tree" in markdown_text([found])
