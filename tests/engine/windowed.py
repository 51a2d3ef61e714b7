"""Random trees with windows, counts and a common variable, and traces with times, for the engine and the reference."""

from collections.abc import Iterator
from contextlib import suppress
from random import Random
from typing import Any

import rvaft
from rvaft.errors import RvaftError
from rvaft.model.patterns import Literal
from rvaft.model.tree import RVAFT
from tests.engine.checking import small_valid_trees

EVENTS = "event letter(l) = { l: l }; event pair(l, v) = { l: l, v: v };"
GATES = ("or", "or", "and", "and", "sand", "sand", "pand", "sand_rl", "vot")


def windowed_tree(random: Random, *, late: str = " late 0 s", gates: int = 4) -> RVAFT:
    """A tree whose leaves are letters; nodes may have windows, leaves counts, and all of them one variable."""
    keyed = random.random() < 0.5
    letters = iter("abcdefghijklmnopqrstuvwxyz")
    lines = [f"time t as s{late};", EVENTS, "semantics scattered;", "toplevel n0;"]
    if random.random() < 0.2:
        lines.append("causality bottom_up;")
    names, agenda = iter(f"n{number}" for number in range(100)), list[tuple[str, int]]()
    agenda.append((next(names), 0))
    left = gates
    while agenda:
        name, depth = agenda.pop()
        text = name
        is_gate = left > 0 and (depth == 0 or random.random() < 0.55)
        if is_gate:
            left -= 1
            size = random.randint(1, 3) if depth else random.randint(2, 3)
            children = [next(names) for _ in range(size)]
            agenda += [(child, depth + 1) for child in children]
            gate = random.choice(GATES)
            gate = f"{random.randint(1, size)}of{size}" if gate == "vot" else gate
            text += f" {gate} {' '.join(children)}"
            if random.random() < 0.3:
                text += random.choice((" fault", " attack"))
            if random.random() < (0.3 if depth else 0.7):
                text += f" within {random.choice((0, 1, 2, 3, 4, 6))} s"
        if not is_gate or (depth and random.random() < 0.2):
            letter = next(letters) if random.random() < 0.75 else random.choice("abcdef")
            own = f'letter("{letter}")', f'pair("{letter}", _)', f'pair("{letter}", Y{name})'
            on = f'pair("{letter}", X)' if keyed else random.choice(own)
            text += f" on {on}"
            if not is_gate and random.random() < 0.2:
                text += f" times {random.randint(2, 3)}"
            if keyed and random.random() < 0.1:
                text += f" when X {random.choice(('!=', '<', '=='))} 2"
            elif "Y" in on and random.random() < 0.4:
                text += f" when Y{name} >= 2"
        lines.append(text + ";")
    return rvaft.loads("\n".join(lines))


def windowed_trees(random: Random, *, late: str, gates: int = 4) -> Iterator[RVAFT]:
    """Valid trees that the reference takes quickly, without end."""

    def made() -> RVAFT:
        while True:
            with suppress(RvaftError):
                return windowed_tree(random, late=late, gates=gates)

    return small_valid_trees(made)


def timed_trace(random: Random, tree: RVAFT, length: int, *, disorder: float = 0.0) -> list[dict[str, Any]]:
    """Letters of the tree with values and times; some times are undefined, some decrease."""
    found = (node.on.arguments[0] for node in tree.nodes.values() if node.on is not None)
    letters = sorted({str(one.value) for one in found if isinstance(one, Literal)})
    time, trace = 0.0, []
    values = random.sample((1, 2, 3, 1.0, "x", None, True, [1]), 2)
    for _ in range(length):
        steps = (0, 0, 1, 1, 0.5, 2) if random.random() >= disorder else (-3, -1, -2, -0.5)
        time += random.choice(steps)
        event: dict[str, Any] = {"l": random.choice([*letters, *letters, "z"]), "v": random.choice(values), "t": time}
        if random.random() < 0.03:
            del event["t"]
        trace.append(event)
    return trace
