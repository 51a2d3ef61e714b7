"""Absent events in the languages that write them, held against the reference on random trees."""

import re
from contextlib import suppress
from random import Random

import pytest

from rvaft import NotExpressible, RvaftError, Semantics, TooLarge, loads
from rvaft.backend import backend
from rvaft.errors import Cause
from rvaft.rules.validity import require_valid
from rvaft.semantics import Reference
from tests.backends.texts import SPOT, agreeing, readable, signs
from tests.engine.dense import CHOOSING, Dense, dense_trace, dense_tree
from tests.tables import part_and_whole

SHAPES = {
    "events": Dense(absences=0.3, nodes=6, sharing=0.3, guards=0, gates=CHOOSING),
    "values": Dense(absences=0.5, nodes=4, letters=3, variables=0.6, guards=0),
    "other letters": Dense(absences=0.5, nodes=4, letters=5, gate_events=0.1, guards=0, gates=CHOOSING),
}


@pytest.mark.parametrize("count", [*part_and_whole(1, 60), pytest.param(200, marks=pytest.mark.slow)])
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("name", readable("automaton", "c", "eql", "ltlf", "mtl", "rml", "sql", "sql-duckdb"))
def test_absent_events_of_random_trees(name: str, shape: str, count: int) -> None:
    random, translator, trees, compared = Random(f"{name} {shape}"), backend(name), 0, 0
    while trees < count:
        tree = dense_tree(random, SHAPES[shape])
        with suppress(RvaftError):
            require_valid(tree)
            if not tree.absences:
                continue
            trees += 1
            for semantics in Semantics:
                with suppress(NotExpressible, TooLarge):
                    traces = [dense_trace(random, SHAPES[shape], 7) for _ in range(6)]
                    compared += agreeing(translator, tree, semantics, traces)
    assert compared >= count // 2


BEFORE = 'event e(k, u) = { k: k, u: u }; top or x y; x on e("a", _) without e("c", _) before; y sand s z; '
LASTING = f'{BEFORE}s on e("b", _); z on e("d", U);'
"""After `c` there is still `y`."""


@pytest.mark.parametrize("name", [pytest.param(name, marks=SPOT) for name in ("automaton", "ltlf")])
@pytest.mark.parametrize("word", ["a", "ca", "cbd", "xca", "bca", "xa", "cabxd", "bcad"])
def test_what_is_absent_before_where_another_scenario_remains(name: str, word: str) -> None:
    trace = [{"k": letter, "u": 1} for letter in word]
    for semantics in Semantics if name == "ltlf" else (Semantics.STRICT, Semantics.SCATTERED):
        with suppress(NotExpressible):
            text = backend(name).translate(loads(LASTING), semantics).text
            assert signs(backend(name).read(text), trace) == signs(Reference(loads(LASTING), semantics), trace)


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        pytest.param("ltlf", r"!x_absent U", "true U", marks=SPOT),
        pytest.param("ltlf", r"!x_absent U x", "x", marks=SPOT),
        pytest.param("automaton", r"c", "e", marks=SPOT),
    ],
)
def test_a_fault_in_what_is_absent_before_is_found(name: str, old: str, new: str) -> None:
    text = backend(name).translate(loads(LASTING), Semantics.SCATTERED).text
    old = f'k: \\\\"{old}' if name == "automaton" else old
    changed = re.sub(old, f'k: \\\\"{new}' if name == "automaton" else new, text)
    assert changed != text
    monitor, wanted = backend(name).read(changed), Reference(loads(LASTING), Semantics.SCATTERED)
    words = ["ca", "xa", "cbd", "a"]
    traces = [[{"k": letter, "u": 1} for letter in word] for word in words]
    assert [signs(monitor.fork(), one) for one in traces] != [signs(wanted.fork(), one) for one in traces]


@pytest.mark.parametrize(
    ("text", "semantics", "why"),
    [
        (f'{BEFORE}s on e("b", _) without e("d", _) before; z;', "scattered", "the text would be false at once"),
        (LASTING, "projected", "events absent `before` are not written under projected"),
        (
            LASTING.replace('"a", _) without e("c", _)', '"a", U) without e("c", U)'),
            "scattered",
            "before its variables",
        ),
    ],
)
@pytest.mark.parametrize("name", ["automaton", "ltlf"])
def test_what_is_absent_before_is_refused(name: str, text: str, semantics: str, why: str) -> None:
    with pytest.raises(NotExpressible, match=why) as raised:
        backend(name).translate(loads(text), Semantics(semantics))
    assert raised.value.cause is Cause.WRITER


def choosing_tree(random: Random, *, guards: bool) -> str:
    """A tree with choices, some of which need that an event did not come before."""

    def without(share: float) -> str:
        own, when = random.choice((("_", ""), ("U", ""), ("V", " when V > 1") if guards else ("_", "")))
        absent = f' without e("{random.choice("abcde")}", {own}){when}{random.choice((" before", " before", ""))}'
        return absent if random.random() < share else ""

    def gate(name: str, *children: str) -> str:
        word = random.choice(("and", "sand", "or", "or", f"{len(children) - 1}of{len(children)}"))
        return f"{name} {word} {' '.join(children)}{without(0.3)}; "

    names = ("l0", "l1", "l2", "l3")[: random.choice((2, 3, 4))]
    gates = {2: gate("top", "l0", "l1"), 3: gate("top", "g", "l2"), 4: gate("top", "g", "h") + gate("h", "l2", "l3")}
    shared = gate("g", "l0", "l1") if len(names) > 2 else ""
    leaves = (f'{name} on e("{random.choice("abc")}", {random.choice("__U")}){without(0.4)}; ' for name in names)
    return f"event e(k, u) = {{ k: k, u: u }}; toplevel top; {gates[len(names)]}{shared}{''.join(leaves)}"


@pytest.mark.parametrize("count", [*part_and_whole(5, 50), pytest.param(150, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", readable("automaton", "ltlf", "rml"))
def test_what_is_absent_before_in_random_trees(name: str, count: int) -> None:
    random, compared = Random(f"before {name}"), 0
    while compared < 4 * count:
        text = choosing_tree(random, guards=name == "ltlf")
        with suppress(RvaftError):
            made, semantics = loads(text), random.choice((Semantics.SCATTERED, Semantics.CONSECUTIVE))
            if " before" in text:
                backend(name).translate(made, semantics)
                lengths = (4, 6, 7, 8)
                traces = [
                    [{"k": random.choice("abcdex"), "u": random.choice((1, 2))} for _ in range(n)] for n in lengths
                ]
                compared += agreeing(backend(name), made, semantics, traces)
