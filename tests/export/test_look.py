"""What can be chosen about a drawing: how much of a tree, what stands in a box, what is marked."""

import re
import shutil
from pathlib import Path
from random import Random

import pytest

from rvaft import RVAFT, Gate, Node, OptionError, TreeError, load, loads
from rvaft.export import Format, Look, draw, picture
from rvaft.export.layout import looking, wrapped, wrapped_code
from tests.export.geometry import measured, overlaps, pdf_width
from tests.export.trees import AWKWARD, awkward, chain, every_part
from tests.tables import rows
from tests.tex import document, needs_tex

needs_dot = pytest.mark.skipif(shutil.which("dot") is None, reason="needs Graphviz")
TREES = Path(__file__).parents[2] / "trees"
PRUNED = load(TREES / "remote_inspection" / "pruned.rvaft")
FULL = load(TREES / "remote_inspection" / "full.rvaft")
DRAWINGS = (Format.TREE, Format.DOT, Format.TIKZ)


def boxes(dot: str) -> set[str]:
    """The identifiers of the nodes that a graph has."""
    return set(re.findall(r"^  ([ngt]\d+) \[", dot, re.MULTILINE))


def named(tree: RVAFT, *names: str) -> set[str]:
    return {f"n{tree.order.index(name)}" for name in names}


def drawn(tree: RVAFT, form: Format, **options: object) -> str:
    return draw(tree, form, looking(tree, **options)).decode()  # type: ignore[arg-type]


@pytest.mark.parametrize("form", [Format.DOT, Format.TIKZ])
def test_events_and_guards_are_shown_where_they_are_asked_for(form: Format) -> None:
    plain, full = (
        re.sub(r"<br/>|\\\\|tooltip=.*", " ", drawn(PRUNED, form, events=events)) for events in (False, True)
    )
    for text in ("radiation(", "goal(MBGoal)", "when "):
        assert text not in re.sub(r"\\textit\{|\}", "", plain)
        assert text in re.sub(r"\\textit\{|\}", "", full)


@pytest.mark.parametrize("form", [Format.DOT, Format.TIKZ])
def test_names_can_be_left_to_nodes_without_a_label(form: Format) -> None:
    text = drawn(FULL, form, names=False)
    assert "moving" not in re.sub(r"(id|tooltip)=.*", "", text)
    assert "outcome" in text
    assert "moving" in drawn(FULL, form)
    if form is Format.TIKZ:
        assert r"[{Inspection\\actions}, again]" in text


@pytest.mark.parametrize("form", [Format.DOT, Format.TIKZ])
def test_a_leaf_that_states_no_event_has_that_of_its_name(form: Format) -> None:
    tree = loads('event seen(v) = { v: v }; top sand a g d "two words"; g and c; c on seen(V); d when 1 < 2;')
    text = drawn(tree, form, events=True)
    assert "event: &quot;a&quot;" in text or form is Format.TIKZ
    assert text.count("event:") == 2, "neither gates nor conditions, nor leaves with an event"
    assert "event:" not in drawn(tree, form)


def test_lines_are_wrapped_at_the_width_that_is_chosen() -> None:
    assert "Robot damaged<br/>by radiation" in PRUNED.to_dot()
    assert "Robot damaged by radiation" in PRUNED.to_dot(wrap=30)
    with pytest.raises(OptionError, match="at least 4 columns"):
        PRUNED.to_dot(wrap=3)


def test_wrapping_keeps_words_and_breaks_what_is_much_too_wide() -> None:
    assert wrapped("to the decontamination waypoint", 12) == ["to the", "decontamination", "waypoint"]
    assert wrapped("x" * 20, 8) == ["x" * 8, "x" * 8, "x" * 4]
    assert wrapped("/radiation_sensor_plugin/sensor_0", 14) == ["/radiation_", "sensor_plugin/", "sensor_0"]
    assert wrapped("日本語のラベル", 8) == ["日本語の", "ラベル"]
    assert wrapped("one\ntwo\r\n\nthree", 20) == ["one", "two", "", "three"]
    for text in AWKWARD:
        for width in (4, 11, 26):
            for lines in (wrapped(text, width), wrapped_code(text, width)):
                assert all(len(line) <= width + width // 2 for line in lines)
                assert all(line.isprintable() for line in lines)


@pytest.mark.parametrize(("text", "width", "lines"), rows(__file__, "broken_code.txt"))
def test_events_and_guards_break_where_their_parts_end(text: str, width: int, lines: list[str]) -> None:
    assert wrapped_code(text, width) == lines


def test_wrapping_takes_any_length() -> None:
    text = "x" * 60_000 + " word" * 8_000 + " " * 60_000
    for wrap in (wrapped, wrapped_code):
        for width in (14, 100_000):
            assert "".join(wrap(text, width)).replace(" ", "") == text.replace(" ", "")


def test_collapsing_leaves_out_what_is_below_and_counts_it() -> None:
    dot = FULL.to_dot(collapse=["imagery", "leave"])
    imagery, leave = (FULL.order.index(name) for name in ("imagery", "leave"))
    assert f"t{imagery} [label=<+3>, shape=triangle" in dot
    assert f"t{leave} [label=<+6>, shape=triangle" in dot
    assert not boxes(dot) & named(FULL, "blurred", "dark", "occluded", "elsewhere", "outcome", "other")
    assert boxes(dot) >= named(FULL, "imagery", "leave", "high")
    assert f"g{imagery} " not in dot
    assert drawn(FULL, Format.TREE, collapse=["imagery"]).count("(… 3 nodes)") == 1
    assert "[{+3}, folded]" in drawn(FULL, Format.TIKZ, collapse="imagery")


def test_what_is_shared_with_a_part_that_is_drawn_stays() -> None:
    tree = loads("top or x y; x and s a; y and s b; s or c d;")
    dot = tree.to_dot(collapse=["x"])
    assert f"t{tree.order.index('x')} [label=<+1>" in dot
    assert boxes(dot) >= named(tree, "s", "b", "c", "d")
    alone = loads("top or x s; x and s; s or c;")
    assert "[label=<…>" in alone.to_dot(collapse=["x"])
    assert "x AND  (…)" in drawn(alone, Format.TREE, collapse=["x"])
    assert r"[{\ldots}, folded]" in drawn(alone, Format.TIKZ, collapse=["x"])


def test_depth_counts_levels_below_the_root_on_the_shortest_path() -> None:
    assert boxes(FULL.to_dot(depth=0)) == {"n0", "t0"}
    assert boxes(FULL.to_dot(depth=100)) == boxes(FULL.to_dot())
    tree = loads("top or x s; x and s a; s or c d;")
    dot = tree.to_dot(depth=1)
    assert boxes(dot) & named(tree, "a", "c", "d") == set()
    assert dot.count("shape=triangle") == 2
    near = loads("top or x s; x and s;")
    assert "triangle" not in near.to_dot(depth=1), "all that is below x is drawn"
    assert drawn(chain(3000), Format.TREE, depth=1) == "g0 AND\n└─ g1 AND  (… 2999 nodes)\n"
    with pytest.raises(OptionError, match="0 or more"):
        tree.to_dot(depth=-1)


@pytest.mark.parametrize("form", DRAWINGS)
def test_a_node_to_collapse_must_be_there(form: Format) -> None:
    with pytest.raises(OptionError, match="cannot collapse imagry: the tree has no such node; did you mean imagery"):
        drawn(FULL, form, collapse=["imagry"])
    with pytest.raises(OptionError, match=r"cannot collapse \\x1b: the tree has no such node$"):
        drawn(FULL, form, collapse=["\x1b"])
    lonely = RVAFT("a", [Node("a"), Node("b")])
    with pytest.raises(OptionError, match="cannot collapse b: the root does not lead to it"):
        drawn(lonely, form, collapse=["b"])


def test_a_branch_is_marked_edge_by_edge() -> None:
    dot = PRUNED.to_dot(branch=3)
    branch = list(PRUNED.branches())[2]
    looks = dict(re.findall(r"^  n(\d+) \[label.*(penwidth|fontcolor)", dot, re.MULTILINE))
    assert {PRUNED.order[int(node)] for node, look in looks.items() if look == "penwidth"} == set(branch.nodes)
    edges = re.findall(r"g(\d+) -> n(\d+) \[(penwidth)?", dot)
    bold = {(PRUNED.order[int(a)], PRUNED.order[int(b)]) for a, b, mark in edges if mark}
    assert bold == {(name, child) for name in branch.nodes for child in branch.children(name)}
    assert "branch 3: attack" in dot
    assert drawn(PRUNED, Format.TREE, branch=3).count("●") == len(branch.nodes)
    with pytest.raises(TreeError, match="there is no branch 5"):
        PRUNED.to_dot(branch=5)


def test_tikz_marks_a_branch_too() -> None:
    text = drawn(PRUNED, Format.TIKZ, branch=3)
    body = text[text.index("[{") : text.index(r"\end{forest}")]
    assert body.count("[") == body.count("]")
    assert re.search(r"\\textbf\{ev8\}.*, fault, condition, unmarked, edge=\{draw=black!30\}\]", body)
    assert re.search(r"\\textbf\{ev9\}.*, attack, marked, edge=\{very thick\}", body)
    assert r"{branch 3: attack};" in body
    assert body.count(", again, unmarked, edge={draw=black!30}]") == 1


@pytest.mark.parametrize("form", [Format.DOT, Format.TIKZ])
def test_the_legend_says_what_is_in_the_drawing_and_no_more(form: Format) -> None:
    text = drawn(FULL, form, legend=True, branch=1, collapse=["leave"])
    for meaning in (
        "caused by a fault",
        "in any order",
        "from left to right",
        "at least k of the n",
        "n nodes not drawn",
    ):
        assert meaning in text
    for meaning in ("caused by an attack", "from right to left"):
        assert meaning not in text
    assert "drawn elsewhere" not in text
    assert "drawn elsewhere" in drawn(loads("top or x s; x and s; s or c;"), form, legend=True, collapse=["x"])
    assert ("drawn in full elsewhere" in drawn(FULL, form, legend=True)) == (form is Format.TIKZ)
    gates = drawn(load(TREES / "gates" / "sand_rl.rvaft"), form, legend=True)
    assert "from right to left" in gates
    assert "caused by" not in gates


def test_each_gate_has_an_outline_of_its_own() -> None:
    dot = every_part().to_dot()
    legend = every_part().to_dot(legend=True)
    for style in ("shape=house, height=0.34", "shape=hexagon", "orientation=270", "orientation=90"):
        assert re.search(rf"^  l\d+ .*{style}", legend, re.MULTILINE), "the legend shows the shapes themselves"
    for style in ("or gate", "and gate", "sand gate", "sand rl gate", "vot gate"):
        assert rf"\node[{style}, anchor=base]" in drawn(every_part(), Format.TIKZ, legend=True)
    outlines = dict(re.findall(r"label=<([^<>]*)>, (shape=\w+(?:, orientation=\d+)?)", dot))
    assert set(outlines) == {"OR", "AND", "SAND →", "SAND ←", "VOT 2/3"}
    assert len(set(outlines.values())) == 5


def grown(random: Random) -> RVAFT:
    """A tree in which nothing is shared."""
    nodes: list[Node] = []

    def grow(level: int) -> str:
        some = level > 0 and random.random() < 0.8
        children = tuple(grow(level - 1) for _ in range(random.randint(2, 4))) if some else ()
        gate = random.choice([Gate.SAND, Gate.SAND_RL, Gate.OR]) if children else None
        nodes.append(Node(f"n {len(nodes)}", gate, children, label="word " * random.randint(0, 6)))
        return nodes[-1].name

    return RVAFT(grow(3), nodes)


@needs_dot
def test_a_picture_for_the_web_says_which_node_a_box_is() -> None:
    svg = picture(load(TREES / "vehicle" / "takeover.rvaft").to_dot(), "svg").decode()
    assert re.search(r'<g id="node&#45;\w+" class="node attack', svg)
    awkward = picture(loads('"a \\"<b>\\\\N" or "c%"; "c%" attack;').to_dot(), "svg").decode()
    assert 'id="node&#45;a%20%22%3Cb%3E%5CN"' in awkward
    assert 'xlink:title="c% &#160;[attack]"' in awkward


@needs_dot
@pytest.mark.parametrize("stagger", [False, True])
def test_children_stand_in_their_order_and_nothing_overlaps(stagger: bool) -> None:
    """Where nothing is shared every gate has its children from left to right."""
    random = Random("order")
    for _ in range(6):
        tree = grown(random)
        found = measured(picture(tree.to_dot(stagger=stagger), "svg"))
        assert overlaps(found) == []
        for node in tree.nodes.values():
            places = [found.frames[f"n{tree.order.index(child)}"].middle for child in node.children]
            assert places == sorted(places)


def entangled(random: Random) -> RVAFT:
    """A tree in which much is shared."""
    names = [f"n{number}" for number in range(random.randint(5, 12))]
    nodes = []
    for place, name in enumerate(names):
        rest = names[place + 1 :]
        some = rest and (place == 0 or random.random() < 0.6)
        children = tuple(random.sample(rest, min(len(rest), random.randint(2, 3)))) if some else ()
        nodes.append(Node(name, random.choice([Gate.SAND, Gate.SAND_RL, Gate.OR]) if children else None, children))
    return RVAFT("n0", nodes)


@needs_dot
def test_where_sharing_may_break_the_order_of_a_sand_the_children_are_numbered() -> None:
    random = Random("entangled")
    broken = 0
    for _ in range(25):
        tree = entangled(random)
        dot = tree.to_dot()
        found = measured(picture(dot, "svg"))
        for node in tree.top_down():
            places = [found.frames[f"n{tree.order.index(child)}"].middle for child in node.children]
            turns = re.findall(rf"g{tree.order.index(node.name)} -> n\d+ \[label=<(\d)>\]", dot)
            if node.gate is Gate.SAND and turns:
                assert turns == [str(turn) for turn in range(1, len(node.children) + 1)]
            elif node.gate is Gate.SAND_RL and turns:
                assert turns == [str(turn) for turn in range(len(node.children), 0, -1)]
            elif node.gate in (Gate.SAND, Gate.SAND_RL):
                assert places == sorted(places)
            broken += places != sorted(places)
    assert broken
    assert "label=<1>" not in PRUNED.to_dot(), "what is shared there is above the SAND"
    assert "the order under a SAND" in loads("top or x y; x sand a b; y sand_rl a b;").to_dot(legend=True)


@needs_dot
@pytest.mark.parametrize(
    ("tree", "options"),
    [
        ("remote_inspection/pruned", {}),
        ("remote_inspection/pruned", {"branch": 3}),
        ("remote_inspection/pruned", {"stagger": True, "events": True, "legend": True, "wrap": 12}),
        ("remote_inspection/full", {"stagger": True, "names": False, "wrap": 12}),
        ("remote_inspection/full", {"collapse": ["imagery"], "wrap": 12, "stagger": True}),
        ("pressure_tank/tank", {"collapse": ["no_signal"], "stagger": True}),
        ("gates/vot", {"legend": True}),
        ("gates/sand_rl", {"legend": True}),
    ],
)
def test_a_figure_is_readable_in_one_column(tree: str, options: dict[str, object]) -> None:
    """8.5 cm: at least 7 points, no box and no text upon another."""
    shipped = load(TREES / f"{tree}.rvaft")
    dot = shipped.to_dot(**options)  # type: ignore[arg-type]
    found = measured(picture(dot, "svg"))
    assert found.size_in(8.5) >= 7
    assert overlaps(found) == []
    assert abs(pdf_width(picture(dot, "pdf")) - found.width) <= 1, "a printed page has no other margin"


@needs_dot
@pytest.mark.parametrize(
    "tree", ["remote_inspection/full", "pressure_tank/tank", "pipeline/pollution", "vehicle/takeover"]
)
def test_whole_trees_are_readable_across_a_page(tree: str) -> None:
    shipped = load(TREES / f"{tree}.rvaft")
    found = measured(picture(shipped.to_dot(events=True, legend=True), "svg"))
    assert found.size_in(17.8) >= 7
    assert overlaps(found) == []


@needs_dot
def test_no_text_leaves_its_place_under_any_look() -> None:
    tree = awkward()
    leaf = next(name for name in tree.order if tree.nodes[name].leaf)
    branch = looking(tree, branch=1, legend=True, wrap=4, collapse=[leaf], stagger=True, depth=1)
    found = measured(draw(tree, Format.SVG, branch))
    assert len([name for name in found.frames if name[0] in "ngt"]) == len(tree.order) + 1
    text = draw(tree, Format.TIKZ, branch).decode().partition(r"\begin{document}")[2]
    assert text.count(r"\end{forest}") == text.count(r"\begin{forest}") == 1
    assert re.search(r"(?<!\\)%", text) is None
    assert re.search(r"(?<!\\)[$]", text) is None
    assert re.search(r"\\\\[\[*]", text) is None, "a bracket or a star after a line end is an argument of it"


def test_looks_are_values() -> None:
    assert Look() == Look()
    assert looking(PRUNED, collapse="ev3").collapse == ("ev3",)


def _latin(text: str) -> bool:
    """Whether pdfTeX has all letters of it."""
    return not any(letter.isalpha() and letter > "\u0250" and not "\u0370" < letter < "\u0400" for letter in text)


@needs_tex
@pytest.mark.parametrize("tree", [PRUNED, FULL, every_part(), awkward([text for text in AWKWARD if _latin(text)])])
def test_tex_compiles_the_drawing(tree: RVAFT, tmp_path: Path) -> None:
    look = looking(tree, events=True, legend=True, branch=1, collapse=[tree.order[-2]])
    document(draw(tree, Format.TIKZ, look).decode(), tmp_path)
    assert (tmp_path / "test.pdf").stat().st_size > 2000
