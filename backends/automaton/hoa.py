r"""The automaton as text in the Hanoi Omega-Automata format, version 1.

A finite word is encoded as Spot's `from_ltlf` does: the proposition `alive` holds as long as the word lasts and never after, and a
word is accepted when the word that goes on without `alive` is. Lower-case header lines, which tools skip, say what the
propositions mean:

    event: 2 "{ event: \"a\" }"         proposition 2 holds at events of this pattern
    guard: 5 "X >= 5"                   ... where this guard holds, or a variable of it has no value yet
    relevant: 1                         ... that one of the next lines fits and no `ignore` line
    alphabet: "{ event: \"a\" }"        an event's pattern, and where it has one the guard on it
    ignore: "{ v: V }" "V < 250"
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from backends.automaton.labels import Cube, Writer, cubes, rivals
from backends.automaton.letters import Letters, bits
from backends.automaton.names import ALIVE, RELEVANT, atom_name, guard_name
from backends.automaton.structure import Structure
from backends.automaton.subsets import DETECTED, HOPELESS, Automaton
from rvaft.guards import Guard
from rvaft.language import guard_text, pattern_text
from rvaft.patterns import Pattern

_TOKEN: Final = re.compile(r"State:|@?\w+|[^\s\w]")


@dataclass(frozen=True, slots=True)
class Relevance:
    """The lines that decide whether an event is relevant: patterns with guards."""

    alphabet: tuple[tuple[Pattern, Guard | None], ...]
    ignored: tuple[tuple[Pattern, Guard | None], ...]


@dataclass(frozen=True, slots=True)
class Text:
    """The text, and what there is to count in it."""

    text: str
    states: int
    edges: int
    symbols: int


def write(
    automaton: Automaton, structure: Structure, letters: Letters, *, name: str, relevance: Relevance | None
) -> Text:
    """The text of an automaton; with `relevance` events that are not relevant change nothing."""
    order = in_order(automaton)
    number = {state: index for index, state in enumerate(order)}
    edges = [_edges(automaton, state) for state in order]
    writer = _writer(edges, letters, relevant=relevance is not None)
    body = []
    for state, leaving in zip(order, edges, strict=True):
        body.append(f"State: {number[state]}")
        body += _lines(state, leaving, writer, number, relevance is not None)
        if state == DETECTED:
            body.append(f"[!0] {len(order)}")
    final = DETECTED in number
    if final:
        body += [f"State: {len(order)} {{0}}", f"[!0] {len(order)}"]
    header = [
        "HOA: v1",
        f"name: {_quoted(name)}",
        'tool: "rvaft"',
        f"States: {len(order) + final}",
        "Start: 0",
        *_propositions(structure, writer, relevance),
        "acc-name: Buchi",
        "Acceptance: 1 Inf(0)",
        "properties: trans-labels explicit-labels state-acc deterministic",
        *writer.aliases(),
    ]
    text = "\n".join([*header, "--BODY--", *body, "--END--", ""])
    count = sum(line.startswith("[") for line in body)
    symbols = sum(len(_TOKEN.findall(line)) for line in body)
    return Text(text, len(order) + final, count, symbols)


def in_order(automaton: Automaton) -> list[int]:
    """The reachable states in the order of their numbers in the text."""
    order = [automaton.start]
    seen = set(order)
    for state in order:
        for target in automaton.rows[state].targets.values():
            if target not in seen:
                seen.add(target)
                order.append(target)
    return order


def _edges(automaton: Automaton, state: int) -> dict[int, list[Cube]]:
    return {state: [Cube(0, 0)]} if state in (DETECTED, HOPELESS) else cubes(automaton.rows[state])


def _writer(edges: Sequence[dict[int, list[Cube]]], letters: Letters, *, relevant: bool) -> Writer:
    atoms = guards = 0
    for leaving in edges:
        for those in leaving.values():
            for cube in those:
                atoms |= cube.atoms | cube.no_atoms
                guards |= cube.guards | cube.no_guards
    always = (0, 1) if relevant else (0,)
    first = len(always)
    atom_numbers = {atom: first + index for index, atom in enumerate(bits(atoms))}
    first += len(atom_numbers)
    guard_numbers = {guard: first + index for index, guard in enumerate(bits(guards))}
    return Writer(always, atom_numbers, guard_numbers, rivals(edges, letters))


def _lines(
    state: int, leaving: dict[int, list[Cube]], writer: Writer, number: dict[int, int], relevant: bool
) -> Iterator[str]:
    """The edges of one state while the word lasts."""
    if state in (DETECTED, HOPELESS):
        yield f"[0] {number[state]}"
        return
    loops = ["0&!1"] if relevant else []
    labels = {target: [writer.label(cube) for cube in those] for target, those in leaving.items()}
    if loops:
        labels[state] = [*loops, *labels.get(state, [])]
    for target, those in labels.items():
        yield f"[{' | '.join(those)}] {number[target]}"


def _propositions(structure: Structure, writer: Writer, relevance: Relevance | None) -> Iterator[str]:
    names = [ALIVE] if relevance is None else [ALIVE, RELEVANT]
    names += [atom_name(structure.names[atom]) for atom in writer.atoms]
    names += [guard_name(number) for number in writer.guards.values()]
    yield f"AP: {len(names)} " + " ".join(_quoted(name) for name in names)
    for atom, number in writer.atoms.items():
        yield f"event: {number} {_quoted(pattern_text(structure.patterns[atom]))}"
    for guard, number in writer.guards.items():
        yield f"guard: {number} {_quoted(guard_text(structure.guards[guard]))}"
    if relevance is not None:
        yield "relevant: 1"
        yield from _deciding("alphabet", relevance.alphabet)
        yield from _deciding("ignore", relevance.ignored)


def _deciding(word: str, lines: Sequence[tuple[Pattern, Guard | None]]) -> Iterator[str]:
    for pattern, guard in lines:
        yield f"{word}: {_quoted(pattern_text(pattern))}" + ("" if guard is None else f" {_quoted(guard_text(guard))}")


def _quoted(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'
