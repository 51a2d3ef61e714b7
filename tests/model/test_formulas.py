"""The property of a branch and of a tree, in text, in Unicode and in LaTeX."""

from pathlib import Path
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cross_check.generate.trees import random_tree
from rvaft import RVAFT, Branch, EventType, Gate, Node, On, TooLarge, load, loads
from rvaft.core.branches import branch, branches
from rvaft.core.restriction import restrict
from rvaft.export import latex
from rvaft.export.property_text import (
    STYLE,
    align_latex,
    equation_latex,
    property_latex,
    property_sign,
    property_text,
    property_unicode,
)
from rvaft.language.parser import parse, parse_guard
from rvaft.model.expressions import guard_text
from rvaft.model.guards import Duration, Operation, Operator, TimePoint
from rvaft.model.nodes import Argument
from rvaft.model.patterns import Anything, Literal, ObjectPattern, Variable
from tests.cli.runs import PRUNED, TREES
from tests.tables import rows
from tests.tex import compiled, needs_tex, unsound

SHIPPED = sorted(path for path in TREES.rglob("*.rvaft") if path.stem != "listing")
"""But for the one that is refused, as its paper prints it."""
EVENTS = "event p(x) = { x: x }; event q_1(x, y) = { x: x, y: y };"
A, B, C = (rf"\mathit{{{letter}}}" for letter in "abc")

FORMULAS = rows(__file__, "formulas.txt")
GUARDS = rows(__file__, "guards.txt")


@pytest.mark.parametrize(("tree", "text", "pretty", "tex"), FORMULAS)
def test_table_of_formulas(tree: str, text: str, pretty: str, tex: str | None) -> None:
    loaded = parse(EVENTS + " toplevel t; " + tree).build()
    assert property_text(loaded) == text
    assert property_unicode(loaded) == pretty
    assert unsound(property_latex(loaded)) is None
    if tex is not None:
        assert property_latex(loaded) == tex


@pytest.mark.parametrize(("text", "pretty", "tex"), GUARDS)
def test_table_of_guards(text: str, pretty: str, tex: str) -> None:
    guard = parse_guard(text)
    assert (guard_text(guard, STYLE), guard_text(guard, latex.STYLE)) == (pretty, tex)
    assert parse_guard(guard_text(guard)) == guard


def test_the_formulas_of_the_paper() -> None:
    """Section 4.2, with a sign of its own for one after the other."""
    tree = load(PRUNED)
    radiation = 'inspect(Waypoint) · radiation(Value, T₁) · [Value ≥ 250] · move(NewWp, T₂) · [NewWp ≠ "entrance"]'
    moving, at = "move(Waypoint, _)", 'result(Waypoint, "success")'
    late, attacked = "[T₂ ≥ T₁ + 10]", "goal(MBGoal) · [NewWp ≠ MBGoal]"
    assert [property_unicode(each) for each in branches(tree)] == [
        f"{moving} · {radiation} · {late}",
        f"{at} · {radiation} · {late}",
        f"{moving} · {radiation} · {attacked}",
        f"{at} · {radiation} · {attacked}",
    ]
    assert property_unicode(tree) == f"({moving} ∨ {at}) · {radiation} · ({late} ∨ ({attacked}))"


def test_a_property_has_the_sign_of_its_part() -> None:
    tree = load(PRUNED)
    parts: list[RVAFT | Branch] = [tree, branch(tree, 3), restrict(tree, branch=3), restrict(tree, kind="fault")]
    assert [property_sign(part) for part in parts] == ["φ", "φ₃", "φ₃", "φ(fault)"]
    signs = [equation_latex(part).partition(" &= ")[0] for part in parts]
    assert signs == [r"\varphi", r"\varphi_{3}", r"\varphi_{3}", r"\varphi_{\mathrm{fault}}"]


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
@pytest.mark.parametrize("width", [1, 40, 72, None])
def test_rows_of_the_shipped_trees(path: Path, width: int | None) -> None:
    tree = load(path)
    parts: list[RVAFT | Branch] = [tree, *branches(tree)]
    for part in parts:
        assert unsound(equation_latex(part, width=width), allowed="&") is None
        broken = property_latex(part, width=width)
        assert broken.replace("\\\\\n  &\\quad ", "") == property_latex(part)
        if width == 40:  # a row is longer only where it could not be broken
            rows = broken.split(" \\\\\n")
            assert len(rows) >= len(property_unicode(part)) // 60


def test_shared_nodes_multiply_and_there_is_a_limit() -> None:
    text = "toplevel g0; " + "".join(f"g{n} and a{n} g{n + 1} h{n}; h{n} and g{n + 1} b{n};" for n in range(40))
    tree = loads(text)
    for written in (property_text, property_unicode, property_latex):
        with pytest.raises(TooLarge, match="limit 100000"):
            written(tree)
    with pytest.raises(TooLarge):
        property_latex(tree, width=50, limit=10)


WILD = st.text(st.characters(exclude_categories=["Cs"]) | st.sampled_from("\\%$#&_{}~^\"'`<>|-\n\t @*()[]"), min_size=1)


DURATIONS = st.sampled_from([0, 1, 1_000, 5_000_000_000, 90_000_000_000, 10**20 + 1])


@st.composite
def wild_trees(draw: st.DrawFn) -> RVAFT:
    """A random tree in which names and strings are any text."""
    tree = random_tree(Random(draw(st.integers(0, 2**16))))
    names = draw(st.lists(WILD, min_size=len(tree.nodes), max_size=len(tree.nodes), unique=True))
    new = dict(zip(tree.nodes, names, strict=True))
    event = EventType(draw(WILD), ("p", "q"), ObjectPattern((("k", Variable("p")), ("l", Variable("q")))))
    arguments: tuple[Argument, ...] = (Literal(draw(WILD)), Anything())
    points = [TimePoint.of(point, draw(st.sampled_from(names))) for point in ("at", "end")]
    late = Operation(Operator.LE, (Operation(Operator.SUB, (points[0], points[1])), Duration(draw(DURATIONS))))
    guard = draw(st.sampled_from([Operation(Operator.NE, (Literal(draw(WILD)), Literal(-1))), late]))
    nodes = []
    for node in tree.nodes.values():
        leaf = node.gate is None
        on = On(event.name, arguments) if leaf and draw(st.booleans()) else None
        children = tuple(new[child] for child in node.children)
        threshold = node.threshold if node.gate is Gate.VOT else None
        when = guard if draw(st.booleans()) else None
        times = draw(st.integers(1, 30)) if leaf and (on or not when) else 1
        within = None if leaf else draw(st.none() | DURATIONS)
        nodes.append(Node(new[node.name], node.gate, children, threshold, on, when, times=times, within=within))
    return RVAFT(new[tree.root], nodes, [event], causality=tree.causality)


@given(wild_trees(), st.integers(1, 100))
def test_no_text_keeps_a_meaning_in_latex(tree: RVAFT, width: int) -> None:
    for part in (tree, branch(tree, 1)):
        assert unsound(property_latex(part)) is None
        assert unsound("\n".join(align_latex([part], width=width)), allowed="&") is None
        assert "\n" not in property_unicode(part)


@given(WILD)
def test_escaped_text_is_one_sound_line(text: str) -> None:
    assert unsound(latex.escaped(text)) is None
    assert unsound(latex.name(text)) is None
    assert "\n" not in latex.escaped(text)


@given(st.text("aB_01", min_size=1).filter(str.isidentifier), st.text("aB_01", min_size=1).filter(str.isidentifier))
def test_different_names_look_different(one: str, other: str) -> None:
    assert (latex.name(one) == latex.name(other)) == (one == other)


@needs_tex
def test_formulas_compile(tmp_path: Path) -> None:
    odd = "".join(
        f't{n} and "{name}";' for n, name in enumerate(("a_%$\\\\{}^~#&<>|'`--", "x  y", "é ≥ 5 °C → µ Ω “½” –", "["))
    )
    trees = [load(PRUNED), loads(EVENTS + "toplevel t; t sand t0 t1 t2 t3;" + odd)]
    trees += [parse(f"{EVENTS} toplevel t; {row[0]}").build() for row in FORMULAS]
    conditions = [Node(f"g{number}", when=parse_guard(row[0])) for number, row in enumerate(GUARDS)]
    conditions += [Node(name) for name in ("ev1", "a b", "a", "b")]
    trees.append(RVAFT("t", [Node("t", Gate.AND, tuple(node.name for node in conditions)), *conditions]))
    rows = align_latex([*branches(trees[0]), *trees])
    compiled("\n".join(rows), tmp_path, "amsmath", "textcomp")


@needs_tex
def test_formulas_go_on_on_the_next_page(tmp_path: Path) -> None:
    many = loads(f"toplevel t; t or {' '.join(f'e{number}' for number in range(200))};")
    said = compiled("\n".join(align_latex(branches(many))), tmp_path, "amsmath", "textcomp")
    assert r"Overfull \vbox" not in said
    assert "[3]" in said  # pages are told as they are made
