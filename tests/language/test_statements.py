"""Texts that are in the language, and the tree or the draft that they make."""

import pytest

from rvaft.language.parser import parse, parse_guard, parse_pattern
from rvaft.model.guards import Guard, Operation, Operator
from rvaft.model.nodes import Causality, EventType, Gate, Ignore, Kind, Node, On, Place
from rvaft.model.patterns import Anything, ListPattern, Literal, ObjectPattern, Pattern, Variable
from rvaft.model.tree import RVAFT

X, Y, Z = Variable("X"), Variable("Y"), Variable("Z")
ONE, TWO = Literal(1), Literal(2)


def tree(text: str) -> RVAFT:
    return parse(text).build()


def node(text: str) -> Node:
    """The node of the first statement."""
    return next(iter(parse(text).nodes.values())).build()


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a;", Node("a")),
        ('"A B";', Node("A B")),
        (r'"say \"é\"\n";', Node('say "é"\n')),
        ('"or";', Node("or")),
        ("a or b;", Node("a", Gate.OR, ("b",))),
        ("a and b c;", Node("a", Gate.AND, ("b", "c"))),
        ('a sand "x y" c;', Node("a", Gate.SAND, ("x y", "c"))),
        ("a sand_rl b c;", Node("a", Gate.SAND_RL, ("b", "c"))),
        ("a 2of3 b c d;", Node("a", Gate.VOT, ("b", "c", "d"), 2)),
        ("a vot2 b c d;", Node("a", Gate.VOT, ("b", "c", "d"), 2)),
        ("a fault;", Node("a", kind=Kind.FAULT)),
        ("a attack;", Node("a", kind=Kind.ATTACK)),
        ('a label "no; // comment";', Node("a", label="no; // comment")),
        ("a on move();", Node("a", on=On("move", ()))),
        ('a on "my event"(X);', Node("a", on=On("my event", (X,)))),
        (
            'a on f(X, _, "s", -1, 2.5e1, true, false, null);',
            Node(
                "a",
                on=On("f", (X, Anything(), *map(Literal, ("s", -1, 25.0, True, False, None)))),
            ),
        ),
        ("a when X > 1;", Node("a", when=Operation(Operator.GT, (X, ONE)))),
        ("a lambda=0.1 dorm=.5;", Node("a", attributes=(("lambda", "0.1"), ("dorm", ".5")))),
        ("a lambda = x // rate\n;", Node("a", attributes=(("lambda", "x"),))),
        ('a res="2 x" "odd key"=(1+2)/3 or=1;', Node("a", attributes=(("res", "2 x"), ("odd key", "(1+2)/3"), ("or", "1")))),
        (
            'a or b label "l" attack when X > 1 prob=1 on f(X);',
            Node("a", Gate.OR, ("b",), None, On("f", (X,)), Operation(Operator.GT, (X, ONE)), Kind.ATTACK, "l", (("prob", "1"),)),
        ),
        ("a # one\n /* two\n * lines **/ or // three\n b;", Node("a", Gate.OR, ("b",))),
        ("orange or android sandy;", Node("orange", Gate.OR, ("android", "sandy"))),
        ("a or onset whenever labels attacks;", Node("a", Gate.OR, ("onset", "whenever", "labels", "attacks"))),
    ],
)  # fmt: skip
def test_a_statement_about_a_node(text: str, expected: Node) -> None:
    assert node(text) == expected


def test_galileo_is_a_start() -> None:
    assert tree('toplevel "A"; "A" or "B" "C"; "B" lambda=0.1;') == RVAFT(
        "A", [Node("A", Gate.OR, ("B", "C")), Node("B", attributes=(("lambda", "0.1"),)), Node("C")]
    )


def test_a_child_without_statement_is_undeclared() -> None:
    nodes = tree("a or b c; b;").nodes
    assert [node.declared for node in nodes.values()] == [True, True, False]
    assert nodes["c"].has_event


def test_toplevel_may_be_left_out_for_the_only_node_without_parent() -> None:
    assert tree("b or c; a and b d;").root == "a"
    assert parse("a or b; c or b;").root is None
    assert parse("a or b; c or b; toplevel c;").root == "c"


def test_statements_about_one_node_are_merged() -> None:
    assert tree('a; a or b; a label "l" x=1; a fault y=2;').nodes["a"] == Node(
        "a", Gate.OR, ("b",), kind=Kind.FAULT, label="l", attributes=(("x", "1"), ("y", "2"))
    )


def test_what_is_said_twice_stays_in_the_draft() -> None:
    draft = parse(
        "a or b; a and c; a on e(X) on f(Y) fault attack;\n event e() = {}; event e(x) = { x: x };\ntoplevel a; toplevel b;"
    )
    a = draft.nodes["a"]
    assert [use.value.gate for use in a.gates] == [Gate.OR, Gate.AND]
    assert [use.value.children[0].value for use in a.gates] == ["b", "c"]
    assert [place.column for place in a.settings()["on"]] == [23, 31]
    assert [said.value for said in a.kinds] == [Kind.FAULT, Kind.ATTACK]
    assert [event.name for event in draft.events] == ["e", "e"]
    assert [said.value for said in draft.toplevels] == ["a", "b"]


def test_numbers_of_a_vote_stay_in_the_draft() -> None:
    use = parse("a 2of3 b b c d;").nodes["a"].gates[0].value
    assert (use.threshold, use.out_of) == (2, 3)
    assert [child.value for child in use.children] == ["b", "b", "c", "d"]
    assert parse("a vot7 b;").nodes["a"].gates[0].value.out_of is None


def test_places() -> None:
    text = 'toplevel a;\na or b\n  c on e(X) when X > 1\n  fault label "l";'
    a = parse(text, "f.rvaft").nodes["a"].build()
    assert {part: (place.line, place.column) for part, place in a.places.items()} == {
        "name": (2, 1), "gate": (2, 3), "on": (3, 8), "when": (3, 13), "kind": (4, 3), "label": (4, 9),
    }  # fmt: skip
    assert a.place().file == "f.rvaft"
    assert parse(text, "f.rvaft").undeclared()[1].place == Place("f.rvaft", 3, 3)


def test_declarations() -> None:
    text = """
        causality bottom_up; param x;
        event move(wp, t) = { topic: "/c", on: wp, "a b": [t, _, { or: -1.5 }, []], event: null, _x: true };
        ignore move(V, _) when V < 250; ignore move(_, 1);
        a on move(X, X);
    """
    fields = (
        ("topic", Literal("/c")),
        ("on", Variable("wp")),
        ("a b", ListPattern((Variable("t"), Anything(), ObjectPattern((("or", Literal(-1.5)),)), ListPattern(())))),
        ("event", Literal(None)),
        ("_x", Literal(True)),
    )
    v = Variable("V")
    assert tree(text) == RVAFT(
        "a",
        [Node("a", on=On("move", (X, X)))],
        [EventType("move", ("wp", "t"), ObjectPattern(fields))],
        ignores=[
            Ignore(On("move", (v, Anything())), Operation(Operator.LT, (v, Literal(250)))),
            Ignore(On("move", (Anything(), ONE))),
        ],
        causality=Causality.BOTTOM_UP,
    )
    assert [said.value for said in parse(text).parameters] == ["x"]


def op(operator: Operator, *operands: Guard) -> Guard:
    return Operation(operator, operands)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("X", X),
        ('"s"', Literal("s")),
        ("not X == Y", op(Operator.NOT, op(Operator.EQ, X, Y))),
        ("not not X", op(Operator.NOT, op(Operator.NOT, X))),
        ("X and not Y and Z", op(Operator.AND, X, op(Operator.NOT, Y), Z)),
        ("X or Y and Z or X", op(Operator.OR, X, op(Operator.AND, Y, Z), X)),
        ("(X or Y) or Z", op(Operator.OR, op(Operator.OR, X, Y), Z)),
        ("X or (Y or Z)", op(Operator.OR, X, op(Operator.OR, Y, Z))),
        ("X - Y - Z", op(Operator.SUB, op(Operator.SUB, X, Y), Z)),
        ("X - (Y - Z)", op(Operator.SUB, X, op(Operator.SUB, Y, Z))),
        ("X + Y * Z < 2", op(Operator.LT, op(Operator.ADD, X, op(Operator.MUL, Y, Z)), TWO)),
        ("X / Y * Z", op(Operator.MUL, op(Operator.DIV, X, Y), Z)),
        ("-X * -Y", op(Operator.MUL, op(Operator.NEGATE, X), op(Operator.NEGATE, Y))),
        ("X-1", op(Operator.SUB, X, ONE)),
        ("X - -1", op(Operator.SUB, X, Literal(-1))),
        ("-1", Literal(-1)),
        ("- 1.5", Literal(-1.5)),
        ("-(1)", op(Operator.NEGATE, ONE)),
        ("--1", op(Operator.NEGATE, Literal(-1))),
        ("(X < Y) == true", op(Operator.EQ, op(Operator.LT, X, Y), Literal(True))),
        ("null != false", op(Operator.NE, Literal(None), Literal(False))),
        ("12345678901234567890 >= 0.1", op(Operator.GE, Literal(12345678901234567890), Literal(0.1))),
        ("X / /* by */ Y // two", op(Operator.DIV, X, Y)),
    ],
)  # fmt: skip
def test_guards(text: str, expected: Guard) -> None:
    assert parse_guard(text) == expected


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("_", Anything()),
        ("_1", Variable("_1")),
        ("Value", Variable("Value")),
        ("{}", ObjectPattern(())),
        (
            '{ "a b": [_, X], when: "s" }',
            ObjectPattern((("a b", ListPattern((Anything(), X))), ("when", Literal("s")))),
        ),
        ("trueish", Variable("trueish")),
    ],
)
def test_patterns(text: str, expected: Pattern) -> None:
    assert parse_pattern(text) == expected
