"""The automaton as people look at it: what the edges say is what the text means."""

import re
import shutil
from html import unescape
from itertools import product
from random import Random
from xml.dom import minidom

import pytest

from backends.automaton import AutomatonBackend
from backends.automaton.backend import _built, _relevance
from backends.automaton.diagram import joined, possible
from backends.automaton.hoa_writer import Cube, write
from cross_check.generate.traces import random_trace
from cross_check.generate.trees import Shape, random_tree
from rvaft import NotExpressible, Semantics, TooLarge, Verdict, load, loads, monitor
from rvaft.backend import all_backends, backend
from rvaft.core.restriction import restrict
from rvaft.export.dot import picture
from rvaft.support.budget import Work
from tests.backends.texts import tree
from tests.cli.runs import PRUNED, TREES
from tests.export.geometry import measured, overlaps
from tests.export.trees import awkward

needs_dot = pytest.mark.skipif(shutil.which("dot") is None, reason="needs Graphviz")
FINAL = re.compile(r"(s\d+) \[label=<([⊤⊥])>")
EDGE = re.compile(r"^  (\w+) -> (\w+)(?: \[label=<(.*?)>(?:, .*)?\])?;$", re.MULTILINE)


def drawn(text: str, semantics: str = "projected", limit: int | None = None) -> str:
    return AutomatonBackend().diagram(tree(text), Semantics(semantics), limit=limit)


def edges(dot: str) -> dict[tuple[str, str], list[str]]:
    """For each edge the alternatives of its label."""
    found = {}
    for source, target, label in EDGE.findall(dot):
        rows = re.findall(r"<td [^>]*>(.*?)</td>", label)
        found[source, target] = [" ".join(unescape(re.sub(r"<.*?>", " ", row)).split()) for row in rows]
    return found


def test_a_sequence() -> None:
    dot = drawn("top sand a b;", "strict")
    leading = {("s0", "s2"): ["a"], ("s0", "s1"): ["else"], ("s2", "s3"): ["b"], ("s2", "s1"): ["else"]}
    assert edges(dot) == {("start", "s0"): [], **leading}
    assert "s3 [label=<⊤>, shape=doublecircle]" in dot
    assert "s1 [label=<⊥>" in dot


def test_events_and_guards_stand_for_propositions_and_lines_that_go_on_are_indented() -> None:
    dot = AutomatonBackend().diagram(load(PRUNED), Semantics.PROJECTED)
    lines = [line for label in edges(dot).values() for line in label]
    assert 'result(Waypoint, "success")' in lines
    assert "goal(MBGoal) [NewWp != MBGoal]" in lines
    assert 'move(NewWp, T2) [NewWp != "entrance"; not (T2 >= T1 + 10)]' in lines
    assert "radiation(Value, T1) [Value >= 250]" in lines, "T2 has no value yet, so nothing is asked of it"
    assert not any("guard_" in line or "alive" in line for line in lines)
    one, other = re.findall(r"<td [^>]*>(.*?)</td>", re.findall(r"s0 -> s2 \[label=<(.*)>\];", dot)[0])
    assert one == 'move(Waypoint, _)<br align="left"/>'
    assert other == 'result(Waypoint,<br align="left"/>&#160;&#160;&quot;success&quot;)<br align="left"/>'


@pytest.mark.parametrize("semantics", list(Semantics))
@pytest.mark.parametrize(
    "text", ["top 2of3 a b c;", "top sand v d; v 2of3 a b c;", "top or x y; x sand a b; y sand_rl a c b;"]
)
def test_walking_the_edges_gives_the_verdicts(text: str, semantics: Semantics) -> None:
    """All words of four letters, followed on the drawing, against the engine."""
    tree, dot = loads(text), drawn(text, semantics.value)
    final = {state: Verdict.TRUE if sign == "⊤" else Verdict.FALSE for state, sign in FINAL.findall(dot)}
    table = {(source, line): target for (source, target), label in edges(dot).items() for line in label or ["start"]}
    letters = [name for name in tree.nodes if tree.nodes[name].leaf]
    for word in product(letters, repeat=4):
        state, watching = table["start", "start"], monitor(tree, semantics=semantics)
        for letter in word:
            if state not in final:
                state = table.get((state, letter)) or table.get((state, "else")) or table[state, "any event"]
            assert final.get(state, Verdict.UNKNOWN) is watching.step({"event": letter})


def test_letters_that_share_events_say_so() -> None:
    dot = drawn("event x() = { x: 1 }; event y() = { y: 1 }; top and a b; a on x(); b on y();")
    lines = {line for label in edges(dot).values() for line in label}
    assert {"x(), not y()", "y(), not x()"} <= lines or "x(), y()" in lines


def test_joining_keeps_the_letters() -> None:
    random = Random("joined")
    for _ in range(100):
        words = [(random.randrange(64), random.randrange(64)) for _ in range(random.randint(1, 8))]
        those = [Cube(yes, no & ~yes) for yes, no in words]
        after = joined(those, 0b111)
        assert len(after) <= len(set(those))
        for letter in range(64):
            kept, joint = (any(cube.yes & ~letter == cube.no & letter == 0 for cube in some) for some in (those, after))
            assert kept == joint


WIDE = "top and [a# ]*9;"
TOO_MUCH = [
    (WIDE, "projected", None, r"513 states are too many to draw \(limit 100\)"),
    ("top or [a# ]*40;", "strict", 3, "labels are too many to draw"),
    ("top and [a# ]*30;", "strict", None, r"states of the automaton, too many to draw \(limit 100\)"),
]


@pytest.mark.parametrize(("tree", "semantics", "limit", "message"), TOO_MUCH)
def test_a_drawing_has_its_limit(tree: str, semantics: str, limit: int | None, message: str) -> None:
    with pytest.raises(TooLarge, match=message):
        drawn(tree, semantics, limit)


def test_the_limit_can_be_raised_and_other_languages_have_nothing_to_draw() -> None:
    assert len(edges(drawn(WIDE, limit=600))) > 2000
    for name in all_backends().keys() - {"automaton"}:
        with pytest.raises(NotExpressible, match="no graphs"):
            backend(name).diagram(loads("top sand a b;"), Semantics.STRICT)


@pytest.mark.parametrize(("branch", "kind"), [(None, None), (3, None), (None, "attack"), (3, "attack")])
def test_the_title_says_which_part_of_the_tree_it_is(branch: int | None, kind: str | None) -> None:
    part = restrict(load(PRUNED), branch=branch, kind=kind)
    words = ["damaged", *(["branch 3"] if branch else []), *(["attack"] if kind else []), "projected"]
    dot = AutomatonBackend().diagram(part, Semantics.PROJECTED)
    assert dot.startswith(f'digraph "{", ".join(words)}" {{')
    assert f"<td>{', '.join(words)}</td>" in dot
    assert f'name: "{", ".join(words)}"' in AutomatonBackend().translate(part, Semantics.PROJECTED).text


@needs_dot
def test_no_name_leaves_its_place() -> None:
    dot = AutomatonBackend().diagram(awkward(), Semantics.STRICT)
    document = minidom.parseString(picture(dot, "svg"))
    states = [g for g in document.getElementsByTagName("g") if g.getAttribute("class") == "node"]
    assert len(states) == len(re.findall(r"^  s\d+ \[label", dot, re.MULTILINE))
    assert not document.getElementsByTagName("b")
    nodes = [text.firstChild for text in document.getElementsByTagName("text")]
    texts = "".join(node.nodeValue or "" for node in nodes if node).replace("\xa0", " ")
    assert all(name in texts for name in ("<b>bold</b>", "кириллица", "</td></tr></table>", "日本語"))
    assert texts.isprintable()


@needs_dot
@pytest.mark.parametrize("tree", ["gates/vot", "gates/and", "remote_inspection/pruned", "pressure_tank/tank"])
def test_nothing_overlaps(tree: str) -> None:
    for semantics in Semantics:
        found = measured(picture(AutomatonBackend().diagram(load(TREES / f"{tree}.rvaft"), semantics), "svg"))
        assert overlaps(found) == []
        assert found.smallest >= 10


def test_guards_are_labelled_as_the_tree_writes_them() -> None:
    tree = loads("time t as s; top sand a b late within 2 h; late when at(b) - at(a) < 5 min;")
    drawing = AutomatonBackend().diagram(tree, Semantics.STRICT)
    assert "at(b) - at(a) &lt; 5 min;" in drawing
    assert "top within 2 h&#93;" in drawing
    assert "T1" not in drawing


@pytest.mark.ci
@pytest.mark.spot
@pytest.mark.parametrize("semantics", list(Semantics))
def test_what_is_left_out_makes_no_difference(semantics: Semantics) -> None:
    pytest.importorskip("spot")
    random, size = (
        Random("possible"),
        5 if semantics is Semantics.CONSECUTIVE else 7,
    )  # every state has all of the start's
    different, automata = 0, AutomatonBackend()
    for _ in range(40):
        shape = Shape(max_nodes=size, sharing=0.3, variables=1, guards=0.6, typed_events=0.9, times=0, absences=0)
        tree, work = random_tree(random, shape), Work(100_000)
        prop = automata.prepared(tree, semantics)
        automaton, parts, letters = _built(prop, semantics, work)
        relevance = _relevance(prop, semantics)
        whole, rest = (
            write(one, parts, letters, name="", time=None, relevance=relevance, work=work)[0]
            for one in (automaton, possible(automaton, parts))
        )
        different += whole != rest
        for trace in (random_trace(random, tree) for _ in range(5 if whole != rest else 0)):
            one, other = (AutomatonBackend().read(text) for text in (whole, rest))
            assert list(one.run(trace)) == list(other.run(trace))
    assert different >= 5 or size == 5
