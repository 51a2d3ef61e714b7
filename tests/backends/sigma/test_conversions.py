"""The rules of the shipped trees in pySigma's backends, which need an environment of their own."""

import re
from itertools import combinations, product
from typing import Any

import pytest

import rvaft
from tests.backends.sigma import conversions
from tests.tables import rows

pytestmark = [
    pytest.mark.ci,
    pytest.mark.skipif(not conversions.PYTHON.exists(), reason="needs pySigma's backends: make converters"),
]


def test_the_conversions_are_those_stored() -> None:
    """SQLite agrees on every tree with a text, and the validators find nothing in the detections."""
    table, issues = conversions.measured()
    assert [list(row) for row in table] == rows(__file__, "conversions.txt")
    assert conversions.page(table) in conversions.PAGE.read_text(encoding="utf-8")
    assert {shape for name, shape, _ in table if name.startswith(conversions.DETECTIONS)} == {*conversions.SHAPES}
    assert all("sqlite" in by["agrees"] for _, _, by in table if by)
    assert issues == []


def bucketed(tree: rvaft.RVAFT, trace: list[Any], span: int) -> bool:
    """Whether a bucket of time has a detection: what `bin` and `date_trunc` leave of a window."""
    buckets: dict[int, list[Any]] = {}
    for event in trace:
        buckets.setdefault(event["t"] // span, []).append(event)
    return any(conversions.first(tree, part) for part in buckets.values())


def test_a_shortest_trace_that_fixed_buckets_miss() -> None:
    tree = rvaft.loads((conversions.ROOT / "docs/findings/window.rvaft").read_text(encoding="utf-8"))
    texts = {"window": rvaft.translate(tree, "sigma", semantics="scattered").text}
    converted = conversions.run(texts)["window"][0]
    spans = {target: re.search(r"(?:span=|date_trunc\()(\w+)", converted[target][0]) for target in ("splunk", "esql")}
    assert {target: found and found[1] for target, found in spans.items()} == {"splunk": "10m", "esql": "10minutes"}
    logs = (
        [{"event": name, "user": "root", "t": time} for name, time in zip(names, times, strict=True)]
        for length in (1, 2)
        for times in combinations((0, 599, 600, 601), length)
        for names in product("ab", repeat=length)
    )
    missed = (log for log in logs if bool(conversions.first(tree, log)) != bucketed(tree, log, 600))
    assert next(missed) == [{**one, "user": "root"} for one in ({"event": "a", "t": 0}, {"event": "b", "t": 600})]
