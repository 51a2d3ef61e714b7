"""Under `scattered` an event costs what it costs, however long the log was before: ratios within one run.

`pytest tests/benchmarks/test_growth.py -s` prints the table, with `-m slow` for logs of 100,000 events.
"""

import gc
import sys
import time
from collections.abc import Callable, Mapping
from itertools import product
from typing import Any, Final

import pytest

import rvaft
from rvaft import Verdict
from rvaft.engine import Engine
from rvaft.errors import TooLarge

pytestmark = pytest.mark.benchmark

Log = Callable[[int], dict[str, Any]]
TYPES: Final = "event e(n, v) = { n: n, v: v }; event f(n, v, w) = { n: n, v: v, w: w }; "
NEVER: Final = ' never on e("never", _);'


def letters(names: str, value: Callable[[int], Any] = lambda number: number) -> Log:
    """Events of these letters in turn, a value and a second for each."""
    return lambda number: {"n": names[number % len(names)], "v": value(number), "w": number % 97, "t": number}


AB: Final = 'a on e("a", V1); b on e("b", V2)'
TREES: Final[dict[str, tuple[str, Log]]] = {
    "a window": (f"top sand a b never; {AB} when V2 >= V1 and V2 <= V1 + 10;", letters("ab")),
    "a window that nothing keeps": (
        f"top sand a b never; {AB} when V2 >= V1 and V2 <= V1 + 10;",
        letters("ab", lambda number: number if number % 2 == 0 else -number),
    ),
    "within": ("top sand x never; x sand a b within 3 s; a on e(\"a\", _); b on e(\"b\", _);", letters("ab")),
    "within, one user": (
        'top sand x never; x sand a b c within 9 s; a on f("a", _, U); b on f("b", _, U); c on f("c", _, U);',
        letters("abd"),
    ),
    "an equality": ('top sand a b never; a on e("a", V); b on e("b", V);', letters("ab")),
    "an equality in a guard": (
        f"top sand a b never; {AB} when V1 == V2 + 1;",
        letters("ab", lambda number: 2 * number),
    ),
    "an order": (f"top sand a b never; {AB} when V2 > V1;", letters("ab", lambda number: -number)),
    "ascending strings": (f"top and a b never; {AB} when V2 > V1;", letters("ab", lambda number: f"{10**9 - number}")),
    "two that differ": (f"top sand a b never; {AB} when V1 != V2;", letters("ab")),
    "three that differ": (
        (
            'top sand a b c never; a on e("a", V1); b on e("a", V2) when V1 != V2; '
            'c on e("a", V3) when V3 != V1 and V3 != V2;'
        ),
        letters("a"),
    ),
    "independent parts": (
        'top and x y never; x sand a b; y sand c d; a on e("a", V); b on e("b", V); c on e("c", W); d on e("d", W);',
        letters("ac"),
    ),
}  # fmt: skip


def seconds(text: str, log: Log, few: int, many: int) -> tuple[float, float]:
    """Seconds for an event after few and after many events, the shortest of some hundred each."""
    monitor = Engine(rvaft.loads(f"time t as s; {TYPES}{text}{NEVER}"), "scattered", limit=10**6)
    found, number = [], 0
    for events in (few, many):
        batches = []
        while number < events:
            monitor.step(log(number))
            number += 1
        for _ in range(12):
            batch = [log(number + place) for place in range(50)]
            gc.collect()
            start = time.perf_counter()
            for event in batch:
                monitor.step(event)
            batches.append((time.perf_counter() - start) / len(batch))
            number += len(batch)
        found.append(min(batches))
    assert monitor.verdict is Verdict.UNKNOWN
    return found[0], found[1]


@pytest.mark.parametrize("many", [10_000, pytest.param(100_000, marks=pytest.mark.slow)])
def test_an_event_costs_the_same_however_long_the_log(many: int, capsys: pytest.CaptureFixture[str]) -> None:
    check(TREES, many, capsys)


def check(trees: Mapping[str, tuple[str, Log]], many: int, capsys: pytest.CaptureFixture[str]) -> None:
    """No event costs more than twice as much after many events as after 1,000."""
    rows, failures = [f"{'':50} {'µs after 1,000':>15} {f'µs after {many:,}':>18} {'ratio':>6}"], []
    for name, (text, log) in trees.items():
        first, last = seconds(text, log, 1_000, many)
        if last > 2 * first:  # something else ran on the machine, perhaps
            first, last = seconds(text, log, 1_000, many)
        rows.append(f"{name:50} {first * 1e6:15.1f} {last * 1e6:18.1f} {last / first:6.2f}")
        if last > 2 * first:
            failures.append(name)
    with capsys.disabled():
        sys.stdout.write("\n" + "\n".join(rows) + "\n")
    assert not failures


LATE: Final = {
    "within": 'top sand x never; x sand a b within 3 s; a on f("a", _, U); b on f("b", U, _);',
    "times": 'top sand x never; x and a within 30 s; a on e("a", _) times 5;',
    "at": 'top sand x never; x and a b g; a on e("a", V); b on e("b", V); g when at(b) - at(a) <= 5 s;',
}


@pytest.mark.parametrize("name", LATE)
def test_with_late_what_is_followed_is_bounded(name: str) -> None:
    """By what a window and the lateness hold; without `late` any event may still come."""

    def followed(late: str, limit: int) -> None:
        text = f"time t as s{late}; {TYPES}{LATE[name]}{NEVER}"
        monitor = Engine(rvaft.loads(text), "scattered", limit=limit)
        for number in range(2_000):
            monitor.step({"n": "a", "v": number, "w": number, "t": number})

    followed(" late 2 s", 120)
    with pytest.raises(TooLarge):
        followed("", 1_000)


def pairs(count: int, event: str) -> str:
    """Choices of two leaves each, all of them in an hour."""
    names = [f"o{number}" for number in range(count)]
    leaves = " ".join(
        f"o{i} or p{i} q{i}; p{i} on {event.format(f'p{i}')}; q{i} on {event.format(f'q{i}')};" for i in range(count)
    )
    return f"top and {' '.join(names)} never within 1 h; {leaves}"


def guarded(count: int, event: str, guard: str) -> str:
    """The same choices before an event that never comes, with a guard over the time points of both."""
    top, leaves = pairs(count, event).split("; ", 1)
    names = top.removeprefix("top and ").removesuffix(" never within 1 h")
    return f"top sand a never when {guard}; a and {names}; {leaves}"


def few_of_many(gate: str, count: int, event: str) -> str:
    """One gate over leaves in a window within which all of them come, beside a second window."""
    leaves = " ".join(f"p{i} on {event.format(f'p{i}')};" for i in range(count))
    names = " ".join(f"p{i}" for i in range(count))
    both = f"z on {event.format('z')}; w on {event.format('w')};"
    return f"top and x never; x {gate} {names} y within 1 min; y and z w within 50 s; {leaves} {both}"


def some_users(number: int) -> dict[str, Any]:
    """A first event of each user, and then those that are counted."""
    return {"n": "ba"[number > 20], "v": number % 7, "w": 0, "t": number}


def some_pairs(count: int) -> Log:
    return lambda number: {
        "n": "pq"[number * 7 % 3 % 2] + str(number * 5 % count),
        "v": number % 7,
        "w": 0,
        "t": number,
    }


def all_leaves(count: int) -> Log:
    return lambda number: {
        "n": ("z" if number % (2 * count) else "w") if number % count == 0 else f"p{number % count}",
        "v": number % 7,
        "w": 0,
        "t": number * 70 // count,
    }


ONE, USER = 'e("{}", _)', 'e("{}", U)'
SOON: Final = "start(never) - end(a) <= 10 s"
NATURAL: Final[dict[str, Callable[[int], tuple[str, Log]]]] = {
    "and of K pairs": lambda k: (pairs(k, ONE), some_pairs(k)),
    "and of K pairs, one user": lambda k: (pairs(k, USER), some_pairs(k)),
    "and of K leaves": lambda k: (few_of_many("and", k, ONE), all_leaves(k)),
    "and of K leaves, one user": lambda k: (few_of_many("and", k, USER), all_leaves(k)),
    "K pairs, start - end <= 10 s": lambda k: (guarded(k, ONE, SOON), some_pairs(k)),
    "K pairs, start - end >= 10 s": lambda k: (guarded(k, ONE, "start(never) - end(a) >= 10 s"), some_pairs(k)),
    "K pairs, two bounds, one user": lambda k: (
        guarded(k, USER, f"{SOON} and start(never) - start(a) < 1 h"),
        some_pairs(k),
    ),
    "third of K leaves": lambda k: (few_of_many(f"{k // 3 + 1}of{k + 1}", k, ONE), all_leaves(k)),
}
COUNTS: Final = {
    "times N in a window": 'top and a never within 1 h; a on e("a", U) times {};',
    "times N": 'top and a never; a on e("a", U) times {};',
    "an event, then times N": 'top sand b a never within 1 h; b on e("b", U); a on e("a", U) times {};',
}


@pytest.mark.parametrize("late", ["", " late 0 s"])
def test_choices_and_counts_in_time_cost_what_comes(late: str, capsys: pytest.CaptureFixture[str]) -> None:
    """What an event costs with 5, 10, 20 and 40 choices or children, and with counts of 5, 50 and 500."""

    def cost(text: str, log: Log, begin: int = 2_000) -> float:
        never = NEVER.replace("_);", "U);") if "U)" in text else NEVER
        monitor = Engine(rvaft.loads(f"time t as s{late}; {TYPES}{text}{never}"), "scattered")
        for number in range(begin):
            monitor.step(log(number))
        batches = [[log(begin + 100 * batch + number) for number in range(100)] for batch in range(12)]
        times = []
        for batch in batches:
            start = time.process_time()
            for event in batch:
                monitor.step(event)
            times.append((time.process_time() - start) / len(batch))
        assert monitor.verdict is Verdict.UNKNOWN
        return min(times)

    rows, failures = list[str](), list[str]()
    for name, tree in NATURAL.items():
        found = [cost(*tree(count)) for count in (5, 10, 20, 40)]
        rows.append(f"{name:30} {'  '.join(f'{one * 1e6:8.1f}' for one in found)} µs with 5, 10, 20, 40")
        if found[3] > 8 * found[0] + 10e-6 or found[2] > 50e-6:
            failures.append(name)
    for name, text in COUNTS.items():
        found = [cost(text.format(count), some_users, 8_000) for count in (5, 50, 500)]
        rows.append(f"{name:30} {'  '.join(f'{one * 1e6:8.1f}' for one in found)} µs with 5, 50, 500")
        if found[2] > 2 * found[0] + 2e-6:
            failures.append(name)
    with capsys.disabled():
        sys.stdout.write("\n" + "\n".join(rows) + "\n")
    assert not failures


def test_counts_of_different_values_cost_what_counts_of_events_cost(capsys: pytest.CaptureFixture[str]) -> None:
    """At most twice: a scan of ports in a window, of 500 sources at once."""

    def cost(count: str) -> float:
        rules = "time t as s late 0 s; event c(s, p) = { k: 'c', s: s, p: p }; event d(s) = { k: 'd', s: s };"
        tree = f"{rules} scan and x never within 1 min; x on c(S, P) times {count}; never on d(S);".replace("'", '"')
        monitor = Engine(rvaft.loads(tree), "scattered")
        log = [
            {"k": "c", "s": number * 7919 % 500, "p": number * 104729 % 60_000, "t": number / 100}
            for number in range(22_000)
        ]
        for event in log[:10_000]:
            monitor.step(event)
        times = []
        for begin in range(10_000, len(log), 1_000):
            start = time.process_time()
            for event in log[begin : begin + 1_000]:
                monitor.step(event)
            times.append((time.process_time() - start) / 1_000)
        assert monitor.verdict is Verdict.UNKNOWN
        return min(times)

    rows, failures = list[str](), list[str]()
    for count in (10, 20, 100):
        events, values = cost(f"{count} each P"), cost(f"{count} distinct P")
        rows.append(f"times {count:<4} {events * 1e6:6.1f} µs, distinct {values * 1e6:6.1f} µs: {values / events:.2f}")
        if values > 2 * events:
            failures.append(rows[-1])
    with capsys.disabled():
        sys.stdout.write("\n" + "\n".join(rows) + "\n")
    assert not failures


SHARED: Final = {
    "two ANDs": ("and x y", "x and {cs}; y and {cs};", "c{i} or a{i} b{i};"),
    "two sequences": ("and x y", "x sand {cs}; y sand {cs};", "c{i} or a{i} b{i};"),
    "pairs in sequence": ("and {ps}", "", "p{i} sand c{i} c{j}; c{i} or a{i} b{i};"),
    "a ladder of sequences": ("and c0", "", "c{i} or l{i} m{i}; l{i} sand c{j} a{i}; m{i} sand c{j} b{i};"),
}  # fmt: skip


def choices(name: str, count: int) -> str:
    """A tree with choices that are shared."""
    top, parents, each = SHARED[name]
    last = f'c{count} on e("first", _); last on e("last", _); '
    made = [each.format(i=i, j=i + 1) + f' a{i} on e("a{i}", _); b{i} on e("b{i}", _);' for i in range(count)]
    cs, ps = (" ".join(f"{one}{i}" for i in range(count)) for one in "cp")
    ends = last if "c{j}" in each else last[last.index("last on") :]
    return f"{TYPES}top {top.format(ps=ps)} last; {parents.format(cs=cs)} {' '.join(made)} {ends}"


@pytest.mark.slow
def test_shared_choices_do_not_double(capsys: pytest.CaptureFixture[str]) -> None:
    """What an event costs with 20 and with 40 shared choices; both children of each come, but for
    semantics that would end by it.
    """
    rows, failures = [f"{'':24} {'semantics':12} {'ms with 20':>11} {'ms with 40':>11}"], []
    for name in SHARED:
        for semantics in ("strict", "projected", "consecutive", "scattered"):
            found = []
            for count in (20, 40):
                order = [*range(count)][:: -1 if "ladder" in name else 1]
                kinds = "ab" if semantics == "scattered" else "a"
                monitor = Engine(rvaft.loads(choices(name, count)), semantics)
                events = [{"n": f"{kind}{number}", "v": 1} for number in order for kind in kinds]
                events.insert(0 if "ladder" in name else len(events), {"n": "first", "v": 1})
                start = time.process_time()
                for event in events:
                    monitor.step(event)
                found.append((time.process_time() - start) / len(events))
            rows.append(f"{name:24} {semantics:12} {found[0] * 1e3:11.2f} {found[1] * 1e3:11.2f}")
            if found[1] > 12 * found[0] + 0.001 or (semantics == "scattered" and found[0] > 0.005):
                failures.append((name, semantics))
    with capsys.disabled():
        sys.stdout.write("\n" + "\n".join(rows) + "\n")
    assert not failures


GATES: Final = {
    "sand": ("sand x y z", "sand x y", "sand p z"),
    "and": ("and x y z", "and x y", "and p z"),
    "pand": ("pand q z", "and x y", "pand p z"),
    "or inside": ("sand o y z", "sand o y", "sand p z"),
}
"""The gate over three leaves; over two; and over the gate of two and the third."""
GUARDS: Final = {
    "no guard": ("_, _", "_, _"),
    "==": ("_, U", "_, U"),
    "!=": ("V, _", "W, _) when (W != V"),
    "<": ("V, _", "W, _) when (W > V + 1000000000"),
    "two guards": ("V, A", "W, B) when (W < V and A != B"),
}
WINDOWS: Final = {
    "no window": "top sand g never; g {three};",
    "one": "top sand g never; g {three} within 20 s;",
    "nested": "top sand g never; g {outer} within 30 s; p {two} within 20 s;",
    "two": "top sand f never; f and g h; g {two} within 20 s; h {last} within 20 s;",
}


def relation(gate: str, guard: str, window: str, times: int, *, ordered: bool) -> str:
    """A tree in which two or three events are related in these ways."""
    three, two, outer = GATES[gate]
    earlier, later = GUARDS[guard]
    order = "sand" if gate == "or inside" else gate
    text = WINDOWS[window].format(three=three, two=two, outer=outer, last=f"{order} u z")
    text += " q and x y;" if gate == "pand" and window in ("no window", "one") else ""
    text += " o or x w;" if gate == "or inside" else ""
    nodes = {
        "x": f'f("x", {earlier})',
        "w": f'f("w", {earlier})',
        "y": f'f("y", {later})',
        "z": f'e("z", _) times {times}',
        "u": f'f("u", {earlier if guard == "==" else "_, _"})',
    }
    text += "".join(
        f" {name} on {event};" for name, event in nodes.items() if f" {name} " in text or f" {name};" in text
    )
    return f"{' assume order 0 s;' if ordered else ''} {text}"


def related(number: int) -> dict[str, Any]:
    """Events a second apart, few of which satisfy a guard."""
    return {"n": "xyuwxyuwz"[number % 9], "v": number * 7919 % 100_003, "w": number % 97, "t": number}


ALL: Final = list(product(GATES, GUARDS, WINDOWS, (1, 20), (False, True)))


@pytest.mark.parametrize(
    ("wanted", "many"),
    [
        pytest.param(ALL[::17], 3_000, marks=pytest.mark.ci, id="some"),
        pytest.param(ALL, 20_000, marks=pytest.mark.slow, id="all"),
        pytest.param([one for one in ALL if one[3] == 1], 100_000, marks=pytest.mark.slow, id="long"),
    ],
)
def test_what_relates_events_does_not_matter(
    wanted: list[tuple[str, str, str, int, bool]], many: int, capsys: pytest.CaptureFixture[str]
) -> None:
    """Whatever gates, guards, windows, counts and declared orders: an event costs what it did."""
    trees = {
        f"{gate}, {guard}, {window}, times {times}{', order' if ordered else ''}": (
            relation(gate, guard, window, times, ordered=ordered),
            related,
        )
        for gate, guard, window, times, ordered in wanted
    }
    check(trees, many, capsys)
