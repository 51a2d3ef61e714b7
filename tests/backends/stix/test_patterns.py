"""The patterns of trees, pinned; what is refused; patterns written by hand; mappings; and mistakes in a pattern."""

import re
from collections.abc import Callable
from pathlib import Path

import pytest
from stix2patterns.v21.pattern import Pattern

from backends.stix import StixBackend
from backends.stix.reader import StixMonitor
from cross_check.comparison import cross_check
from cross_check.traces import Effort
from rvaft import (
    Gate,
    NotExpressible,
    OptionError,
    Semantics,
    TooLarge,
    ToolFailed,
    TraceError,
    Verdict,
    loads,
    translate,
)
from rvaft import monitor as monitor_of
from rvaft.model.values import Json
from rvaft.monitors import DetectionMonitor
from tests.backends.texts import events, flat, tree
from tests.tables import rows, sampled

DECLARED = (
    "event px(p) = { x: p }; event pxy(p, q) = { x: p, y: q }; event deep(p) = { a: { b: p } }; "
    "time t as s; toplevel r; "
)


@pytest.mark.parametrize(("text", "pattern"), rows(__file__, "patterns.txt"))
def test_patterns(text: str, pattern: str) -> None:
    assert translate(loads(DECLARED + text), "stix", semantics="scattered").text == pattern
    Pattern(pattern)


@pytest.mark.parametrize(("mapping", "message"), rows(__file__, "mappings.txt"))
def test_wrong_mappings(mapping: object, message: str) -> None:
    with pytest.raises(OptionError, match=re.escape(message)):
        translate(loads("event e(p) = { x: p }; r and a; a on e(1);"), "stix", semantics="scattered", mapping=mapping)  # type: ignore[arg-type]


def test_a_mapping_is_read_back() -> None:
    made = loads(
        'event e(p) = { k: { x: p }, e: "e" }; event f(p) = { e: "f", x: p }; r sand a b; a on e(1); b on f(2);'
    )
    objects = {"e": {"k": {"x": "file:size"}, "e": "file:x_event"}, "f": {"e": "process:x_event", "x": "process:pid"}}
    monitor = translate(made, "stix", semantics="scattered", mapping=objects).monitor()
    assert isinstance(monitor, DetectionMonitor)
    one, two = {"k": {"x": 1}, "e": "e"}, {"e": "f", "x": 2, "other": []}
    assert monitor.first_detections([[one, two], [two, one], [{"k": {"x": 2}, "e": "e"}, two], [one, one, two]]) == [
        2,
        None,
        None,
        3,
    ]


@pytest.mark.parametrize(("text", "pattern", "trace"), rows(__file__, "by_hand.txt"))
def test_patterns_by_hand(text: str, pattern: str, trace: str | None, tmp_path: Path) -> None:
    """Where one is wrong, a shortest trace says so."""
    (written := tmp_path / "hand.stix").write_text(pattern)
    _, result = cross_check(loads(text), "scattered", against=[str(written)])
    assert result.detections_only
    assert (None if result.difference is None else list(result.difference.trace)) == (
        None if trace is None else events(trace)
    )


EDITS: list[tuple[str, Callable[[str], str]]] = [
    ("no order", lambda text: text.replace("FOLLOWEDBY", "AND")),
    ("another order", lambda text: re.sub(r"(\[[^]]*\]) FOLLOWEDBY (.*)\) WITHIN", r"\2 FOLLOWEDBY \1) WITHIN", text)),
    ("K - 1", lambda text: text.replace("] AND [", "] OR [")),
    ("no guard", lambda text: text.replace("x-rvaft:f > 2", "x-rvaft:f != 1")),
    ("a guard one off", lambda text: text.replace("> 2", ">= 2")),
    ("a longer window", lambda text: text.replace("WITHIN 3", "WITHIN 4")),
    ("a shorter window", lambda text: text.replace("WITHIN 3", "WITHIN 2")),
    ("a window over less", lambda text: re.sub(r"\((.*)\) WITHIN (.*)", r"\1", text)),
    ("another field", lambda text: text.replace("x-rvaft:e = 1", "x-rvaft:f = 1")),
]


@pytest.mark.parametrize(("name", "edit"), sampled(EDITS, 3))
def test_mistakes_in_a_pattern_show(name: str, edit: Callable[[str], str], tmp_path: Path) -> None:
    declared = "event e(p) = { e: p }; event f(p) = { f: p }; toplevel r; time t as s; "
    made = loads(
        f"{declared} r sand a v within 3 s; v 2of3 d b c; a on e(1); d on e(1); b on f(X) when X > 2; c on e(3);"
    )
    text = translate(made, "stix", semantics="scattered").text
    for pattern, differs in ((text, False), (edit(text), True)) if name == "K - 1" else ((edit(text), True),):
        (written := tmp_path / "hand.stix").write_text(pattern)
        _, result = cross_check(made, "scattered", against=[str(written)], effort=Effort(traces=60))
        assert (result.difference is not None) is differs, (name, pattern, result)


def test_times_that_do_not_increase_are_left_open() -> None:
    monitor = translate(loads("time t as s; r sand a b within 3 s;"), "stix", semantics="scattered").monitor()
    assert isinstance(monitor, DetectionMonitor)
    a, b = {"event": "a", "t": 5}, {"event": "b", "t": "8.000001"}
    assert monitor.first_detections([[a, b], [a, {**b, "t": 8}]]) == [None, 2]
    for trace in ([a, {**b, "t": 5}], [a, {"event": "b"}], [a, {**b, "t": "8.0000001"}], [{**a, "t": -1}]):
        assert monitor.left_open(trace)
        with pytest.raises(TraceError, match="observations are ordered by time"):
            monitor.first_detections([trace])


def test_what_stops_the_matcher_is_said_in_one_line() -> None:
    for pattern, reason in (
        ("[EXISTS x-rvaft:x AND x-rvaft:y = 1]", "unsupported operand"),
        ("[x-rvaft:x ISSUBSET '1.2.3.0/24']", "Invalid IPv4"),
    ):
        with pytest.raises(ToolFailed, match=f"^stix2-matcher failed: {reason}[^\n]*$"):
            StixMonitor(pattern).first_detections([[{"x": "a", "y": 1}]])


def test_texts_are_compared_as_they_are_written() -> None:
    """Neither what Unicode's form NFC makes of a text nor a line break in it changes what is found."""
    texts = [
        "/q/",
        "a/q/b",
        "\n/q/\n",
        "/q\u0301/",
        "q/",
        "/q.exe",
        "/q.exe\n",
        "\u212a/q.exe",
        "/q.ex\u0065\u0301",
        "",
        7,
        True,
    ]
    for guard in (
        'contains(X, "/q/")',
        'endswith(X, "q.exe")',
        'like(X, "*/q*/*")',
        'like(X, "/*.exe")',
        'startswith(X, "/q")',
    ):
        for when in (guard, f"not {guard}"):
            made = loads(f"{DECLARED} r on px(X) when {when};")
            traces: list[list[Json]] = [[{"x": text}] for text in texts]
            try:
                monitor = translate(made, "stix", semantics="scattered").monitor()
            except NotExpressible:
                assert "q*" in guard
                continue
            assert isinstance(monitor, DetectionMonitor)
            found = [next(monitor_of(made, semantics="scattered").run(trace)) is Verdict.TRUE for trace in traces]
            assert [one == 1 for one in monitor.first_detections(traces)] == found, when


def test_sizes_and_limits() -> None:
    with pytest.raises(TooLarge):
        translate(flat(Gate.VOT, 20, 10), "stix", semantics="scattered")
    with pytest.raises(TooLarge):
        StixBackend().translate(tree("toplevel r; r and [p# ]*13; [p# and e# e#'; ]*13"), Semantics.SCATTERED, limit=12)
    assert translate(flat(Gate.VOT, 5, 2), "stix", semantics="scattered").metrics.symbols == 139
    monitor = translate(flat(Gate.SAND, 250), "stix", semantics="scattered").monitor()
    assert isinstance(monitor, DetectionMonitor)
    assert monitor.first_detections([[{"event": f"e{number}"} for number in range(250)]]) == [250]
