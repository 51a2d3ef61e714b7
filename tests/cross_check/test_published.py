"""`rml-published`: the published monitor, run from a checkout.

What needs the checkout is marked; the rest runs stand-ins: folders that are none, programs that are
no `swipl`, and a monitor of a few lines that does what the published one should not.
"""

import os
import shutil
from pathlib import Path
from random import Random

import pytest

from backends.conformance import examples
from cross_check.generate.traces import random_trace
from cross_check.participants import Answer
from cross_check.published.rml_monitor import run
from rvaft import LanguageError, NotExpressible, Semantics, ToolFailed, ToolMissing, Verdict, load, loads
from rvaft.backend import backend
from rvaft.model.values import Json
from rvaft.readers.json_lines import read
from rvaft.semantics import Reference

TREES = Path(__file__).parents[2] / "trees"
T, F, Q = Verdict.TRUE, Verdict.FALSE, Verdict.UNKNOWN


def emitted(text: str) -> str:
    return backend("rml").translate(loads(text), Semantics.STRICT).text


def word(text: str) -> list[Json]:
    return [{"event": name} for name in text.split()]


SEQUENCE = emitted("r sand a b;")


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A folder that looks like a checkout of the monitor."""
    (folder := tmp_path / "monitor").mkdir()
    (folder / "trace_expressions_semantics.pl").write_text(":- module(trace_expressions, [next/3, may_halt/1]).\n")
    return folder


def test_what_is_missing(monkeypatch: pytest.MonkeyPatch, checkout: Path, tmp_path: Path) -> None:
    for folder in (tmp_path, tmp_path / "nowhere"):
        with pytest.raises(ToolMissing, match=f"{folder} is not a checkout of it .*RMLatDIBRIS/monitor"):
            run(SEQUENCE, [word("a")], folder, timeout=5)
    with pytest.raises(LanguageError):
        run("trace_expression('Main', 1).", [word("a")], checkout, timeout=5)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(ToolMissing, match="swipl is not installed: install SWI-Prolog"):
        run(SEQUENCE, [word("a")], checkout, timeout=5)


LOADED = """echo '{"loaded": true}'; echo """
LATE = Answer(error="timeout: no answer within 1 s", expired=True)
DEAD = [Answer(error="type_error(x)"), Answer(error="the monitor ended early: Stack!")]


@pytest.mark.ci
@pytest.mark.parametrize(
    ("script", "said"),  # a `swipl`, and what comes of two traces, or why the text does not load
    [
        (LOADED + """'{"verdicts": ["unknown"]}'; exec sleep 60""", [Answer((Q,)), LATE]),
        (LOADED + """'{"error": "type_error(x)"}'; printf '{"verd'; echo 'Stack!' >&2; exit 3""", DEAD),
        ("""echo '{"error": "Syntax   error\\\\n here"}'""", "cannot load the specification: Syntax error here"),
        ("echo Welcome", "its output is not JSON: Welcome"),
        ("exit 7", "the monitor ended early: exit status 7"),
        ("exec sleep 60", "timeout: no answer within 1 s"),
    ],
)
def test_who_is_late_or_dies_has_answered_what_it_has_answered_and_what_does_not_load_is_a_failure(
    monkeypatch: pytest.MonkeyPatch, checkout: Path, script: str, said: list[Answer] | str
) -> None:
    (checkout / "swipl").write_text(f"#!/bin/sh\n{script}\n")
    (checkout / "swipl").chmod(0o755)
    monkeypatch.setenv("PATH", f"{checkout}{os.pathsep}{os.environ['PATH']}")
    if not isinstance(said, str):
        assert run(SEQUENCE, [word("a"), word("b")], checkout, timeout=1) == said
        return
    with pytest.raises(ToolFailed) as caught:
        run(SEQUENCE, [word("a")], checkout, timeout=1)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


needs_swipl = pytest.mark.skipif(shutil.which("swipl") is None, reason="swipl is not on the path")

ODD = Path(__file__).with_name("odd_monitor.pl").read_text()


@needs_swipl
def test_exceptions_belong_to_their_trace(checkout: Path) -> None:
    (checkout / "trace_expressions_semantics.pl").write_text(ODD)
    words = ("a raise a", "a halt raise", "a", "fail throw", "throw", "endless", "a a", "")
    found = run(SEQUENCE, [*map(word, words)], checkout, timeout=60)
    errors = [result.error for result in found]
    assert errors[0].startswith("type_error(evaluable,f(")
    assert errors[4] == "left"
    assert errors[5].startswith(("@(", "f(f("))
    assert [result.verdicts for result in found] == [None, (Q, T, T), (Q,), (F, F), None, None, (Q, Q), ()]
    assert [result.verdicts is None for result in found] == [bool(error) for error in errors]
    (checkout / "trace_expressions_semantics.pl").write_text(ODD + "\nnext(")
    with pytest.raises(ToolFailed, match=r"cannot load the specification: .*yntax error"):
        run(SEQUENCE, [word("a")], checkout, timeout=60)


@pytest.mark.slow
@needs_swipl
def test_what_takes_all_memory_or_all_time(checkout: Path) -> None:
    (checkout / "trace_expressions_semantics.pl").write_text(ODD)
    deep, after, loop, never = run(SEQUENCE, [*map(word, ("deep", "a", "loop", "a"))], checkout, timeout=12)
    assert "resource_error" in deep.error
    assert after == Answer((Q,))
    assert loop.error == never.error == "timeout: no answer within 12 s"


MONITORS = {
    "monitor": os.environ.get("RML_MONITOR", ""),
    "rosmonitoring": str(Path(os.environ.get("ROSMONITORING", ""), "oracle", "RMLOracle", "prolog")),
}


@pytest.fixture(params=MONITORS)
def published(request: pytest.FixtureRequest) -> Path:
    folder = Path(MONITORS[request.param])
    if shutil.which("swipl") is None or not (folder / "trace_expressions_semantics.pl").is_file():
        pytest.skip("RML_MONITOR or ROSMONITORING names no checkout, or swipl is not on the path")
    return folder


@pytest.mark.published
def test_verdicts_are_those_of_the_reference(published: Path) -> None:
    random = Random("rml-published")
    compared = 0
    for example in [*examples()][::24]:
        for semantics in Semantics:
            try:
                text = backend("rml").translate(example.tree, semantics).text
            except NotExpressible:
                continue
            traces = [random_trace(random, example.tree) for _ in range(12)]
            for given, result in zip(traces, run(text, traces, published, timeout=60), strict=True):
                if not result.deviations:
                    compared += 1
                    expected = tuple(Reference(example.tree, semantics).run(given))
                    assert result.verdicts == expected, (example.name, semantics, given, result.error)
    assert compared > 100


@pytest.mark.published
def test_the_paper_s_traces(published: Path) -> None:
    tree = load(TREES / "remote_inspection" / "pruned.rvaft")
    text = backend("rml").translate(tree, Semantics.PROJECTED).text
    traces = [list(read(file)) for file in sorted((TREES / "remote_inspection" / "pruned.traces").iterdir())]
    for trace, result in zip(traces, run(text, traces, published, timeout=60), strict=True):
        assert result.verdicts == tuple(Reference(tree, Semantics.PROJECTED).run(trace))
        assert "tolerance of guards" in result.deviations


@pytest.mark.published
def test_an_exception_is_no_verdict_and_events_may_have_more_fields_than_the_pattern(published: Path) -> None:
    """The copy in ROSMonitoring has the arguments of `deep_subdict` the other way round; the text
    must not depend on it.
    """
    text = emitted("event p(x) = {p: x}; r sand a b; a on p(X) when X > 1; b on p(_);")
    string, number = run(text, [[{"p": "a"}], [{"p": 2}, {"p": 1}]], published, timeout=60)
    assert (string.verdicts, string.deviations) == (None, ("guards over what is no number",))
    assert "type_error" in string.error
    assert number == Answer((Q, T))
    text = emitted("event p(x) = {p: {q: x, r: [x, 1]}}; r sand a b; a on p(X); b on p(X);")
    one: Json = {"topic": "t", "p": {"q": 5, "r": [5, 1], "more": 0}}
    other: Json = {"p": {"q": 6, "r": [6, 1]}}
    found = run(text, [[one, one], [one, other], [{"p": {"q": 5}}]], published, timeout=60)
    assert [result.verdicts for result in found] == [(Q, T), (Q, F), (F,)]
