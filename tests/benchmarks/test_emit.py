"""Texts of trees with many leaves: processor time for twice as many leaves, and for refusals, as ratios within one run.

`pytest tests/benchmarks/test_emit.py -s` prints the table.
"""

import time
from collections.abc import Callable
from typing import Final

import pytest

from rvaft import RVAFT, NotExpressible, Semantics, TooLarge, loads
from rvaft.backend import backend
from rvaft.core.build import build
from tests.benchmarks.conftest import Ratios

pytestmark = pytest.mark.benchmark

MOST: Final = 3.2
"""The time for twice as many leaves; with quadratic work it is 4."""
TYPES: Final = "event e(k: text, x: text) = { event: k, v: x }; time t as s late 0 s; assume types, present; "


def leaves(count: int, arguments: str = "") -> str:
    """Statements of leaves, with their own event where there are arguments."""
    return "".join(f' l{number} on e("l{number}", {arguments});' for number in range(count)) if arguments else ""


def shape(gate: str, arguments: str = "", window: str = "") -> Callable[[int], str]:
    """The text of a tree of one gate, by its number of leaves."""
    head = TYPES if arguments else ""

    def text(count: int) -> str:
        names = " ".join(f"l{number}" for number in range(count))
        return f"{head}top {gate} {names}{window};{leaves(count, arguments)}"

    return text


SHAPES: Final = {
    "or": shape("or"),
    "or, one variable": shape("or", "X"),
    "or, within": shape("or", "_", " within 1 min"),
    "sand": shape("sand"),
    "sand, one variable": shape("sand", "X"),
    "and": shape("and"),
}
BY_SEMANTICS: Final = {
    Semantics.PROJECTED: [
        "automaton",
        "c",
        "ltlf",
        "match-recognize",
        "mfotl",
        "mtl",
        "rml",
        "rml-paper",
        "sql",
        "sql-table",
    ],
    Semantics.SCATTERED: ["automaton", "c", "eql", "kql", "ltlf", "mfotl", "mtl", "rml", "sigma", "sql", "stix"],
}
CASES: Final = {
    "or": BY_SEMANTICS,
    "or, one variable": {
        Semantics.PROJECTED: ["c", "ltlf", "match-recognize", "rml", "sql"],
        Semantics.SCATTERED: ["eql", "kql", "sigma", "sql", "sql-table", "stix"],
    },
    "or, within": {
        Semantics.PROJECTED: ["c", "mfotl", "sql", "match-recognize"],
        Semantics.SCATTERED: ["c", "kql", "ltlf", "sigma", "sql-table"],
    },
    "sand": {Semantics.PROJECTED: ["automaton", "c", "ltlf", "rml"], Semantics.SCATTERED: ["c", "ltlf", "rml"]},
    "sand, one variable": {Semantics.PROJECTED: ["c", "ltlf"], Semantics.SCATTERED: ["c"]},
    "and": {Semantics.SCATTERED: ["ltlf", "mfotl", "rml"]},
}
"""The languages that write a tree of a shape."""
FEW: Final = 5
"""The time until a refusal, as a multiple of the time to read the tree."""
COUNT: Final = 1_000
REFUSED: Final = {
    "or": [
        *((name, Semantics.PROJECTED) for name in ("eql", "kql", "sigma", "stix")),
        *((name, Semantics.SCATTERED) for name in ("kql", "sql", "sql-table", "c", "sigma", "mfotl", "eql")),
        *((name, Semantics.PROJECTED) for name in ("c", "sql", "match-recognize", "mfotl")),
    ],
    "and": [(name, Semantics.SCATTERED) for name in ("c", "eql", "kql", "match-recognize", "mtl", "sigma", "sql")],
    "and, within": [(name, Semantics.SCATTERED) for name in ("c", "kql", "sigma", "sql")],
    "sand": [(name, Semantics.PROJECTED) for name in ("c", "eql", "kql", "sigma", "stix")],
    "long sand": [(name, Semantics.STRICT) for name in ("match-recognize", "mtl", "mtl-r2u2")],
}
"""What the default limit, or the language, does not allow."""


def seconds(tree: RVAFT, name: str, semantics: Semantics, limit: int | None = 10**7) -> float:
    """The processor time of a translation, also of one that is refused."""
    build.cache_clear()
    start = time.process_time()
    try:
        backend(name).translate(tree, semantics, limit=limit)
    except (NotExpressible, TooLarge):
        assert limit is None, "the language writes the tree"
    return time.process_time() - start


@pytest.mark.parametrize("title", CASES)
def test_twice_as_many_leaves_take_twice_as_long(
    title: str, ratios: Ratios, capsys: pytest.CaptureFixture[str]
) -> None:
    trees = [loads(SHAPES[title](count)) for count in (COUNT, 2 * COUNT)]
    for tree in trees:
        assert tree.alphabet  # is computed once for a tree
    slow = []
    for semantics, names in CASES[title].items():
        for name in names:
            rounds = [[seconds(tree, name, semantics) for tree in trees] for _ in range(2)]
            ratio = min(last for _, last in rounds) / min(first for first, _ in rounds)
            if ratio >= MOST:  # the machine may have been busy
                rounds += [[seconds(tree, name, semantics) for tree in trees] for _ in range(3)]
                ratio = min(last for _, last in rounds) / min(first for first, _ in rounds)
            ratios.add(f"{name} of {title}, {semantics}: {2 * COUNT:,} leaves", f"{COUNT:,} leaves", ratio, MOST)
            with capsys.disabled():
                print(f"\n{title:20} {name:16} {semantics:10} {ratio:5.2f}", end="")
            slow += [(name, semantics, ratio)] if ratio >= MOST else []
    assert slow == []


LARGE: Final = 10_000
BITS: Final = 3.9
"""The same for an automaton, whose letters are sets of all leaves: numbers of 20,000 bits."""


@pytest.mark.slow
def test_texts_of_twenty_thousand_leaves_take_twice_as_long_as_of_ten_thousand(
    ratios: Ratios, capsys: pytest.CaptureFixture[str]
) -> None:
    """An `or`, in every language and under each semantics that write it."""
    trees = [loads(SHAPES["or"](count)) for count in (LARGE, 2 * LARGE)]
    for tree in trees:
        assert tree.alphabet  # is computed once for a tree
    slow = []
    for semantics, names in BY_SEMANTICS.items():
        for name in names:
            rounds = [[seconds(tree, name, semantics) for tree in trees] for _ in range(2)]
            ratio = min(last for _, last in rounds) / min(first for first, _ in rounds)
            most = BITS if name == "automaton" else MOST
            ratios.add(f"{name} of or, {semantics}: {2 * LARGE:,} leaves", f"{LARGE:,} leaves", ratio, most)
            with capsys.disabled():
                print(f"\n{name:16} {semantics:10} {min(last for _, last in rounds):7.2f} s {ratio:5.2f}", end="")
            slow += [(name, semantics, ratio)] if ratio >= most else []
    assert slow == []


@pytest.mark.parametrize("title", REFUSED)
def test_refusals_come_before_the_work(title: str, ratios: Ratios) -> None:
    """They take little more than reading the tree."""
    others = {"and, within": shape("and", "_", " within 1 min"), "long sand": SHAPES["sand"]}
    text = (SHAPES | others)[title](COUNT * {"or": 5, "long sand": 4}.get(title, 1))
    start = time.process_time()
    tree = loads(text)
    assert tree.alphabet
    reading = time.process_time() - start
    slow = []
    for name, semantics in REFUSED[title]:
        ratio = min(seconds(tree, name, semantics, limit=None) for _ in range(2)) / reading
        ratios.add(f"refusal of {title} by {name}, {semantics}", "reading the tree", ratio, FEW)
        slow += [(name, semantics, ratio)] if ratio >= FEW else []
    assert slow == []
