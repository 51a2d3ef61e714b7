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
    json_text,
    junit_text,
    markdown_text,
    result_lines,
    summary_lines,
    unable_lines,
)
from rvaft.model.verdict import Semantics, Verdict

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


def test_totals_and_words_that_are_not_blurred() -> None:
    totals = ComparisonTotals(results())
    assert list(totals.counts.values()) == [2, 2, 34, 1]
    assert [result.participant for result in totals.differing] == ["rml"]
    assert [result.participant for result in totals.unable] == ["rml", "automaton", "other"]
    assert totals.headline == "2 trees, 2 comparisons, 34 verdicts, 1 proof, 2 masked traces; 1 disagreement"
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
    assert found["totals"] == {"trees": 2, "comparisons": 2, "verdicts": 34, "proofs": 1, "disagreements": 1}
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
