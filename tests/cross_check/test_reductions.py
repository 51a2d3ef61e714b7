"""Every way of being smaller: what a disagreement does not need goes, whatever it is."""

from collections.abc import Callable

import pytest

from cross_check.reductions import (
    Pair,
    Reduction,
    constant_variables,
    fewer_children,
    plain_names,
    shorter_trace,
    simpler_literals,
    simpler_patterns,
    smaller_arguments,
    smaller_events,
    unshared_leaves,
    without_events,
    without_guards,
    without_unused,
)
from cross_check.shrink import shrink
from rvaft import RVAFT, Gate, Node, Verdict, dumps, loads
from rvaft.engine import Engine
from rvaft.model.guards import Operation, Operator
from rvaft.model.values import Json

Trace = list[Json]
Stays = Callable[[RVAFT, Trace], bool]


def word(text: str) -> Trace:
    return [{"event": name} for name in text.split()]


def detected(semantics: str, *wanted: Callable[[RVAFT], bool]) -> Stays:
    """Whether the trace is detected, by a tree that has something."""

    def holds(tree: RVAFT, trace: Trace) -> bool:
        return list(Engine(tree, semantics).run(trace))[-1:] == [Verdict.TRUE] and all(want(tree) for want in wanted)

    return holds


def root_is(*gates: Gate, children: int = 2) -> Callable[[RVAFT], bool]:
    return lambda tree: tree.nodes[tree.root].gate in gates and len(tree.nodes[tree.root].children) >= children


def gates(count: int) -> Callable[[RVAFT], bool]:
    return lambda tree: sum(node.gate is not None for node in tree.nodes.values()) >= count


def some(has: Callable[[Node], object]) -> Callable[[RVAFT], bool]:
    return lambda tree: any(has(node) for node in tree.nodes.values())


def patterns(count: int) -> Callable[[RVAFT], bool]:
    return lambda tree: sum(node.on is not None for node in tree.nodes.values()) >= count


TYPES = """event x(p) = { x: p };
event y(p) = { y: p };
event deep(p, q) = { k: "a long text", l: [p, _, { m: q }] };
"""

WAYS: dict[str, tuple[Stays, str, Trace, str, Trace]] = {
    # what is removed: what has to stay, tree, trace, the smallest tree, the smallest trace
    "the root and all its descendants but one": (
        detected("projected"),
        "top or p q; p and x y; q and z; ",
        word("x n y"),
        "toplevel a;\na;\n",
        word("a"),
    ),
    "a gate between its parents and its child": (
        detected(
            "strict", root_is(Gate.AND), lambda tree: all(node.gate is not Gate.OR for node in tree.nodes.values())
        ),
        "top and g x; g vot2 y z; ",
        word("z x y"),
        "toplevel a;\na and b c;\nb;\nc;\n",
        word("b c"),
    ),
    "what is below a gate": (
        detected("strict", some(lambda node: node.on)),
        TYPES + "g and y z on x(1); ",
        [{"x": 1}, *word("y z")],
        "event e() = {};\n\ntoplevel a;\na on e();\n",
        [{}],
    ),
    "what is below a gate without event": (
        detected("strict", lambda tree: "g" in tree.nodes, root_is(Gate.SAND)),
        "top sand g q; g and y z; ",
        word("y z q"),
        "toplevel a;\na sand g c;\ng;\nc;\n",
        word("g c"),
    ),
    "children of a VOT, and its K": (
        detected("strict", root_is(Gate.VOT, children=3)),
        "top 3of5 p q r s t; ",
        word("t q p"),
        "toplevel a;\na 1of3 b c d;\nb;\nc;\nd;\n",
        word("b"),
    ),
    "the other order": (
        detected("strict", root_is(Gate.SAND, Gate.SAND_RL, children=3)),
        "top sand_rl p q r; ",
        word("r q p"),
        "toplevel a;\na sand b c d;\nb;\nc;\nd;\n",
        word("b c d"),
    ),
    "sharing": (
        detected("strict", root_is(Gate.AND), gates(3)),
        "top and p q; p and s; q and s; ",
        word("s"),
        "toplevel a;\na and b c;\nb or d;\nd;\nc or e;\ne;\n",
        [{"event": "d"}, {"event": "e"}],
    ),
    "sharing of a typed event": (
        detected("strict", root_is(Gate.AND), gates(3), patterns(1)),
        TYPES + "top and p q; p and s; q and s; s on x(1); ",
        [{"x": 1}],
        "event e() = {};\n\ntoplevel a;\na and b c;\nb or d;\nd;\nc or e;\ne         on e();\n",
        [{"event": "d"}, {}],
    ),
    "causality": (
        detected("strict", root_is(Gate.AND, Gate.OR, children=1), patterns(1)),
        TYPES + "causality bottom_up; top and g; g and z on x(1); ",
        [*word("z"), {"x": 1}],
        "event e() = {};\n\ntoplevel a;\na or b on e();\nb;\n",
        [{}, {"event": "b"}],
    ),
    "causality, the trace turned round": (
        detected("strict", some(lambda node: node.on and node.gate)),
        TYPES + "causality bottom_up; top and x y on x(1); ",
        [*word("y x"), {"x": 1}],
        "event e() = {};\n\ntoplevel a;\na or b on e();\nb;\n",
        [{}, *word("b")],
    ),
    "typed events, one event fitting both": (
        detected("strict", root_is(Gate.AND)),
        TYPES + "top and p q; p on x(V); q on y(_); ",
        [{"x": 1, "y": 2}, {"y": 3, "x": 1}],
        "toplevel a;\na and b c;\nb;\nc;\n",
        word("b c"),
    ),
    "events of gates": (
        detected("strict", root_is(Gate.AND), gates(2)),
        TYPES + "top and p q on x(V) when V == 3; p or z on y(_); q; ",
        [{"x": 3}, {"y": 3}, *word("z q")],
        "toplevel a;\na and b c;\nb or d;\nd;\nc;\n",
        [{"event": "d"}, {"event": "c"}],
    ),
    "guards of leaves": (
        detected("strict", root_is(Gate.AND)),
        TYPES + "top and p q; p on x(V); q when V == 3; ",
        [{"x": 3}],
        "toplevel a;\na and b c;\nb;\nc         when true;\n",
        [{"event": "b"}],
    ),
    "parts of guards, and variables": (
        detected("strict", some(lambda node: "Operator.GE" in repr(node.when))),
        TYPES + "top and p q; p on x(V) when 3 < 4 and (not V + 2 != 5 or V < 2) and V * 2 >= 6; q; ",
        [{"x": 3}, *word("q")],
        "event e() = {};\n\ntoplevel a;\na on e() when 0 >= 0;\n",
        [{}],
    ),
    "conjuncts": (
        detected("strict", some(lambda node: isinstance(node.when, Operation) and node.when.operator is Operator.AND)),
        TYPES + "p on x(V) when V > 1 and V > 2 and V == 3 and V < 4; ",
        [{"x": 3}],
        "event e() = {};\n\ntoplevel a;\na on e() when true and true;\n",
        [{}],
    ),
    "parts of patterns": (
        detected("strict", patterns(1), lambda tree: "('l', " in repr(tree.events)),
        TYPES + "p on deep(V, 7); ",
        [{"k": "a long text", "l": [{"o": {}}, 2, {"m": 7.0, "n": []}]}],
        "event e() = { l: _ };\n\ntoplevel a;\na on e();\n",
        [{"l": 0}],
    ),
    "items of patterns and values": (
        detected(
            "strict", patterns(1), lambda tree: any("ListPattern" in repr(e.pattern) for e in tree.events.values())
        ),
        TYPES + "p on deep(V, 7); ",
        [{"k": "a long text", "l": [{"o": {}}, 2, {"m": 7.0, "n": []}]}],
        "event e() = { l: [] };\n\ntoplevel a;\na on e();\n",
        [{"l": []}],
    ),
    "arguments and literals": (
        detected("strict", some(lambda node: node.on and node.on.arguments)),
        TYPES + 'p on x("long"); q on deep(1, 2); toplevel p; ',
        [{"x": "long", "time": 12.5}],
        "event e(p) = { x: p };\n\ntoplevel a;\na on e(_);\n",
        [{"x": 0}],
    ),
    "literals": (
        detected("strict", patterns(1), lambda tree: "Literal" in repr(tree.events)),
        TYPES + "p on deep(3, 7); ",
        [{"k": "a long text", "l": [3, None, {"m": 7}]}],
        "event e() = { k: 0 };\n\ntoplevel a;\na on e();\n",
        [{"k": 0}],
    ),
    "two different variables": (
        detected("strict", lambda tree: bool(tree.variables)),
        TYPES + "top and p q; p on deep(V, W); q on x(W); ",
        [{"k": "a long text", "l": [3, None, {"m": 7}]}, {"x": 7.0}],
        "event e(q) = { l: [{m: q}] };\n\ntoplevel a;\na on e(W);\n",
        [{"l": [{"m": 0}]}],
    ),
    "arguments of ignores": (
        detected("projected", lambda tree: any(len(i.on.arguments) for i in tree.ignores)),
        TYPES + "ignore deep(V, W) when W < 3 and V == 1; ignore x(2); p on x(_); ",
        [{"x": 2}, {"k": "a long text", "l": [1, 0, {"m": 2}]}, {"x": 3}],
        "event e(p) = { x: p };\n\nignore e(_);\n\ntoplevel a;\na;\n",
        [{"event": "a"}],
    ),
    "unreachable nodes and unused event types": (
        detected("strict", lambda tree: len(tree.events) > 0),
        TYPES + "toplevel p; p; q and r; r on y(1); ",
        word("p"),
        "event e() = {};\n\ntoplevel a;\na;\n",
        [{"event": "a"}],
    ),
    "names, where one has to stay": (
        detected("strict", root_is(Gate.AND, children=3), lambda tree: "p" in tree.nodes),
        "top and q p r; ",
        word("p q r"),
        "toplevel a;\na and b p d;\nb;\np;\nd;\n",
        [{"event": "p"}, {"event": "b"}, {"event": "d"}],
    ),
}


@pytest.mark.parametrize("way", WAYS)
def test_whatever_is_not_needed_goes(way: str) -> None:
    stays, text, trace, smallest, left = WAYS[way]
    tree, found = shrink(loads(text), trace, stays)
    assert (dumps(tree), found) == (smallest, left)


# -- what single reductions offer -------------------------------------------------------------------------------

X = "event x(p) = { x: p };\n"
LOST = "toplevel top;\ntop and a b;\na;\nb;\n"

OFFERED: dict[str, tuple[Reduction, str, Trace, str, Trace]] = {
    # what: the reduction, tree, trace, a tree and a trace among the candidates
    "a lost child with its events": (
        fewer_children,
        "top and a b c;",
        word("a c b c"),
        LOST,
        word("a b"),
    ),
    "a lost child with one of its events": (fewer_children, "top and a b c;", word("a c b c"), LOST, word("a c b")),
    "a lost child, with one of the events that another child matches too": (
        fewer_children,
        X + "top and a b; a on x(1); b on x(_);",
        [{"x": 1}, {"x": 1}],
        "event x(p) = { x: p };\n\ntoplevel top;\ntop and a;\na         on x(1);\n",
        [{"x": 1}],
    ),
    "K with a child": (fewer_children, "top 2of3 a b c;", [], "toplevel top;\ntop 1of2 a b;\na;\nb;\n", []),
    "a child without K": (fewer_children, "top 2of3 a b c;", [], "toplevel top;\ntop 2of2 a b;\na;\nb;\n", []),
    "the first child": (fewer_children, "top 1of2 a b;", [], "toplevel top;\ntop 1of1 b;\nb;\n", []),
    "an event after that of a shared leaf": (
        unshared_leaves,
        "top and a p; p and a;",
        word("n a"),
        "toplevel top;\ntop and a p;\na;\np   and a_2;\na_2;\n",
        word("n a a_2"),
    ),
    "an event before that of a shared leaf": (
        unshared_leaves,
        "top and a p; p and a;",
        word("n a"),
        "toplevel top;\ntop and a p;\na;\np   and a_2;\na_2;\n",
        word("n a_2 a"),
    ),
    "all events of an `on` as default events": (
        without_events,
        X + "top and a; a on x(_);",
        [{"x": 1}, {}, {"x": 2, "y": 1}],
        X + "\ntoplevel top;\ntop and a;\na;\n",
        [*word("a"), {}, *word("a")],
    ),
    "all events of an `on` as default events too": (
        without_events,
        X + "top and a; a on x(_);",
        [{"x": 1}, {}, {"x": 2, "y": 1}],
        X + "\ntoplevel top;\ntop and a;\na;\n",
        [{"x": 1, "event": "a"}, {}, {"x": 2, "y": 1, "event": "a"}],
    ),
    "one event of an `on` as a default event": (
        without_events,
        X + "top and a; a on x(_);",
        [{"x": 1}, {}, {"x": 2}],
        X + "\ntoplevel top;\ntop and a;\na;\n",
        [{"x": 1}, {}, *word("a")],
    ),
    "one event of an `on` as a default event too": (
        without_events,
        X + "top and a; a on x(_);",
        [{"x": 1}, {}, {"x": 2}],
        X + "\ntoplevel top;\ntop and a;\na;\n",
        [{"x": 1, "event": "a"}, {}, {"x": 2}],
    ),
    "the events of a gate's `on` go with it": (
        without_events,
        X + "top and a on x(_); a;",
        [{"x": 1}, *word("a"), {"x": 2}],
        X + "\ntoplevel top;\ntop and a;\na;\n",
        word("a"),
    ),
    "a leaf loses event and guard together": (
        without_events,
        X + "top and a; a on x(V) when V > 1;",
        [{"x": 2}],
        X + "\ntoplevel top;\ntop and a;\na;\n",
        word("a"),
    ),
    "a leaf that loses its guard waits for an event": (
        without_guards,
        "top and a b; b when 1 < 2;",
        word("a n"),
        "toplevel top;\ntop and a b;\na;\nb;\n",
        word("a b"),
    ),
    "a guard that holds": (
        without_guards,
        "top and a b; b when 1 < 2;",
        word("a"),
        "toplevel top;\ntop and a b;\na;\nb           when true;\n",
        word("a"),
    ),
    "a guard that does not hold": (
        without_guards,
        "top and a b; b when 1 < 2;",
        word("a"),
        "toplevel top;\ntop and a b;\na;\nb           when false;\n",
        word("a"),
    ),
    "one of three conjuncts": (
        without_guards,
        "top and a b; b when 1 < 2 and 3 < 4 and 5 < 6;",
        [],
        "toplevel top;\ntop and a b;\na;\nb           when 1 < 2 and 5 < 6;\n",
        [],
    ),
    "an operand further in": (
        without_guards,
        "top and a b; b when not (2 < 1 or 4 < 3);",
        [],
        "toplevel top;\ntop and a b;\na;\nb           when not 4 < 3;\n",
        [],
    ),
    "the guard of an ignore": (
        without_guards,
        X + "ignore x(V) when V < 2; a;",
        [],
        X + "\nignore x(V);\n\ntoplevel a;\na;\n",
        [],
    ),
    "a part of the guard of an ignore": (
        without_guards,
        X + "ignore x(V) when not V < 2; a;",
        [],
        X + "\nignore x(V) when V < 2;\n\ntoplevel a;\na;\n",
        [],
    ),
    "a literal for an argument of an ignore": (
        smaller_arguments,
        X + "ignore x(V); a;",
        [],
        X + "\nignore x(0);\n\ntoplevel a;\na;\n",
        [],
    ),
    "what all uses give a parameter": (
        simpler_patterns,
        X + "top and a b; a on x(1); b on x(1);",
        [{"x": 1}],
        "event x() = { x: 1 };\n\ntoplevel top;\ntop and a b;\na           on x();\nb           on x();\n",
        [{"x": 1}],
    ),
    "anything for a parameter that is used twice": (
        simpler_patterns,
        "event x(p, q) = { x: p, y: [p], z: q }; top and a; a on x(V, W);",
        [{"x": 1, "y": [1], "z": 1}],
        "event x(q) = { x: _, y: [_], z: q };\n\ntoplevel top;\ntop and a;\na         on x(W);\n",
        [{"x": 1, "y": [1], "z": 1}],
    ),
    "anything for a part of a pattern": (
        simpler_patterns,
        "event x(p) = { x: p, y: { z: [1] } }; a on x(2);",
        [],
        "event x(p) = { x: p, y: {z: _} };\n\ntoplevel a;\na on x(2);\n",
        [],
    ),
    "an item of a pattern with that of the trace": (
        simpler_patterns,
        "event x() = { l: [1, [2, 3]] }; a on x();",
        [{"l": [1, [2, 3]]}, {"l": [1, [2]]}, {"l": 1}],
        "event x() = { l: [1, [2]] };\n\ntoplevel a;\na on x();\n",
        [{"l": [1, [2]]}, {"l": [1, [2]]}, {"l": 1}],
    ),
    "a plain literal in the tree and the trace": (
        simpler_literals,
        X + "a on x(5.5);",
        [{"x": 5.5, "y": [5.5, 5]}],
        X + "\ntoplevel a;\na on x(0);\n",
        [{"x": 0, "y": [0, 5]}],
    ),
    "a plain literal in the tree alone": (
        simpler_literals,
        X + "a on x(5.5);",
        [{"x": 5.5}],
        X + '\ntoplevel a;\na on x("");\n',
        [{"x": 5.5}],
    ),
    "the value that a variable has": (
        constant_variables,
        X + "a on x(V) when V > 1;",
        [{"x": 7}],
        X + "\ntoplevel a;\na on x(7) when 7 > 1;\n",
        [{"x": 7}],
    ),
    "an event with nothing in it": (smaller_events, "a;", [{"x": 1, "y": 2}], "toplevel a;\na;\n", [{}]),
    "an event without a field": (
        smaller_events,
        "a;",
        [{}, {"x": [{"z": 1, "y": 2}]}],
        "toplevel a;\na;\n",
        [{}, {"x": [{"y": 2}]}],
    ),
    "half of a trace": (shorter_trace, "a;", word("a b c d"), "toplevel a;\na;\n", word("c d")),
    "names with a trace as it is": (plain_names, "p;", word("p"), "toplevel a;\na;\n", word("p")),
    "one name": (
        plain_names,
        "p and q a;",
        word("a q"),
        "toplevel p;\np and b a;\nb;\na;\n",
        word("a b"),
    ),
    "one event type": (
        without_unused,
        "event x() = {}; event y() = {}; event z() = {}; a;",
        [],
        "event x() = {};\nevent z() = {};\n\ntoplevel a;\na;\n",
        [],
    ),
    "unreachable nodes": (without_unused, "toplevel a; a; b or c;", [], "toplevel a;\na;\n", []),
}


@pytest.mark.parametrize("what", OFFERED)
def test_a_reduction_offers(what: str) -> None:
    reduction, text, trace, smaller, left = OFFERED[what]
    before = Pair.of(loads(text), trace)
    after = next((p for p in reduction(before) if (dumps(p.tree), list(p.trace)) == (smaller, left)), None)
    assert after is not None, [(dumps(p.tree), p.trace) for p in reduction(before)]
    assert after.measure < before.measure
