"""Monitors in C of trees whose matches need no joins: they keep no partial matches."""

import json
from collections.abc import Sequence
from itertools import islice, pairwise
from pathlib import Path
from random import Random
from typing import Any

import pytest

from backends.c import CBackend
from backends.c.library import CMonitor, build_program, compile_c, compiler
from rvaft import RVAFT, NotExpressible, Semantics, TooLarge, dumps, loads, monitor
from rvaft.errors import NoVerdict
from rvaft.model.verdict import Verdict
from rvaft.monitors import Repetition
from rvaft.semantics import Reference
from tests.backends.c.programs import BACKEND, SANITIZERS, SCATTERED, status
from tests.backends.c.test_c import PIECES
from tests.engine.checking import small_valid_trees
from tests.engine.dense import SHAPES, dense_trace, dense_tree
from tests.engine.test_windowed import CASES
from tests.engine.windowed import timed_trace, windowed_trees
from tests.tables import sampled

pytestmark = pytest.mark.skipif(compiler() is None, reason="needs a C compiler")
LATE = {
    "in order": (" late 0 s", 0.0),
    "late events": (" late 0 s", 0.2),
    "disorder": (" late 2 s", 0.3),
    "no late": ("", 0.3),
}
"""What the tree says of late events, and how often times decrease."""


def written(tree: RVAFT, backend: CBackend = BACKEND) -> str | None:
    try:
        return backend.translate(tree, SCATTERED).text
    except (NotExpressible, TooLarge):
        return None


def follows_units(text: str) -> bool:
    return "static const leaf leaves[]" in text


def follows_fronts(text: str) -> bool:
    return "front fronts[" in text


def agrees(text: str, tree: RVAFT, trace: Sequence[dict[str, Any]]) -> Verdict:
    """Compare the verdicts with the definition, and those of a copy in the middle; return the last one."""
    wanted = [*Reference(tree, SCATTERED).run(trace)]
    compiled = CMonitor(text)
    try:
        found = [compiled.step(event) for event in trace[: len(trace) // 2]]
        compiled = compiled.fork()
        found += [compiled.step(event) for event in trace[len(trace) // 2 :]]
    except NoVerdict:
        return Verdict.UNKNOWN
    assert found == wanted, f"{dumps(tree)}\n{json.dumps(trace)}"
    return wanted[-1]


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 5))])
@pytest.mark.parametrize("order", sampled(LATE, 4))
def test_verdicts_of_trees_with_windows(order: str, seed: int) -> None:
    late, disorder = LATE[order]
    random, detected, units, fronts = Random(f"C {order} {seed}"), 0, 0, 0
    for tree in islice(windowed_trees(random, late=late), 150 if seed else 40):
        text = written(tree)
        if text is None:
            continue
        units += follows_units(text)
        fronts += follows_fronts(text)
        for _ in range(4):
            trace = timed_trace(random, tree, random.randint(3, 14), disorder=disorder)
            detected += agrees(text, tree, trace) is Verdict.TRUE
    assert detected > 10
    assert units > 10
    assert (fronts > 10) is (late != " late 0 s")


@pytest.mark.parametrize("late", ["", " late 1 s", " late 9 s"])
@pytest.mark.parametrize(("tree", "word"), CASES)
def test_what_a_front_keeps(tree: str, word: str, late: str) -> None:
    letters = [one.rstrip("0123456789") for one in word.split()]
    times = [int(one[len(letter) :]) for one, letter in zip(word.split(), letters, strict=True)]
    if late == " late 1 s" and times != sorted(times):
        return
    text = written(loads(f"time t as s{late}; {tree}"))
    assert text is not None
    assert follows_fronts(text)
    compiled = CMonitor(text)
    verdicts = [compiled.step({"event": name, "t": time}) for name, time in zip(letters, times, strict=True)]
    assert [verdict is Verdict.TRUE for verdict in verdicts] == [False] * (len(times) - 1) + [True]


FRONTS = {
    "counts after an event": ("top sand x a within 9 s; a times 7;", "aaaaxz"),
    "counts of two values": (
        """top and f within 30 s; f sand x y within 20 s; x on e("x", U, _) times 5; y on e("y", U, V) times 2;""",
        "xxyz",
    ),
    "a nested sequence": ("top sand p q r within 14 s; p and a b; q 2of3 x y z; r sand c d within 5 s;", "abcdxyz"),
    "choices of choices": (
        "top 2of4 p q r s within 3 s; p or a b; q and c d; r 2of3 x y z; s pand v w;",
        "abcdxyzvw" + 30 * "-",
    ),
}
"""Trees, and the events of their logs."""


@pytest.mark.parametrize("late", ["", " late 5 s"])
@pytest.mark.parametrize("tree", FRONTS)
def test_long_logs_of_fronts(tree: str, late: str) -> None:
    """As the engine, which starts again after each detection, and a copy in each state of the log."""
    text, letters = FRONTS[tree]
    random, detections = Random(f"{tree} {late}"), 0
    loaded = loads(f"time ts as s{late}; event e(k, u, v) = {{ event: k, user: u, value: v }}; {text}")
    made = written(loaded)
    assert made is not None
    assert follows_fronts(made)
    made = f"#define RVAFT_CAPACITY 16384U\n{made}"
    compiled, engine = CMonitor(made), monitor(loaded, semantics=SCATTERED)
    for number in range(2_500):
        event = {"event": random.choice(letters), "user": random.randrange(2), "value": random.randrange(2)}
        event |= {} if random.random() < 0.02 else {"ts": number - random.choice((0, 0, 0, 1, 3, 5, 8, 8.5))}
        verdict = engine.step(event)
        assert compiled.step(event) is verdict, number
        if random.random() < 0.05:
            compiled = compiled.fork()
        if verdict is Verdict.TRUE:
            detections += 1
            compiled, engine = CMonitor(made), monitor(loaded, semantics=SCATTERED)
    assert detections > 2


def test_a_front_that_is_too_large_is_no_verdict() -> None:
    """Without `late` an older event may always come; with it, little room is enough."""
    for late, full in (("", True), ("late 5 s", False)):
        tree = loads(f"time ts as s {late}; top and a b never within 1 min; a; b; never;")
        compiled = CMonitor(BACKEND.translate(tree, SCATTERED).text)
        events = ({"event": "ab"[number % 2], "ts": number} for number in range(5_000))
        if full:
            with pytest.raises(NoVerdict, match="an array is full"):
                [compiled.step(event) for event in events]
        else:
            assert {compiled.step(event) for event in events} == {Verdict.UNKNOWN}


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 4))])
@pytest.mark.parametrize(
    "name", sampled(["many letters", "silent", "variables", "windows", "many ends", "time points"], 3)
)
def test_verdicts_of_dense_trees(name: str, seed: int) -> None:
    random, shape = Random(f"C {name} {seed}"), SHAPES[name]
    trees = small_valid_trees(lambda: dense_tree(random, shape))
    for tree in islice(trees, 40 if seed else 8):
        text = written(tree)
        for _ in range(4):
            trace = dense_trace(random, shape, random.randint(3, 10))
            if text is not None:
                agrees(text, tree, trace)


def detections(tree: RVAFT, events: Sequence[dict[str, Any]], key: object) -> list[int]:
    """The numbers of the events of a value of the key at which the engine detects."""
    watching = Repetition(monitor(tree, semantics=SCATTERED))
    own = [number for number, event in enumerate(events, 1) if event["key"] == key]
    return [number for number in own if watching.step(events[number - 1]) is Verdict.TRUE]


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 4))])
@pytest.mark.parametrize(
    "keys", [pytest.param([None], marks=pytest.mark.ci), ["a", 1, [True]]], ids=["one log", "keys"]
)
@pytest.mark.parametrize(
    "late", [pytest.param(" late 0 s", marks=pytest.mark.ci), pytest.param("", marks=pytest.mark.slow), " late 2 s"]
)
def test_matches_with_sanitizers(late: str, keys: list[Any], seed: int, tmp_path: Path) -> None:
    """Each detection is one of the engine, and its events are a match by the definition."""
    random, left = Random(f"C {late} {keys} {seed}"), 10 if seed else 1
    backend = BACKEND.keyed([(("key",), ("key",))]) if len(keys) > 1 else BACKEND
    for tree in windowed_trees(random, late=late):
        trace = timed_trace(random, tree, 150, disorder=0.02 if late == " late 0 s" else 0.2)
        events = [{**event, "key": random.choice(keys)} for event in trace]
        wanted = sorted(number for key in keys for number in detections(tree, events, key))
        text = written(tree, backend)
        if len(wanted) < 3 or text is None or not follows_units(text):
            continue
        if not follows_fronts(text) and late != " late 0 s":
            continue
        compile_c(text + PIECES, tmp_path / "monitor", (*SANITIZERS, "-DRVAFT_PLACES=1", "-DRVAFT_CAPACITY=2048"))
        code, out, error = status(tmp_path / "monitor", b"\n".join(json.dumps(one).encode() for one in events))
        assert code == 0, error
        found = [[int(one) for one in line.split()] for line in out.splitlines()]
        assert sorted(one[-1] for one in found) == wanted
        for one in found:
            assert one == sorted(set(one))
            assert [*Reference(tree, SCATTERED).run([events[place - 1] for place in one])][-1] is Verdict.TRUE
        left -= 1
        if not left:
            return


def choices(number: int, late: str = " late 0 s") -> RVAFT:
    names = [f"o{one}" for one in range(number)]
    gates = "".join(f" {name} or {name}a {name}b;" for name in names)
    return loads(f"time ts as s{late}; top and {' '.join(names)} within 1 h;{gates}")


@pytest.mark.parametrize("backend", [BACKEND, BACKEND.keyed([(("key",), ("key",))])], ids=["one log", "keys"])
@pytest.mark.parametrize("late", [" late 0 s", " late 5 s", ""])
def test_the_text_grows_as_the_tree(late: str, backend: CBackend) -> None:
    sizes = [len(backend.translate(choices(number, late), SCATTERED).text) for number in (10, 20, 30, 40)]
    steps = [later - earlier for earlier, later in pairwise(sizes)]
    assert max(steps) < 1.2 * min(steps)
    counts = [
        len(backend.translate(loads(f"top and a b; a times {number}; b;"), SCATTERED).text) for number in (5, 4000)
    ]
    assert counts[1] - counts[0] < 200


@pytest.mark.parametrize("late", [" late 0 s", " late 60 s", ""])
@pytest.mark.parametrize("number", [5, 40])
def test_many_choices(number: int, late: str) -> None:
    random, tree = Random(number), choices(number, late)
    compiled, engine = CMonitor(BACKEND.translate(tree, SCATTERED).text), monitor(tree, semantics=SCATTERED)
    detected = 0
    for time in range(40 * number):
        gate = random.randrange(number + time % 2)  # the last one often lacks
        shift = 0 if late == " late 0 s" else random.choice((0, 0, 30, 59))
        event = {"event": f"o{gate}{random.choice('ab')}", "ts": 3600 / number * time / 4 - shift}
        verdict = compiled.step(event)
        assert verdict is engine.step(event)
        if verdict is Verdict.TRUE:
            detected += 1
            compiled, engine = CMonitor(BACKEND.translate(tree, SCATTERED).text), monitor(tree, semantics=SCATTERED)
    assert detected or number == 40


KEYED = """time ts as s late 0 s; event e(k, u) = { k: k, u: u }; event f(k, u, v) = { k: k, u: u, v: v };
top sand x y z within 20 s; x on f("x", U, V) times 3; y on e("y", U) times 2; z and p q;
p on e("p", U); q on e("q", U);"""


@pytest.mark.parametrize(("late", "room"), sampled([("late 0 s", 64), ("late 7 s", 512)], 2))
def test_instances_are_forgotten_when_their_window_has_passed(late: str, room: int, tmp_path: Path) -> None:
    """There is room for a few partial matches; without the window there were thousands."""
    tree = loads(KEYED.replace("late 0 s", late))
    build_program(BACKEND.translate(tree, SCATTERED).text, tmp_path / "monitor", room)
    random, events = Random(1), list[dict[str, Any]]()
    for time in range(20_000):
        shift = 0 if late == "late 0 s" else random.choice((0, 0, 5, 9))
        event = {
            "k": random.choice("xxyypq"),
            "u": f"user {time // 20 * 5 + random.randrange(2)}",
            "ts": time - shift,
        }
        events.append({**event, "v": random.randrange(2)})
    code, out, error = status(tmp_path / "monitor", b"\n".join(json.dumps(one).encode() for one in events), "--repeat")
    watching = Repetition(monitor(tree, semantics=SCATTERED))
    wanted = [watching.step(event).value for event in events]
    assert error == ""
    assert [json.loads(line)["verdict"] for line in out.splitlines()] == wanted
    assert code == ("true" in wanted)


def test_places_of_events_are_used_again(tmp_path: Path) -> None:
    tree = loads("time ts as s late 0 s; top sand x y within 9 s; x times 40; y and p q; p sand a b; q times 3;")
    text = BACKEND.translate(tree, SCATTERED).text
    compile_c(text + PIECES, tmp_path / "monitor", ("-O1", "-DRVAFT_PLACES=1"))
    random = Random(1)
    names = [random.choice(["x", "x", "x", "a", "b", "q"]) for _ in range(100_000 // 8)]
    lines = (json.dumps({"event": name, "ts": number / 20}).encode() for number, name in enumerate(names))
    code, out, _ = status(tmp_path / "monitor", b"\n".join(lines))
    found = [[*map(int, line.split())] for line in out.splitlines()]
    assert code == 0
    assert found
    assert {len(one) for one in found} == {45}


@pytest.mark.parametrize(
    ("text", "events"),
    [
        ("top or a b; a on e(1, U); b on e(2, V);", [{"k": 1, "u": float("nan")}]),
        ("top 1of2 a b; a on e(1, U); b on e(2, U);", [{"k": 1, "u": float("nan")}]),
        ("top and a b; a on e(1, U); b on e(2, U);", [{"k": 1, "u": float("inf")}, {"k": 2, "u": float("inf")}]),
        ("top or a; a on e(1, U) times 2;", [{"k": 1, "u": float("nan")}] * 2),
        ("top sand a b; a on f(1, U, V) times 2; b on e(2, U);", [{"k": 1, "u": 1, "v": float("nan")}] * 2),
    ],
)
def test_undefined_values_of_a_key(text: str, events: list[dict[str, Any]]) -> None:
    tree = loads(f"event e(k, u) = {{ k: k, u: u }}; event f(k, u, v) = {{ k: k, u: u, v: v }}; {text}")
    last = {"k": 2, "u": 1}
    wanted = [*Reference(tree, SCATTERED).run([*events, last])]
    compiled = CMonitor(BACKEND.translate(tree, SCATTERED).text)
    assert [compiled.step(event) for event in [*events, last]] == wanted


NESTED = """time ts as s late 0 s; event e(k, u) = { k: k, u: u };
top sand a p within 50 s; p sand b c within 5 s;
a on e("a", U); b on e("b", V) when V != U; c on e("c", U);"""


def test_partial_matches_of_joins_expire_by_their_own_window(tmp_path: Path) -> None:
    """The first of two hundred partial matches waits for longer than the inner window."""
    build_program(BACKEND.translate(loads(NESTED), SCATTERED).text, tmp_path / "monitor", 1024)
    events = [{"k": "a", "u": number, "ts": 100 + number / 100} for number in range(200)]
    events += [{"k": "b", "u": -1, "ts": 139}, {"k": "c", "u": 0, "ts": 140}]
    assert status(tmp_path / "monitor", b"\n".join(json.dumps(one).encode() for one in events))[0] == 1


@pytest.mark.parametrize("semantics", Semantics)
def test_an_impossible_choice_is_left_out(semantics: Semantics) -> None:
    tree = loads("top or a b; a when 1 == 2; b times 2;")
    compiled = CMonitor(BACKEND.translate(tree, semantics).text)
    trace = [{"event": "b"}] * 2
    assert [compiled.step(event) for event in trace] == [*Reference(tree, semantics).run(trace)]


def test_instances_of_many_keys_in_little_room(tmp_path: Path) -> None:
    """The instances of keys that have detected make room for others; times are before 1970."""
    text = BACKEND.keyed([(("key",), ("key",))]).translate(loads(KEYED), SCATTERED).text
    sizes = ("-DRVAFT_CAPACITY=48", "-DRVAFT_KEYS=400")
    compile_c(text + PIECES, tmp_path / "monitor", ("-O1", "-DRVAFT_PLACES=1", *sizes))
    events = [
        {"key": key, "k": name, "u": key, "v": 1, "ts": -1_000_000 + key}
        for key in range(300)
        for name in ("x", "x", "x", "y", "y", "p", "q")
    ]
    code, out, _ = status(tmp_path / "monitor", b"\n".join(json.dumps(event).encode() for event in events))
    assert code == 0
    assert [int(line.split()[-1]) for line in out.splitlines()] == [7 * key + 7 for key in range(300)]


ROTATING = {
    "a key, latest starts": KEYED,
    "a key, fronts": KEYED.replace("late 0 s", "late 3 s"),
    "a key, stages": NESTED.replace("late 0 s", "late 3 s"),
}


@pytest.mark.parametrize("tree", sampled(ROTATING, 3))
def test_rotating_keys_in_little_room(tree: str, tmp_path: Path) -> None:
    """There are many more keys than there is room for, of which one in ten may detect, and one that stays.

    As by a monitor of its own for each key, with the places of the events.
    """
    loaded = loads(ROTATING[tree])
    text = BACKEND.keyed([(("key",), ("key",))]).translate(loaded, SCATTERED).text
    sizes = ("-DRVAFT_CAPACITY=3000", "-DRVAFT_KEYS=250")
    compile_c(text + PIECES, tmp_path / "monitor", (*SANITIZERS, "-DRVAFT_PLACES=1", *sizes))
    random, events, wanted = Random(tree), list[dict[str, Any]](), list[int]()
    word = "xxxyypq" if "sand x y z" in ROTATING[tree] else "abc"
    waiting = [("fixed", iter(word[:0]))]
    for number in range(6_000):
        if number % len(word) == 0:
            whole = random.random() < 0.05
            waiting.append((f"key {number} {'long ' * random.randrange(9)}", iter(word if whole else word[:-1])))
        place = random.randrange(max(0, len(waiting) - 5), len(waiting)) if random.random() < 0.95 else 0
        key, left = waiting[place]
        name = next(left, None)
        if name is None and key != "fixed":
            waiting.pop(place)
        user = -1 if name == "b" and "V != U" in ROTATING[tree] else 1
        event = {"key": key, "k": name or random.choice(word[:-1]), "u": user, "v": 1, "ts": number / 4 - 1_000}
        events.append(event)
    apart = dict[str, Repetition]()
    for number, event in enumerate(events, 1):
        key = str(event["key"])
        if key not in apart:
            apart[key] = Repetition(monitor(loaded, semantics=SCATTERED))
        if apart[key].step(event) is Verdict.TRUE:
            wanted.append(number)
    code, out, error = status(tmp_path / "monitor", b"\n".join(json.dumps(event).encode() for event in events))
    assert code == 0, error
    found = [[int(one) for one in line.split()] for line in out.splitlines()]
    assert [one[-1] for one in found] == wanted
    assert {len(one) for one in found} == {len(word)}
    assert len(wanted) > 10
