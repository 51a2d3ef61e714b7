"""The engine on trees with windows, counts and a common variable, whose matches need no joins.

The reference is slow, so that long logs and many values are held against other computations.
"""

import pickle
from bisect import bisect_left
from itertools import islice
from random import Random

import pytest

import rvaft
from rvaft.engine import Engine
from rvaft.model.verdict import Verdict
from rvaft.semantics import Reference
from tests.engine.checking import compare
from tests.engine.windowed import timed_trace, windowed_trees
from tests.tables import sampled

SEEDS = [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 41))]
LATE = {
    "in order": (" late 0 s", 0.0),
    "late events": (" late 0 s", 0.2),
    "disorder": (" late 2 s", 0.3),
    "no late": ("", 0.3),
}
"""What the tree says of late events, and how often times decrease."""


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("order", sampled(LATE, 4))
def test_verdicts_and_explanations(order: str, seed: int) -> None:
    late, disorder = LATE[order]
    random, detected = Random(f"{order} {seed}"), 0
    for tree in islice(windowed_trees(random, late=late), 100 if seed else 25):
        for _ in range(4):
            trace = timed_trace(random, tree, random.randint(3, 12), disorder=disorder)
            engine = compare(tree, trace, "scattered")
            detected += engine is not None and engine.verdict is Verdict.TRUE
            if random.random() < 0.1:
                compare(tree, trace, "scattered", branch=random.randint(1, 3))
                compare(tree, trace, "scattered", kind=random.choice(("fault", "attack")))
    assert detected > 10


CASES = [
    # a part ends again with the start that it had
    ("top pand a b within 100 s; b and s y; s sand p q;", "p0 q1 y2 a3 q4"),
    ("top pand a b within 100 s; b 2of3 s y z; s sand p q;", "p0 q1 y2 a3 q4"),
    # the children that start last, not the first ones
    ("top 2of3 a b c within 5 s;", "a0 b9 c10"),
    ("top 2of4 a b c d within 5 s;", "a0 c9 d10"),
    ("top sand x v within 6 s; v 2of3 a b c;", "x0 a1 x5 b9 c10"),
    # an event at the time of an earlier one, but after another start of the sequence
    ("top sand a v within 3 s; v and b c;", "a0 b5 a6 b5 c7"),
    ("top sand a v within 3 s; v and b c; b times 2;", "a0 b5 b5 a6 b5 b5 c7"),
    # the first children that are complete before the next, not the best ones
    ("top sand a v within 9 s; v and b c;", "a3 b4 a9 c2"),
    ("top sand a v within 3 s; v and b c;", "a5 b6 a5 c7"),
    ("top sand x a v within 6 s; v and b c;", "x1 a5 b6 x3 a5 c7"),
    # the events of the lowest branch, which are not those of the match that starts last
    ("top and a o within 4 s; o or p q;", "a0 p10 q13 a13"),
    ("top and g c; g and o b within 2 s; o or p q;", "q0 b1 p10 b11 c12"),
    # the windows of parts, and of the whole
    ("top and g c within 9 s; g sand a b within 2 s;", "a0 b5 a6 b8 a9 c10"),
    ("top sand g c within 9 s; g or v w within 3 s; v and a b; w and p q;", "a0 b2 p5 q7 c11"),
]
"""Trees, and words of letters with their times, of which only the last event detects."""


@pytest.mark.parametrize("late", ["", " late 0 s", " late 1 s", " late 9 s"])
@pytest.mark.parametrize(("tree", "word"), CASES)
def test_what_a_node_remembers(tree: str, word: str, late: str) -> None:
    names = [one.rstrip("0123456789") for one in word.split()]
    times = [int(one[len(name) :]) for one, name in zip(word.split(), names, strict=True)]
    if late in (" late 0 s", " late 1 s") and times != sorted(times):
        return
    events = [{"event": name, "t": time} for name, time in zip(names, times, strict=True)]
    engine = compare(rvaft.loads(f"time t as s{late}; {tree}"), events, "scattered")
    assert engine is not None
    assert engine.verdict is Verdict.TRUE
    assert engine.explanation is not None
    assert engine.explanation.matched[-1].event == len(events)


@pytest.mark.ci
@pytest.mark.parametrize("order", sampled(LATE, 4))
def test_copies_and_pickles(order: str) -> None:
    late, disorder = LATE[order]
    random, told = Random(f"copies {order}"), dict.fromkeys(Verdict, 0)
    for tree in islice(windowed_trees(random, late=late), 20):
        straight, copy, pickled = (Engine(tree, "scattered") for _ in range(3))
        for event in timed_trace(random, tree, 12, disorder=disorder):
            copy, pickled = copy.fork(), pickle.loads(pickle.dumps(pickled))
            straight.fork().step(event)
            for monitor in (straight, copy, pickled):
                monitor.step(event)
            for monitor in (copy, pickled):
                assert (monitor.verdict, monitor.state) == (straight.verdict, straight.state)
                assert (monitor.explanation, monitor.pending()) == (straight.explanation, straight.pending())
        told[straight.verdict] += 1
    assert told[Verdict.TRUE]
    assert told[Verdict.UNKNOWN]


@pytest.mark.parametrize("order", sampled(LATE, 4))
def test_equal_states_have_equal_futures(order: str) -> None:
    random, compared = Random(f"futures {order}"), 0
    for tree in islice(windowed_trees(random, late=LATE[order][0], gates=3), 12):
        by_state: dict[object, list[tuple[Engine, Reference]]] = {}
        for _ in range(10):
            monitor, reference = Engine(tree, "scattered"), Reference(tree, "scattered")
            for time, event in enumerate(timed_trace(random, tree, 4)):
                if monitor.step({**event, "t": time}).final:
                    break
                reference.step({**event, "t": time})
                by_state.setdefault(monitor.state, []).append((monitor.fork(), reference.fork()))
        for alike in by_state.values():
            for time, event in enumerate(timed_trace(random, tree, 5), 3):
                assert len({one.step({**event, "t": time}) for pair in alike for one in pair}) == 1
            compared += len(alike) - 1
    assert compared


GUARDED = {"a": 'a on e("a", U) when U != 2;', "b": 'b on e("b", U);', "c": 'c on e("c", U);'}


@pytest.mark.parametrize(
    ("tree", "word"),
    [
        ("top and o c; o or a b;", "b2 c2"),  # the guard of an alternative does not hold for another
        ("top and o c; o 1of2 a b;", "b2 c2"),
        ("top or a c;", "c2"),
        ('top and v c; v or w b; w and a d; d on e("d", U);', "b2 c2"),
        ("top 2of3 a b c;", "a2 b2 c2"),
        ("top and a c;", "a2 c3 c1 a1"),
    ],
)
def test_a_guard_over_the_common_variable_belongs_to_its_node(tree: str, word: str) -> None:
    nodes = " ".join(node for name, node in GUARDED.items() if f" {name}" in tree)
    events = [{"n": one[0], "u": int(one[1:])} for one in word.split()]
    engine = compare(rvaft.loads(f"event e(n, u) = {{ n: n, u: u }}; {tree} {nodes}"), events, "scattered")
    assert engine is not None
    assert engine.verdict is Verdict.TRUE


KEYED = """
event e(n, u) = { n: n, u: u };
time t as s LATE; semantics scattered;
top sand tries x within 20 s;
tries times 3 on e("a", U);
x and b c; b on e("b", U); c or c1 c2; c1 on e("c", U); c2 on e("d", U);
"""


@pytest.mark.parametrize("late", sampled(["", "late 0 s", "late 3 s"], 3))
@pytest.mark.parametrize("users", sampled([3, 3_000], 2))
def test_the_values_of_a_common_variable_are_followed_apart(users: int, late: str) -> None:
    """As by a monitor for each value; the first detection of any of them is that of the tree."""
    random, tree = Random(users), rvaft.loads(KEYED.replace("LATE", late))
    engine, apart = Engine(tree), dict[object, Engine]()
    latest, detections = 0, 0
    for number in range(60_000 if users > 3 else 2_000):
        busy = random.random() < 0.5
        time = number // (200 if users > 3 else 1) - (random.choice((0, 0, 1, 2)) if late != "late 0 s" else 0)
        latest = max(latest, time)
        number_of = random.randrange(3 if busy else users)
        user = random.choice((number_of, number_of, number_of, float(number_of), f"u{number_of}"))
        event = {"n": random.choice("aaabcdz" if not busy else "abz"), "u": user, "t": time}
        if user not in apart:
            apart[user] = Engine(tree)
        own = apart[user]
        own.reach(engine.latest)
        expected = own.step(event)
        assert engine.step(event) is expected, number
        if expected is Verdict.TRUE:
            detections += 1
            assert engine.explanation is not None
            assert own.explanation is not None
            assert engine.explanation.branch == own.explanation.branch
            break
    assert detections or users == 3


@pytest.mark.ci
def test_counts_in_a_window_are_those_of_the_times() -> None:
    """N events in a window, whatever N: the times of each user are compared by hand."""
    for count in (2, 7, 50):
        for late in ("", "late 0 s"):
            random = Random(f"{count} {late}")
            text = f"event e(u) = {{ u: u }}; time t as s {late}; top and a within 100 s; a times {count} on e(U);"
            engine, times = Engine(rvaft.loads(text), "scattered"), dict[int, list[float]]()
            detections, now = 0, 0.0
            for number in range(6_000):
                now += 30 if random.random() < 0.5 / count else random.random() * 105 / count
                time = now if late else round(now - random.choice((0, 0, 40)), 3)
                user = random.randrange(2)
                own = times.setdefault(user, [])
                own.insert(bisect_left(own, time), time)
                expected = any(own[at + count - 1] - own[at] <= 100 for at in range(len(own) - count + 1))
                verdict = engine.step({"u": user, "t": time})
                assert (verdict is Verdict.TRUE) is expected, (count, late, number)
                if expected:
                    detections += 1
                    assert engine.explanation is not None
                    assert len(engine.explanation.matched) == count
                    engine, times = Engine(engine.tree, "scattered"), {}
            assert detections > 3, (count, late)


@pytest.mark.parametrize("late", ["", "late 0 s", "late 60 s"])
@pytest.mark.parametrize("count", [3, 20])
def test_an_event_and_then_a_count_in_a_window(count: int, late: str) -> None:
    """The positions of the counted events matter, too, where times decrease."""
    random = Random(f"{count} {late}")
    text = f"time t as s {late}; top sand b a within 100 s; a times {count};"
    engine, came = Engine(rvaft.loads(text), "scattered"), list[tuple[str, float, int]]()
    detections, now = 0, 0.0
    for number in range(4_000):
        now += random.random() * 150 / count
        time = round(now - (0 if late == "late 0 s" else random.choice((0, 0, 0, 20, 50))), 3)
        letter = "b" if random.random() < 1 / count else "a"
        came = [one for one in came if abs(one[1] - time) <= 300]
        came.append((letter, time, number))
        expected = letter == "a" and any(
            max(last, begin) - min(first, begin) <= 100
            for other, begin, place in came
            if other == "b" and abs(begin - time) <= 100
            for times in [sorted(one[1] for one in came if one[0] == "a" and one[2] > place)]
            for first, last in zip(times, times[count - 1 :], strict=False)
        )
        verdict = engine.step({"event": letter, "t": time})
        assert (verdict is Verdict.TRUE) is expected, number
        if expected:
            detections += 1
            engine, came = Engine(engine.tree, "scattered"), []
    assert detections > 5


def test_a_window_over_many_choices() -> None:
    """The lowest branch of 2^25."""
    names = [f"o{number}" for number in range(25)]
    leaves = " ".join(f"{o} or p{o} q{o}; p{o}; q{o};" for o in names)
    text = f"time t as s late 0 s; top and {' '.join(names)} within 1 h; {leaves}"
    engine = Engine(rvaft.loads(text), "scattered")
    word = [f"{letter}{name}" for letter in "qpq" for name in names[1:]]  # every choice has both, but for the last
    word = [one for number, one in enumerate(word) if one[0] == "q" or int(one[2:]) % 2 == 0] + ["qo0"]
    verdicts = [engine.step({"event": one, "t": time}) for time, one in enumerate(word)]
    assert set(verdicts[:-1]) == {Verdict.UNKNOWN}
    assert engine.verdict is Verdict.TRUE
    assert engine.explanation is not None
    assert engine.explanation.branch == 1 + sum(1 << number for number in range(25) if number % 2 or not number)


def test_values_whose_window_has_passed_are_forgotten() -> None:
    text = "event e(n, u) = { n: n, u: u }; time t as s late 0 s; semantics scattered; top sand a b within 10 s; "
    engine = Engine(rvaft.loads(text + 'a on e("a", U); b on e("b", U);'), limit=200)
    for number in range(40_000):
        assert engine.step({"n": "a", "u": f"u{number}", "t": number}) is Verdict.UNKNOWN
    assert len(pickle.dumps(engine)) < 500_000
    assert engine.step({"n": "b", "u": "u39995", "t": 40_000}) is Verdict.TRUE


@pytest.mark.parametrize("late", [0, 3])
def test_values_whose_window_lasts_are_not_forgotten(late: int) -> None:
    text = f"event e(n, u) = {{ n: n, u: u }}; time t as s late {late} s; semantics scattered; "
    engine = Engine(rvaft.loads(text + 'top sand a b within 10 s; a on e("a", U); b on e("b", U);'))
    for number in range(20_000):
        assert engine.step({"n": "a", "u": number, "t": 0 if number < 5_000 else 10 + late}) is Verdict.UNKNOWN
    assert engine.step({"n": "b", "u": 0, "t": 10}) is Verdict.TRUE
