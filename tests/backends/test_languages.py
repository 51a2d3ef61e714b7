"""What each language refuses, what its reader cannot read, and which package it needs: the rows of its folder."""

import re
import sys
from itertools import product
from pathlib import Path
from typing import Any, Final

import pytest
from _pytest.mark.structures import ParameterSet

from rvaft import (
    RVAFT,
    EventType,
    Gate,
    LanguageError,
    Node,
    NotExpressible,
    On,
    RvaftError,
    Semantics,
    TooLarge,
    ToolMissing,
    loads,
)
from rvaft.backend import backend
from rvaft.model.patterns import Literal, ObjectPattern
from rvaft.model.values import Json
from tests.backends.injections import INJECTIONS
from tests.backends.texts import SPOT, readable, signs, tree
from tests.tables import rows

EVENTS: Final = "event e(v) = { e: v }; event p(v, w) = { v: v, w: w }; "
CORRELATED: Final = (
    'event px(p) = { x: p }; event in(u) = { e: "in", u: u }; event out(u) = { e: "out", u: u }; '
    'event cp(u) = { e: "cp", by: { u: u } }; time t as s; toplevel r; '
)
OBSERVED: Final = (
    "event px(p) = { x: p }; event pxy(p, q) = { x: p, y: q }; event deep(p) = { a: { b: p } }; "
    "time t as s; toplevel r; "
)
DECLARED: Final = {"match-recognize": EVENTS, "mfotl": EVENTS, "sigma": CORRELATED, "stix": OBSERVED}
"""What stands before each tree in the rows of a language."""


def rows_of(table: str, *names: str) -> list[ParameterSet]:
    """The rows of a table in the folders of some languages, each after the name of its language."""
    folder = Path(__file__).parent
    tables = {name: rows(str(folder / name.replace("-", "_") / "test.py"), table) for name in names}
    marks = {name: SPOT if name == "ltlf" else () for name in names}
    return [pytest.param(name, row, marks=marks[name]) for name, found in tables.items() for row in found]


@pytest.mark.parametrize(
    ("name", "row"), rows_of("refused.txt", "eql", "kql", "match-recognize", "mfotl", "mtl", "sigma", "sql", "stix")
)
def test_what_a_language_cannot_say_is_refused(name: str, row: list[Any]) -> None:
    """A row is a tree, perhaps a semantics, and a piece of the reason; null for a size."""
    text, *semantics, reason = row
    made = tree(f"{DECLARED.get(name, '')}{text}")
    for language in (name, "mtl-r2u2") if name == "mtl" else (name,):
        with pytest.raises(NotExpressible if reason else TooLarge) as raised:
            backend(language).translate(made, Semantics(semantics[0] if semantics else "scattered"))
        other = language == "mtl-r2u2" and made.absences
        assert shows(raised.value, "written without absent events" if other else reason or "too large")
        assert not isinstance(raised.value, NotExpressible) or raised.value.backend == language


@pytest.mark.parametrize(("name", "row"), rows_of("malformed.txt", "eql", "kql", "ltlf", "mtl", "sigma", "sql", "stix"))
def test_what_is_malformed_is_said_in_one_line(name: str, row: list[Any]) -> None:
    """A row is a text, perhaps the line and the column of the fault, and a piece of the message."""
    text, *place, message = row
    for read in (backend(name).read, backend(name).observed) if name == "ltlf" else (backend(name).read,):
        with pytest.raises(LanguageError) as raised:
            read(text)
        assert shows(raised.value, message)
        assert "\n" not in raised.value.message
        assert place in ([], [raised.value.line, raised.value.column])


def shows(error: RvaftError, said: str) -> bool:
    """Whether an error says this; in some tables it is an expression."""
    return said in str(error) or re.search(said, str(error)) is not None


@pytest.mark.parametrize(
    ("name", "module", "said"),
    [
        ("automaton", "spot", "pip install spottl"),
        ("eql", "eql", "pip install '.[eql]'"),
        ("ltlf", "spot", "pip install spottl"),
        ("mtl", "reelay", "pip install '.[mtl]'"),
        ("sigma", "sigma.collection", "sigma"),
        ("stix", "stix2matcher.matcher", "stix"),
    ],
)
def test_without_its_package_a_language_is_written_and_the_error_says_what_to_install(
    name: str, module: str, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    text = backend(name).translate(loads("r and never_read_before b;"), Semantics.SCATTERED).text
    with pytest.raises(ToolMissing, match=re.escape(said)):
        backend(name).read(text).step({})


@pytest.mark.parametrize("name", readable("automaton", "eql", "kql", "ltlf", "mtl", "rml", "sigma", "sql", "stix"))
def test_what_users_write_stays_in_its_place(name: str) -> None:
    """An odd text is a label and a value, and then also the name of a field, a node and an event type."""
    said, language = 0, backend(name)
    for odd, named in product(INJECTIONS, (False, True)):
        field, leaf, seen = (odd if named else word for word in ("field", "leaf", "seen"))
        event = EventType(seen, (), ObjectPattern(((field, Literal(odd)), ("x", Literal(1)))))
        nodes = [Node("first", label=odd), Node(leaf, label=odd, on=On(seen, ()))]
        made = RVAFT(f"{odd} ", [Node(f"{odd} ", Gate.SAND, ("first", leaf), label=odd), *nodes], [event])
        try:
            monitor = language.read(language.translate(made, Semantics.SCATTERED).text)
        except NotExpressible:
            continue
        said += 1
        wrong: list[Json] = [{field: value, "x": 1} for value in ("a", odd[:-1], f"{odd.swapcase()}x", 7)]
        trace: list[Json] = [{field: odd, "x": 1}, {"event": "first"}, *wrong, {field: odd}, {"x": 1}]
        assert signs(monitor, [*trace, {field: odd, "x": 1}]) == "?" * len(trace) + "T", odd
    assert said > (30 if name in ("kql", "sigma") else 50), said


@pytest.mark.parametrize("name", ["eql", "kql", "sql", "stix"])
def test_half_a_surrogate_pair_is_refused(name: str) -> None:
    event = EventType("seen", (), ObjectPattern((("field", Literal("\ud800")),)))
    made = RVAFT("top", [Node("top", Gate.SAND, ("a", "b")), Node("a"), Node("b", on=On("seen", ()))], [event])
    with pytest.raises(NotExpressible):
        backend(name).translate(made, Semantics.SCATTERED)
