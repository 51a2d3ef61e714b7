"""What is written reads as what was meant, and what is printed reads back equal."""

from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given

from rvaft import RVAFT, Gate, Kind, LanguageError, Node, dumps, loads
from rvaft.language.parser import parse, parse_guard, parse_pattern
from rvaft.model.expressions import guard_text, name_text, pattern_text
from rvaft.model.guards import Guard, Operation, Operator
from rvaft.model.nodes import Place
from rvaft.model.patterns import Anything, ListPattern, Literal, ObjectPattern, Pattern, Variable
from tests.language import strategies as some
from tests.tables import rows

READ: dict[str, Callable[[str], Any]] = {
    "tree": lambda text: parse(text).build(),
    "guard": parse_guard,
    "pattern": parse_pattern,
}


@given(some.trees())
def test_trees(tree: RVAFT) -> None:
    text = dumps(tree)
    again = parse(text).build()
    assert again == tree
    assert dumps(again) == text


@given(some.guards, some.patterns(some.literals | some.variables), some.names)
def test_parts_of_trees(guard: Guard, pattern: Pattern, name: str) -> None:
    assert parse_guard(guard_text(guard)) == guard
    assert parse_pattern(pattern_text(pattern)) == pattern
    assert list(parse(f"{name_text(name)};").nodes) == [name]


@pytest.mark.parametrize(("equal", "kind", "text", "other"), rows(__file__, "same.txt"))
def test_two_texts(equal: bool, kind: str, text: str, other: str) -> None:
    assert (READ[kind](text) == READ[kind](other)) == equal


def test_what_is_said_twice_stays_in_the_draft() -> None:
    draft = parse(
        "a or b; a and c; a on e(X) on f(Y) fault attack;\n event e() = {}; event e(x) = { x: x };\n"
        "toplevel a; toplevel b; v 2of3 b b c d; w vot7 b; param x;"
    )
    a, v, w = (draft.nodes[name] for name in "avw")
    assert [(use.value.gate, use.value.children[0].value) for use in a.gates] == [(Gate.OR, "b"), (Gate.AND, "c")]
    assert [place.column for place in a.settings()["on"]] == [23, 31]
    assert [said.value for said in a.kinds] == [Kind.FAULT, Kind.ATTACK]
    assert [event.name for event in draft.events] == ["e", "e"]
    assert [said.value for said in (*draft.toplevels, *draft.parameters)] == ["a", "b", "x"]
    assert [child.value for child in v.children()] == ["b", "b", "c", "d"]
    assert [node.gates[0].value[2:4] for node in (v, w)] == [(2, 3), (7, None)]
    assert parse("a or b; c or b;").root is None


def test_places() -> None:
    draft = parse('toplevel a;\na or b\n  c on e(X) when X > 1\n  fault label "l";', "f.rvaft")
    places = draft.nodes["a"].build().places
    found = {part: (place.line, place.column) for part, place in places.items()}
    assert found == {"name": (2, 1), "gate": (2, 3), "on": (3, 8), "when": (3, 13), "kind": (4, 3), "label": (4, 9)}
    assert draft.undeclared()[1].place == Place("f.rvaft", 3, 3)
    assert [node.declared for node in loads("a or b c; b;").nodes.values()] == [True, True, False]


@pytest.mark.parametrize(
    "text",
    [
        *("X", "-X * -(1)", "--1 - -1", "not (X and Y) or not X == Y and Z", "(X or Y) and (X or (Y or Z))"),
        *("(X < Y) == (Y < X)", "X - (Y - Z) - (Y + Z)", "X / (Y / Z) * (Y * Z)", "-(X + 1) >= 1.5e+300"),
        'X != "a\\"b\\u0000"',
    ],
)
def test_guards_have_no_more_parentheses_than_needed(text: str) -> None:
    assert guard_text(parse_guard(text)) == text


def test_the_canonical_form() -> None:
    text = """
        ignore e(V, _) when V<2; toplevel top; x lambda=1 "a b"=" "; causality bottom_up; topic "c" type "a.msg.B";
        top or  x "and" attack label "é"; "and" 2of3 u v x on e("s",_); z or y; y;
        event e(p,q)={ "a":p, "a b":[q,{}], c:{d:null}}; event long_name()={};
        topic "t/1" type "a.msg.Long" from "/x", y;
    """
    assert (
        dumps(parse(text).build())
        == """\
causality bottom_up;

event e(p, q)     = { a: p, "a b": [q, {}], c: {d: null} };
event long_name() = {};

topic "c"   type "a.msg.B";
topic "t/1" type "a.msg.Long" from "/x", y;

ignore e(V, _) when V < 2;

toplevel top;
top   or x "and" attack                                 label "é";
"and" 2of3 u v x        on e("s", _);
x                                    lambda=1 "a b"=" ";
y;
z     or y;
"""
    )


@pytest.mark.parametrize(
    "value", ["", "=", "==1", "a=b", "//", "a/*b", "#f00", "a;b", "x y", '"', "\x85", "\0", "é", "}"]
)
def test_attributes_keep_their_text(value: str) -> None:
    tree = RVAFT("a", [Node("a", attributes=(("on", value), ("a b", value)))])
    assert parse(dumps(tree)).build() == tree


def test_the_limit_of_nesting_is_that_of_the_parser() -> None:
    pattern: Pattern = Anything()
    guard: Guard = Variable("X")
    for depth in range(1, 50_001):
        pattern, guard = ListPattern((pattern,)), Operation(Operator.NOT, (guard,))
        if depth == 100:
            assert parse_pattern(pattern_text(pattern)) == pattern
            assert parse_guard(guard_text(guard)) == guard
        elif depth in (101, 50_000):
            with pytest.raises(LanguageError, match="deeper than 100"):
                pattern_text(pattern)
            with pytest.raises(LanguageError, match="deeper than 100"):
                guard_text(guard)


@pytest.mark.parametrize(
    "value", [float("inf"), float("nan"), 10**5000, "\ud800"], ids=["infinity", "nan", "digits", "surrogate"]
)
def test_what_has_no_text(value: float | str) -> None:
    with pytest.raises(LanguageError, match="cannot be written"):
        pattern_text(ObjectPattern((("a", Literal(value)),)))


def test_a_chain_of_5000_gates_and_a_tree_of_10000_nodes() -> None:
    nodes = [Node(f"n{i}", Gate.AND, (f"n{i + 1}", f"m{i}")) for i in range(5000)]
    leaves = [Node("n5000"), *(Node(f"m{i}") for i in range(5000))]
    tree = RVAFT("n0", [*nodes, *leaves])
    assert loads(dumps(tree)) == tree
