"""What a notebook shows: a picture of a tree, and tables; texts are escaped."""

import importlib
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from xml.dom import minidom

import pytest

import rvaft
from cross_check.results import Job, Result, Status
from rvaft import Semantics
from rvaft.diagnosis.near_misses import near_misses
from tests.export.trees import PINNED, awkward

ROOT = Path(__file__).parents[2]


def elements(text: str, name: str) -> list[str]:
    """The texts of elements of a fragment, which is well-formed."""
    found = minidom.parseString(f"<div>{text}</div>").getElementsByTagName(name)
    return ["".join(str(child.nodeValue) for child in one.childNodes) for one in found]


def test_every_display_exists() -> None:
    every = entry_points(group="rvaft.displays")
    assert {"tree", "explanation", "specification", "near_misses", "comparison"} <= every.names
    for one in every:
        assert isinstance(one, EntryPoint)
        assert callable(getattr(importlib.import_module(one.module), one.attr))


def test_a_tree_is_a_picture_whose_style_stays_in_it() -> None:
    for tree in (rvaft.load(PINNED / "every.rvaft"), awkward()):
        svg = tree._repr_svg_()
        (style,) = elements(svg, "style")
        rules = [line for line in style.splitlines() if line.endswith("}") and "{" in line]
        assert len(rules) > 20
        assert all(one.startswith(".rvaft-tree") for rule in rules for one in rule.partition("{")[0].split(", "))


def test_a_detection_is_a_table() -> None:
    tree = rvaft.loads('event e(v) = { e: v }; time t as s; top sand a "<b>"; a on e(X); "<b>" attack times 2;')
    monitor = rvaft.monitor(tree)
    log = [{"e": "<i>"}, {"event": "<b>"}, {"event": "<b>"}]
    assert [*monitor.run(log)][-1].symbol == "⊤"
    explanation = monitor.explanation
    assert explanation is not None
    text = explanation._repr_html_()
    assert elements(text, "td") == ["a", "1", "", "<b>", "2, 3", "", "X", "", '= "<i>"']
    assert elements(text, "p") == ["branch 1: attack"]


def test_a_near_miss_is_a_row_of_a_table() -> None:
    tree = rvaft.loads("time t as s; top sand a b within 5 s;")
    found = near_misses(tree, [{"event": "a", "t": 1}, {"event": "b", "t": 8}], semantics="scattered")
    assert elements(found._repr_html_(), "td")[:3] == ["top took 2 s longer than 5 s", "top", "1, 2"]
    assert elements(near_misses(tree, [])._repr_html_(), "p") == ["no near miss"]


@pytest.mark.parametrize("language", ["rml", "sql"])
def test_a_specification_is_its_text_with_its_sizes(language: str) -> None:
    specification = rvaft.translate(rvaft.loads("top sand a b;"), language, semantics="scattered")
    text = specification._repr_html_()
    assert elements(text, "pre") == [specification.text]
    assert f"symbols: {specification.metrics.symbols}" in text


def test_a_result_of_the_cross_check_is_a_row() -> None:
    result = Result(Job("<t>", Semantics.STRICT), "rml", Status.NOT_EXPRESSIBLE, why="a & b")
    assert elements(result._repr_html_(), "td") == ["<t>", "strict", "rml", "not expressible: a & b", "0"]
