"""The texts: the formula of each gate, where compositional forms give way to a sum, names, strings, guards."""

from itertools import product

import pytest

from rvaft.api import loads
from rvaft.errors import TreeError
from rvaft.model.nodes import Gate, Node
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics
from rvaft.semantics import Reference
from tests.backends.ltlf.building import BACKEND, events, needs_spot, verdicts
from tests.tables import rows

FORMULAS = rows(__file__, "formulas.txt")


def text_of(tree: str, semantics: str) -> str:
    return BACKEND.translate(loads(tree), Semantics(semantics)).text


def body(text: str) -> list[str]:
    """Definitions and formula, without the lines about events."""
    about = ("/* rvaft", "*/", "atom ", "relevant ", "ignored ")
    return [line for line in text.splitlines() if not line.startswith(about)]


@pytest.mark.parametrize(("tree", "semantics", "expected"), FORMULAS)
def test_formula(tree: str, semantics: str, expected: list[str]) -> None:
    assert body(text_of(tree, semantics)) == expected


@pytest.mark.spot
@needs_spot
@pytest.mark.parametrize("tree", [tree for tree, _, _ in FORMULAS[-9:]] + ["t sand a b; a or x s; b or y s;"])
@pytest.mark.parametrize("semantics", list(Semantics))
def test_every_short_word(tree: str, semantics: Semantics) -> None:
    """The trees with the counterexamples, on every word of up to four events."""
    made = loads(tree)
    letters: list[Json] = [{"e": 1}, {"e": 2}] if "event e" in tree else events("b s x y z")
    specification = BACKEND.translate(made, semantics)
    for word in product([*letters, {}], repeat=4):
        expected = list(Reference(made, semantics).run(word))
        assert list(specification.monitor().run(word)) == expected, word


def test_whole_text() -> None:
    tree = """
        event reading(v) = { topic: "/sensor", value: v };
        ignore reading(V) when V < 0;
        t sand a b;
        a on reading(Value);
        b on reading(_) when Value >= 250;
    """
    assert text_of(tree, "projected").splitlines() == [
        "/* rvaft",
        'atom a := { topic: "/sensor", value: Value } when Value >= 250',
        'atom b := { topic: "/sensor", value: _ }',
        'relevant rel := { topic: "/sensor", value: Value }',
        'relevant rel := { topic: "/sensor", value: _ }',
        'ignored rel := { topic: "/sensor", value: V } when V < 0',
        "*/",
        "!rel U (rel & a & X[!](!rel U (rel & b)))",
    ]


REMOTE = """
    event move(w, t) = { name: "move", waypoint: w, time: t };
    event radiation(v, t) = { topic: "/radiation", value: v, time: t };
    event goal(w) = { goal: w };
    t sand reading high out;
    reading on radiation(Value, T1);
    high when Value >= 250;
    out sand leave ends on move(Wp, T2);
    leave when Wp != "entrance";
    ends or late changed;
    late fault when T2 >= T1 + 10;
    changed and altered attack on goal(Goal);
    altered when Wp != Goal;
"""


def test_names_are_legal_and_different() -> None:
    leaves = ("a", "A", "x y", "x_y", "true", "xor", "1st", "é", "F", "a_2", "s1", "rel")
    tree = RVAFT("top", [Node("top", Gate.SAND, leaves), *map(Node, leaves)])
    lines = BACKEND.translate(tree, Semantics.PROJECTED).text.splitlines()
    given = [line.split()[1] for line in lines if line.startswith("atom ")]
    assert len(set(given)) == len(leaves)
    assert all(name.isascii() and name == name.lower() and not name[0].isdigit() for name in given)


@pytest.mark.spot
@needs_spot
def test_names_and_strings_that_could_end_the_comment() -> None:
    tree = 't sand "Ärger" "X" "s1" "s 1" rel; "Ärger" on e("*/ 1 /*"); event e(p) = { "*/": p, "when": "when" };'
    for semantics in Semantics:
        text = BACKEND.translate(loads(tree), semantics).text
        assert text.count("*/") == text.count("/*") == 1
        start: list[Json] = [{"*/": "*/ 1 /*", "when": "when"}]
        trace = [*start, *({"event": name} for name in ("X", "s1", "s 1", "rel"))]
        assert verdicts(text, trace) == "????T"


def test_guards_stand_at_every_event_that_binds_one_of_their_variables() -> None:
    text = text_of(REMOTE, "strict")
    lines = [line.removeprefix("atom ").split(" := ") for line in text.splitlines() if line.startswith("atom ")]
    atoms = {name: what.split(" when ")[1:] for name, what in lines}
    assert atoms == {
        "reading": ["Value >= 250", "T2 >= T1 + 10"],
        "out": ['Wp != "entrance"', "T2 >= T1 + 10"],
        "reading_2": ["Value >= 250"],
        "out_2": ['Wp != "entrance"', "Wp != Goal"],
        "changed": ["Wp != Goal"],
    }
    assert body(text) == ["(reading & X[!] out) | (reading_2 & X[!](out_2 & X[!] changed))"]


def test_no_feasible_scenario() -> None:
    nodes = [Node("t", Gate.SAND, ("a", "b")), Node("a", Gate.AND, ("s",)), Node("b", Gate.AND, ("s",)), Node("s")]
    for semantics in Semantics:
        with pytest.raises(TreeError, match="no-scenario"):
            BACKEND.translate(RVAFT("t", nodes), semantics)
