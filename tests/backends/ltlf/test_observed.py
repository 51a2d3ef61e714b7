"""What a formula asks of events."""

import pytest

from rvaft.backend import Observed
from rvaft.errors import LanguageError
from rvaft.language.parser import parse_guard, parse_pattern
from rvaft.model.guards import Operation, Operator
from rvaft.model.patterns import Literal, ObjectPattern, Variable
from tests.backends.ltlf.building import BACKEND, needs_spot

pytestmark = needs_spot


def test_atoms_by_default_by_the_caller_and_by_the_header() -> None:
    text = "/* rvaft\natom a := {x: _1, y: _1}\natom unused := {z: 1}\nd := F b\n*/\na & d & c"
    own = parse_pattern("{v: 1}")
    expected = [
        Observed(ObjectPattern((("event", Literal("b")),))),
        Observed(parse_pattern("{x: _1, y: _1}")),
        Observed(own),
    ]
    found = BACKEND.observed(text, atoms={"c": own, "a": own})
    assert set(found) == set(expected)
    assert len(found) == 3


def test_variables_of_relevance_are_its_own() -> None:
    text = (
        "/* rvaft\nrelevant rel := {v: X} when X > 1 when X < 5\nrelevant rel := {w: X} when Y > 1\n"
        "ignored rel := {v: X, w: _X}\n*/\nF rel"
    )
    x = Variable("_X")
    both = (Operation(Operator.GT, (x, Literal(1))), Operation(Operator.LT, (x, Literal(5))))
    assert BACKEND.observed(text) == (
        Observed(ObjectPattern((("v", x),)), Operation(Operator.AND, both)),
        Observed(ObjectPattern((("v", Variable("__X")), ("w", x)))),
    )


def test_variables_of_atoms_are_shared() -> None:
    text = "/* rvaft\natom a := {v: X} when X > 1\n*/\nF a"
    assert BACKEND.observed(text) == (Observed(parse_pattern("{v: X}"), parse_guard("X > 1")),)


def test_bad_texts() -> None:
    for text in ("", "a &", "/* rvaft\natom a := \n*/\na"):
        with pytest.raises(LanguageError):
            BACKEND.observed(text)
