"""Every format: what it says, and that no text leaves its place."""

import json
import os
import re
import shutil
import stat
import zlib
from itertools import product
from pathlib import Path
from xml.dom import minidom

import pytest

from rvaft import RVAFT, Gate, Node, OptionError, ToolFailed, ToolMissing, loads
from rvaft.export import Format, draw, format_of, losses, picture
from rvaft.export.layout import WIDTH, wrapped
from rvaft.export.text import MAX_LEVELS
from rvaft.export.tikz import escaped
from tests.export.trees import AWKWARD, awkward, chain, every_part

needs_dot = pytest.mark.skipif(shutil.which("dot") is None, reason="needs Graphviz")
TEXTS = [form for form in Format if form not in (Format.SVG, Format.PDF, Format.PNG)]

TREE = """\
top OR  "Top"
├─ left SAND →  [fault]
│  ├─ a
│  └─ shared AND
│     ├─ c
│     └─ d  on seen(V, null)  when V >= 250
├─ right SAND ←  on seen(V, _)
│  ├─ shared (see above)
│  └─ b  on seen("x", V)  "See x"
└─ vote VOT 2/3  [attack]  "Vote"
   ├─ a (see above)
   ├─ b (see above)
   └─ shared (see above)
"""


def test_the_terminal_drawing_says_every_part_and_draws_shared_nodes_once() -> None:
    assert draw(every_part(), Format.TREE).decode() == TREE


def test_a_chain_of_thousands_of_gates_keeps_its_indentation_bounded() -> None:
    lines = draw(chain(5000), Format.TREE).decode().splitlines()
    assert max(map(len, lines)) < 3 * MAX_LEVELS + 40
    named = [re.findall(r"g\d+", line)[0] for line in lines if line]
    assert set(named) == {f"g{number}" for number in range(5001)}
    assert lines[MAX_LEVELS] == "   " * (MAX_LEVELS - 1) + f"└─ g{MAX_LEVELS} AND  (continued below)"
    assert lines[MAX_LEVELS + 1 : MAX_LEVELS + 3] == ["", f"g{MAX_LEVELS} AND"]


@pytest.mark.parametrize("form", TEXTS)
def test_every_text_format_takes_a_long_chain(form: Format) -> None:
    assert b"g5000" in draw(chain(5000), form)


def test_a_shared_node_that_is_yet_to_come_is_said_to_be_below() -> None:
    text = " ".join(f"g{n} and g{n + 1};" for n in range(1, MAX_LEVELS))
    tree = loads(f"toplevel g0; g0 and g1 g{MAX_LEVELS}; {text} g{MAX_LEVELS} and x; x;")
    drawn = draw(tree, Format.TREE).decode()
    assert f"└─ g{MAX_LEVELS} (see below)\n\ng{MAX_LEVELS} AND\n└─ x\n" in drawn


def test_nothing_in_the_terminal_drawing_can_steer_the_terminal() -> None:
    text = draw(awkward(), Format.TREE).decode()
    assert all(line.isprintable() for line in text.splitlines())
    assert len(text.splitlines()) == 1 + len(AWKWARD) + len([label for label in AWKWARD if label.strip()])


def test_dot_draws_kinds_gates_and_the_order_of_children() -> None:
    dot = every_part().to_dot()
    assert dot.count("#fbb659") == dot.count("#ee7872") == 1
    for gate in ("OR", "SAND →", "SAND ←", "AND", "VOT 2/3"):
        assert f"label=<{gate}>" in dot
    assert "ordering=out" in dot
    number = {name: index for index, name in enumerate(every_part().order)}
    edges = re.findall(r"g(\d+) -> n(\d+)", dot)
    children = [int(child) for gate, child in edges if int(gate) == number["right"]]
    assert children == [number["shared"], number["b"]]
    assert dot.count(">shared<") == 1


@needs_dot
def test_svg_shows_every_text_as_it_is() -> None:
    document = minidom.parseString(draw(awkward(), Format.SVG))
    shown = [text.firstChild.nodeValue or "" for text in document.getElementsByTagName("text") if text.firstChild]
    for label in AWKWARD:
        for line in wrapped(label, WIDTH):
            assert line.strip() == "" or line in shown
    assert not document.getElementsByTagName("b")
    assert "\\N \\G \\\\" in " ".join(shown)


@needs_dot
@pytest.mark.parametrize("name", ["a &nbsp; b", "a &lt; b", "back\\slash\\", 'say "x"', "<b>]]>", "&#92;"])
def test_the_title_of_an_svg_is_the_name_of_the_root(name: str) -> None:
    document = minidom.parseString(draw(RVAFT(name, [Node(name)]), Format.SVG))
    title = document.getElementsByTagName("title")[0].firstChild
    assert title is not None
    assert title.nodeValue == name


@needs_dot
def test_no_short_text_confuses_graphviz() -> None:
    """All texts of up to three characters that mean something to it, as lines of labels."""
    texts = ["".join(letters) for length in (1, 2, 3) for letters in product("]>[<& \\x", repeat=length)]
    leaves = [Node(f"leaf {place}", label="\n".join(texts[place::9])) for place in range(9)]
    tree = RVAFT("top", [Node("top", Gate.OR, tuple(leaf.name for leaf in leaves)), *leaves])
    shown = minidom.parseString(draw(tree, Format.SVG)).getElementsByTagName("text")
    found = {(text.firstChild.nodeValue or "").replace("\xa0", " ").strip() for text in shown if text.firstChild}
    assert found >= {text.strip() for text in texts}


@needs_dot
@pytest.mark.parametrize(("form", "magic"), [(Format.PNG, b"\x89PNG"), (Format.PDF, b"%PDF"), (Format.SVG, b"<?xml")])
def test_pictures_are_what_they_say(form: Format, magic: bytes) -> None:
    data = draw(every_part(), form)
    assert data.startswith(magic)
    assert len(data) > 2000


@needs_dot
def test_a_picture_is_not_blank() -> None:
    """Its pixels, unpacked: white paper, black lines and text, and the two tints."""
    data = draw(every_part(), Format.PNG)
    place, packed, depth = 8, b"", b""
    while place < len(data):
        length, kind = int.from_bytes(data[place : place + 4]), data[place + 4 : place + 8]
        packed += data[place + 8 : place + 8 + length] if kind == b"IDAT" else b""
        depth = data[place + 8 : place + 8 + length] if kind == b"IHDR" else depth
        place += 12 + length
    width, height = int.from_bytes(depth[:4]), int.from_bytes(depth[4:8])
    pixels = zlib.decompress(packed)
    assert width > 300
    assert height > 300
    assert len(pixels) == height * (4 * width + 1)
    assert len(set(pixels)) > 50


@needs_dot
def test_a_notebook_shows_the_picture() -> None:
    assert "<svg" in str(every_part()._repr_svg_())


def test_without_graphviz_the_error_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    with pytest.raises(ToolMissing, match=r"dot is not installed.*apt-get install graphviz"):
        draw(every_part(), Format.SVG)
    assert every_part()._repr_svg_() is None
    assert draw(every_part(), Format.DOT)


@pytest.mark.parametrize(
    ("script", "reason"),
    [
        ("echo 'Error: out of paper' >&2; exit 3", "out of paper"),
        ("exit 3", "exit status 3"),
        ("exit 0", "exit status 0"),
        ("exec sleep 60", "no layout after 0.5 s"),
    ],
)
def test_a_graphviz_that_fails_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, script: str, reason: str
) -> None:
    program = tmp_path / "dot"
    program.write_text(f"#!/bin/sh\n{script}\n")
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    with pytest.raises(ToolFailed, match=reason):
        picture("digraph {}", "svg", timeout=0.5)


def test_tikz_nests_every_node_and_refers_to_shared_ones() -> None:
    text = draw(every_part(), Format.TIKZ).decode()
    body = text[text.index("[{") : text.index(r"\end{forest}")]
    assert body.count("[") == body.count("]")
    assert body.count(", again]") == 4
    assert body.count(r"{shared}, box") == 1
    assert r"SAND \ensuremath{\leftarrow}" in body
    assert "VOT 2/3" in body


def test_no_character_keeps_a_meaning_for_tex() -> None:
    plain = "%$#_{}~^\\&"
    commands = r"\\text(backslash|asciitilde|asciicircum)\{\}|\\[%$#_{}&]"
    assert re.sub(commands, "", escaped(plain)) == ""
    assert len(re.findall(commands, escaped(plain))) == len(plain)
    assert "\n" not in escaped("a\nb")
    body = draw(awkward(), Format.TIKZ).decode()
    assert body.count(r"\end{forest}") == body.count(r"\begin{forest}") == 1


def test_json_says_everything() -> None:
    tree = every_part()
    value = json.loads(draw(tree, Format.JSON))
    assert (value["format"], value["version"], value["root"], value["causality"]) == ("rvaft", 1, "top", "top_down")
    nodes = {node["name"]: node for node in value["nodes"]}
    assert list(nodes) == list(tree.nodes)
    assert nodes["vote"] == {
        "name": "vote",
        "gate": "vot",
        "threshold": 2,
        "children": ["a", "b", "shared"],
        "on": None,
        "when": None,
        "kind": "attack",
        "label": "Vote",
        "attributes": [],
    }
    assert nodes["d"]["on"] == {"event": "seen", "arguments": [{"variable": "V"}, {"literal": None}]}
    assert nodes["d"]["when"] == "V >= 250"
    assert nodes["right"]["on"]["arguments"] == [{"variable": "V"}, {"any": True}]
    assert nodes["a"]["attributes"] == [["lambda", "0.5"], ["dorm", "0"]]
    assert value["events"][0]["pattern"] == {"object": {"value": {"variable": "v"}, "time": {"variable": "t"}}}


def test_json_keeps_awkward_texts() -> None:
    nodes = json.loads(draw(awkward(), Format.JSON))["nodes"]
    assert [node["label"] for node in nodes[1 : 1 + len(AWKWARD)]] == list(AWKWARD)


def test_galileo_orders_by_pand_and_says_what_is_lost() -> None:
    text = draw(every_part(), Format.GALILEO).decode()
    assert '"left" pand "a" "shared";' in text
    assert '"right" pand "b" "shared";' in text
    assert '"vote" 2of3 "a" "b" "shared";' in text
    assert '"a" lambda=0.5 dorm=0;' in text
    lost = " ".join(losses(every_part()))
    for word in (
        "2 sand gates",
        "3 runtime events",
        "1 guard ",
        "2 fault or attack marks",
        "3 labels",
        "3 basic events",
    ):
        assert word in lost


def test_a_static_fault_tree_survives_galileo() -> None:
    text = 'toplevel "A"; "A" or "B" "C d"; "B" and "C d" "E"; "C d" lambda=0.5; "E" prob=0.1;'
    tree = loads(text)
    assert loads(draw(tree, Format.GALILEO).decode()) == tree
    assert list(losses(tree)) == []


def test_a_name_that_galileo_cannot_write_is_refused() -> None:
    with pytest.raises(OptionError, match="Galileo cannot write the name"):
        draw(awkward(), Format.GALILEO)


def test_the_language_reads_back_what_it_wrote() -> None:
    assert loads(draw(every_part(), Format.RVAFT).decode()).nodes == every_part().nodes


@pytest.mark.parametrize(
    ("file", "form"),
    [
        ("a.dot", Format.DOT),
        ("a.gv", Format.DOT),
        ("a.tex", Format.TIKZ),
        ("a.dft", Format.GALILEO),
        ("a.SVG", Format.SVG),
    ],
)
def test_a_suffix_names_a_format(file: str, form: Format) -> None:
    assert format_of(file) is form
    assert format_of("a.odt") is None
    assert format_of("tree") is None


def test_an_attribute_that_galileo_cannot_write_is_left_out_and_said() -> None:
    """Otherwise its value becomes statements of its own."""
    tree = loads('top or a b; a k="x; sneaky or hidden" lambda=0.5; b m="1\\" // z" "k\\"];x"="1";')
    text = draw(tree, Format.GALILEO).decode()
    assert text == 'toplevel "top";\n"top" or "a" "b";\n"a" lambda=0.5;\n"b";\n'
    assert any(loss.startswith("3 attributes left out") for loss in losses(tree))
    assert loads(text).nodes.keys() == tree.nodes.keys()
