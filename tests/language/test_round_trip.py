"""What is printed reads back equal."""

import pytest
from hypothesis import given, settings

from rvaft.api import loads
from rvaft.errors import LanguageError
from rvaft.language.parser import parse, parse_guard, parse_pattern
from rvaft.language.printer import dumps
from rvaft.model.expressions import guard_text, name_text, pattern_text
from rvaft.model.guards import Guard, Operation, Operator
from rvaft.model.nodes import Gate, Node
from rvaft.model.patterns import Anything, ListPattern, Literal, ObjectPattern, Pattern, Variable
from rvaft.model.tree import RVAFT
from tests.language import strategies as some


@settings(deadline=None)
@given(some.trees())
def test_trees(tree: RVAFT) -> None:
    text = dumps(tree)
    again = parse(text).build()
    assert again == tree
    assert dumps(again) == text


@settings(deadline=None)
@given(some.guards)
def test_guards(guard: Guard) -> None:
    assert parse_guard(guard_text(guard)) == guard


@settings(deadline=None)
@given(some.patterns(some.literals | some.variables))
def test_patterns(pattern: Pattern) -> None:
    assert parse_pattern(pattern_text(pattern)) == pattern


@settings(deadline=None)
@given(some.names)
def test_names(name: str) -> None:
    assert list(parse(f"{name_text(name)};").nodes) == [name]


@pytest.mark.parametrize(
    "text",
    [
        "X",
        "-X * -(1)",
        "--1 - -1",
        "not (X and Y) or not X == Y and Z",
        "(X or Y) and (X or (Y or Z))",
        "(X < Y) == (Y < X)",
        "X - (Y - Z) - (Y + Z)",
        "X / (Y / Z) * (Y * Z)",
        "-(X + 1) >= 1.5e+300",
        'X != "a\\"b\\u0000"',
    ],
)
def test_guards_have_no_more_parentheses_than_needed(text: str) -> None:
    assert guard_text(parse_guard(text)) == text


def test_the_canonical_form() -> None:
    text = """
        ignore e(V, _) when V<2; toplevel top; x lambda=1 "a b"=" "; causality bottom_up;
        top or  x "and" attack label "é"; "and" 2of3 u v x on e("s",_);
        event e(p,q)={ "a":p, "a b":[q,{}], c:{d:null}}; event long_name()={};
    """
    assert (
        dumps(parse(text).build())
        == """\
causality bottom_up;

event e(p, q)     = { a: p, "a b": [q, {}], c: {d: null} };
event long_name() = {};

ignore e(V, _) when V < 2;

toplevel top;
top   or x "and" attack                                 label "é";
"and" 2of3 u v x        on e("s", _);
x                                    lambda=1 "a b"=" ";
"""
    )


@pytest.mark.parametrize(
    "value", ["", "=", "==1", "a=b", "//", "a/*b", "#f00", "a;b", "x y", '"', "\x85", "\0", "é", "}"]
)
def test_attributes_keep_their_text(value: str) -> None:
    tree = RVAFT("a", [Node("a", attributes=(("on", value), ("a b", value)))])
    assert parse(dumps(tree)).build() == tree


def test_unreachable_nodes_come_last() -> None:
    tree = parse("z or y; toplevel a; a or b; b; y;").build()
    assert dumps(tree) == "toplevel a;\na or b;\nb;\ny;\nz or y;\n"


def nested(depth: int) -> Pattern:
    pattern: Pattern = Anything()
    for _ in range(depth):
        pattern = ListPattern((pattern,))
    return pattern


def negated(depth: int) -> Guard:
    guard: Guard = Variable("X")
    for _ in range(depth):
        guard = Operation(Operator.NOT, (guard,))
    return guard


def test_the_limit_of_nesting_is_that_of_the_parser() -> None:
    assert parse_pattern(pattern_text(nested(100))) == nested(100)
    assert parse_guard(guard_text(negated(100))) == negated(100)
    for depth in (101, 50_000):
        with pytest.raises(LanguageError, match="deeper than 100"):
            pattern_text(nested(depth))
        with pytest.raises(LanguageError, match="deeper than 100"):
            guard_text(negated(depth))


@pytest.mark.parametrize(
    "value", [float("inf"), float("nan"), 10**5000, "\ud800"], ids=["infinity", "nan", "digits", "surrogate"]
)
def test_what_has_no_text(value: float | str) -> None:
    with pytest.raises(LanguageError, match="cannot be written"):
        pattern_text(ObjectPattern((("a", Literal(value)),)))


def test_a_chain_of_5000_gates() -> None:
    nodes = [Node(f"n{i}", Gate.AND, (f"n{i + 1}", f"m{i}")) for i in range(5000)]
    leaves = [Node("n5000"), *(Node(f"m{i}") for i in range(5000))]
    tree = RVAFT("n0", [*nodes, *leaves])
    assert loads(dumps(tree)) == tree
