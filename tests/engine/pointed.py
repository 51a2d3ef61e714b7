"""Random trees whose guards have the start and the end of nodes with choices, and traces for them."""

from collections.abc import Iterator
from contextlib import suppress
from random import Random
from typing import Any, Final

import rvaft
from rvaft.engine import Engine
from rvaft.errors import RvaftError
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics
from tests.engine.checking import small_valid_trees

GATES: Final = ("or", "or", "vot", "vot", "and", "sand", "pand", "sand_rl")
SHAPES: Final[dict[str, dict[str, Any]]] = {
    "few letters": {"letters": "abc"},
    "one letter each": {"letters": "abcdefghijkl", "apart": True},
    "values": {"letters": "abcd", "names": ("_", "X", "Y", "Z")},
    "a common value": {"letters": "abcdefghijkl", "apart": True, "names": ("X",)},
    "windows": {"letters": "abcd", "windows": 0.3},
    "counts": {"letters": "abcdef", "times": 0.3},
    "absences": {"letters": "abcd", "without": 0.2},
    "shared": {"letters": "abcd", "shared": 0.4, "gates": ("or", "vot", "and", "and", "sand", "sand")},
}


def pointed_tree(random: Random, shape: str, *, gates: int = 5, late: str | None = None) -> RVAFT:
    """A tree with one or two guards over time points."""
    facts = SHAPES[shape]
    letters, names_of = iter(facts["letters"]), facts.get("names", ("_",))
    names, agenda, children = (
        iter(f"n{number}" for number in range(100)),
        list[tuple[str, int]](),
        dict[str, list[str]](),
    )
    agenda.append((next(names), 0))
    texts, left, own = dict[str, str](), gates, dict[str, str]()
    while agenda:
        name, depth = agenda.pop(0)
        children[name], text = [], name
        if left > 0 and (depth == 0 or random.random() < 0.6):
            left -= 1
            size = random.randint(2, 3)
            children[name] = [next(names) for _ in range(size)]
            agenda += [(child, depth + 1) for child in children[name]]
            gate = random.choice(
                facts.get("gates", GATES if depth else ("and", "sand", "sand", "pand", "sand_rl", "or"))
            )
            gate = f"{random.randint(1, size - 1)}of{size}" if gate == "vot" else gate
            others = [one for one in texts if one != "n0" and one not in children[name] and not children[one]]
            if others and random.random() < facts.get("shared", 0):
                children[name][0] = random.choice(others)
                with suppress(ValueError):
                    agenda.remove((children[name][0], depth + 1))
                agenda = [one for one in agenda if one[0] in {c for some in children.values() for c in some}]
            text += f" {gate} {' '.join(children[name])}"
            if random.random() < facts.get("windows", 0):
                text += f" within {random.choice((1, 2, 4))} s"
        if not children[name] or random.random() < 0.1:
            letter = next(letters, None) if facts.get("apart") else random.choice(facts["letters"])
            own[name] = letter or random.choice(facts["letters"])
            text += f' on e("{own[name]}", {random.choice(names_of)})'
            if not children[name] and random.random() < facts.get("times", 0):
                text += f" times {random.randint(2, 3)}"
            elif random.random() < 0.08:
                text += " when 1 == 1"
        if random.random() < facts.get("without", 0):
            text += f' without e("z", _){random.choice(("", " before", " for 1 s after", " for 2 s before"))}'
        if random.random() < 0.2:
            text += random.choice((" fault", " attack"))
        texts[name] = text
    gated = [name for name, below in children.items() if below]
    for _ in range(random.randint(1, 2)):
        node = random.choice([*gated, *gated, *children])
        if " when " in texts[node]:
            continue
        texts[node] = _with_guard(texts[node], guard_of(random, [*gated, *gated, *own]))
    times = f"time t as s{random.choice(('', ' late 0 s', ' late 0 s', ' late 2 s')) if late is None else late};"
    causality = random.choice(("", "", "causality bottom_up; "))
    head = f"{causality}{times} event e(n, v) = {{ e: n, v: v }}; toplevel n0; "
    return rvaft.loads(head + " ".join(f"{text};" for text in texts.values()))


def _with_guard(text: str, guard: str) -> str:
    """The text of a node with a guard, before what must follow it."""
    for word in (" within ", " without ", " fault", " attack"):
        if word in text:
            before, after = text.split(word, 1)
            return f"{before} when {guard}{word}{after}"
    return f"{text} when {guard}"


def guard_of(random: Random, nodes: list[str]) -> str:
    """A guard over the time points of these nodes."""

    def comparison() -> str:
        one, other = (f"{random.choice(('start', 'end', 'end', 'at'))}({random.choice(nodes)})" for _ in range(2))
        operator = random.choice(("<=", "<=", ">=", ">=", "<", ">", "==", "!="))
        if random.random() < 0.3:
            return f"{one} {operator} {other}"
        return f"{one} - {other} {operator} {random.choice((0, 1, 2, 3))} s"

    match random.randrange(8):
        case 0:
            return f"{comparison()} and {comparison()}"
        case 1:
            return f"({comparison()} or {comparison()})"
        case 2:
            return f"not {comparison()}"
        case _:
            return comparison()


def pointed_trees(random: Random, shape: str, *, late: str | None = None) -> Iterator[RVAFT]:
    """Valid trees with a time point of a node with choices that the reference takes quickly, without end."""

    def made() -> RVAFT:
        while True:
            with suppress(RvaftError):
                return pointed_tree(random, shape, gates=random.randint(2, 5), late=late)

    return small_valid_trees(made)


def pointed_trace(random: Random, tree: RVAFT, semantics: Semantics, *, length: int = 12) -> list[dict[str, Any]]:
    """A trace that avoids a final verdict for as long as it easily can; times may go back or lack."""
    letters = sorted({str(node.on.arguments[0].value) for node in tree.nodes.values() if node.on is not None})  # type: ignore[union-attr]
    trace: list[dict[str, Any]] = []
    monitor, clock = Engine(tree, semantics), 0
    patience = random.choice((0, 2, 5))
    back = random.choice(((), (-2, -1)))
    for _ in range(random.randint(3, length)):
        for _ in range(patience + 1):
            time = clock + random.choice((*back, 0, 0, 1, 1, 2, 4))
            stamp = {"t": time} if random.random() < 0.97 else {}
            letter = random.choice(letters) if random.random() < 0.95 else "z"
            event = {"e": letter, "v": random.choice((0, 0, 0, 1)), **stamp}
            ahead = monitor.fork()
            if not ahead.step(event).final:
                break
        trace.append(event)
        monitor, clock = ahead, max(clock, time)
        if monitor.verdict.final:
            break
    return trace
