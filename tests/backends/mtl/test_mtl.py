"""Texts, refusals, and formulas that people write; agreement with the reference is tested with all backends."""

import re
import sys

import pytest

from backends.mtl import MtlBackend
from backends.mtl.r2u2 import MtlR2u2Backend
from cross_check.participants import faithful_backends
from rvaft.api import loads
from rvaft.errors import LanguageError, NotExpressible, OptionError, TooLarge, ToolMissing
from rvaft.model.nodes import EventType, Gate, Node, On
from rvaft.model.patterns import Literal, ObjectPattern
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics
from rvaft.monitors import DetectionMonitor
from rvaft.semantics import Reference
from tests.backends.injections import INJECTIONS
from tests.backends.texts import events, signs, tree
from tests.cli.runs import run
from tests.tables import rows

BACKEND, BOUNDED = MtlBackend(), MtlR2u2Backend()
TEXTS = rows(__file__, "texts.txt")


@pytest.mark.parametrize(("text", "expected"), TEXTS)
def test_text(text: str, expected: str) -> None:
    assert BACKEND.translate(loads(text), Semantics.SCATTERED).text.splitlines()[-1] == expected


@pytest.mark.parametrize(("text", "semantics", "reason"), rows(__file__, "refused.txt"))
def test_what_it_cannot_say_is_refused(text: str, semantics: str, reason: str | None) -> None:
    with pytest.raises(TooLarge if reason is None else NotExpressible, match=reason or "too large"):
        BACKEND.translate(tree(text), Semantics(semantics))


@pytest.mark.parametrize(("text", "line", "column", "message"), rows(__file__, "malformed.txt"))
def test_malformed(text: str, line: int, column: int, message: str) -> None:
    """Reelay itself ends the process at any of these."""
    with pytest.raises(LanguageError, match=message) as raised:
        BACKEND.read(text)
    assert (raised.value.line, raised.value.column) == (line, column)


def test_what_is_too_deep() -> None:
    with pytest.raises(TooLarge):
        BACKEND.read("not " * 5_000 + "{a: true}")


@pytest.mark.parametrize(("text", "word", "number"), rows(__file__, "runs.txt"))
def test_hand_written(text: str, word: str, number: int | None) -> None:
    """Beside other traces: nothing of one is left for another."""
    monitor = BACKEND.read(text)
    assert isinstance(monitor, DetectionMonitor)
    trace = events(word)
    assert monitor.first_detections([trace, [], trace, trace[:-1], trace])[::2] == [number] * 3


@pytest.mark.parametrize("text", INJECTIONS)
def test_nothing_breaks_out(text: str) -> None:
    event = EventType("seen", (), ObjectPattern(((text, Literal(text)),)))
    made = RVAFT(
        "top", [Node("top", Gate.SAND, ("x", text)), Node("x", label=text), Node(text, on=On("seen", ()))], [event]
    )
    written = BACKEND.translate(made, Semantics.SCATTERED).text
    monitor = BACKEND.read(written)
    assert (written.count("*/"), signs(monitor, [{"event": "x"}, {text: "a"}, {text: text}])) == (1, "??T")


@pytest.mark.parametrize(("text", "inputs", "formula"), rows(__file__, "r2u2.txt"))
def test_the_form_for_r2u2(text: str, inputs: str, formula: str) -> None:
    """Each way back is `S` from one event before, to the horizon; what the inputs are is as in `mtl`."""
    found = BOUNDED.translate(loads(text), Semantics.SCATTERED)
    lines = found.text.replace("[1,1073741823]", "").splitlines()
    assert lines[-4:] == ["INPUT", f"    {inputs}: bool;", "PTSPEC", f"    detection: {formula};"]
    defined = [line for line in BACKEND.translate(loads(text), Semantics.SCATTERED).text.splitlines() if ":=" in line]
    assert lines[1:-4] == [f"-- {line}" for line in defined]
    assert found.text.count("true S[1,1073741823] ") == formula.count("S ")


def test_the_form_is_only_emitted_and_misses_what_is_beyond_the_horizon() -> None:
    assert (BOUNDED.faithful, BOUNDED.form_of, BOUNDED.readable) == (False, "mtl", False)
    assert "mtl-r2u2" not in faithful_backends()
    found = BOUNDED.translate(loads("top sand a b;"), Semantics.SCATTERED)
    assert "misses what comes after 1073741824 events" in found.text.splitlines()[0]
    assert signs(found.monitor(), events("b a b")) == "??T"  # that of the formula for Reelay
    with pytest.raises(OptionError, match="c2po is only emitted"):
        BOUNDED.read(found.text)


@pytest.mark.parametrize(("text", "semantics", "reason"), rows(__file__, "refused.txt")[:6])
def test_the_form_refuses_what_mtl_refuses(text: str, semantics: str, reason: str | None) -> None:
    with pytest.raises(TooLarge if reason is None else NotExpressible, match=reason or "too large"):
        BOUNDED.translate(tree(text), Semantics(semantics))


@pytest.mark.parametrize("text", INJECTIONS)
def test_no_name_ends_a_comment_of_c2po(text: str) -> None:
    event = EventType("seen", (), ObjectPattern(((text, Literal(text)),)))
    made = RVAFT("top", [Node("top", Gate.SAND, ("x", text)), Node("x"), Node(text, on=On("seen", ()))], [event])
    lines = re.split(r"[\r\n]", BOUNDED.translate(made, Semantics.SCATTERED).text)
    assert ([line[:2] for line in lines[:3]], lines[3:5]) == (["--"] * 3, ["INPUT", "    p1, p2: bool;"])


SLIPS = {
    "order dropped": (
        "top sand a b;",
        "once({p2: true} and pre(once({p1: true})))",
        "once({p2: true}) and once({p1: true})",
    ),
    "one event for two": ("top sand o; o and a b; a times 2;", "pre(once({p1: true}))", "once({p1: true})"),
    "one less of K": ("top 2of3 a b c;", " and pre(once(({p1: true} or {p2: true})))", ""),
    "a guard dropped": ("event e(k) = { k: k }; top sand a b; a on e(X) when X > 2;", " when X > 2", ""),
    "order turned round": ("top sand a b;", "{p2: true} and pre(once({p1", "{p1: true} and pre(once({p2"),
    "now for once": ("top sand a b;", "pre(once({p1: true}))", "pre({p1: true})"),
    "an order forgotten": ("top and a b;", " or once({p1: true} and pre(once({p2: true})))", ""),
}


@pytest.mark.parametrize("slip", SLIPS)
def test_a_slip_in_the_text_shows(slip: str) -> None:
    text, right, wrong = SLIPS[slip]
    made, same = loads(text), {"event": "a", "k": 1}
    written = BACKEND.translate(made, Semantics.SCATTERED).text
    assert right in written
    monitor = BACKEND.read(written.replace(right, wrong))
    letters = [same, {"event": "b", "k": 3}, {"event": "c"}]
    traces = [[one, other, third] for one in letters for other in letters for third in letters]
    traces += [[{"event": "a"}], [{"event": "b"}], [{"event": "c"}]]
    assert isinstance(monitor, DetectionMonitor)
    wanted = [signs(Reference(made, Semantics.SCATTERED), trace).find("T") + 1 or None for trace in traces]
    assert list(monitor.first_detections(traces)) != wanted


def test_a_formula_is_held_against_a_tree(tmp_path_factory: pytest.TempPathFactory) -> None:
    file = tmp_path_factory.mktemp("rule") / "rule.mtl"
    file.write_text("{c: true} and pre(once({b: true} and pre(once({a: true}))))")
    good = run(
        "cross-check", "trees/gates/sand.rvaft", "--against", file, "--semantics", "scattered", "--backends", "mtl"
    )
    assert (good.exit_code, "detections only" in good.output) == (0, True)
    file.write_text("{c: true} and once({b: true} and once({a: true")
    assert run("cross-check", "trees/gates/sand.rvaft", "--against", file).exit_code == 2


def test_without_the_package_the_error_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "reelay", None)
    text = BACKEND.translate(loads("toplevel r; r and never_read_before b;"), Semantics.SCATTERED).text
    with pytest.raises(ToolMissing, match=r"pip install '\.\[mtl\]'"):
        BACKEND.read(text)
