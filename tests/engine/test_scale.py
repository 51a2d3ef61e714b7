"""Trees too large for anything but an incremental monitor, and traces too long to remember."""

from random import Random

import pytest

import rvaft
from rvaft.engine import Engine
from rvaft.engine.scattered_linear import Earliest
from rvaft.errors import TooLarge
from rvaft.model.nodes import Gate, Node
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Verdict

MANY = 5_000
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
    assert monitor.explanation.matched == {letter: position for position, letter in enumerate(word, 1)}
    assert monitor.explanation.branch == {"or": MANY, "chain of or": MANY + 1}.get(name, 1)


def test_a_scattered_log_does_not_grow() -> None:
    """What is kept for the explanation depends on the tree alone."""
    monitor = Engine(
        rvaft.loads(
            'event n(x) = { event: x }; top sand x y z; x or a b; y or c d again; again on n("a"); z or e f g;'
        ),
        "scattered",
    )
    random = Random(1)
    letters = [{"event": letter} for letter in "abcda"]
    sizes = []
    for _ in range(2):
        for _ in range(2_000):
            monitor.step(random.choice(letters))
        assert isinstance(monitor._strategy, Earliest)
        assert monitor._strategy.useful is not None
        sizes.append(len(monitor._strategy.useful.entries))
    assert sizes[0] == sizes[1] < 50
    assert monitor.step({"event": "g"}) is Verdict.TRUE


def test_too_many_values_are_refused_by_name() -> None:
    tree = rvaft.loads("event p(v) = { p: v }; event q(v) = { q: v }; top sand a b; a on p(First); b on q(First);")
    monitor = Engine(tree, "scattered", limit=100)
    with pytest.raises(TooLarge, match="First") as caught:
        list(monitor.run({"p": number} for number in range(101)))
    assert caught.value.limit == 100


def test_a_log_too_large_is_refused_by_name() -> None:
    tree = rvaft.loads("top sand x y z; x or a b; y or c d; z or e f;")
    monitor = Engine(tree, "scattered", limit=2)
    with pytest.raises(TooLarge, match="most of them for") as caught:
        list(monitor.run({"event": word} for word in "acb"))
    assert caught.value.limit == 2
    assert "a, c, b" in str(caught.value)


def test_too_many_ways_are_refused_by_name() -> None:
    """An `and` over leaves, each of which wants another field of the same events: every subset is a way."""
    types = "".join(f"event e{i}(x) = {{ f{i}: x }}; " for i in range(20))
    leaves = "".join(f" l{i} on e{i}(_);" for i in range(20))
    names = " ".join(f"l{i}" for i in range(20))
    monitor = Engine(rvaft.loads(f"{types} top and {names};{leaves}"), limit=1_000)
    with pytest.raises(TooLarge, match="l0"):
        list(monitor.run([{f"f{i}": 1 for i in range(20)}] * 10))


def test_resolutions_of_a_core_are_bounded() -> None:
    """Which choices cover exactly the events seen is as hard as satisfiability."""
    random = Random(3)
    gates = [Node(f"o{i}", Gate.OR, (f"p{i}", f"n{i}")) for i in range(24)]
    clauses = [sorted(random.sample(range(40), 4)) for _ in range(48)]
    sides = [
        Node(f"{side}{i}", Gate.AND, tuple(f"c{c}" for c in clauses[2 * i + (side == "n")]))
        for i in range(24)
        for side in "pn"
    ]
    used = sorted({leaf for node in sides for leaf in node.children})
    tree = RVAFT("top", [Node("top", Gate.AND, tuple(node.name for node in gates)), *gates, *sides, *map(Node, used)])
    monitor = Engine(tree, limit=200)
    with pytest.raises(TooLarge, match="o0"):
        list(monitor.run({"event": leaf} for leaf in used))
