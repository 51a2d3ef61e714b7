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
from typing import Final, NamedTuple

from backends.automaton.determinise import DETECTED, HOPELESS, Automaton, StateRow
from backends.automaton.letters import FeasibleLetters, Relevance
from backends.automaton.structure import Structure, Work
from rvaft.backend import Metrics
from rvaft.model.expressions import guard_text, pattern_text
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics
from rvaft.support.bits import bits, union

ALIVE: Final = "alive"
RELEVANT: Final = "relevant"

_TAKEN: Final = re.compile(r"alive|relevant|guard_\d+|true|false|and|or|xor|not|last|first|[FGXUWRMV]", re.IGNORECASE)


def atom_name(node: str) -> str:
    """The name of the proposition for a node's event: the node's own where that is a word with no other meaning.

    Otherwise the characters in the way are written as `_x` and their number in hexadecimal, and a `_`; so is a `_` that an `x`
    follows, which keeps different names different.

    >>> atom_name("land"), atom_name("or"), atom_name("lost link")
    ('land', '_x6f_r', 'lost_x20_link')
    """
    if _TAKEN.fullmatch(node):
        return f"_x{ord(node[0]):x}_{node[1:]}"
    return re.sub(r"^\d|[^A-Za-z0-9_]|_(?=x)", lambda found: f"_x{ord(found[0]):x}_", node) or "_x_"


def title_of(tree: RVAFT, semantics: Semantics) -> str:
    """The name of an automaton: the root, the part of the tree that is watched, the semantics."""
    if (part := tree.part_of) is None:
        return f"{tree.root}, {semantics}"
    chosen = [f"branch {part.branch}"] if part.branch is not None else []
    chosen += [part.kind.value] if part.kind is not None else []
    return ", ".join([part.tree.root, *chosen, semantics])


class Cube(NamedTuple):
    """Propositions that hold and that do not: an alternative of a label."""

    yes: int
    no: int

    def covers(self, other: "Cube") -> bool:
        """Whether every letter of the other is one of this."""
        return not (self.yes & ~other.yes or self.no & ~other.no)


def cubes(row: StateRow) -> dict[int, list[Cube]]:
    """For each target of a state what leads there: short, and disjoint from what leads to the others.

    A letter needs to say `not` only of the propositions by which letters with another target differ.
    """
    elsewhere = _elsewhere(row)
    found: dict[int, list[Cube]] = {}
    for letter, target in row.targets.items():
        seen = row.sees | row.asks[letter & row.sees]
        found.setdefault(target, []).append(Cube(letter, elsewhere[target] & seen & ~letter))
    return {target: _needed(those) for target, those in found.items()}


def _elsewhere(row: StateRow) -> dict[int, int]:
    """For each target the propositions in letters that lead to another one."""
    own: dict[int, int] = {}
    for letter, target in row.targets.items():
        own[target] = own.get(target, 0) | letter
    elsewhere = dict.fromkeys(own, 0)
    for order in (list(own), list(own)[::-1]):
        before = 0
        for target in order:
            elsewhere[target] |= before
            before |= own[target]
    return elsewhere


def _needed(those: list[Cube]) -> list[Cube]:
    """Without cubes that another one covers, which holds no proposition that they do not: found by its first one."""
    ordered: list[Cube] = []
    kept: dict[int, list[Cube]] = {}
    for one in sorted(dict.fromkeys(those), key=lambda cube: cube.yes.bit_count()):
        firsts = (0, *(1 << proposition for proposition in bits(one.yes)))
        if not any(other.covers(one) for first in firsts for other in kept.get(first, ())):
            kept.setdefault(one.yes & -one.yes, []).append(one)
            ordered.append(one)
    return ordered


_TOKEN: Final = re.compile(r"State:|@?\w+|[^\s\w]")


def write(
    automaton: Automaton,
    structure: Structure,
    letters: FeasibleLetters,
    *,
    name: str,
    relevance: Relevance | None,
    work: Work,
) -> tuple[str, Metrics]:
    """The text of an automaton, and its sizes; with `relevance` events that are not relevant change nothing.

    Atoms that never hold together and yet tell targets apart exclude each other in an alias of the header, so that an edge names
    just the atoms that hold.
    """
    order = automaton.in_order()
    number = {state: index for index, state in enumerate(order)}
    edges = [{state: [Cube(0, 0)]} if state in _FINAL else cubes(automaton.rows[state]) for state in order]
    labels = _Labels(edges, letters, len(structure.patterns), work, relevant=relevance is not None)
    body = []
    for state, leaving in zip(order, edges, strict=True):
        body.append(f"State: {number[state]}")
        if state in _FINAL:
            body.append(f"[0] {number[state]}")
        else:
            written = {target: [labels.of(cube) for cube in those] for target, those in leaving.items()}
            if relevance is not None:
                written[state] = ["0&!1", *written.get(state, [])]
            body += [f"[{' | '.join(those)}] {number[target]}" for target, those in written.items()]
        if state == DETECTED:
            body.append(f"[!0] {len(order)}")
    states = len(order) + (DETECTED in number)
    if DETECTED in number:
        body += [f"State: {len(order)} {{0}}", f"[!0] {len(order)}"]
    header = [
        "HOA: v1",
        f"name: {_quoted(name)}",
        'tool: "rvaft"',
        f"States: {states}",
        "Start: 0",
        *_propositions(structure, labels.numbers, relevance),
        "acc-name: Buchi",
        "Acceptance: 1 Inf(0)",
        "properties: trans-labels explicit-labels state-acc deterministic",
        *labels.aliases(),
    ]
    text = "\n".join([*header, "--BODY--", *body, "--END--", ""])
    symbols = sum(len(_TOKEN.findall(line)) for line in body)
    return text, Metrics(symbols, states=states, edges=sum(line.startswith("[") for line in body))


_FINAL: Final = (DETECTED, HOPELESS)


class _Labels:
    """Writes cubes over the numbers that the used propositions have in the text; what `always` says holds on all these edges."""

    def __init__(
        self,
        edges: Sequence[Mapping[int, list[Cube]]],
        letters: FeasibleLetters,
        atoms: int,
        work: Work,
        *,
        relevant: bool,
    ) -> None:
        self.always = ["0", "1"] if relevant else ["0"]
        used = [cube for leaving in edges for those in leaving.values() for cube in those]
        self.numbers = {
            proposition: index
            for index, proposition in enumerate(bits(union(cube.yes | cube.no for cube in used)), len(self.always))
        }
        self._atoms = (1 << atoms) - 1
        self._work = work
        self._rivals: dict[
            int, int
        ] = {}  # for each atom those that never hold with it and that some letter with it excludes
        for cube in used:
            excluded = cube.no & self._atoms
            for atom in bits(cube.yes & self._atoms):
                if apart := excluded & ~letters.together(atom, excluded):
                    self._rivals[atom] = self._rivals.get(atom, 0) | apart

    def aliases(self) -> Iterator[str]:
        """The definitions that labels refer to."""
        for atom, excluded in sorted(self._rivals.items()):
            number = self.numbers[atom]
            yield f"Alias: @{number} " + "&".join([*self.always, str(number), *self._words(excluded, "!")])

    def of(self, cube: Cube) -> str:
        """One cube."""
        aliased = [atom for atom in bits(cube.yes & self._atoms) if atom in self._rivals]
        said = union(self._rivals[atom] for atom in aliased)
        words = [] if aliased else [*self.always]
        words += [f"{'@' * (atom in self._rivals)}{self.numbers[atom]}" for atom in bits(cube.yes & self._atoms)]
        words += self._words(cube.no & self._atoms & ~said, "!")
        words += [*self._words(cube.yes & ~self._atoms), *self._words(cube.no & ~self._atoms, "!")]
        return "&".join(words)

    def _words(self, propositions: int, sign: str = "") -> list[str]:
        self._work.step(propositions.bit_count())
        return [f"{sign}{self.numbers[proposition]}" for proposition in bits(propositions)]


def _propositions(structure: Structure, numbers: Mapping[int, int], relevance: Relevance | None) -> Iterator[str]:
    """The lines that name the propositions, and say what they mean."""
    atoms = len(structure.patterns)
    names = [ALIVE] if relevance is None else [ALIVE, RELEVANT]
    meanings = []
    for proposition, number in numbers.items():
        if proposition < atoms:
            names.append(atom_name(structure.names[proposition]))
            meanings.append(f"event: {number} {_quoted(pattern_text(structure.patterns[proposition]))}")
        else:
            names.append(f"guard_{number}")
            meanings.append(f"guard: {number} {_quoted(guard_text(structure.guards[proposition - atoms]))}")
    yield f"AP: {len(names)} " + " ".join(map(_quoted, names))
    yield from meanings
    if relevance is not None:
        yield "relevant: 1"
        for word, fits in (("alphabet", relevance.alphabet), ("ignore", relevance.ignored)):
            for pattern, guard in fits:
                asked = "" if guard is None else f" {_quoted(guard_text(guard))}"
                yield f"{word}: {_quoted(pattern_text(pattern))}{asked}"


def _quoted(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'
