"""Repetition by a variable against one reference for each of its values (definition, 4.9)."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from random import Random
from typing import Any, Final

import pytest

import rvaft
from rvaft import RVAFT, OptionError, Repetition, TreeError
from rvaft.model.guards import Guard, substitute
from rvaft.model.nodes import On
from rvaft.model.patterns import Literal, Variable
from rvaft.semantics import Reference

VALUES: Final = (1, 2, "x")


def instance(tree: RVAFT, name: str, value: Any) -> RVAFT:
    """The tree with a value in place of a variable."""

    def called(on: On | None) -> Any:
        own = () if on is None else on.arguments
        arguments = tuple(Literal(value) if one == Variable(name) else one for one in own)
        return None if on is None else replace(on, arguments=arguments)

    def guarded(guard: Guard | None) -> Guard | None:
        return None if guard is None else substitute(guard, {name: Literal(value)})

    nodes = []
    for node in tree.nodes.values():
        without = tuple(replace(one, on=called(one.on), when=guarded(one.when)) for one in node.without)
        nodes.append(replace(node, on=called(node.on), when=guarded(node.when), without=without))
    return tree.changed(nodes=nodes)


def text_of(random: Random) -> str:
    """A small tree under `scattered` in which every event has the variable U."""
    names = [f"l{number}" for number in range(random.choice((1, 2, 3, 3, 4)))]
    timed = random.random() < 0.6
    settings = f"time t as s{random.choice(('', ' late 0 s', ' late 2 s'))}; " if timed else ""
    sides = ["", " before", *([" for 2 s after", " for 1 s before"] if timed else [])]

    def leaf(name: str) -> str:
        call = f'{random.choice("eef")}("{random.choice("abc")}"'
        own = f"{name} on {call}, U, {random.choice(('_', '_', 'Y', '1'))})"
        own += " times 2" if random.random() < 0.15 else ""
        if random.random() < 0.25:
            absent = f'{random.choice("ef")}("{random.choice("abc")}", {random.choice("U_")}, _)'
            own += f" without {absent}{random.choice(sides)}"
        return f"{own}; "

    def gate(name: str, *children: str) -> str:
        word = random.choice(("and", "sand", "or", "sand", "pand", f"2of{len(children)}"))
        window = f" within {random.choice((1, 3))} s" if timed and random.random() < 0.3 else ""
        return f"{name} {word} {' '.join(children)}{window}; "

    gates = ""
    if len(names) == 2:
        gates = gate("top", *names)
    elif len(names) == 3:
        gates = gate("top", "g", names[2]) + gate("g", *names[:2])
    elif len(names) == 4:
        gates = gate("top", "g", "h") + gate("g", *names[:2]) + gate("h", *names[random.choice((1, 2)) :])
    root = "top" if gates else "l0"
    event = "event e(k, u, v) = { k: k, u: u, v: v }; event f(k, u, v) = { k: k, w: u, v: v }; "
    return f"semantics scattered; {settings}{event}toplevel {root}; {gates}{''.join(map(leaf, names))}"


def trees(random: Random, count: int) -> Iterator[RVAFT]:
    while count:
        try:
            tree = rvaft.loads(text_of(random))
            Reference(tree)
        except TreeError:
            continue
        count -= 1
        yield tree


def events_of(random: Random, count: int) -> list[dict[str, Any]]:
    clock, events = 0, list[dict[str, Any]]()
    for _ in range(count):
        clock += random.choice((0, 1, 1, 2, -1))
        users = {"u": random.choice(VALUES), "w": random.choice(VALUES)}
        events.append({"k": random.choice("abc"), **users, "v": random.choice((1, 2)), "t": clock})
    return events


def detections(tree: RVAFT, events: Sequence[Any]) -> list[bool]:
    """Whether some instance of U detects at each event, by one reference for each value."""
    apart = [Repetition(Reference(instance(tree, "U", value))) for value in VALUES]
    return ["⊤" in [one.step(event).symbol for one in apart] for event in events]


@pytest.mark.ci
@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 9))])
def test_only_the_detected_value_starts_afresh(seed: int) -> None:
    random, detected = Random(f"repeat by {seed}"), 0
    for tree in trees(random, 60):
        for _ in range(4):
            events = events_of(random, random.choice((6, 9, 12)))
            expected = detections(tree, events)
            monitor = rvaft.monitor(tree, repeat_by="U")
            found = [monitor.step(event).symbol for event in events]
            assert found == ["⊤" if one else "?" for one in expected], (rvaft.dumps(tree), events)
            detected += sum(expected)
    assert detected


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (
            "event e(u) = { u: u }; event f(v) = { v: v }; top sand a b; a on e(U); b on f(_);",
            "the event of b does not",
        ),
        ("semantics projected; event e(u) = { u: u }; top sand a b; a on e(U); b on e(U);", "needs the semantics"),
    ],
)
def test_a_variable_that_not_every_event_has_is_refused(text: str, why: str) -> None:
    semantics = None if text.startswith("semantics") else "scattered"
    with pytest.raises(OptionError, match=why):
        rvaft.monitor(rvaft.loads(text), semantics=semantics, repeat_by="U")
