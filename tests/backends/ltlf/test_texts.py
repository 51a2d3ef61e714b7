"""The text is all there is: another operator means other verdicts, names and strings survive, guards travel."""

import pytest

from backends.ltlf.reader import split
from backends.ltlf.writer import Names
from rvaft.api import loads
from rvaft.errors import TreeError
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics
from tests.backends.ltlf.building import BACKEND, body, events, needs_spot, text_of, verdicts

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

MUTATIONS = [
    ("scattered", "t sand a b;", "X[!] F", "X[!] X[!]", "a b"),
    ("scattered", "t and a b;", " & ", " | ", "a b"),
    ("scattered", "t 2of3 a b c;", "(F a & (s1 | s2))", "(F a | (s1 | s2))", "a b"),
    ("strict", "t and a b;", "!(a & X[!] a) & ", "", "a a b"),
    ("strict", "t sand a b;", "a & X[!] b", "a & X[!] a", "a b"),
    ("projected", "t sand a b;", "!rel U (rel & b)", "!rel U (rel & a)", "x a x b"),
    ("projected", "t sand a b;", "X[!](!rel U", "X[!](!rel R", "a x b"),
    ("projected", "t sand a b;", "!rel U (rel & a", "F (rel & a", "b a b"),
]


@pytest.mark.parametrize(("semantics", "tree", "old", "new", "word"), MUTATIONS)
@needs_spot[0]
@needs_spot[1]
def test_an_operator_changed_is_seen(semantics: str, tree: str, old: str, new: str, word: str) -> None:
    text = text_of(tree, semantics)
    assert old in text
    assert verdicts(text, events(word)) != verdicts(text.replace(old, new, 1), events(word))


def test_names_are_legal_and_different() -> None:
    names = Names()
    wanted = ["a", "A", "a", "x y", "x_y", "true", "xor", "1st", "é", "", "F", "a_2"]
    given = [names.fresh(name) for name in wanted]
    assert len(set(given)) == len(wanted)
    assert all(name.isascii() and name == name.lower() and not name[0].isdigit() for name in given)
    assert given[0] == "a"


@needs_spot[0]
@needs_spot[1]
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
    atoms = {name: [str(part) for part in str(atom).split(" when ")[1:]] for name, atom in split(text)[0].atoms.items()}
    assert atoms == {
        "reading": ["Value >= 250", "T2 >= T1 + 10"],
        "out": ['Wp != "entrance"', "T2 >= T1 + 10"],
        "reading_2": ["Value >= 250"],
        "out_2": ['Wp != "entrance"', "Wp != Goal"],
        "changed": ["Wp != Goal"],
    }
    assert body(text) == ["(reading & X[!] out) | (reading_2 & X[!](out_2 & X[!] changed))"]


@needs_spot[0]
@needs_spot[1]
def test_guards_on_choices() -> None:
    def run(*trace: Json) -> str:
        return verdicts(text_of(REMOTE, "strict"), list(trace))

    high: Json = {"topic": "/radiation", "value": 300, "time": 5}
    assert run({**high, "value": 249.5}) == "F"
    assert run({**high, "value": "300"}) == "F"
    assert run(high, {"name": "move", "waypoint": 1, "time": 15}) == "?T"
    assert run(high, {"name": "move", "waypoint": "entrance", "time": 15}) == "?F"
    assert run(high, {"name": "move", "waypoint": 1, "time": 14}, {"goal": 2}) == "??T"
    assert run(high, {"name": "move", "waypoint": 1, "time": 14}, {"goal": 1.0}) == "??F"
    assert run(high, {"name": "move", "waypoint": 1, "time": "late"}, {"goal": 2}) == "??T"


def test_gates_do_not_travel() -> None:
    text = text_of("t and left right; left or a b; right 1of2 c d;", "projected")
    assert "left" not in text
    assert "right" not in text


def test_no_feasible_scenario() -> None:
    from rvaft.model.nodes import Gate, Node
    from rvaft.model.tree import RVAFT

    nodes = [Node("t", Gate.SAND, ("a", "b")), Node("a", Gate.AND, ("s",)), Node("b", Gate.AND, ("s",)), Node("s")]
    for semantics in Semantics:
        with pytest.raises(TreeError, match="no-scenario"):
            BACKEND.translate(RVAFT("t", nodes), semantics)
