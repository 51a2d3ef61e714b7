"""Fault trees by the failures themselves: a text of Galileo, an order of failures, and when the top fails.

Shares nothing with rvaft, so that the two can be compared. A basic event fails once, at the position at which the
order has it; a dependent event fails with its trigger, too. A gate fails at the first position at which its condition
holds. The inputs of `pand` fail from left to right, also at the same position (*inclusive*).
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from random import Random
from typing import NamedTuple

NEVER = 10**9
DEPENDENCIES = ("fdep", "pdep=1", "pdep=1.0")


class Gate(NamedTuple):
    """A gate of a fault tree; `need` is the number of inputs that must fail."""

    word: str
    inputs: list[str]
    need: int


class FaultTree(NamedTuple):
    """A text of Galileo: gates, the dependents of triggers, the pairs of a cold part and what fails before it."""

    top: str
    gates: dict[str, Gate]
    triggers: list[tuple[str, list[str]]]
    enforced: list[list[str]]
    events: list[str]


def read(text: str) -> FaultTree:
    """Return the fault tree of a text, in which attributes do not matter but `dorm`."""
    text = re.sub(r"//[^\n]*|/\*.*?\*/", "", text, flags=re.DOTALL)
    gates: dict[str, Gate] = {}
    words: dict[str, str] = {}
    triggers, enforced, names, dormant, top = [], [], dict[str, None](), {}, ""
    for statement in filter(None, map(str.strip, text.split(";"))):
        tokens = [one.strip('"') for one in re.findall(r'"[^"]*"|[^\s"]+', statement)]
        if tokens[0] in ("toplevel", "param"):
            top = tokens[1] if tokens[0] == "toplevel" else top
            continue
        name, rest = tokens[0], tokens[1:]
        if not rest or ("=" in rest[0] and not rest[0].startswith("pdep")):
            names[name] = None
            dormant[name] = next((one.partition("=")[2] for one in rest if one.startswith("dorm=")), "")
            continue
        word, inputs = rest[0], [one for one in rest[1:] if "=" not in one]
        words[name] = word
        if word in DEPENDENCIES:
            triggers.append((inputs[0], inputs[1:]))
            names.update(dict.fromkeys(inputs))
            continue
        names.update(dict.fromkeys(inputs))
        counted = re.fullmatch(r"(\d+)of\d+|vot(\d+)", word)
        need = 1 if word == "or" else int(counted[1] or counted[2]) if counted else len(inputs)
        gates[name] = Gate("vot" if counted else word, inputs, need)
    dependencies = {name for name, word in words.items() if word in DEPENDENCIES}
    for name, gate in gates.items():  # a dependency never fails, and no gate waits for it
        kept = [one for one in gate.inputs if one not in dependencies]
        gates[name] = gate._replace(inputs=kept, need=min(gate.need, len(kept)))
    for gate in gates.values():
        cold = gate.word == "spare" and all(dormant.get(one, "") in ("0", "0.0") for one in gate.inputs[1:])
        if cold or gate.word in ("csp", "seq"):
            enforced.append(gate.inputs)
    ordered = dict.fromkeys(_leaves(gates, top))
    return FaultTree(
        top,
        gates,
        triggers,
        enforced,
        [one for one in {**ordered, **names} if one not in gates and one not in dependencies],
    )


def _leaves(gates: Mapping[str, Gate], name: str) -> Iterator[str]:
    if name not in gates:
        yield name
        return
    for one in gates[name].inputs:
        yield from _leaves(gates, one)


def failures(tree: FaultTree, order: Sequence[str]) -> dict[str, int]:
    """Return at which position (from 1) each event and gate fails; NEVER if it does not."""
    at: dict[str, int] = dict.fromkeys([*tree.events, *tree.gates], NEVER)
    for position in range(len(order) + 1):
        if position:
            at[order[position - 1]] = min(at[order[position - 1]], position)
        failing = True
        while failing:
            failing = False
            for trigger, dependents in tree.triggers:
                for one in dependents:
                    if at[trigger] <= position < at[one]:
                        at[one], failing = position, True
            for name, gate in tree.gates.items():
                if at[name] == NEVER and _holds(gate, [at[one] for one in gate.inputs]):
                    at[name], failing = position, True
    return at


def _holds(gate: Gate, times: list[int]) -> bool:
    if gate.word == "pand":
        return times == sorted(times) and NEVER not in times
    return sum(time < NEVER for time in times) >= gate.need


def orders(tree: FaultTree, random: Random, number: int) -> Iterator[list[str]]:
    """Yield random orders in which all events fail that can: none before what is enforced to fail first.

    Every other order is near to that from left to right, in which priority gates fail.
    """
    below = {name: {*_leaves(tree.gates, name)} for name in [*tree.gates, *tree.events]}
    for place in range(number):
        order: list[str] = []
        while True:
            at = failures(tree, order)
            early = {
                event
                for inputs in tree.enforced
                for turn, one in enumerate(inputs)
                if any(at[earlier] == NEVER for earlier in inputs[:turn])
                for event in below[one]
            }
            ready = [event for event in tree.events if event not in order and event not in early]
            if not ready:
                break
            order.append(random.choice(ready[: 2 if place % 2 else None]))
        yield order


def random_text(random: Random) -> str:
    """Return a random fault tree with priority gates over choices, shared events and dependencies."""
    unused = [f"e{number}" for number in range(random.choice([5, 6]))]
    used: list[str] = []
    gates: list[str] = []
    text: list[str] = []
    sharing = random.choice([0, 0, 0, 0.2])
    for number in range(random.choice([2, 3, 4])):
        below: list[str] = []
        for _ in range(random.choice([2, 2, 3])):
            pool = used if used and (not unused or random.random() < sharing) else unused
            below.append(pool.pop() if pool is unused else random.choice(used))
        if number > 1:
            below[: random.choice([1, 2])] = random.sample(gates, random.choice([1, 2]))
        used += below
        below = list(dict.fromkeys(below))
        word = random.choice(
            ["pand", "or", "or", "and", f"vot{max(1, len(below) - 1)}", "wsp"] + ["pand"] * (number - 1)
        )
        text.append(f'"g{number}" {word} {" ".join(below)};')
        gates.append(f"g{number}")
    events = sorted({name for name in used if name[0] == "e"})
    if random.random() < 0.2 and len(events) > 2:
        trigger, *dependents = random.sample(events, random.choice([2, 3]))
        text.append(f'"f" fdep {trigger} {" ".join(dependents)};')
    return f'toplevel "{gates[-1]}"; {" ".join(reversed(text))}'
