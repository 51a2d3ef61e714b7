"""Trees too large for anything but an incremental monitor, and traces too long to remember."""

import subprocess
import sys
from random import Random
from typing import Any, Final

import pytest

import rvaft
from rvaft.engine import Engine
from rvaft.engine.scattered_linear import LinearMonitor
from rvaft.errors import TooLarge
from rvaft.model.nodes import Gate, Node
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Verdict
from rvaft.support import budget

MANY = 1_100
LEAVES = [f"l{index}" for index in range(MANY)]


def wide(gate: Gate, threshold: int | None = None) -> RVAFT:
    return RVAFT("top", [Node("top", gate, tuple(LEAVES), threshold), *map(Node, LEAVES)])


def chain(gate: Gate, *, leaf_first: bool) -> RVAFT:
    """Gates below one another, each with a leaf; the last child of the last is the leaf `end`."""
    gates = [*(f"g{index}" for index in range(MANY)), "end"]
    pairs = [(leaf, gates[i + 1]) if leaf_first else (gates[i + 1], leaf) for i, leaf in enumerate(LEAVES)]
    nodes = [Node(gates[i], gate, pair) for i, pair in enumerate(pairs)]
    return RVAFT("g0", [*nodes, Node("end"), *map(Node, LEAVES)])


BACK = LEAVES[::-1]
DEEP_AND_WIDE = {
    "and": (wide(Gate.AND), BACK),
    "sand": (wide(Gate.SAND), LEAVES),
    "sand_rl": (wide(Gate.SAND_RL), BACK),
    "vot": (wide(Gate.VOT, MANY - 10), BACK[10:]),
    "or": (wide(Gate.OR), BACK[:1]),
    "chain of and": (chain(Gate.AND, leaf_first=False), [*LEAVES, "end"]),
    "chain of sand": (chain(Gate.SAND, leaf_first=True), [*LEAVES, "end"]),
    "chain of sand, deepest first": (chain(Gate.SAND, leaf_first=False), ["end", *BACK]),
    "chain of sand_rl": (chain(Gate.SAND_RL, leaf_first=True), ["end", *BACK]),
    "chain of or": (chain(Gate.OR, leaf_first=True), ["end"]),
}


@pytest.mark.ci
@pytest.mark.parametrize("name", DEEP_AND_WIDE)
@pytest.mark.parametrize("semantics", ["strict", "projected", "scattered"])
def test_large_trees(name: str, semantics: str) -> None:
    tree, word = DEEP_AND_WIDE[name]
    monitor = Engine(tree, semantics)
    verdicts = [monitor.step({"event": letter}) for letter in word]
    assert set(verdicts[:-1]) <= {Verdict.UNKNOWN}
    assert verdicts[-1] is Verdict.TRUE
    hash(monitor.state)
    assert monitor.explanation is not None
    assert monitor.explanation.events == {letter: [position] for position, letter in enumerate(word, 1)}
    assert monitor.explanation.branch == {"or": MANY, "chain of or": MANY + 1}.get(name, 1)


def test_a_scattered_log_does_not_grow() -> None:
    """What is kept for the explanation depends on the tree alone."""
    text = 'event n(x) = { event: x }; top sand x y z; x or a b; y or c d again; again on n("a"); z or e f g;'
    monitor, random, sizes = Engine(rvaft.loads(text), "scattered"), Random(1), []
    for _ in range(2):
        for _ in range(1_000):
            monitor.step({"event": random.choice("abcda")})
        assert isinstance(monitor._strategy, LinearMonitor)
        assert monitor._strategy.useful is not None
        sizes.append(len(monitor._strategy.useful.entries))
    assert sizes[0] == sizes[1] < 50
    assert monitor.step({"event": "g"}) is Verdict.TRUE


REFUSED: dict[str, tuple[str, str, int, list[Any], str]] = {
    "values": (
        (
            "event p(v) = { p: v }; event q(v) = { q: v }; top sand a b; a on p(First); "
            "b on q(Second) when First + 1 == Second;"
        ),
        *("scattered", 100, [{"p": number} for number in range(101)], "First"),
    ),
    "a log": (
        "top sand x y z; x or a b; y or c d; z or e f;",
        *("scattered", 2, [{"event": word} for word in "acb"], "most of them for a, c, b"),
    ),
    "ways": (  # leaves of which each wants another field of the same events: every subset is a way
        "".join(f"event e{i}(x) = {{ f{i}: x }}; l{i} on e{i}(_);" for i in range(20))
        + f"top and {' '.join(f'l{i}' for i in range(20))};",
        *("projected", 1000, [{f"f{i}": 1 for i in range(20)}] * 10, "l0"),
    ),
}


@pytest.mark.parametrize("what", REFUSED)
def test_too_much_is_refused_by_name(what: str) -> None:
    tree, semantics, limit, events, said = REFUSED[what]
    monitor = Engine(rvaft.loads(tree), semantics, limit=limit)
    with pytest.raises(TooLarge, match=said) as caught:
        list(monitor.run(events))
    assert caught.value.limit == limit


def test_values_of_a_common_variable_take_little() -> None:
    """Of these the limit allows twenty times as many."""
    text = "event p(v) = { p: v }; event q(v) = { q: v }; top sand a b; a on p(Value); b on q(Value);"
    monitor = Engine(rvaft.loads(text), "scattered", limit=100)
    for number in range(2_000):
        assert monitor.step({"p": number}) is Verdict.UNKNOWN
    with pytest.raises(TooLarge, match="values of Value") as caught:
        monitor.step({"p": -1})
    assert caught.value.limit == 2_000
    assert monitor.step({"q": 1_999}) is Verdict.TRUE


def test_resolutions_of_a_core_are_bounded() -> None:
    """Which choices cover exactly the events seen is as hard as satisfiability."""
    random = Random(3)
    gates = [Node(f"o{i}", Gate.OR, (f"p{i}", f"n{i}")) for i in range(24)]
    sides: dict[str, list[str]] = {side: [] for gate in gates for side in gate.children}
    for clause in range(48):
        sides[f"{'pn'[clause % 2]}{clause // 2}"] = sorted({f"c{leaf}" for leaf in random.sample(range(40), 4)})
    used = sorted(set().union(*sides.values()))
    ands = [Node(side, Gate.AND, tuple(leaves)) for side, leaves in sides.items()]
    top = Node("top", Gate.AND, tuple(node.name for node in gates))
    monitor = Engine(RVAFT("top", [top, *gates, *ands, *map(Node, used)]), limit=200)
    with pytest.raises(TooLarge, match="o0"):
        list(monitor.run({"event": leaf} for leaf in used))


HEAVY: Final = {
    "resolutions of the choices": (
        (
            "top pand a b c; a and x o q; o 1of2 p r; q pand s t; b and x y; c and o z; x on e(4); p on e(3);"
            " r on e(3); s on e(1); t on e(1); y on e(1); z on e(3);"
        ),
        "projected",
    ),
    "ways to join matches": (
        (
            "time t as s; top sand a b w within 500 s; a 1of2 p q; b and r s; p on e(1); q on e(2); r on e(3);"
            " s on e(4); w on e(0);"
        ),
        "scattered",
    ),
    "new partial matches": (
        "top and a b c; a on e(N) when N != M; b on e(M) when M != K; c on e(K) when K == 1000;",
        "scattered",
    ),
}


@pytest.mark.parametrize("what", HEAVY)
def test_the_work_of_one_step_is_bounded(what: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Over all searches of the step; the next step begins anew."""
    tree, semantics = HEAVY[what]

    def run() -> None:
        engine, random = Engine(rvaft.loads(f"event e(n) = {{ n: n }}; {tree}"), semantics), Random(1)
        for number in range(60):
            event = {"n": random.randint(1, 4), "t": random.randrange(1_000)}
            if engine.step(event if semantics == "scattered" else {"n": (4, 1, 1, 3, 3)[number % 5]}).final:
                break

    run()
    monkeypatch.setattr(budget, "MIN_VISITS", 10)
    monkeypatch.setattr(budget, "VISITS", 0)
    with pytest.raises(TooLarge, match=rf"one step of the monitor; it visits too many {what}") as caught:
        run()
    assert "--max-configurations" in caught.value.__notes__[0]


PROGRAM = """
import sys
from itertools import islice
import rvaft

TREE = '''
event go(w, t)   = { do: "go", where: w, time: t };
event stay(w, t) = { do: "stay", where: w, time: t };
event read(v, t) = { value: v, time: t };
top or round high;
round sand p q never;
p on go(W, T1);
q on stay(W, T2);
never when T2 + 10 <= T1;
high sand r s;
r on go(U, _);
s sand t h;
t on read(V, T3);
h when V >= 250 and T3 >= 0;
'''

def events():
    number = 0
    while True:
        where = f"w{number * 7 % 10}"
        yield {"do": "go", "where": where, "time": number}
        yield {"value": number % 250, "time": number}
        yield {"do": "stay", "where": where, "time": number + 1}
        yield {"other": number, "name": f"n{number % 1000}"}
        number += 1

def resident():
    with open("/proc/self/statm") as status:
        return int(status.read().split()[1]) * 4096 / 1e6

few, many = int(sys.argv[1]), int(sys.argv[2])
monitor = rvaft.monitor(rvaft.loads(TREE), semantics=sys.argv[3])
stream = events()
for event in islice(stream, few):
    monitor.step(event)
before = resident()
for event in islice(stream, many - few):
    verdict = monitor.step(event)
assert verdict is rvaft.Verdict.UNKNOWN
print(resident() - before)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
@pytest.mark.parametrize(
    ("few", "many", "most"), [(10_000, 40_000, 2), pytest.param(10**6, 10**7, 5, marks=pytest.mark.slow)]
)
def test_memory_stays(few: int, many: int, most: float) -> None:
    """A trace without end does not take memory without end, where the values that matter are bounded."""
    command = [sys.executable, "-c", PROGRAM, str(few), str(many), "scattered"]
    assert float(subprocess.run(command, capture_output=True, text=True, check=True).stdout) < most
