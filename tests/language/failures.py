"""Fault trees by the failures themselves: a text of Galileo, an order of failures, and when the top fails.

Shares nothing with rvaft, so that the two can be compared. A basic event fails once, at the position at which the
order has it; a dependent event fails with its trigger, too. A gate fails at the first position at which its condition
holds. The inputs of `pand` fail from left to right, also at the same position (*inclusive*). A gate whose spares others
list, too, uses one of its inputs at a time: when that fails, it takes the first that is left, or fails.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from random import Random
from typing import NamedTuple

NEVER = 10**9
SPARES = ("wsp", "hsp", "csp", "spare")
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
    shared: dict[str, bool]
    """The gates that share spares, and whether these are cold: whether a failure counts only once it is taken."""


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
    shared: dict[str, bool] = {}
    dependents = {one for _, names in triggers for one in names}
    for name, gate in gates.items():
        cold = gate.word == "spare" and all(dormant.get(one, "") in ("0", "0.0") for one in gate.inputs[1:])
        others = [one for one in gates.values() if one is not gate and one.word in SPARES]
        if gate.word in SPARES and any(set(gate.inputs[1:]) & set(one.inputs) for one in others):
            below = [{*_leaves(gates, one)} for one in gate.inputs]
            free = sum(map(len, below)) == len(set().union(*below)) and not dependents & set().union(*below[1:])
            shared[name] = free and (cold or gate.word == "csp")
        elif cold or gate.word in ("csp", "seq"):
            enforced.append(gate.inputs)
    ordered = dict.fromkeys(_leaves(gates, top))
    return FaultTree(
        top,
        gates,
        triggers,
        enforced,
        [one for one in {**ordered, **names} if one not in gates and one not in dependencies],
        shared,
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
    uses = {name: tree.gates[name].inputs[0] for name in tree.shared}
    taken = dict.fromkeys(uses.values(), 0)
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
            for name, part in uses.items():
                if at[name] == NEVER and at[part] <= position and not (tree.shared[name] and at[part] < taken[part]):
                    spares = [one for one in tree.gates[name].inputs[1:] if one not in taken]
                    left = [one for one in spares if tree.shared[name] or at[one] > position]
                    failing = True
                    if left:
                        uses[name], taken[left[0]] = left[0], position
                    else:
                        at[name] = position
                    break
            for name, gate in tree.gates.items():
                if name not in uses and at[name] == NEVER and _holds(gate, [at[one] for one in gate.inputs]):
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


def random_spares(random: Random) -> str:
    """Return a random fault tree in which gates share one or two spares, some of them below other gates."""
    number, spares = random.choice([(2, 1), (3, 1), (4, 1), (2, 2), (2, 2), (3, 2), (2, 3)])
    word = random.choice(["wsp", "wsp", "csp", "spare"])
    text, gates = [], [f"g{place}" for place in range(number)]
    for place, gate in enumerate(gates):
        kept = [f"s{spare}" for spare in range(spares)]
        if random.random() < 0.3:
            kept = random.sample(kept, random.randint(1, spares))
        first = f"p{place}"
        if random.random() < 0.2 and number < 4:
            first = f"f{place}"
            text.append(f"{first} {random.choice(['and', 'pand', 'or'])} p{place} q{place};")
        text.append(f"{gate} {word} {first} {' '.join(kept)};")
    parts = random.sample(gates, random.randint(1, number))
    if random.random() < 0.3:
        parts.append(random.choice(["x", "p0", "s0"]))
    top = random.choice(["and", "or", f"vot{(len(parts) + 1) // 2}", "pand" if len(parts) > 1 else "or"])
    return f"toplevel top; top {top} {' '.join(parts)}; {' '.join(text)}"


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
