"""The engine against the reference where values and times tie events together, and partial matches
are found, replaced and forgotten by them.
"""

from collections.abc import Iterator, Sequence
from random import Random
from typing import Any, Final

import pytest

from rvaft import loads, monitor
from rvaft.engine import Engine
from rvaft.engine.scattered_linear import LinearMonitor
from rvaft.errors import TooLarge
from rvaft.language.parser import parse
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Verdict
from tests.engine.checking import compare, small_and_valid
from tests.tables import sampled

SHAPES: Final = (
    "top sand l0 l1 l2 l3 g0 g1;",
    "top and l0 l1 l2 g0 g1;",
    "top sand x l3; x and l0 l1 l2 g0 g1;",
    "top or x y; x sand l0 l1 g0; y sand l0 l2 l3 g1;",
    "top sand l0 x l3; x 2of4 l1 l2 g0 g1;",
    "top and x y; x sand l0 l1 g0; y sand l2 l3 g1;",
    "top and x y g1; x and l0 l1 g0; y or l2 z; z and l3 l4;",
    "top and x y z; x sand l0 l1; y sand l2 l3; z or l4 g0;",
    "top sand x y; x and l0 l1 within 2 s; y and l2 l3 g0;",
    "top and x l3 within 3 s; x sand l0 l1 l2 within 1 s;",
    "top and x y within 2 s; x or l0 l1; y sand l2 l3 g0;",
    'top sand x l3; x and a within 1 s; a on e("a", P) times 3;',
)
WINDOWS: Final = (
    "top and l0 l1 l2 l3 within 3 s;",
    "top sand x l3 within 4 s; x and l0 l1 l2 within 2 s;",
    "top and x l4 g0 within 4 s; x sand l0 l1 l2 l3 within 3 s;",
    'top sand x l3; x and a l0 within 2 s; a on e("a", P) times 3;',
    'top and x y; x and a l0 within 2 s; y or l1 z; z and l2 l3 b within 3 s; a on e("a", P) times 3; b on e("b", Q);',
    "top 3of4 l0 l1 l2 l3 within 2 s;",
    "top or x y; x and l0 l1 l2 within 2 s; y and l1 l2 l3 l4 within 3 s;",
    'top and a l1 g2; a on e("a", _) times 3; g2 when end(a) - start(a) <= 1 s and at(l1) - start(a) <= 9 s;',
    'top and x l1; x and a l0 g2 within 3 s; a on e("a", _) times 3; g2 when start(a) - at(l0) <= 0 s;',
)
"""Windows over three times and more."""
VALUES: Final = (
    (0, 1, 2),
    (0, 1, 2, 3, 4),
    (0, 1, 1.0, 2, "a"),
    "abc",
    (0, None, [1]),
    (0.5, 1, 2.5, float("nan"), float("inf"), 10**101),
)


MANY_VALUES: Final = (
    range(9),
    (*range(-4, 5), 0.5, 1.0, "a", "b"),
    "abcdefgh",
    (2**53, 2**53 + 1, -(2**60), 10**101, 1.5, float("nan"), 0, 1, 2),
)


def comparison(random: Random, leaves: list[int], names: list[str]) -> str:
    one, other = random.choice(names), random.choice(names)
    if random.random() < 0.25 and leaves:
        points = [f"{random.choice(('at', 'start', 'end'))}(l{random.choice(leaves)})" for _ in range(2)]
        return f"{' - '.join(points)} {random.choice(('<=', '<', '>=', '=='))} {random.randint(0, 3)} s"
    more = random.choice(("", "", " + 1", " + 0.5"))
    return (
        f"{random.choice(('', '', 'not '))}{one} "
        f"{random.choice(('==', '!=', '!=', '!=', '<', '<=', '>', '>='))} {other}{more}"
    )


def trees(random: Random, shapes: Sequence[str], count: int) -> Iterator[tuple[RVAFT, str]]:
    """Trees of few leaves with the letters of their events."""
    while count:
        shape, letters = random.choice(shapes), random.choice(("abc", "abcde"))
        names = random.choice((list("PQRST"), list("PQRSP"), [random.choice("PQ_") for _ in range(5)]))
        leaves = [number for number in range(5) if f"l{number}" in shape]
        on = [f'l{n} on e("{letters[n % len(letters)]}", {names[n]});' for n in leaves]
        bound = [names[n] for n in leaves if names[n] != "_"] or ["1"]
        for guard in [guard for guard in ("g0", "g1") if guard in shape]:
            asked = [comparison(random, leaves, bound) for _ in range(random.choice((1, 1, 2, 3)))]
            on.append(f"{guard} when {random.choice((' and ', ' and ', ' or ')).join(asked)};")
        late = random.choice(("", " late 0 s", " late 1 s"))
        tree = parse(f"time t as s{late}; event e(n, v) = {{ e: n, v: v }}; {shape} {' '.join(on)}").build()
        if small_and_valid(tree, 20):
            count -= 1
            yield tree, letters


def guarded(random: Random) -> RVAFT:
    """A tree of three leaves in which all values of V may matter: two guards need it, in different ways."""

    def guard(later: str, name: str) -> str:
        if random.random() < 0.3:
            return f"at({later}) - at(a) {random.choice(('<=', '<', '>=', '>'))} {random.randint(0, 6)} s"
        one = (
            f"{name} {random.choice(('<', '<=', '>', '>=', '=='))} V{random.choice(('', '', ' + 1', ' - 0.5', ' + V'))}"
        )
        return random.choice((one, one, f"not {one}", f"V + 1 > {name}"))

    late = random.choice(("", " late 1 s"))
    return loads(
        f"time t as s{late}; event e(n, v) = {{ e: n, v: v }}; top {random.choice(('sand', 'and'))} a b c g"
        f'{random.choice(("", "", " within 9 s"))}; a on e("a", V); b on e("b", W) when {guard("b", "W")};'
        f' c on e("c", X); g when {guard("c", "X")}{random.choice(("", " and X != V", " and X < W"))};'
    )


def trace(random: Random, letters: str, *, long: bool = False) -> list[dict[str, Any]]:
    """Events whose times sometimes go back, and sometimes lack."""
    time, events, values = 0, list[dict[str, Any]](), random.choice(MANY_VALUES if long else VALUES)
    for _ in range(random.randint(15, 30) if long else random.randint(5, 11)):
        time += random.choice((-2, -1, 0, 0, 1, 1, 1, 2))
        told = {"t": time} if random.random() < 0.95 else {}
        events.append({"e": random.choice(letters), "v": random.choice(values), **told})
    return events


@pytest.mark.ci
@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 12))])
@pytest.mark.parametrize("shapes", sampled([(SHAPES,), (WINDOWS,)], 2), ids=["joins", "windows"])
def test_joined_events(shapes: Sequence[str], seed: int) -> None:
    """Verdicts and explanations are those of the definition; copies are in the same state, and wait for the same."""
    random, detected = Random(f"joins {seed}"), 0
    for tree, letters in trees(random, shapes, 120):
        for _ in range(3):
            events = trace(random, letters)
            found = compare(tree, events, "scattered")
            detected += found is not None and found.verdict is Verdict.TRUE
        monitor = Engine(tree, "scattered")
        for event in events:
            if monitor.step(event).final:
                break
            twin = monitor.fork()
            assert (twin.state, twin.pending()) == (monitor.state, monitor.pending())
    assert detected > 10


@pytest.mark.ci
@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 12))])
def test_many_partial_matches(seed: int) -> None:
    """Partial matches that an index finds, by equal values and by ranges of values and times."""
    random, detected, many = Random(f"many {seed}"), 0, 0
    for _ in range(400):
        events = trace(random, random.choice(("aaabc", "aaaaaaabc")), long=True)
        found = compare(guarded(random), events, "scattered")
        assert found is not None
        detected += found.verdict is Verdict.TRUE
        many += len(getattr(found._strategy, "partial", ())) > 9
    assert detected > 100
    assert many > 40


FEW: Final = {
    "a value that differs": ('top sand a b; a on e("a", V); b on e("b", W) when V != W;', 3),
    "three that differ": (
        ('top sand a b c; a on e("a", V); b on e("a", W) when V != W; c on e("c", X) when X != V and X != W;'),
        8,
    ),
    "the greatest": ('top sand a b; a on e("a", V); b on e("b", W) when W < V;', 2),
    "independent parts": (
        ('top and x y; x sand a b; y sand c d; a on e("a", V); b on e("b", V); c on e("a2", W); d on e("d", W);'),
        202,
    ),
    "nested ands": (
        (
            'top and p z; p and q x; q and y; x sand a b; y sand c d; z sand g h; a on e("a", V); b on '
            'e("b", V); c on e("a2", W); d on e("d", W); g on e("g", X); h on e("h", X);'
        ),
        202,
    ),
    "a window with late": ('time t as s late 2 s; top and a b within 5 s; a on e("a", _); b on e("b", _);', 10),
    "a count with late": (
        ('time t as s late 2 s; top sand x b; x and a within 5 s; a on e("a", _) times 9; b on e("b", _);'),
        30,
    ),
}


@pytest.mark.parametrize("name", FEW)
def test_how_many_are_followed(name: str) -> None:
    """Two hundred values, of which few matter; where all do, as many as there are and not their product."""
    text, most = FEW[name]
    monitor = Engine(parse(f"event e(n, v) = {{ e: n, v: v }}; {text}").build(), "scattered", limit=most)
    for number in range(200):
        event = {
            "e": "a2" if name in ("independent parts", "nested ands") and number % 2 else "a",
            "v": number,
            "t": number,
        }
        assert monitor.step(event) is Verdict.UNKNOWN  # it raises beyond the limit


@pytest.mark.parametrize("last", ["or x", "or x y"])
def test_nested_orders_do_not_multiply(last: str) -> None:
    """An event that every scenario has, and before which nothing is left to come, is taken: passing
    over it is of no use.
    """
    gates = " ".join(f"g{number} pand l{number} g{number + 1};" for number in range(12))
    monitor = Engine(parse(f"toplevel g0; {gates} g12 {last};").build(), "scattered")
    for number in range(12):
        monitor.step({"event": f"l{number}"})
        parts = getattr(monitor._strategy, "parts", [monitor._strategy])
        assert all(isinstance(strategy, LinearMonitor) or len(strategy.partial) == 1 for strategy in parts)
    assert monitor.step({"event": "x"}) is Verdict.TRUE


def test_a_branch_has_its_number_where_its_choice_is_not_made() -> None:
    """Also where the tree is said as several, one for each way to make the choices."""
    tree = parse("time t as s; top 1of2 a p within 3 s; p or x y;").build()
    assert compare(tree, [{"event": "a", "t": 1}], "scattered", branch=2) is not None


def test_too_many_sets_of_events_are_refused_before_they_take_long() -> None:
    """Of events that join in a window any may be skipped: each set of them is followed, up to a
    tenth of the limit.
    """
    names = [f"l{number}" for number in range(14)]
    known = "guard when at(l0) != at(l1);"  # relates two events, so that each set of them counts
    tree = parse(f"time t as s; top and {' '.join(names)} guard within 100 s; {known}").build()
    monitor = Engine(tree, "scattered", limit=20_000)
    events = [{"event": name, "t": time} for time, name in enumerate(names)]
    with pytest.raises(TooLarge, match=r"sets of events .*; any of l0, l1, .* may be skipped \(limit 2000\)"):
        list(map(monitor.step, events))


def test_the_time_of_what_has_no_event_in_a_part_that_never_happens_is_undefined() -> None:
    tree = loads(
        "causality bottom_up; time t as s; event e(n) = { e: n }; top and g3; g0 or l0 l3; g1 sand_rl g0 l0 l1;"
        'g2 sand l2 l1 g1 on e("a") when at(l3) <= at(g1); g3 1of2 g2 l1; l0 on e("a"); l1 on e("a") times '
        '2; l2 on e("b"); l3 on e("a");'
    )
    watching = monitor(tree, semantics="strict", branch=2)
    assert [watching.step({"e": "a", "t": time}).symbol for time in (1, 3)] == ["?", "⊤"]


def test_what_is_not_finite_equals_nothing() -> None:
    text = (
        'event a(v) = { event: "a", v: v }; event b(v) = { event: "b", v: v }; top and c s; s sand x y; '
        "x on a(V); y on b(V); c;"
    )
    for value in (float("inf"), float("nan"), [float("-inf")]):
        events: list[dict[str, Any]] = [{"event": "c"}, {"event": "a", "v": value}, {"event": "b", "v": value}]
        engine = compare(loads(text), events, "scattered")
        assert engine is not None
        assert engine.verdict is Verdict.UNKNOWN


def test_a_window_that_is_complete_has_no_deadline() -> None:
    """Also where only the least and the greatest of its times are remembered."""
    tree = loads(
        'time t as s late 0 s; event e(n) = { e: n }; top and a l g; a on e("a") times 3; l on e("l"); '
        "g when end(a) - start(a) <= 1 s and at(l) - start(a) <= 9 s;"
    )
    engine = compare(tree, [{"e": "a", "t": 0}] * 3 + [{"e": "x", "t": 4}, {"e": "l", "t": 5}], "scattered")
    assert engine is not None
    assert engine.verdict is Verdict.TRUE
