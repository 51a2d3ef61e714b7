"""The tree with the path marked on which it was detected."""

import re
from collections.abc import Callable
from random import Random
from typing import Any
from xml.dom import minidom

import pytest

import rvaft
from rvaft import RVAFT, Explanation, Kind, TreeError, load, loads, to_dot
from rvaft.core.restriction import restrict
from rvaft.engine import Engine
from rvaft.export import Format
from rvaft.export.dot import picture
from rvaft.export.drawing import draw, fired_dot, fired_picture, fired_text
from rvaft.export.layout import LONGEST, Look, branch_marks
from rvaft.export.text import MARK, MAX_LEVELS
from rvaft.monitors import MatchedEvent
from rvaft.readers.json_lines import read
from rvaft.semantics import branches, feasible_scenarios
from rvaft.semantics.scenarios import of_branch
from tests.engine.checking import matched_occurrences, small_and_valid
from tests.engine.dense import SHAPES, dense_trace, dense_tree
from tests.export.geometry import drawn, needs_dot, overlaps
from tests.export.trees import AWKWARD, PINNED, awkward, chain
from tests.tables import sampled

ROBOT = load(PINNED / "robot.rvaft")
EVENTS = list(read(PINNED / "robot.jsonl"))
DRAWN = (PINNED / "robot.fired.txt").read_text(encoding="utf-8")


def explained(tree: RVAFT, events: list[Any] | str, semantics: str = "projected") -> Explanation:
    """The explanation of a trace, or of default events by their names, that ends with a detection."""
    trace = [{"event": name} for name in events.split()] if isinstance(events, str) else events
    monitor = rvaft.monitor(tree, semantics=semantics)
    assert list(monitor.run(trace))[-1] == "true"
    assert monitor.explanation is not None
    return monitor.explanation


def marked(text: str) -> set[str]:
    """The first words of the marked lines that draw a node."""
    lines = (line[len(MARK) :].strip("│├└─ ") for line in text.splitlines() if line.startswith(MARK))
    return {line.split()[0] for line in lines if "(see " not in line}


def test_the_terminal_shows_the_path_its_events_and_the_variables() -> None:
    explanation, numbered = explained(ROBOT, EVENTS), dict(enumerate(EVENTS, 1))
    assert fired_text(ROBOT, explanation, numbered) == DRAWN
    assert fired_text(ROBOT, explanation, {}) == re.sub(r", (time|topic) [^,\n]*", "", DRAWN), "events not at hand"
    coloured = fired_text(ROBOT, explanation, numbered, colour=True)
    assert re.sub(r"\x1b\[[0-9;]*m", "", coloured) == DRAWN
    codes = [re.fullmatch(r"\x1b\[([0-9;]*)m.*\x1b\[0m", line) for line in coloured.splitlines()[:7]]
    assert [code and code[1] for code in codes] == ["1", "1", "1", "1;31", "1", "2", "2"]


def test_a_reference_is_marked_where_the_scenario_comes_from() -> None:
    tree = loads("top or x y; x and s a; y and s b;")
    assert fired_text(tree, explained(tree, "s b"), {}).splitlines()[:7] == [
        "● top OR",
        "  ├─ x AND",
        "● │  ├─ s  event 1",
        "  │  └─ a",
        "● └─ y AND",
        "●    ├─ s (see above)",
        "●    └─ b  event 2",
    ]


@pytest.mark.parametrize("shape", sampled(SHAPES, 4))
@pytest.mark.parametrize("semantics", ["strict", "projected", "scattered"])
def test_what_is_marked_is_a_scenario_of_the_reference(shape: str, semantics: str) -> None:
    """For the whole tree and for a kind: node by node, edge by edge."""
    random, found = Random(f"fired {shape} {semantics}"), 0
    while found < 2:
        tree = dense_tree(random, SHAPES[shape])
        if not small_and_valid(tree):
            continue
        kinds = [kind for kind in Kind if any(tree.nodes[name].kind is kind for name in tree.order)]
        part = restrict(tree, kind=random.choice([None, *kinds]))
        try:
            engine = Engine(part, semantics)
        except TreeError:  # no scenario of this kind is feasible
            continue
        any(engine.step(event).final for event in dense_trace(random, SHAPES[shape], 12))
        explanation = engine.explanation
        if explanation is None or explanation.branch is None:
            continue
        found += 1
        chosen = branches(tree)[explanation.branch - 1]
        scenarios = [scenario for scenario in feasible_scenarios(tree) if of_branch(scenario, chosen)]
        fitting = [scenario for scenario in scenarios if scenario.kept == explanation.scenario]
        assert [scenario.occurrences for scenario in fitting] == [set(matched_occurrences(tree, explanation))]
        assert marked(fired_text(part, explanation, {})) == set(explanation.scenario)
        assert fired_text(part, explanation, {}) == fired_text(tree, explanation, {}), "the whole tree is drawn"
        check_graph(tree, explanation)


def check_graph(tree: RVAFT, explanation: Explanation) -> None:
    """Exactly the nodes and edges of the scenario are bold, the others grey."""
    dot = fired_dot(tree, explanation, {})
    found = re.findall(r"g(\d+) -> n(\d+) \[(.*)\];", dot)
    edges = {(tree.order[int(a)], tree.order[int(b)]): "penwidth" in look for a, b, look in found}
    kept = {(name, child) for name, children in explanation.scenario.items() for child in children}
    assert {edge for edge, bold in edges.items() if bold} == kept
    assert set(edges) == {(name, child) for name in tree.order for child in tree.nodes[name].children}
    nodes = re.findall(r"^  n(\d+) \[label.*(penwidth|fontcolor)", dot, re.MULTILINE)
    looks = {tree.order[int(node)]: look == "penwidth" for node, look in nodes}
    assert looks == {name: name in explanation.scenario for name in tree.order}


def test_marked_edges_are_drawn_over_the_others_of_their_gates() -> None:
    tree = loads("top or x y z; x and a; y and b; z and c;")
    picture = draw(tree, Format.SVG, Look(marks=branch_marks(tree, 1))).decode()
    assert re.findall(r'class="line (\w+)" data-line', picture) == ["faint"] * 4 + ["kept"] * 2


def test_a_counted_leaf_has_all_its_events_and_times_stand_where_the_tree_says() -> None:
    tree = loads("time at.s as s; top sand a b within 1 h; a times 7; b times 2;")
    trace = [{"event": "a" if number < 7 else "b", "at": {"s": number}} for number in range(9)]
    lines = fired_text(tree, explained(tree, trace, "scattered"), dict(enumerate(trace, 1))).splitlines()
    assert lines[:3] == [
        "● top SAND →  within 1 h",
        "● ├─ a  ×7  events 1, 2, 3, 4, …, 7",
        "● └─ b  ×2  events 8, 9",
    ]
    single = loads("time at.s as s; top and b;")
    assert "b  event 1, time 7\n" in fired_text(single, explained(single, trace[7:8]), {1: trace[7]})


def test_the_matched_nodes_alone_are_marked_without_a_scenario_and_once_in_a_deep_tree() -> None:
    explanation = Explanation(1, frozenset(), (MatchedEvent("a", 1, 1), MatchedEvent("b", 1, 2)), {})
    assert marked(fired_text(loads("top sand a b;"), explanation, {})) == {"a", "b"}
    text = fired_text(tree := chain(3 * MAX_LEVELS), explained(tree, f"g{3 * MAX_LEVELS}"), {})
    assert text.count("event 1") == 1
    assert all(line.startswith(MARK) for line in text.split("\n\nbranch")[0].splitlines() if line)


def awkward_match() -> tuple[RVAFT, Explanation, dict[int, Any]]:
    """Every awkward text as the topic and the time of an event and as the value of a variable."""
    tree = awkward()
    leaves = [name for name in tree.order if tree.nodes[name].leaf][: len(AWKWARD)]
    events = {number: {"time": {text: [text]}, "topic": text} for number, text in enumerate(AWKWARD, 1)}
    scenario = {tree.root: tree.nodes[tree.root].children, **dict.fromkeys(leaves, ())}
    variables = {f"V{number}": text for number, text in enumerate(AWKWARD)}
    matched = tuple(MatchedEvent(name, 1, number) for number, name in enumerate(leaves, 1))
    return tree, Explanation(1, frozenset(), matched, variables, scenario), events


def test_no_value_of_an_event_can_steer_the_terminal() -> None:
    text = fired_text(*awkward_match())
    assert all(line.isprintable() for line in text.splitlines())
    assert "日本語" in text
    assert r"zero \x00, next line \x85" in text


def by_graphviz() -> list[bytes]:
    return [picture(dot, "svg") for dot in (to_dot(awkward()), fired_dot(*awkward_match()))]


def by_us() -> list[bytes]:
    return [draw(awkward(), Format.SVG, Look(events=True)), fired_picture(*awkward_match(), Format.SVG)]


@pytest.mark.parametrize("drawer", [by_us, pytest.param(by_graphviz, marks=needs_dot)])
def test_no_value_of_an_event_leaves_its_place_in_a_picture(drawer: Callable[[], list[bytes]]) -> None:
    pictures = drawer()
    plain, document = map(minidom.parseString, pictures)
    assert len(plain.getElementsByTagName("g")) == len(document.getElementsByTagName("g")), "the same nodes and edges"
    assert not document.getElementsByTagName("b")
    shown = " ".join(t.firstChild.nodeValue or "" for t in document.getElementsByTagName("text") if t.firstChild)
    assert r"topic \N \G \\ back\slash\\" in re.sub(r"\s+", " ", shown)
    assert "<b>bold</b>" in shown


def test_a_long_value_is_cut_and_any_value_can_be_shown() -> None:
    tree = loads("toplevel a; event e(v) = {v: v}; a on e(V);")
    for value in ("x" * 10_000, ["x"] * 10_000, 10**5000, "\ud800"):
        match = explained(tree, [{"v": value}]), {1: {"v": value, "topic": value, "time": value}}
        assert len(fired_text(tree, *match)) < 5 * LONGEST
        assert fired_text(tree, *match).encode()
        assert fired_dot(tree, *match).encode()


def test_no_text_of_the_picture_overlaps_another() -> None:
    explanation = explained(ROBOT, EVENTS)
    check_graph(ROBOT, explanation)
    found = drawn(fired_picture(ROBOT, explanation, dict(enumerate(EVENTS, 1)), Format.SVG))
    assert overlaps(found) == []
    frames = [frame for name, frame in found.frames.items() if " of " not in name]
    assert len(frames) == len(ROBOT.order)
    for text, place in found.texts:
        assert sum(frame.top < place.bottom < frame.bottom and place.overlaps(frame) for frame in frames) <= 1, text
