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
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from backends.automaton.determinise import DETECTED, HOPELESS, Automaton, Row
from backends.automaton.letters import Letters, bits
from backends.automaton.structure import Structure
from rvaft.model.expressions import guard_text, pattern_text
from rvaft.model.guards import Guard
from rvaft.model.patterns import Pattern
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics

# Names of atomic propositions, words that every tool reads and different for different nodes, and of automata.

ALIVE: Final = "alive"
RELEVANT: Final = "relevant"

_PLAIN: Final = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_TAKEN: Final = re.compile(r"alive|relevant|guard_\d+|true|false|and|or|xor|not|last|first|[FGXUWRMV]", re.IGNORECASE)


def guard_name(number: int) -> str:
    """The name of the proposition of a guard."""
    return f"guard_{number}"


def atom_name(node: str) -> str:
    """The name of the proposition for a node's event: the node's own where that is a word with no other meaning.

    Otherwise the characters in the way are written as `_x` and their number in hexadecimal, and a `_`; so is a `_` that an `x`
    follows, which keeps different names different.
    """
    if _PLAIN.fullmatch(node) and not _TAKEN.fullmatch(node) and "_x" not in node:
        return node
    if _TAKEN.fullmatch(node):
        return _code(node[0]) + node[1:]
    written = [_written(node, index) for index in range(len(node))]
    return "".join(written) or "_x_"


def _written(node: str, index: int) -> str:
    character = node[index]
    letter = character.isascii() and (character.isalpha() or character == "_" or (character.isdigit() and index > 0))
    return character if letter and node[index : index + 2] != "_x" else _code(character)


def _code(character: str) -> str:
    return f"_x{ord(character):x}_"


def title_of(tree: RVAFT, semantics: Semantics) -> str:
    """The name of an automaton: the root, the part of the tree that is watched, the semantics."""
    if (part := tree.part_of) is None:
        return f"{tree.root}, {semantics}"
    chosen = [f"branch {part.branch}"] if part.branch is not None else []
    chosen += [part.kind.value] if part.kind is not None else []
    return ", ".join([part.tree.root, *chosen, semantics])


# The labels of the edges of one state, short and pairwise disjoint.
#
# A letter needs to say `not` only of the atoms by which letters with another target differ. Atoms that never hold together and yet
# tell targets apart exclude each other in an alias of the header, so that an edge names just the atoms that hold.


@dataclass(frozen=True, slots=True)
class Cube:
    """Atoms and guards that hold and that do not."""

    atoms: int
    no_atoms: int
    guards: int = 0
    no_guards: int = 0

    def covers(self, other: "Cube") -> bool:
        """Whether every letter of the other is one of this."""
        return not (
            self.atoms & ~other.atoms
            or self.no_atoms & ~other.no_atoms
            or self.guards & ~other.guards
            or self.no_guards & ~other.no_guards
        )


def cubes(row: Row) -> dict[int, list[Cube]]:
    """For each target what leads there."""
    seen_elsewhere = _elsewhere(row)
    found: dict[int, list[Cube]] = {}
    for (atoms, holding), target in row.targets.items():
        other_atoms, other_guards = seen_elsewhere[target]
        matter = row.guards[atoms]
        cube = Cube(atoms, other_atoms & ~atoms, holding, other_guards & matter & ~holding)
        found.setdefault(target, []).append(cube)
    return {target: _needed(those) for target, those in found.items()}


def _elsewhere(row: Row) -> dict[int, tuple[int, int]]:
    """For each target the atoms and guards of letters that lead to another one."""
    own: dict[int, tuple[int, int]] = {}
    first: dict[int, tuple[int, int]] = {}
    for (atoms, holding), target in row.targets.items():
        before = own.get(target, (0, 0))
        own[target] = (before[0] | atoms, before[1] | holding)
    targets = list(own)
    for order in (targets, targets[::-1]):
        atoms = guards = 0
        for target in order:
            kept = first.get(target, (0, 0))
            first[target] = (kept[0] | atoms, kept[1] | guards)
            atoms |= own[target][0]
            guards |= own[target][1]
    return first


def _needed(those: list[Cube]) -> list[Cube]:
    """Without cubes that another one covers; a cube has at least the atoms and guards of one that covers it."""
    if len(those) == 1:
        return those
    kept: list[Cube] = []
    for one in sorted(dict.fromkeys(those), key=lambda cube: cube.atoms.bit_count() + cube.guards.bit_count()):
        if not any(other.covers(one) for other in kept):
            kept.append(one)
    return kept


def rivals(states: Sequence[Mapping[int, list[Cube]]], letters: Letters) -> dict[int, int]:
    """For each atom those that never hold with it and that some letter with it excludes."""
    found: dict[int, int] = {}
    for state in states:
        for those in state.values():
            for cube in those:
                for atom in bits(cube.atoms):
                    found[atom] = found.get(atom, 0) | cube.no_atoms & ~letters.together(atom, cube.no_atoms)
    return {atom: excluded for atom, excluded in found.items() if excluded}


@dataclass(frozen=True, slots=True)
class Writer:
    """Writes cubes over the numbers of propositions; `always` holds on every edge it writes."""

    always: tuple[int, ...]
    atoms: Mapping[int, int]
    guards: Mapping[int, int]
    rivals: Mapping[int, int]

    def aliases(self) -> list[str]:
        """The definitions that labels refer to."""
        return [
            f"Alias: @{self.atoms[atom]} " + "&".join(self._alias(atom, excluded))
            for atom, excluded in sorted(self.rivals.items())
        ]

    def _alias(self, atom: int, excluded: int) -> list[str]:
        return [*map(str, self.always), str(self.atoms[atom]), *(f"!{self.atoms[other]}" for other in bits(excluded))]

    def label(self, cube: Cube) -> str:
        """One cube."""
        aliased = [atom for atom in bits(cube.atoms) if atom in self.rivals]
        said = 0
        for atom in aliased:
            said |= self.rivals[atom]
        words = [] if aliased else [str(number) for number in self.always]
        words += [f"@{self.atoms[atom]}" if atom in self.rivals else str(self.atoms[atom]) for atom in bits(cube.atoms)]
        words += [f"!{self.atoms[atom]}" for atom in bits(cube.no_atoms & ~said)]
        words += [str(self.guards[guard]) for guard in bits(cube.guards)]
        words += [f"!{self.guards[guard]}" for guard in bits(cube.no_guards)]
        return "&".join(words)


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
