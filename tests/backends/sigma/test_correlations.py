"""Correlations of trees, pinned; what is refused; rules written by hand; and mistakes in a correlation."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from backends.sigma.reader import SigmaMonitor
from cross_check.comparison import cross_check
from cross_check.traces import Effort
from rvaft import Gate, TooLarge, TraceError, loads, translate
from rvaft.model.values import Json
from rvaft.monitors import DetectionMonitor
from tests.backends.texts import events, flat
from tests.tables import rows, sampled

DECLARED = (
    'event px(p) = { x: p }; event in(u) = { e: "in", u: u }; event out(u) = { e: "out", u: u }; '
    'event cp(u) = { e: "cp", by: { u: u } }; time t as s; toplevel r; '
)


@pytest.mark.parametrize(("text", "correlation", "selections"), rows(__file__, "correlations.txt"))
def test_correlations(text: str, correlation: object, selections: object) -> None:
    *rules, last = yaml.safe_load_all(translate(loads(DECLARED + text), "sigma", semantics="scattered").text)
    assert last["correlation"] == correlation
    assert {one["name"]: [v for k, v in one["detection"].items() if k != "condition"] for one in rules} == selections


def test_a_choice_of_events_is_one_rule() -> None:
    (rule,) = yaml.safe_load_all(translate(loads(f"{DECLARED}r or a b;"), "sigma", semantics="scattered").text)
    selections = {"selection_1": {"event|cased": "a"}, "selection_2": {"event|cased": "b"}}
    assert rule["detection"] == {**selections, "condition": "1 of selection_*"}


@pytest.mark.parametrize(("text", "correlations"), rows(__file__, "chains.txt"))
def test_correlations_of_correlations(text: str, correlations: object) -> None:
    documents = yaml.safe_load_all(translate(loads(DECLARED + text), "sigma", semantics="scattered").text)
    assert {one.get("name", ""): one["correlation"] for one in documents if "correlation" in one} == correlations


@pytest.mark.ci
@pytest.mark.parametrize(("text", "field", "correlation", "trace"), rows(__file__, "by_hand.txt"))
def test_rules_by_hand(text: str, field: str, correlation: dict[str, Any], trace: str | None, tmp_path: Path) -> None:
    """Where one is wrong, a shortest trace says so."""
    rules = [
        {"title": one, "name": one, "logsource": {"category": "x"}, "detection": {"s": {field: one}, "condition": "s"}}
        for one in correlation["rules"]
    ]
    (written := tmp_path / "hand.yml").write_text(
        yaml.safe_dump_all([*rules, {"title": "it", "correlation": correlation}])
    )
    _, result = cross_check(loads(text), "scattered", against=[str(written)])
    assert result.detections_only
    found = None if result.difference is None else list(result.difference.trace)
    assert found == (None if trace is None else events(trace)), result


@pytest.mark.parametrize(("documents", "trace", "number"), rows(__file__, "written.txt"))
def test_rules_as_people_write_them(documents: list[Any], trace: list[Json], number: int | None) -> None:
    text = yaml.safe_dump_all(documents)
    assert SigmaMonitor(text).first_detections([trace]) == [number]
    if number is not None:
        beginnings = [trace[:length] for length in range(len(trace))]
        assert SigmaMonitor(text).first_detections(beginnings) == [
            number if len(one) >= number else None for one in beginnings
        ]


EDITS: list[tuple[str, Callable[[str], str]]] = [
    ("nothing", lambda text: text),
    ("no order", lambda text: text.replace("temporal_ordered", "temporal")),
    ("another order", lambda text: text.replace("  - a\n  - b\n", "  - b\n  - a\n")),
    ("one event less", lambda text: text.replace("  timespan", "  condition: (a or b) and c\n  timespan")),
    ("no group", lambda text: re.sub(r"  group-by:\n  - u\n", "", text)),
    ("another group", lambda text: text.replace("  - u\n", "  - e\n")),
    ("a longer timespan", lambda text: text.replace("timespan: 3s", "timespan: 4s")),
    ("a shorter timespan", lambda text: text.replace("timespan: 3s", "timespan: 2s")),
    ("another constant", lambda text: text.replace("e|cased: cp", "e|cased: in")),
    ("two of three", lambda text: text.replace("timespan", "condition:\n    gte: 2\n  timespan")),
]


@pytest.mark.parametrize(("name", "edit"), sampled(EDITS, 3))
def test_mistakes_in_a_correlation_show(name: str, edit: Callable[[str], str], tmp_path: Path) -> None:
    declared = "".join(f'event {one}(u) = {{ e: "{one}", u: u }}; ' for one in ("in", "cp", "out"))
    made = loads(f"{declared} time t as s; r sand a b c within 3 s; a on in(User); b on cp(User); c on out(User);")
    (written := tmp_path / "hand.yml").write_text(edit(translate(made, "sigma", semantics="scattered").text))
    _, result = cross_check(made, "scattered", against=[str(written)], effort=Effort(traces=100))
    assert (result.difference is None) is (name == "nothing"), result


def test_what_is_left_open() -> None:
    monitor = translate(
        loads(f"{DECLARED} r sand a b within 2 s; a on in(User); b on out(User);"), "sigma", semantics="scattered"
    ).monitor()
    assert isinstance(monitor, DetectionMonitor)
    a, b = {"e": "in", "u": "bob", "t": 5}, {"e": "out", "u": "bob", "t": 7}
    assert monitor.first_detections([[a, b], [a, {**b, "t": "7.000001"}], [a, {**b, "u": "eve"}]]) == [2, None, None]
    alike: list[tuple[Json, Json]] = [(9007199254740991, 9007199254740991.0), ({"k": 1, "l": 2}, {"l": 2, "k": 1.0})]
    for x, y in alike:
        assert monitor.first_detections([[{**a, "u": x}, {**b, "u": y}]]) == [2]
    some: list[tuple[Json, Json]] = [
        ("bob", "Bob"),
        ("bob", None),
        (3, 3.0000000000000004),
    ]
    for one, other in (
        *(({**a, "u": x}, {**b, "u": y}) for x, y in some),
        (a, {**b, "t": 5}),
        (a, {"e": "out", "u": "bob"}),
    ):
        assert monitor.left_open([one, other])
        with pytest.raises(TraceError, match="Sigma has no verdict for this trace"):
            monitor.first_detections([[one, other]])

    one, other = {"k": 1, "l": [2]}, {"l": [2.0], "k": 1.0}
    assert monitor.first_detections([[{**a, "u": one}, {**b, "u": other}]]) == [2]


def test_a_key_with_a_dot_is_left_open() -> None:
    """Zeek writes the key `id.orig_h`, which products and Sigma write like a field inside `id`."""
    text = "event conn(h) = { id: { orig_h: h } }; r sand a b; a on conn(1); b on conn(2);"
    translated = translate(loads(text), "sigma", semantics="scattered")
    assert "    id.orig_h: 1\n" in translated.text
    monitor = translated.monitor()
    assert isinstance(monitor, DetectionMonitor)
    one, other = ({"id": {"orig_h": host}} for host in (1, 2))
    assert monitor.first_detections([[one, {**other, "id.resp_h": 1, "x.y": 1}]]) == [2]
    for dotted in ({"id.orig_h": 2}, {**other, "id.orig_h": 3}):
        with pytest.raises(TraceError, match="a key with a dot"):
            monitor.first_detections([[one, dotted]])


def test_sizes_and_limits() -> None:
    for gate, size, least in ((Gate.AND, 101, None), (Gate.SAND, 101, None)):
        with pytest.raises(TooLarge, match="rules of the correlation"):
            translate(flat(gate, size, least), "sigma", semantics="scattered")
    assert translate(flat(Gate.VOT, 5, 2), "sigma", semantics="scattered").metrics.symbols == 158
