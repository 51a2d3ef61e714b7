"""Texts, refusals, and texts that people write; agreement with the reference is tested with all backends."""

from pathlib import Path

import pytest

from backends.eql import EqlBackend
from backends.eql.reader import compiled
from rvaft import Semantics, TooLarge, ToolFailed, TraceError, loads
from rvaft.model.values import Json
from rvaft.semantics import Reference
from tests.backends.texts import signs
from tests.cli.runs import run
from tests.tables import rows

BACKEND = EqlBackend()
TEXTS = rows(__file__, "texts.txt")


@pytest.mark.parametrize(("text", "expected"), TEXTS)
def test_text(text: str, expected: list[str]) -> None:
    assert BACKEND.translate(loads(text), Semantics.SCATTERED).text.splitlines()[1:] == expected


def test_a_long_guard() -> None:
    guard = "X < 1"
    for number in range(60):
        guard = f"({guard} {'or' if number % 2 else 'and'} X > {number})"
    with pytest.raises(TooLarge):
        BACKEND.translate(
            loads(f"event e(k) = {{ k: k }}; t sand a b; a on e(X) when not {guard};"), Semantics.SCATTERED
        )


@pytest.mark.parametrize(("text", "trace", "number"), rows(__file__, "runs.txt"))
def test_hand_written(text: str, trace: list[Json], number: int) -> None:
    """Twice, and beside other traces: an engine keeps nothing of one for another."""
    assert compiled(text).first_detections([trace, [], trace, trace[: number - 1], trace]) == [
        number,
        None,
        number,
        None,
        number,
    ]


@pytest.mark.parametrize(
    ("text", "event", "told"),
    [
        ("any where a.b == 1", {"a": {"b": [1]}}, False),
        ("any where a.b == 1", {"a": [{"b": 1}]}, False),
        ("sequence by a [any where true] [any where true]", {"a": []}, False),
        ("any where a.b == 1", {"a": {"b": 1, "c": [1]}, "b": [1]}, True),
        ("file where a == 1", {"a": 1, "event": {"category": ["file"]}}, True),
        ("any where a[0] == 1", {"a": [1]}, True),
        ("any where a == 1 or b != null", {"a": 1, "b": None}, False),
        ("any where a == 1", {"a": 1, "b": None}, True),
    ],
)
def test_of_null_and_of_lists_nothing_is_told_but_by_number(text: str, event: Json, *, told: bool) -> None:
    queries = compiled(text)
    assert bool(queries.left_open([{}, event])) is not told
    if told:
        assert queries.first_detections([[{}, event]]) == [2]
    else:
        with pytest.raises(TraceError, match=r"each element of a list|null from a missing"):
            queries.first_detections([[{}, event]])


EVENT: Json = {"x": "FooBarBaz", "ip": "192.168.152.12", "six": "::ffff:192.168.1.1", "b": True, "n": 1, "o": {}}
EVENT |= {"l": "a\nb", "k": "\N{KELVIN SIGN}elvin", "u": "AB"}


@pytest.mark.parametrize(("condition", "holds"), rows(__file__, "conditions.txt"))
def test_conditions_mean_what_they_do_to_elasticsearch(condition: str, *, holds: bool) -> None:
    assert compiled(f"any where {condition}").first_detections([[EVENT]]) == [1 if holds else None]


WRONG = {  # what a slip in the text makes of it, and a row of the texts on whose trees it shows
    "order dropped": (
        '[any where event == "a"]\n  [any where event == "b"]',
        '[any where event == "b"]\n  [any where event == "a"]',
    ),
    "one event for two": (" with runs=2", ""),
    "one event less": (" with runs=3", " with runs=2"),
    "an order forgotten": (';\nsequence\n  [any where event == "b"]\n  [any where event == "a"]', ""),
    "a guard dropped": (" and ((u == 1) == null or u != 1)", ""),
    "a typed comparison": ('((u == "entrance") == null or u != "entrance")', 'u != "entrance"'),
    "a bound one off": ("u >= -2.5", "u > -2.5"),
    "a null overlooked": ("u != null", "(u == 1 or u != 1)"),
    "contains for startsWith": ("not startsWith(u", "not stringContains(u"),
    "no join": ("sequence by user.name", "sequence"),
    "the wrong key": ("by v[1]", "by v[0]"),
    "a window less by one unit": ("maxspan=10m", "maxspan=599s"),
    "a window more by one unit": ("maxspan=10m", "maxspan=601s"),
}


@pytest.mark.parametrize("slip", WRONG)
def test_a_slip_in_the_text_shows(slip: str) -> None:
    right, wrong = WRONG[slip]
    assert any(
        differs(text, "\n".join(lines).replace(right, wrong)) for text, lines in TEXTS if right in "\n".join(lines)
    )


def differs(text: str, written: str) -> bool:
    made, found = loads(text), compiled(written)
    values: list[Json] = [{"event": name} for name in "abc"]
    values += [{"u": value, "v": [1, value], "event": "b"} for value in (1, 3, None, "entrance", -2.5, -3)]
    values += [{"u": value} for value in ("xA\n'", "entrance", -2.5, -3)]
    values += [{"user": {"name": name}, "ok": ok} for name in ("x", "y") for ok in (False, True)]
    values += [{"and": '"]\\', "a b": "by"}, {"and": 1, "a b": {"by": True}}, {"and": '"]\\', "a b": {"by": True}}]
    values += [{"event": name, "ts": ts} for name, ts in (("a", 0), ("b", 600), ("b", 601))]
    lasts = [*values[:1], *values[-2:], {"user": {"name": "y"}, "ok": True}]
    traces = [[one, other, third] for one in values for other in values for third in [*lasts, other]]
    traces = [trace for trace in traces if not found.left_open(trace)]
    for trace, number in zip(traces, found.first_detections(traces), strict=True):
        signs_of = signs(Reference(made, Semantics.SCATTERED), trace)
        if (signs_of.find("T") + 1 or None) != number:
            return True
    return False


def test_a_rule_is_held_against_a_tree(tmp_path: Path) -> None:
    rule = tmp_path / "rule.eql"
    rule.write_text('sequence [any where event == "a"] [any where event == "b"] [any where event == "c"]')
    good = run("cross-check", "trees/gates/sand.rvaft", "--against", rule, "--semantics", "scattered")
    assert (good.exit_code, "detections only" in good.output) == (0, True)
    rule.write_text('sequence [any where event == "a"] [any where event == "c"]')
    bad = run("cross-check", "trees/gates/sand.rvaft", "--against", rule, "--semantics", "scattered")
    assert (bad.exit_code, "differs after 2 events" in bad.output) == (1, True)
    rule.write_text("sequence\n  [any were true]")
    result = run("cross-check", "trees/gates/sand.rvaft", "--against", rule)
    assert (result.exit_code, result.stderr.splitlines()[0].endswith("2:8: not an EQL query")) == (2, True)


def test_what_the_engine_cannot_run() -> None:
    with pytest.raises(ToolFailed, match="event 2: TypeError"):
        compiled('any where substring(a, b) == "x"').first_detections([[{}, {"a": "x", "b": 0.5}]])
