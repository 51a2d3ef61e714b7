"""Pictures by Graphviz and TeX: every text is where it belongs, children stand in order, figures
are readable, and failures are reported.
"""

import os
import re
import struct
import zlib
from itertools import product
from pathlib import Path
from random import Random
from typing import Any
from xml.dom import minidom

import pytest

from rvaft import RVAFT, Gate, Kind, Node, ToolFailed, ToolMissing, load, loads, to_dot
from rvaft.export import Format
from rvaft.export.dot import picture
from rvaft.export.drawing import draw
from rvaft.export.layout import WIDTH, looking, wrapped
from tests.cli.runs import FULL, TREES, written
from tests.export.geometry import measured, needs_dot, overlaps, pdf_width
from tests.export.trees import AWKWARD, PINNED, awkward
from tests.tables import rows
from tests.tex import document, needs_tex

EVERY = PINNED / "every.rvaft"


def shown(svg: bytes) -> list[str]:
    """The texts of a picture."""
    texts = minidom.parseString(svg).getElementsByTagName("text")
    return [(text.firstChild.nodeValue or "").replace("\xa0", " ").strip() for text in texts if text.firstChild]


@needs_dot
def test_svg_shows_every_text_as_it_is() -> None:
    """Also all texts of up to three characters that mean something to Graphviz, as lines of labels."""
    svg = draw(awkward(), Format.SVG)
    assert not minidom.parseString(svg).getElementsByTagName("b")
    assert {line.strip() for label in AWKWARD for line in wrapped(label, WIDTH)} - {""} <= set(shown(svg))
    texts = ["".join(letters) for length in (1, 2, 3) for letters in product("]>[<& \\x", repeat=length)]
    leaves = [Node(f"leaf {place}", label="\n".join(texts[place::9])) for place in range(9)]
    tree = RVAFT("top", [Node("top", Gate.OR, tuple(leaf.name for leaf in leaves)), *leaves])
    assert {text.strip() for text in texts} - {""} <= set(shown(draw(tree, Format.SVG)))


@needs_dot
def test_no_text_leaves_its_place_under_any_look() -> None:
    tree = awkward()
    leaf = next(name for name in tree.order if tree.nodes[name].leaf)
    look = looking(tree, branch=1, legend=True, wrap=4, collapse=[leaf], stagger=True, depth=1)
    found = measured(draw(tree, Format.SVG, look))
    assert len([name for name in found.frames if name[0] in "ngt"]) == len(tree.order) + 1


@needs_dot
def test_an_svg_says_what_it_shows_and_which_node_a_box_is() -> None:
    for name in ("a &nbsp; b", "a &lt; b", "back\\slash\\", 'say "x"', "<b>]]>", "&#92;"):
        svg = draw(RVAFT(name, [Node(name, kind=Kind.ATTACK)]), Format.SVG)
        title = minidom.parseString(svg).getElementsByTagName("title")[0].firstChild
        assert title is not None
        assert title.nodeValue == name
        assert b'class="node attack' in svg
    odd = draw(loads('"a \\"<b>\\\\N" or "c%"; "c%" attack;'), Format.SVG).decode()
    assert 'id="node&#45;a%20%22%3Cb%3E%5CN"' in odd
    assert 'xlink:title="c% &#160;[attack]"' in odd


@needs_dot
def test_pictures_are_what_they_say_and_not_blank() -> None:
    """The pixels of a PNG, unpacked: white paper, black lines and text, and the two tints."""
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


def test_without_graphviz_the_error_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    with pytest.raises(ToolMissing, match=r"dot is not installed.*apt-get install graphviz"):
        draw(load(EVERY), Format.SVG)
    assert load(EVERY)._repr_svg_() is None
    assert draw(load(EVERY), Format.DOT)


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
@pytest.mark.parametrize(("tree", "options", "centimetres"), rows(__file__, "figures.txt"))
def test_a_figure_is_readable(tree: str, options: dict[str, Any], centimetres: float) -> None:
    """At least 7 points, no box and no text upon another; a printed page has no other margin."""
    dot = to_dot(load(TREES / f"{tree}.rvaft"), **options)
    found = measured(picture(dot, "svg"))
    assert found.size_in(centimetres) >= 7
    assert overlaps(found) == []
    assert "wrap" in options or abs(pdf_width(picture(dot, "pdf")) - found.width) <= 1


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
        head, begin, rest = draw(tree, Format.TIKZ, look).decode().partition(r"\begin{forest}")
        forest, end, tail = rest.rpartition(r"\end{forest}")
        parts = [head, parts[1] + begin + forest + end, tail]
    document("".join(parts), tmp_path)
    assert (tmp_path / "test.pdf").stat().st_size > 6000
