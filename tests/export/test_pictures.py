"""Pictures as SVG, PDF and PNG, by Graphviz and TeX: every text is where it belongs, edges end at
boxes and pass between others, children stand in order, figures are readable, failures are reported.
"""

import os
import re
import shutil
import struct
import subprocess
import sys
import zlib
from collections.abc import Callable
from itertools import pairwise, product
from pathlib import Path
from random import Random
from typing import Any
from xml.dom import minidom

import pytest

from rvaft import RVAFT, Gate, Kind, Node, ToolFailed, ToolMissing, load, loads, to_dot
from rvaft.export import Format
from rvaft.export.dot import picture
from rvaft.export.drawing import draw
from rvaft.export.layout import WIDTH, Look, gate_text, looking, wrapped
from tests.cli.runs import FULL, TREES, written
from tests.export.geometry import Box, Picture, drawn, edges, measured, needs_dot, overlaps, pdf_width
from tests.export.trees import AWKWARD, PINNED, awkward
from tests.tables import rows
from tests.tex import document, needs_tex

EVERY = PINNED / "every.rvaft"


def shown(svg: bytes) -> list[str]:
    """The texts of a picture."""
    texts = minidom.parseString(svg).getElementsByTagName("text")
    return [(text.firstChild.nodeValue or "").replace("\xa0", " ").strip() for text in texts if text.firstChild]


def graphviz(tree: RVAFT) -> bytes:
    return picture(to_dot(tree), "svg")


def ours(tree: RVAFT) -> bytes:
    return draw(tree, Format.SVG)


@pytest.mark.parametrize("drawer", [ours, pytest.param(graphviz, marks=needs_dot)])
def test_svg_shows_every_text_as_it_is(drawer: Callable[[RVAFT], bytes]) -> None:
    """Also all texts of up to three characters that mean something to Graphviz, as lines of labels."""
    svg = drawer(awkward())
    assert not minidom.parseString(svg).getElementsByTagName("b")
    assert {line.strip() for label in AWKWARD for line in wrapped(label, WIDTH)} - {""} <= set(shown(svg))
    texts = ["".join(letters) for length in (1, 2, 3) for letters in product("]>[<& \\x", repeat=length)]
    leaves = [Node(f"leaf {place}", label="\n".join(texts[place::9])) for place in range(9)]
    tree = RVAFT("top", [Node("top", Gate.OR, tuple(leaf.name for leaf in leaves)), *leaves])
    assert {text.strip() for text in texts} - {""} <= set(shown(drawer(tree)))


def test_no_text_leaves_its_place_under_any_look() -> None:
    tree = awkward()
    leaf = next(name for name in tree.order if tree.nodes[name].leaf)
    look = looking(tree, branch=1, legend=True, wrap=4, collapse=[leaf], stagger=True, depth=1)
    found = drawn(draw(tree, Format.SVG, look))
    assert len(found.frames) == 2 * len(tree.order), "a box and a symbol each"
    assert overlaps(found) == []


def test_an_svg_says_what_it_shows_and_which_node_a_box_is() -> None:
    for name in ("a &nbsp; b", "a &lt; b", "back\\slash\\", 'say "x"', "<b>]]>", "&#92;"):
        svg = draw(RVAFT(name, [Node(name, kind=Kind.ATTACK)]), Format.SVG)
        title = minidom.parseString(svg).getElementsByTagName("title")[0].firstChild
        assert title is not None
        assert title.nodeValue == name
        assert b'class="node attack' in svg
    odd = draw(loads('"a \\"<b>\\\\N" or "c%"; "c%" attack;'), Format.SVG).decode()
    assert 'id="node-a%20%22%3Cb%3E%5CN"' in odd
    assert "<title>c%  [attack]</title>" in odd


@needs_dot
def test_graphviz_says_which_node_a_box_is() -> None:
    odd = graphviz(loads('"a \\"<b>\\\\N" or "c%"; "c%" attack;')).decode()
    assert 'id="node&#45;a%20%22%3Cb%3E%5CN"' in odd
    assert 'xlink:title="c% &#160;[attack]"' in odd


SHAPES = {
    "top or a b; a; b;": {"gate or": 1, "leaf": 2, "inside": 0},
    "top and a b; a; b;": {"gate and": 1, "leaf": 2, "inside": 0},
    "top sand a b; a; b;": {"gate sand": 1, "inside": 1},
    "top pand a b; a; b;": {"gate pand": 1, "inside": 1},
    "top 2of3 a b c; a; b; c;": {"gate vot": 1, "leaf": 3},
}


@pytest.mark.parametrize("text", SHAPES)
def test_every_gate_has_its_symbol_and_every_event_a_circle(text: str) -> None:
    tree = loads(text)
    svg = draw(tree, Format.SVG).decode()
    assert {word: svg.count(f'class="{word}"') + svg.count(f'class="line {word}"') for word in SHAPES[text]} == SHAPES[
        text
    ]
    assert ("2/3" in shown(svg.encode())) is ("2of3" in text)
    boxes = draw(tree, Format.SVG, Look(symbols=False)).decode()
    assert 'class="leaf"' not in boxes
    assert gate_text(tree.nodes["top"]) in shown(boxes.encode())
    condition = loads("event e(x) = { x: x }; top sand a b; a on e(X); b when X > 1;")
    assert draw(condition, Format.SVG).decode().count('class="node condition"') == 1


def test_edges_end_at_the_middle_of_a_box_and_pass_between_boxes() -> None:
    """Also where nodes are shared, at every level."""
    random = Random("edges")
    for shared, stagger in [(False, True), (True, False), (True, True)] * 4:
        tree = drawn_from(random, shared=shared)
        svg = draw(tree, Format.SVG, Look(stagger=stagger))
        found = drawn(svg)
        assert overlaps(Picture(found.frames, [], found.width, found.smallest)) == []
        for (first, last), corners in edges(svg).items():
            above, below = tree.order[first], found.frames[tree.order[last]]
            assert corners[-1][0] == pytest.approx(below.middle, abs=0.1)
            assert corners[-1][1] == pytest.approx(below.top, abs=0.1)
            assert corners[0][0] == pytest.approx(found.frames[above].middle, abs=0.1)
            for (x, y), (other, lower) in pairwise(corners[1:]):
                if x == other:  # upright, beside the boxes of a level
                    way = Box(x - 1, x + 1, y + 0.2, lower - 0.2)
                    hit = [name for name, frame in found.frames.items() if frame.overlaps(way)]
                    assert set(hit) <= {above, f"gate of {above}"}


def test_pictures_are_what_they_say_and_not_blank() -> None:
    """The pixels of a PNG, unpacked: white paper, black lines and text, and the two tints."""
    pytest.importorskip("cairosvg")
    every = load(EVERY)
    for form, magic in ((Format.PDF, b"%PDF"), (Format.SVG, b"<?xml"), (Format.PNG, b"\x89PNG")):
        data = draw(every, form)
        assert data == draw(every, form)
        assert data.startswith(magic)
        assert len(data) > 2000
    assert "<svg" in str(every._repr_svg_())
    (width, height), place, packed = struct.unpack(">II", data[16:24]), 8, b""
    while place < len(data):
        length, kind = struct.unpack(">I4s", data[place : place + 8])
        packed += data[place + 8 : place + 8 + length] if kind == b"IDAT" else b""
        place += 12 + length
    pixels = zlib.decompress(packed)
    assert min(width, height) > 300
    assert len(pixels) == height * ({2: 3, 6: 4}[data[25]] * width + 1), "with or without transparency"
    assert len(set(pixels)) > 50


def test_without_cairosvg_the_error_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    monkeypatch.setitem(sys.modules, "cairosvg", None)
    for form in (Format.PDF, Format.PNG):
        with pytest.raises(ToolMissing, match=r"cairosvg is not installed: pip install '\.\[pictures\]'"):
            draw(load(EVERY), form)
    assert draw(load(EVERY), Format.SVG)
    assert load(EVERY)._repr_svg_().startswith("<svg")
    with pytest.raises(ToolMissing, match=r"dot is not installed.*apt-get install graphviz"):
        picture("digraph {}", "svg")


def test_a_graphviz_that_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    for script, reason in (
        ("echo 'Error: out of paper' >&2; exit 3", "out of paper"),
        ("exit 3", "exit status 3"),
        ("exit 0", "exit status 0"),
        ("exec sleep 60", r"no layout after 0.5 s"),
    ):
        written(tmp_path / "dot", f"#!/bin/sh\n{script}\n").chmod(0o755)
        with pytest.raises(ToolFailed, match=reason):
            picture("digraph {}", "svg", timeout=0.5)


def drawn_from(random: Random, *, shared: bool) -> RVAFT:
    """A tree of choices and sequences in which much is shared, or nothing."""
    nodes: list[Node] = []

    def grow(level: int) -> str:
        some = level > 0 and (level == 3 or random.random() < 0.7)
        fresh = tuple(grow(level - 1) for _ in range(random.randint(2, 3))) if some else ()
        others = [node.name for node in nodes if node.name not in fresh]
        again = tuple(random.sample(others, min(1, len(others)))) if fresh and shared else ()
        gate = random.choice([Gate.SAND, Gate.SAND_RL, Gate.PAND, Gate.OR]) if fresh else None
        label = None if shared else "word " * random.randint(0, 6)
        nodes.append(Node(f"n {len(nodes)}", gate, (*again, *fresh), label=label))
        return nodes[-1].name

    return RVAFT(grow(3), nodes)


@needs_dot
@pytest.mark.parametrize(("shared", "stagger", "count"), [(False, False, 4), (False, True, 4), (True, False, 10)])
def test_children_stand_in_their_order(shared: bool, stagger: bool, count: int) -> None:
    """Where sharing may break the order of a SAND its children are numbered."""
    random, broken = Random("order"), 0
    for _ in range(count):
        tree = drawn_from(random, shared=shared)
        dot = to_dot(tree, stagger=stagger)
        found = measured(picture(dot, "svg"))
        assert shared or overlaps(found) == []
        for node in tree.nodes.values():
            places = [found.frames[f"n{tree.order.index(child)}"].middle for child in node.children]
            in_order = places == sorted(places)
            turns = re.findall(rf"g{tree.order.index(node.name)} -> n\d+ \[label=<(\d)>\]", dot)
            numbers = [str(turn) for turn in range(1, len(node.children) + 1)]
            if shared and node.gate is not None and node.gate.ordered:
                assert turns == (numbers[::-1] if node.gate is Gate.SAND_RL else numbers) or (not turns and in_order)
                broken += not in_order
            assert shared or in_order
    assert bool(broken) is shared


@needs_dot
def test_graphviz_can_use_the_positions() -> None:
    """By `neato -n`: each node is where the own drawer places it."""
    tree = load(FULL)
    program = shutil.which("neato")
    assert program is not None
    dot = to_dot(tree, legend=True, branch=1)
    done = subprocess.run([program, "-n", "-Tsvg"], input=dot.encode(), capture_output=True, check=True)
    found, expected = measured(done.stdout), drawn(draw(tree, Format.SVG, looking(tree, branch=1, symbols=False)))
    shifts = [
        (found.frames[f"n{rank}"].middle - expected.frames[name].middle, frame.middle)
        for rank, (name, frame) in enumerate((one, expected.frames[one]) for one in tree.order)
    ]
    assert max(shift for shift, _ in shifts) - min(shift for shift, _ in shifts) < 1


@pytest.mark.parametrize(("tree", "options", "centimetres"), rows(__file__, "figures.txt"))
def test_a_figure_is_readable(tree: str, options: dict[str, Any], centimetres: float) -> None:
    """At least 7 points, no box and no text upon another; a printed page has no other margin."""
    loaded = load(TREES / f"{tree}.rvaft")
    look = looking(loaded, **options)
    found = drawn(draw(loaded, Format.SVG, look))
    assert found.size_in(centimetres) >= 7
    assert overlaps(found) == []
    pytest.importorskip("cairosvg")
    assert "wrap" in options or abs(pdf_width(draw(loaded, Format.PDF, look)) - found.width) <= 1


def _latin(text: str) -> bool:
    """Whether pdfTeX has all letters of it."""
    return not any(letter.isalpha() and letter > "\u0250" and not "\u0370" < letter < "\u0400" for letter in text)


@pytest.mark.ci
@needs_tex
def test_tex_compiles_the_drawings(tmp_path: Path) -> None:
    """All in one document, which has the head of the first."""
    parts = ["", "", ""]
    for tree in (load(FULL), load(EVERY), awkward(list(filter(_latin, AWKWARD)))):
        look = looking(tree, events=True, legend=True, branch=1, collapse=[tree.order[-2]])
        head, begin, rest = draw(tree, Format.TIKZ, look).decode().partition(r"\begin{tikzpicture}")
        drawing, end, tail = rest.rpartition(r"\end{tikzpicture}")
        parts = [head, parts[1] + begin + drawing + end, tail]
    document("".join(parts), tmp_path)
    assert (tmp_path / "test.pdf").stat().st_size > 6000
