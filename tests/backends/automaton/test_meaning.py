"""The language as Spot sees it, texts that run alone, slices, and that no two states are equivalent."""

from itertools import combinations
from random import Random
from typing import Any

import pytest

from backends.automaton import AutomatonBackend
from backends.conformance import examples
from cross_check.generate.trees import Shape, random_tree
from rvaft.api import loads
from rvaft.errors import TooLarge
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics
from tests.backends.texts import signs

pytestmark = pytest.mark.spot
spot: Any = pytest.importorskip("spot")

VALUES = loads("event a(x) = { a: x }; event b(x) = { b: x }; toplevel r; r sand m n; m on a(X); n on b(X);")


def text_of(tree: str, semantics: str) -> str:
    return AutomatonBackend().translate(loads(f"toplevel r; {tree}"), Semantics(semantics)).text


FORMULAS = [
    ("r or a b c;", "scattered", "F(a | b | c)"),
    ("r and a b c;", "scattered", "F a & F b & F c"),
    ("r sand a b c;", "scattered", "F(a & X[!]F(b & X[!]F c))"),
    ("r sand_rl a b c;", "scattered", "F(c & X[!]F(b & X[!]F a))"),
    ("r 2of3 a b c;", "scattered", "(F a & F b) | (F a & F c) | (F b & F c)"),
    ("r sand a b c;", "strict", "a & X[!](b & X[!]c)"),
    ("r and a b;", "strict", "(a & X[!]b) | (b & X[!]a)"),
    ("r sand v c; v 1of2 a b;", "strict", "(a & X[!]c) | (b & X[!]c) | (a & X[!](b & X[!]c)) | (b & X[!](a & X[!]c))"),
    ("r sand a b;", "projected", "!relevant U (relevant & a & X[!](!relevant U (relevant & b)))"),
]


@pytest.mark.parametrize(("tree", "semantics", "formula"), FORMULAS)
def test_language_is_that_of_a_formula(tree: str, semantics: str, formula: str) -> None:
    """Over words of exclusive letters, Spot finds the text equivalent to a formula on finite words,
    and reads it as it is.
    """
    text = text_of(tree, semantics)
    names = [name for name in "abc" if f'"{name}"' in text]
    exclusive = " & ".join(f"G!({one} & {other})" for one, other in combinations(names, 2))
    if semantics == "projected":
        exclusive += " & " + " & ".join(f"G({name} -> relevant)" for name in names)
    words = spot.translate(spot.formula(exclusive or "1"))
    expected = spot.translate(spot.from_ltlf(spot.formula(formula)))
    ours = spot.automaton(text)
    assert spot.is_deterministic(ours)
    assert spot.are_equivalent(ours, spot.automaton(ours.to_str("hoa")))
    assert spot.are_equivalent(spot.product(ours, words), spot.product(expected, words))


@pytest.mark.parametrize(
    ("old", "new", "verdicts"),
    [
        ("", "", "??T"),
        ("[0&1] 2", "[0&1] 3", "?FF"),
        ("[0&1] 2", "[0&1] 1", "FFF"),
        ("[0&2] 3", "[0&2] 4", "?TT"),
        ('event: 2 "{ event: \\"b\\" }"', 'event: 2 "{ event: \\"z\\" }"', "?FF"),
    ],
)
def test_the_text_alone_is_run(old: str, new: str, verdicts: str) -> None:
    """With the tree gone, another target of one edge gives other verdicts, and so does another
    event of one proposition.
    """
    monitor = AutomatonBackend().read(text_of("r sand a b c;", "strict").replace(old, new))
    assert signs(monitor, "a b c") == verdicts


def test_slices_follow_each_value_and_are_limited(monkeypatch: pytest.MonkeyPatch) -> None:
    specification = AutomatonBackend().translate(VALUES, Semantics.SCATTERED)
    monitor = specification.monitor()
    for value in (1, 2, 3, 1.0, True):
        monitor.step({"a": value})
    state = monitor.state
    monitor.step({"a": 1})
    assert monitor.state == state
    assert signs(monitor, [{"b": 4}, {"b": "1"}, {"b": 3.0}]) == "??T"
    monkeypatch.setattr("backends.slices.LIMIT", 10)
    with pytest.raises(TooLarge, match="slices, one for each assignment of X"):
        list(specification.monitor().run({"a": value} for value in range(20)))


# No two states of an emitted automaton can be merged, by a way of minimising that is not the backend's.


def distinct(tree: RVAFT, semantics: Semantics) -> bool:
    """Moore's algorithm over letters that exclude each other: whether every state of the text is a class of its own."""
    import buddy

    automaton = spot.automaton(AutomatonBackend().translate(tree, semantics).text)
    names = [ap.ap_name() for ap in automaton.ap() if ap.ap_name() not in {"alive", "relevant"}]
    condition = " & ".join(f"!({one} & {other})" for one, other in combinations(names, 2)) or "1"
    if semantics.projects:
        condition += "".join(f" & ({name} -> relevant)" for name in names) + f" & (relevant -> ({' | '.join(names)}))"
    states = range(automaton.num_states())
    letters = [spot.formula_to_bdd(condition, automaton.get_dict(), automaton)]
    for edge in automaton.edges():
        letters = [part for one in letters for part in (one & edge.cond, one - edge.cond) if part != buddy.bddfalse]

    def move(state: int, letter: Any) -> int:
        return next((edge.dst for edge in automaton.out(state) if edge.cond & letter != buddy.bddfalse), -1)

    moves = [[move(state, letter) for letter in letters] for state in states]
    classes, before = [int(automaton.state_is_accepting(state)) for state in states] + [2], 0
    while len(set(classes)) > before:
        before = len(set(classes))
        keys = [(one, *(classes[to] for to in row)) for one, row in zip(classes, [*moves, []], strict=True)]
        classes = [keys.index(key) for key in keys]
    return before == len(classes)


@pytest.mark.ci
@pytest.mark.parametrize("semantics", list(Semantics))
def test_no_two_states_are_equivalent(semantics: Semantics) -> None:
    shape = Shape(
        gate_events=0, typed_events=0, variables=0, guards=0, ignores=0, times=0, absences=0, sharing=0.4, max_nodes=8
    )
    words = [one for one in examples() if one.tree.time is None and all("event" in event for event in one.events)]
    default = [one.tree for one in words if one.tree.alphabet and not one.tree.absences]
    for tree in default[::2] + [random_tree(Random(seed), shape) for seed in range(30)]:
        assert distinct(tree, semantics), tree
