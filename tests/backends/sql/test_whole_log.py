"""`rvaft monitor --engine duckdb` against the same command without it: output, warnings and status."""

import csv
import json
import random
import re
from collections import Counter
from collections.abc import Sequence
from decimal import Decimal
from pathlib import Path
from typing import Any, Literal

import pytest

from tests.cli.runs import FILES, TREES, run
from tests.tables import sampled

pytest.importorskip("duckdb", reason="DuckDB is not installed")

TYPED = """
event x(u: text) = { event: "x", u: u }; event y(u: text, n: integer) = { event: "y", u: u, n: n };
event z(u: text) = { event: "z", u: u, v: true };
"""
NESTED = """
event x(u: text) = { event: "x", d: { u: u } }; event y(n: number, w: text) = { event: "y", d: { n: n }, u: w };
"""
SCATTERED = "assume types, present; semantics scattered;"
CONSECUTIVE = "assume types, present; semantics consecutive;"
EXACT = "assume types, present, exact; semantics scattered;"
CASES = (
    f"{TYPED} {SCATTERED} time t as s; top sand a b c within 3 s; a on x(U); b on y(U, N) when N > 2; c on z(U);",
    f"{TYPED} {SCATTERED} top or p q; p sand a b; q and b c; a on x(U); b on y(U, N) when N != 1; c attack on z(U);",
    f"{TYPED} {CONSECUTIVE} top sand a b; a on x(U); b on y(U, N) when N <= 3; ignore y(_, N) when N == 2;",
    (
        f"{TYPED} {CONSECUTIVE} time t as s; top or p q; p fault sand a b; q attack and b c; a on x(U); b on y(_, N); "
        "c on z(U);"
    ),
    (
        f"{TYPED} {SCATTERED} time t as s; top 2of3 a b c; a times 2 on x(U); b on y(U, N); "
        'c on z(U) when startswith(U, "a");'
    ),
    "semantics scattered; top sand x y;",
    f"{NESTED} {EXACT} time t as s late 2 s; top sand a b within 2 s; a on x(U); b on y(N, U) when N >= 0.5;",
    (
        'event x(n: integer, m: integer) = { event: "x", n: n, k: m }; event y(n: integer) = { event: "y", n: n };'
        f"{SCATTERED} top pand a b; a and a1 a2; a1 on x(N, M); a2 on y(M); b on x(K, L) when K > N + L;"
    ),
    f'event x(u: text) = {{ kind: 4, u: u }}; {SCATTERED} time t as ms; top sand a b; a on x("a"); b on x("b");',
    (
        f"{TYPED} {SCATTERED} time iso as iso8601; top sand a b within 2 s; a on x(U); b on y(U, _) "
        "when at(b) - at(a) >= 1 s;"
    ),
    f"{TYPED} {SCATTERED} time t as s; top sand a b within 3 s; a times 3 on x(U); b times 3 on y(U, N) when N > 0;",
    f"{TYPED} {SCATTERED} top sand a b without z(U); a on x(U); b on y(U, N) without y(U, M) when M > N before;",
    (
        f"{TYPED} {SCATTERED} time t as s; top or p q; p on y(U, N) when N > 2 without y(U, _) for 0.5 s after "
        "without z(V) when V != U for 1 s before; q attack sand a b; a on x(U) without z(_) for 0.25 s after; "
        "b on z(U);"
    ),
    f"{TYPED} {SCATTERED} time t as s late 2 s; top and a; a on x(U) without y(U, N) when N > 1 for 1 s after;",
    (
        f"{TYPED} {CONSECUTIVE} time t as s; top sand a b without z(_); a on x(U); "
        "b on y(U, N) without x(_) for 1 s after;"
    ),
)
OPTIONS = ((), ("--repeat",), ("--format", "jsonl"), ("--format", "jsonl", "--detections", "--repeat"), ("--explain",))
PER = ((), (), ("--per", "branch"), ("--per", "kind"))
KEYS = ((), ("--key", "u"), ("--key", "kind"), ("--key", "n", "--key", "u"), ("--key", "k"))
INSIDE = (*KEYS, ("--key", "d.u"), ("--key", "q"), ("--key", "q", "--max-keys", "4"))
MIXED = (1, 1.0, -0.0, 0, "1", "1.0", None, "null", True, "true", "é", 1e3, 1000, 0.1, 1e-7, "")
ODD = (None, "5", 5, 5.0, "X", "/x", " x", False, [1], {"a": 1}, 10**20, 2**60, "é", "\0", "😀", 1.1234567890123, "a,]")
LINES = ("", "  ", "null", "{}", '{"event": "x", "u": "a", "t": 1} x', "\f")
"""Lines that are no events, or events without a field."""
ENDS = (",}", ', "u": "b"}', ', "U": "b"}', ', "q": NaN}', ', "u": NaN}', ', "\\u0075": "b"}', ', "t": 1e999}', "}\r")
"""Ends of lines that are not JSON, or that other programs read in another way."""


QUOTING: list[Literal[0, 1, 2]] = [0, 1, 2]
FRACTIONS = ("", ".5", ",25", ".123456789")


def event(draw: random.Random, time: float, odd: float) -> dict[str, Any]:
    user = draw.choice("ab")
    made: dict[str, Any] = {
        "event": draw.choice("xyzxyzw"),
        "u": user,
        "n": draw.randint(0, 4),
        "t": time,
        "v": True,
        "k": draw.randint(0, 4),
        "d": {"u": user, "n": draw.choice([0, 0.5, 1, 2])},
        "kind": draw.choice([4, 4.0, 4.5]),
        "q": draw.choice(MIXED),
        "iso": f"2024-01-01T00:00:{int(time) % 60:02}{draw.choice(FRACTIONS)}{draw.choice(['', 'Z', '+00:00'])}",
    }
    if draw.random() < odd:
        made[draw.choice(list(made))] = draw.choice(ODD)
    if draw.random() < odd:
        made.pop(draw.choice(list(made)))
    return made


def events(draw: random.Random, odd: float) -> list[dict[str, Any]]:
    made, time, digits = list[dict[str, Any]](), draw.choice([0.0, 1_700_000_000.0]), draw.choice([6, 30])
    for _ in range(draw.choice([3, 20, 100])):
        time = round(time + draw.choice([0, 0.1, 0.25, 1]), digits)
        made.append(event(draw, time, odd))
    return made


def written(draw: random.Random, odd: float) -> str:
    lines = []
    for one in events(draw, odd):
        line = json.dumps(one, ensure_ascii=draw.random() < 0.5, separators=draw.choice([(",", ":"), (", ", ": ")]))
        if draw.random() < odd / 3:
            line = draw.choice([*LINES, *(line[:-1] + end for end in ENDS)])
        lines.append(line)
    return "\n".join(lines) + draw.choice(["\n", "\n\n", ""])


NEAR = re.compile(r"^near misses, closest first:\n(?:  .*\n)+(?:note: .*near misses.*\n)*", re.MULTILINE)
"""What the engine says beside, of events that a query does not keep."""


def differences(tree: Path, log: Path, options: Sequence[str]) -> tuple[bool, bool]:
    """Compare the runs; return whether DuckDB answered, and whether something was detected."""
    plain, asked = run("monitor", tree, log, *options), run("monitor", tree, log, *options, "--engine", "duckdb")
    told = [line for line in asked.stderr.splitlines() if "is read without DuckDB: " not in line]
    assert (asked.stdout, asked.exit_code) == (NEAR.sub("", plain.stdout), plain.exit_code)
    assert told == plain.stderr.splitlines()
    return "is read without DuckDB" not in asked.stderr, plain.exit_code == 1


@pytest.mark.ci
@pytest.mark.parametrize("first", sampled(((first,) for first in range(0, 600, 60)), 10, ci=5))
def test_json_lines(first: int, tmp_path: Path) -> None:
    seen = Counter[str]()
    tree, log = tmp_path / "tree.rvaft", tmp_path / "log.jsonl"
    for seed in range(first, first + 70):
        draw = random.Random(seed)
        tree.write_text(CASES[seed % len(CASES)])
        log.write_text(written(draw, draw.choice([0, 0, 0.004, 0.02])), encoding="utf-8")
        keys = () if " after" in tree.read_text() else draw.choice(INSIDE)
        answered, found = differences(tree, log, [*draw.choice(OPTIONS), *draw.choice(PER), *keys])
        seen.update({"answered": answered, "found": answered and found, "declined": not answered})
    assert seen["answered"] > 30
    assert seen["found"] > 10
    assert seen["declined"] > 3


BY_VALUE = (
    "time t as s; top sand a b within 2 s; a on x(U); b on y(U, N) when N > 1;",
    "time t as s; top or p q; p sand a b; q and b c; a on x(U); b on y(U, _); c attack on z(U);",
    "time t as s; top and f within 2 s; f on y(U, N) times 3 distinct N;",
    "time t as s; top sand a f; a on x(U); f on y(U, _) times 3;",
    "top sand a b without z(U); a on x(U); b on y(U, N) without y(U, M) when M > N before;",
    "time t as s; top on x(U) without x(U) for 0.5 s after;",
    "time t as s late 2 s; top 2of3 a b c within 3 s; a on x(U); b on y(U, 2); c on z(U);",
    "top on y(U, 2);",
)


@pytest.mark.ci
@pytest.mark.parametrize("first", sampled(((first,) for first in range(0, 400, 40)), 10, ci=5))
def test_repetition_by_a_variable(first: int, tmp_path: Path) -> None:
    """By an option or by the tree, also within keys, in files with few and with many values."""
    tree, log = tmp_path / "tree.rvaft", tmp_path / "log.jsonl"
    seen = Counter[str]()
    for seed in range(first, first + 32):
        draw = random.Random(f"by {seed}")
        text, said = BY_VALUE[seed % len(BY_VALUE)], draw.random() < 0.5
        tree.write_text(f"{TYPED} {SCATTERED} {'repeat by U; ' if said else ''}{text}")
        lines = [json.dumps({**one, "u": draw.choice("abcd")}) for one in events(draw, 0)]
        log.write_text("".join(f"{line}\n" for line in lines))
        by = ("--repeat",) if said else ("--repeat-by", "U")
        keys = draw.choice([(), (), ("--key", "n")]) if " after" not in text else ()
        form = draw.choice([(), ("--format", "jsonl"), ("--format", "jsonl", "--detections"), ("--explain",)])
        answered, found = differences(tree, log, [*by, *keys, *form])
        seen.update({"answered": answered, "found": found})
    assert seen["answered"] > 24
    assert seen["found"] > 6


def test_only_the_detected_value_starts_afresh(tmp_path: Path) -> None:
    tree, log = tmp_path / "tree.rvaft", tmp_path / "log.jsonl"
    tree.write_text(JOIN)
    log.write_text("".join(f'{{"event": "{kind}", "u": "{u}", "n": 1}}\n' for kind, u in ("xa", "xb", "ya", "yb")))
    for options, detections in ((["--repeat"], ["3"]), (["--repeat-by", "U"], ["3", "4"])):
        assert differences(tree, log, options) == (True, True)
        found = run("monitor", tree, log, *options, "--engine", "duckdb").stdout
        assert re.findall(r"^event (\d+): true", found, re.MULTILINE) == detections


@pytest.mark.parametrize(
    ("unit", "scale", "nested"), [("s", 9, False), ("s", 9, True), ("ms", 6, False), ("ns", 0, True)]
)
def test_times_are_rounded_as_the_definition_does(unit: str, scale: int, nested: bool, tmp_path: Path) -> None:
    """Pairs of events around the end of a window, written with more digits than nanoseconds have."""
    draw = random.Random(f"{unit} {nested}")
    tree, log = tmp_path / "tree.rvaft", tmp_path / "log.jsonl"
    field = "time.of" if nested else "time"
    tree.write_text(f"{TYPED} {SCATTERED} time {field} as {unit}; top sand a b within 1 s; a on x(_); b on y(_, _);")
    lines = []
    for pair in range(200):
        start = Decimal(draw.randrange(10**9)).scaleb(-9) + 10 * pair - 500
        end = start + 1 + Decimal(draw.choice([0, -4, 4, -5, 5, -6, 6, 51, -51])).scaleb(-10)
        for name, time in (("x", start + Decimal(draw.choice([0, 5, 3])).scaleb(-10)), ("y", end)):
            number = time.scaleb(9 - scale)
            text = draw.choice([f"{number:f}", f"{number:f}" + "0" * (scale == 9), str(number)])
            moment = f'"time": {{"of": {text}}}' if nested else f'"time": {text}'
            lines.append((pair, f'{{"event": "{name}", "u": "{pair}", "n": 1, {moment}}}'))
    for some in (lines[:4], lines):
        log.write_text("".join(f"{line}\n" for _, line in some))
        plain = run("monitor", tree, log, "--key", "u")
        asked = run("monitor", tree, log, "--key", "u", "--engine", "duckdb")
        assert (asked.stdout, asked.exit_code) == (plain.stdout, plain.exit_code)
    assert 20 < plain.stdout.count(": true") < 180
    assert "without DuckDB" not in asked.stderr


@pytest.mark.ci
@pytest.mark.parametrize("first", sampled(((first,) for first in range(0, 400, 40)), 10, ci=5))
def test_tables(first: int, tmp_path: Path) -> None:
    pa = pytest.importorskip("pyarrow", reason="pyarrow is not installed")
    pq = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")
    seen = Counter[str]()
    tree = tmp_path / "tree.rvaft"
    for seed in range(first, first + 40):
        draw = random.Random(seed)
        tree.write_text(CASES[seed % len(CASES)].replace(", v: true", ""))
        rows = [{name: value for name, value in one.items() if name not in ("d", "q", "v")} for one in events(draw, 0)]
        if draw.random() < 0.2:
            rows[-1]["n"] = None
        if seed // len(CASES) % 2:
            log = tmp_path / "log.csv"
            with log.open("w", newline="", encoding="utf-8") as stream:
                delimiter, end = draw.choice(",;\t"), draw.choice(["\n", "\r\n"])
                quoting = draw.choice(QUOTING)
                table = csv.DictWriter(stream, list(rows[0]), delimiter=delimiter, lineterminator=end, quoting=quoting)
                table.writeheader()
                table.writerows(rows)
        else:
            log = tmp_path / "log.parquet"
            columns = {name: pa.array([row[name] for row in rows]) for name in rows[0]}
            if draw.random() < 0.3:
                milliseconds = [int(row["t"] * 1000) for row in rows]
                columns["iso"] = pa.array(milliseconds, pa.timestamp("ms", draw.choice([None, "UTC"])))
            pq.write_table(pa.table(columns), log, row_group_size=draw.choice([7, 1000]))
        keys = () if " after" in tree.read_text() else draw.choice(KEYS)
        answered, found = differences(tree, log, [*draw.choice(OPTIONS), *keys])
        seen.update({"answered": answered, "found": answered and found})
    assert seen["answered"] > 20
    assert seen["found"] > 5


@pytest.mark.ci
def test_logs_of_shipped_trees() -> None:
    answered = 0
    for tree in sorted(TREES.rglob("*.rvaft")):
        for log in sorted(tree.with_suffix(".traces").glob("*.jsonl"))[:2]:
            asked = run("monitor", tree, log, "--semantics", "scattered", "--engine", "duckdb")
            if asked.exit_code == 2:
                assert re.search("does not write this tree|no-scenario", asked.stderr), asked.stderr
                break
            answered += differences(tree, log, ["--semantics", "scattered"])[0]
    assert answered > 10


JOIN = f"{TYPED} {SCATTERED} top sand a b; a on x(U); b on y(U, _);"


def test_many_matches_are_found_event_by_event(tmp_path: Path) -> None:
    """200 × 200 matches: more than a query returns."""
    tree, log = tmp_path / "tree.rvaft", tmp_path / "log.jsonl"
    tree.write_text(JOIN)
    lines = [{"event": kind, "u": "a", "n": 1} for kind in "xy" for _ in range(200)]
    log.write_text("".join(f"{json.dumps(line)}\n" for line in lines))
    assert differences(tree, log, []) == differences(tree, log, ["--repeat"]) == (True, True)


def test_the_fiftieth_misspelt_event(tmp_path: Path) -> None:
    """Of events without a match, statistics look at the first ones of each spelling."""
    tree, log = tmp_path / "tree.rvaft", tmp_path / "log.jsonl"
    tree.write_text(JOIN)
    kinds = [*["X", "/y", "other", "x"] * 50, "ÿ", "ſ", *map(str, range(50))]
    lines = [{"event": kind, "u": "a", "n": 1} for kind in kinds]
    log.write_text("".join(f"{json.dumps(line)}\n" for line in lines))
    assert differences(tree, log, []) == (True, False)
    assert "near miss: at least 20 events would be x" in run("monitor", tree, log, "--engine", "duckdb").stdout


DECLINED = {
    "a broken type": ('{"event": "x", "u": 5}', "event 2 breaks an assumption"),
    "an absent field": ('{"event": "y", "u": "a"}', "event 2 breaks an assumption"),
    "null": ('{"event": "x", "u": null}', "event 2 breaks an assumption"),
    "a large integer": ('{"event": "y", "u": "a", "n": 9223372036854775808}', "a value that a column cannot hold"),
    "a double beyond 64 bits": ('{"event": "y", "u": "a", "n": 1e30}', "a value that a column cannot hold"),
    "NaN": ('{"event": "y", "u": "a", "n": NaN}', "not finite|cannot hold"),
    "an infinite double": ('{"event": "x", "u": 1e999}', "cannot hold|breaks"),
    "a repeated key": ('{"event": "x", "u": "a", "u": "b"}', "repeated"),
    "a repeated key with an escape": ('{"event": "x", "u": "a", "\\u0075": "b"}', "repeated"),
    "a trailing comma": ('{"event": "x", "u": "a",}', "not JSON"),
    "a list": ("[1]", "cannot hold|not a JSON object"),
    "no JSON": ("x", "DuckDB"),
    "two objects": ('{"event": "x", "u": "a"} {"event": "x", "u": "a"}', "DuckDB"),
    "a form feed": ('\f{"event": "x", "u": "a"}', "control character"),
    "deep nesting": (f'{{"q": {"[" * 600}{"]" * 600}}}', "nested|DuckDB"),
    "a long number": (f'{{"q": {"1" * 5000}}}', "digits|DuckDB"),
}


@pytest.mark.parametrize("name", DECLINED)
def test_what_duckdb_may_read_in_another_way_is_read_without_it(name: str, tmp_path: Path) -> None:
    tree, log = tmp_path / "tree.rvaft", tmp_path / "log.jsonl"
    tree.write_text(JOIN)
    line, reason = DECLINED[name]
    log.write_text(f'{{"event": "x", "u": "a"}}\n{line}\n{{"event": "y", "u": "a", "n": 1}}\n')
    assert not differences(tree, log, [])[0]
    assert re.search(reason, run("monitor", tree, log, "--engine", "duckdb").stderr)


ONE = f"{TYPED} {SCATTERED} top on x(U);"
LATE = f"{TYPED} {SCATTERED} time t as s late 2 s; top sand a b within 3 s; a on x(U); b on y(U, _);"
DRIFT = "".join(
    f'{{"event": "{kind}", "u": "a", "n": 1, "k": {key}, "t": {time + 100 * key}}}\n'
    for kind, time in (("x", 5), ("y", 6), ("x", 9), ("y", 8), ("y", 10))
    for key in range(3)
)
"""Events of three keys, 100 s apart: none is late among those of its key."""
BY_KEY = {
    "events without the key": (ONE, '{"event": "x", "u": "a"}\n{"event": "x", "u": "a", "k": 1}\n', True),
    "late only beside other keys": (LATE, DRIFT, True),
    "late for its key": (LATE, DRIFT + '{"event": "x", "u": "a", "k": 0, "t": 7}\n', False),
    "a long number": (ONE, '{"event": "x", "u": "a", "k": 12345678901234567890}\n', False),
    "an object": (ONE, '{"event": "x", "u": "a", "k": {"id": 1}}\n', False),
    "a key inside a field": ("semantics scattered; top sand x y;", '{"event": "x", "event.u": 1}\n', False),
    "two fields of one name": ("semantics scattered; top sand x y;", '{"event": "x", "k": {"k": 1}}\n', True),
}


@pytest.mark.parametrize("name", BY_KEY)
def test_keys(name: str, tmp_path: Path) -> None:
    text, lines, answered = BY_KEY[name]
    tree, log = tmp_path / "tree.rvaft", tmp_path / "log.jsonl"
    tree.write_text(text)
    log.write_text(lines)
    key = {"a key inside a field": "event.u", "two fields of one name": "k.k"}.get(name, "k")
    for options in (["--repeat"], ["--format", "jsonl", "--repeat"], ["--max-keys", "1"]):
        found = differences(tree, log, ["--key", key, *options])
        assert found[0] == (answered and not ("beside" in name and "1" in options))


def test_a_table_without_the_key(tmp_path: Path) -> None:
    tree, log = tmp_path / "tree.rvaft", tmp_path / "log.csv"
    tree.write_text("semantics scattered; top sand x y;")
    log.write_text("event,user\nx,a\ny,a\n")
    assert differences(tree, log, ["--key", "user"]) == (True, True)
    assert differences(tree, log, ["--key", "host"]) == (False, False)
    assert "there is no column host" in run("monitor", tree, log, "--key", "host", "--engine", "duckdb").stderr


@pytest.mark.parametrize(
    ("place", "cell", "end"),
    [(1, "2", "\n"), (3, '"2"', "\r\n"), (2, '"2,""3"', "\n"), (3, "", "\n"), (3, "2,", "\n"), (100_000, "2", "\r\n")],
)
def test_a_line_with_a_separator_after_the_last_cell(place: int, cell: str, end: str, tmp_path: Path) -> None:
    """It is malformed, but DuckDB accepts it. A line may end with an empty cell."""
    tree, log = tmp_path / "tree.rvaft", tmp_path / "log.csv"
    tree.write_text("semantics scattered; top sand x y;")
    lines = ["event,user", "x,a", "w,", "y,a", *["w,some one"] * place]
    log.write_text(end.join(lines))
    assert differences(tree, log, []) == (True, True)
    lines[place] = f"w,{cell},"
    log.write_text(end.join(lines))
    assert differences(tree, log, [])[0] is False


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_an_empty_line_in_a_table_of_one_column(end: str, tmp_path: Path) -> None:
    tree, log = tmp_path / "tree.rvaft", tmp_path / "log.csv"
    tree.write_text("semantics scattered; top sand x y;")
    log.write_text(end.join(["event", "x", "y", ""]))
    assert differences(tree, log, []) == (True, True)
    log.write_text(end.join(["event", "x", "", "y", ""]))
    assert differences(tree, log, []) == (False, True)


def test_the_longest_of_several_matches(tmp_path: Path) -> None:
    """With all events since its begin, the monitors explain the branch that they explain without DuckDB."""
    tree, log = tmp_path / "tree.rvaft", tmp_path / "log.jsonl"
    tree.write_text(
        f"{TYPED} {CONSECUTIVE} top or p q; p sand x1 y1 z1; q sand a b; "
        "x1 on x(_); y1 on y(_, _); z1 on z(_); a on y(_, _); b on z(_);"
    )
    log.write_text("".join(f'{{"event": "{name}", "u": "a", "n": 1, "v": true}}\n' for name in "xyz"))
    for options in ([], ["--repeat"], ["--key", "u"]):
        assert differences(tree, log, options) == (True, True)


def test_a_field_that_is_read_as_a_whole_and_inside(tmp_path: Path) -> None:
    tree, log = tmp_path / "tree.rvaft", tmp_path / "log.jsonl"
    tree.write_text(
        'event x(u: text) = { event: "x", u: u }; event y(v: text) = { event: "y", u: { v: v } };'
        f"{SCATTERED} top sand a b; a on x(U); b on y(V);"
    )
    log.write_text('{"event": "x", "u": "a"}\n{"event": "y", "u": {"v": "b"}}\n')
    assert differences(tree, log, []) == (False, True)


REFUSED: Sequence[tuple[str, list[str], str]] = (
    (JOIN, ["--repeat-by", "N"], "matches cannot be repeated by N"),
    (JOIN, ["--follow"], "--engine does not take --follow: a query reads a whole file"),
    (JOIN, ["--checkpoint", "state"], "--engine does not take --checkpoint"),
    (JOIN, ["--order-by", "t"], "--engine does not take --order-by"),
    (JOIN, ["--format", "table"], "--engine does not take --format table"),
    (JOIN, ["--semantics", "projected"], "a query does not tell when a verdict becomes false"),
    (JOIN.replace("assume types, present;", ""), [], "typed columns need `assume types, present;`"),
    (JOIN.replace("n: integer", "n"), [], "a column has text, numbers or Booleans"),
    (f"{TYPED} {SCATTERED} time t as filetime; top on x(U);", [], "DuckDB does not read times as filetime"),
    (f"{TYPED} {SCATTERED} top on y(_, N) when N * 2 > 3;", [], "guards with *, / and number()"),
)


@pytest.mark.parametrize(("text", "options", "reason"), REFUSED)
def test_refusals(text: str, options: list[str], reason: str, tmp_path: Path) -> None:
    tree, log = tmp_path / "tree.rvaft", tmp_path / "log.jsonl"
    tree.write_text(text)
    log.touch()
    done = run("monitor", tree, log, "--engine", "duckdb", *options)
    assert done.exit_code == 2
    assert reason in done.stderr


def test_standard_input_and_other_engines_are_refused() -> None:
    tree = FILES["SAND"]
    assert "name a TRACE" in run("monitor", tree, "--semantics", "scattered", "--engine", "duckdb", data="").stderr
    assert "unknown engine duck; known: duckdb" in run("monitor", tree, "log.jsonl", "--engine", "duck").stderr
