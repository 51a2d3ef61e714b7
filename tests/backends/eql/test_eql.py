"""Texts, refusals, and texts that people write; agreement with the reference is tested with all backends."""

from contextlib import suppress
from pathlib import Path
from random import Random

import pytest

from backends.eql import EqlBackend
from backends.eql.reader import compiled
from rvaft import NotExpressible, OptionError, Semantics, TooLarge, ToolFailed, TraceError, loads
from rvaft.errors import Cause
from rvaft.model.values import Json
from rvaft.semantics import Reference
from tests.backends.texts import agreeing, signs
from tests.cli.runs import run
from tests.tables import rows, sampled

BACKEND = EqlBackend()
TEXTS = rows(__file__, "texts.txt")


@pytest.mark.parametrize(("text", "expected"), TEXTS)
def test_text(text: str, expected: list[str]) -> None:
    assert BACKEND.translate(loads(text), Semantics.SCATTERED).text.splitlines()[1:] == expected


def test_a_long_guard() -> None:
    guard = "X < 1"
    for number in range(60):
        guard = f"({guard} {'or Y' if number % 2 else 'and X'} > {number})"
    with pytest.raises(TooLarge):
        BACKEND.translate(
            loads(f"event e(k, l) = {{ k: k, l: l }}; t sand a b; a on e(X, Y) when not {guard};"), Semantics.SCATTERED
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


@pytest.mark.parametrize("slip", sampled(WRONG, 4))
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


MISSING = BACKEND.mapped({"missing_events": True})
NEW = "time t as s; event e(k, u) = { k: k, u: u }; event f(k, w) = { k: k, w: w }; "


@pytest.mark.parametrize(("text", "expected"), rows(__file__, "missing.txt"))
def test_missing_events(text: str, expected: list[str] | str) -> None:
    made = loads(text)
    if isinstance(expected, str):
        with pytest.raises(NotExpressible, match=expected) as raised:
            MISSING.translate(made, Semantics.SCATTERED)
        assert raised.value.cause is Cause.WRITER
    else:
        assert MISSING.translate(made, Semantics.SCATTERED).text.splitlines()[1:] == expected
    with pytest.raises(NotExpressible):
        BACKEND.translate(made, Semantics.SCATTERED)


def new_tree(random: Random) -> str:
    """A tree of single events, some of which need that others did not come for a time."""

    def without() -> str:
        own, when = random.choice(
            (("U", ""), ("_", ""), ('"x"', ""), ("V", " when V == 1"), ("U", " when U != 2"), ("V", " when V > 1"))
        )
        call = f'{random.choice("ef")}("{random.choice("abcd")}", {own}){when}'
        return f" without {call} for {random.choice(('2 s', '1 s', '1500 ms'))} before"

    names = ("l0", "l1", "l2")[: random.choice((1, 2, 3))]
    leaves = [
        f'{name} on {random.choice("ef")}("{random.choice("abc")}", U){"".join(without() for _ in range(count))}; '
        for name in names
        for count in [random.choice((0, 1, 1, 1, 2))]
    ]
    late = random.choice(("", " late 0 s", " late 2 s"))
    gate = f"top or {' '.join(names)}; " if len(names) > 1 else "top and l0; "
    return f"{NEW.replace('as s', f'as s{late}')}toplevel top; {gate}{''.join(leaves)}"


def new_trace(random: Random, count: int) -> list[Json]:
    clock, made = 0.0, list[Json]()
    for _ in range(count):
        clock += random.choice((0, 0.5, 1, 1, 2, 2.5, 0.0004))
        event: dict[str, Json] = {"k": random.choice("abcdx"), "w": random.choice((1, 2, "x"))}
        event |= {"u": random.choice((1, 2, 3, "x"))} if random.random() < 0.9 else {}
        made.append(event | ({"t": clock} if random.random() < 0.9 else {}))
    return made


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 5))])
def test_missing_events_of_random_trees(seed: int) -> None:
    random, compared, left = Random(f"missing {seed}"), 0, 100 if seed else 25
    while left:
        made = loads(new_tree(random))
        with suppress(NotExpressible):
            if "![" in MISSING.translate(made, Semantics.SCATTERED).text:
                traces = [new_trace(random, count) for count in (3, 5, 8, 10)]
                compared += agreeing(MISSING, made, Semantics.SCATTERED, traces)
                left -= 1
    assert compared > 40


FIRST_SEEN = f'{NEW}top on e("a", U) without e("b", U) for 2 s before;'


@pytest.mark.parametrize(
    ("old", "new"),
    [("maxspan=2s", "maxspan=3s"), ("maxspan=2s", "maxspan=1s"), ('!"b"', '"c"'), ("sequence by u", "sequence")],
)
def test_a_fault_in_a_missing_event_is_found(old: str, new: str) -> None:
    old = old.replace("!", "")
    text, random = MISSING.translate(loads(FIRST_SEEN), Semantics.SCATTERED).text, Random(f"{old} {new}")
    assert old in text
    monitor = compiled(text.replace(old, new))
    traces = [one for one in (new_trace(random, 12) for _ in range(200)) if not monitor.left_open(one)]
    made = loads(FIRST_SEEN)
    wanted = [signs(Reference(made, Semantics.SCATTERED), one).find("T") + 1 or None for one in traces]
    assert monitor.first_detections(traces) != wanted


@pytest.mark.parametrize(
    ("events", "told"), [("1 0.1, 2 0.9", False), ("1 0.9, 2 1", True), ("2 0, 2 0", True), ("2 1, 2 0", False)]
)
def test_a_missing_event_in_the_same_millisecond_is_left_open(events: str, *, told: bool) -> None:
    """An event is its value of `a`, and its time in milliseconds."""
    queries = compiled("// time t as ms\nsequence with maxspan=1s ![any where a == 1] [any where a == 2]")
    pairs = (one.split() for one in events.split(", "))
    assert (not queries.left_open([{"a": int(value), "t": float(time)} for value, time in pairs])) == told


def test_the_option_for_missing_events(tmp_path: Path) -> None:
    (tree := tmp_path / "new.rvaft").write_text(f"semantics scattered; {FIRST_SEEN}", encoding="utf-8")
    assert "![any where" in run("emit", tree, "--to", "eql", "--missing-events").stdout
    assert run("emit", tree, "--to", "eql").exit_code == 2
    assert "--missing-events is for eql" in run("emit", tree, "--to", "sql", "--missing-events").stderr
    with pytest.raises(OptionError, match="no other mapping"):
        BACKEND.mapped({"missing_events": 1})
