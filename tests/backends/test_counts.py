"""Counted leaves in the languages that query tables, held against the reference on random trees."""

import re
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from importlib.util import find_spec
from random import Random
from typing import Any, Final

import pytest

from rvaft import RVAFT, NotExpressible, RvaftError, Semantics, TooLarge, Verdict, dumps, loads
from rvaft.backend import backend
from rvaft.rules.validity import require_valid
from rvaft.semantics import Reference
from tests.tables import part_and_whole, sampled

TYPED: Final = "".join(
    f'event {k}(u: text, v: integer, w: integer) = {{ k: "{k}", u: u, v: v, w: w }}; ' for k in "abc"
)
FORMS: Final = ("", "", " each V", " each V, W", " distinct V", " distinct V", " distinct V, W", " distinct V each W")
needs_duckdb: Final = pytest.mark.skipif(not find_spec("duckdb"), reason="needs DuckDB")
LANGUAGES: Final = ["sql", "sql-table", "kql"] + [
    pytest.param(name, marks=needs_duckdb) for name in ("sql-duckdb", "sql-table-duckdb")
]


def leaf(random: Random, name: str, *, timed: bool) -> str:
    """A leaf, most often with several events."""
    letter, number = random.choice("aab"), random.choice((1, 3, 3, 4))
    form = random.choice(FORMS) if number > 1 else ""
    own = {word.strip(",") for word in form.split()[1:]}
    v, w = (f"{one}{name}" if one in own else random.choice(("_", "_", "1")) for one in "VW")
    text = f"{name} on {letter}({random.choice('UUU_')}, {v}, {w})"
    if own and random.random() < 0.4:
        text += f" when {random.choice([one + name for one in sorted(own & {'V', 'W'})])} {random.choice(('<', '>'))} 1"
    if number > 1:
        named = " ".join(word.replace("V", f"V{name}").replace("W", f"W{name}") for word in form.split())
        text += f" times {number} {named}"
    if random.random() < 0.2:
        sides = ("", " for 1 s after", " for 1 s before", " before") if timed else ("", " before")
        text += f" without c({random.choice('U_')}, _, _){random.choice(sides)}"
    return f"{text};"


def tree_of(random: Random) -> str:
    timed = random.random() < 0.8
    names = [f"l{number}" for number in range(random.choice((1, 1, 2, 2, 3)))]
    leaves = " ".join(leaf(random, name, timed=timed) for name in names)

    def window() -> str:
        return f" within {random.choice((1, 2, 4, 6))} s" if timed and random.random() < 0.6 else ""

    gate = random.choice(("and", "sand", "sand", "pand", "or")) if len(names) > 1 else "and"
    if len(names) == 3 and random.random() < 0.5:
        gates = f"top {gate} l0 g{window()}; g {random.choice(('sand', 'and', 'or'))} l1 l2{window()};"
    elif random.random() < 0.3:
        gates = f"top {gate} g {' '.join(names[1:])}{window()}; g and l0{window()};"
    else:
        gates = f"top {gate} {' '.join(names)}{window()};"
    time = f"time t as s; {random.choice(('', 'assume order 0 s;', 'assume order 0 s;', 'assume order 1 s;'))}"
    return f"{TYPED}assume types, present; {time if timed else ''} toplevel top; {gates} {leaves}"


def trees(random: Random, count: int) -> Iterator[RVAFT]:
    while count:
        with suppress(RvaftError):
            tree = loads(tree_of(random))
            require_valid(tree)
            count -= 1
            yield tree


def trace_of(random: Random, tree: RVAFT) -> list[Any]:
    """A trace that keeps the assumptions of a tree."""
    late = 1 if tree.time is None or tree.time.late is None else tree.time.late // 10**9
    now, trace, letters = 0, list[Any](), random.choice(("aaab", "aabb", "aaabc", "aabbc"))
    for _ in range(random.randrange(4, 16)):
        now += random.choice((0, 0, 1, 1, 2))
        event = {"k": random.choice(letters), "u": random.choice(("x", "x", "y"))}
        values = {"v": random.randrange(4), "w": random.randrange(3)}
        back = random.choice((0, 0, 1)) if late else 0
        trace.append({**event, **values, "t": now - back})
    return trace


@pytest.mark.parametrize("count", [*part_and_whole(10, 60), pytest.param(200, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", LANGUAGES)
def test_counted_leaves_of_random_trees(name: str, count: int) -> None:
    random, seen = Random(f"counts {name}"), Counter[str]()
    for tree in trees(random, count):
        try:
            specification = backend(name).translate(tree, Semantics.SCATTERED)
        except (NotExpressible, TooLarge):
            seen["refused"] += 1
            continue
        traces = [trace_of(random, tree) for _ in range(15)]
        verdicts = [[*Reference(tree, Semantics.SCATTERED).run(trace)] for trace in traces]
        wanted = [run.index(Verdict.TRUE) + 1 if Verdict.TRUE in run else None for run in verdicts]
        found = specification.monitor().first_detections(traces)  # type: ignore[attr-defined]
        assert found == wanted, (dumps(tree), specification.text, [*zip(traces, found, wanted, strict=True)])
        seen.update(
            {"detected": any(wanted), "one row": any(one in specification.text for one in ("count_1", "prev("))}
        )
    assert seen["detected"] >= count // 5
    assert seen["one row"] >= count // 5


DISTINCT: Final = "f on a(U, V, _) times 3 distinct V;"
PAIRS: Final = "f on a(U, V, W) times 3 distinct V, W;"
EACH: Final = "f on a(U, V, _) times 3 each V;"
FAULTS: Final = {
    "one event fewer": (
        ("sql-table", "sql-table-duckdb", "kql"),
        DISTINCT,
        r"([\w)] (>=|==)) 3|(lag\(time,) 2",
        r"\1\3 2",
    ),
    "one each fewer": (("sql-table", "sql-table-duckdb", "kql"), EACH, r"((lag|prev)\(\w+,) 2", r"\1 1"),
    "a longer window": (
        ("sql-table", "sql-table-duckdb", "kql"),
        DISTINCT,
        r"(<=|time -|time \+|BETWEEN) 3\b|_time \+ 3",
        r"\1 4",
    ),
    "a shorter window": (("sql-table", "sql-table-duckdb", "kql"), DISTINCT, r"(<=|time -|BETWEEN) 3\b", r"\1 2"),
    "a longer window of each": (("sql-table-duckdb", "kql"), EACH, r"(_time \+|<=) 3\b", r"\1 4"),
    "equal values": (("sql-table", "sql-table-duckdb"), DISTINCT, "DISTINCT ", ""),
    "the first value of a pair": (("sql-table-duckdb",), PAIRS, r'\("V", "W"\)', '"V"'),
    "the first value alone": (("sql-table", "kql"), PAIRS, r', o\."W"|, W_1(?=\n)', ""),
    "all keys": (("sql-table", "sql-table-duckdb"), DISTINCT, r', "U"(?= ORDER BY)| AND e\."U" = o\."U"', ""),
    "all keys of each": (("sql-table", "sql-table-duckdb", "kql"), EACH, r', "U"(?= ORDER BY)| and U_1 == U_3', ""),
    "events of equal times": (
        ("sql-table-duckdb",),
        DISTINCT,
        "pos ROWS BETWEEN reach PRECEDING",
        "time RANGE BETWEEN 3 PRECEDING",
    ),
    "later events": (("sql-table", "kql"), DISTINCT, r"(o\.pos <= e\.pos AND |pos_1 <= pos_3 and )", ""),
}


@pytest.mark.parametrize("fault", sampled(FAULTS, 4))
def test_a_wrong_count_is_found(fault: str) -> None:
    languages, leaf_, right, wrong = FAULTS[fault]
    tree = loads(f"{TYPED}assume types, present, order 0 s; time t as ns; toplevel top; top and f within 3 ns; {leaf_}")
    random, traces = Random(fault), list[list[Any]]()
    for _ in range(600):
        now, trace = 0, list[Any]()
        for _ in range(random.randrange(3, 7)):
            now += random.choice((0, 0, 1, 1, 2))
            values = {"v": random.randrange(3), "w": random.randrange(2)}
            trace.append({"k": "a", "u": random.choice("xxxy"), **values, "t": now})
        traces.append(trace)
    verdicts = [[*Reference(tree, Semantics.SCATTERED).run(trace)] for trace in traces]
    wanted = [run.index(Verdict.TRUE) + 1 if Verdict.TRUE in run else None for run in verdicts]
    for name in languages:
        if name.endswith("duckdb") and not find_spec("duckdb"):
            continue
        text = backend(name).translate(tree, Semantics.SCATTERED).text
        assert backend(name).read(text).first_detections(traces) == wanted, text  # type: ignore[attr-defined]
        changed = re.sub(right, wrong, text)
        assert changed != text, text
        assert backend(name).read(changed).first_detections(traces) != wanted, changed  # type: ignore[attr-defined]
