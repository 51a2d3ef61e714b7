"""The transitions of an automaton as a list, read from its HOA text."""

import re
from collections.abc import Iterator, Mapping, Set
from typing import Final

from backends.automaton.hoa_writer import ALIVE

_ALIAS: Final = re.compile(r"^Alias: (@\w+) (.*)$", re.MULTILINE)
_NAMES: Final = re.compile(r"^AP: \d+ (.*)$", re.MULTILINE)
_STATE: Final = re.compile(r"^State: (\d+).*\n((?:\[.*\n)*)", re.MULTILINE)
_EDGE: Final = re.compile(r"^\[(.*)\] (\d+)", re.MULTILINE)
_DETECTED: Final = "⊤"


def transitions(text: str) -> list[str]:
    """Return the transitions per state, as `0: a → 2` and `2: b, c → ⊤`; each event is one
    proposition.

    ⊤ is the detecting state. Transitions to states that cannot reach it, and the end of a trace,
    are left out.
    """
    names = re.findall(r'"(.*?)"', _NAMES.findall(text)[0])
    alive = names.index(ALIVE)
    edges: dict[str, dict[str, str]] = {}
    detected: set[str] = set()
    for state, body in _STATE.findall(text):
        labels = [(_expanded(label, text), target) for label, target in _EDGE.findall(body)]
        if any(_holds(label, set()) for label, _ in labels):  # only a detecting state may see the end
            detected.add(state)
        edges[state] = {
            name: target
            for number, name in enumerate(names)
            for label, target in labels
            if number != alive and _holds(label, {alive, number})
        }
    return [
        f"{state}: {', '.join(_grouped(leaving, edges, detected))}"
        for state, leaving in edges.items()
        if state not in detected and not _hopeless(state, leaving)
    ]


def _grouped(leaving: Mapping[str, str], edges: Mapping[str, Mapping[str, str]], detected: Set[str]) -> Iterator[str]:
    """Yield `b, c → 5` for each target that can reach a detection."""
    for target in dict.fromkeys(leaving.values()):
        if not _hopeless(target, edges[target]) or target in detected:
            events = ", ".join(event for event, one in leaving.items() if one == target)
            yield f"{events} → {_DETECTED if target in detected else target}"


def _hopeless(state: str, leaving: Mapping[str, str]) -> bool:
    return set(leaving.values()) <= {state}


def _expanded(label: str, text: str) -> str:
    for alias, meaning in _ALIAS.findall(text):
        label = re.sub(rf"{re.escape(alias)}\b", meaning, label)
    return label


def _holds(label: str, propositions: Set[int]) -> bool:
    """Return whether a disjunction of conjunctions of literals holds for exactly these
    propositions.
    """
    return any(
        all((int(literal.strip(" !")) in propositions) != ("!" in literal) for literal in term.split("&"))
        for term in label.split("|")
    )
