r"""Automata as text in the Hanoi Omega-Automata format, version 1.

Finite words are encoded as by Spot's `from_ltlf`: the proposition `alive` holds during the word and
never after it; a word is accepted if its continuation without `alive` is. Lower-case header lines,
which tools skip, define the propositions:

    event: 2 "{ event: \"a\" }"         proposition 2 holds at events of this pattern
    event: 3 "{ event: \"b\" }" "T1"    ... and binds the time of the event in nanoseconds, or null
    guard: 5 "X >= 5"                   ... if the guard holds or has an unbound variable
    relevant: 1                         ... at events of an `alphabet` and no `ignore` line
    alphabet: "{ event: \"a\" }"        a pattern, with a guard if there is one
    ignore: "{ v: V }" "V < 250"
    time: "ts as iso8601"               the time of an event
"""

import re
from collections.abc import Container, Iterator, Mapping
from hashlib import sha256
from itertools import count
from typing import Final, NamedTuple

from backends.automaton.determinise import DETECTED, HOPELESS, Automaton, StateRow
from backends.automaton.letters import FeasibleLetters, Relevance
from backends.automaton.structure import Structure
from rvaft.backend import Metrics
from rvaft.core.property import Property
from rvaft.core.times import untimed
from rvaft.model.event_time import EventTime
from rvaft.model.expressions import guard_text, pattern_text, time_text
from rvaft.model.verdict import Semantics
from rvaft.support.bits import bits, in_at_least, union
from rvaft.support.budget import Work
from rvaft.support.terminal import visible

ALIVE: Final = "alive"
RELEVANT: Final = "relevant"

_TAKEN: Final = re.compile(r"alive|relevant|guard_\d+|true|false|and|or|xor|not|last|first|[FGXUWRMV]", re.IGNORECASE)
_TOKEN: Final = re.compile(r"State:|@?\w+|[^\s\w]")


def atom_name(node: str) -> str:
    """Return the proposition name for a node's event: the node name, with other characters escaped.

    An escape is `_x`, the hexadecimal code point and `_`. A `_` before an `x` and the first
    character of a reserved word are escaped too.

    >>> atom_name("land"), atom_name("or"), atom_name("lost link")
    ('land', '_x6f_r', 'lost_x20_link')
    """
    if _TAKEN.fullmatch(node):
        return f"_x{ord(node[0]):x}_{node[1:]}"
    return re.sub(r"^\d|[^A-Za-z0-9_]|_(?=x)", lambda found: f"_x{ord(found[0]):x}_", node) or "_x_"


def title_of(prop: Property, semantics: Semantics) -> str:
    """Return the name of an automaton: root, branch or kind, and semantics."""
    chosen = [f"branch {prop.branch}"] if prop.branch is not None else []
    chosen += [prop.kind.value] if prop.kind is not None else []
    return ", ".join([prop.tree.root, *chosen, semantics])


class Cube(NamedTuple):
    """A conjunction of propositions: `yes` hold, `no` do not. A label is a disjunction of cubes."""

    yes: int
    no: int


def cubes(row: StateRow, work: Work) -> dict[int, list[Cube]]:
    """Return per successor of a state its cubes, short and disjoint from those of other successors.

    A cube negates only propositions that distinguish letters with another target.
    """
    work.step(10 * len(row.targets))
    own: dict[int, int] = {}
    for letter, target in row.targets.items():
        own[target] = own.get(target, 0) | letter
    everywhere, repeated = union(own.values()), in_at_least(2, own.values())
    elsewhere = {target: everywhere & ~mine | repeated for target, mine in own.items()}
    found: dict[int, list[Cube]] = {}
    for letter, target in row.targets.items():
        seen = row.sees | row.asks[letter & row.sees]
        found.setdefault(target, []).append(Cube(letter, elsewhere[target] & seen & ~letter))
    return {target: _needed(alternatives, work) for target, alternatives in found.items()}


def _needed(alternatives: list[Cube], work: Work) -> list[Cube]:
    ordered: list[Cube] = []
    kept: dict[int, list[Cube]] = {}
    for one in sorted(dict.fromkeys(alternatives), key=lambda cube: cube.yes.bit_count()):
        firsts = (0, *(1 << proposition for proposition in bits(one.yes)))
        near = [kept[first] for first in firsts if first in kept]
        work.step(sum(map(len, near)))
        without = ~one.yes, ~one.no
        if not any(not (yes & without[0] or no & without[1]) for some in near for yes, no in some):
            kept.setdefault(one.yes & -one.yes, []).append(one)
            ordered.append(one)
    return ordered


def write(
    automaton: Automaton,
    structure: Structure,
    letters: FeasibleLetters,
    *,
    name: str,
    time: EventTime | None,
    relevance: Relevance | None,
    work: Work,
) -> tuple[str, Metrics]:
    """Return the text of an automaton and its metrics; `relevance` adds self-loops on irrelevant
    events.

    Header aliases express the mutual exclusion of atoms, so that an edge names only atoms that
    hold.
    """
    order = automaton.in_order()
    number = {state: index for index, state in enumerate(order)}
    edges = {state: cubes(automaton.rows[state], work) for state in order if state not in (DETECTED, HOPELESS)}
    used = [cube for leaving in edges.values() for alternatives in leaving.values() for cube in alternatives]
    always = ["0"] if relevance is None else ["0", "1"]  # propositions that hold on all these edges
    present = union((*(cube.yes | cube.no for cube in used), *(automaton.rows[state].misses for state in edges)))
    numbers = {proposition: index for index, proposition in enumerate(bits(present), len(always))}
    atoms = (1 << len(structure.patterns)) - 1
    rivals: dict[int, int] = {}  # per atom, the incompatible atoms that some cube negates beside it
    for cube in used:
        excluded = cube.no & atoms
        for atom in bits(cube.yes & atoms):
            if apart := excluded & ~letters.together(atom, excluded):
                rivals[atom] = rivals.get(atom, 0) | apart

    def words(propositions: int, sign: str = "") -> list[str]:
        work.step(propositions.bit_count())
        return [f"{sign}{numbers[proposition]}" for proposition in bits(propositions)]

    def label(cube: Cube) -> str:
        positive = list(bits(cube.yes & atoms))
        aliased = [atom for atom in positive if atom in rivals]
        excluded = cube.no & atoms & ~union(rivals[atom] for atom in aliased)
        literals = [f"@{numbers[atom]}" if atom in rivals else f"{numbers[atom]}" for atom in positive]
        guards = [*words(cube.yes & ~atoms), *words(cube.no & ~atoms, "!")]
        return "&".join([*(() if aliased else always), *literals, *words(excluded, "!"), *guards])

    body: list[str] = []
    length = 0
    for state in order:
        work.size(length)
        body.append(f"State: {number[state]}")
        written = {
            target: [label(cube) for cube in alternatives] for target, alternatives in edges.get(state, {}).items()
        }
        if state not in edges:
            written = {state: ["0"]}
        elif relevance is not None:
            misses, skips = automaton.rows[state].misses, automaton.rows[state].skips
            for coming, target in {0: state, **skips}.items():
                skipping = "&".join(["0&!1", *words(coming), *words(misses & ~coming, "!")])
                written[target] = [skipping, *written.get(target, [])]
        body += [f"[{' | '.join(alternatives)}] {number[target]}" for target, alternatives in written.items()]
        length += sum(map(len, body[-len(written) :]))
        if state == DETECTED:
            body.append(f"[!0] {len(order)}")
    if DETECTED in number:
        body += [f"State: {len(order)} {{0}}", f"[!0] {len(order)}"]
    states = len(order) + (DETECTED in number)
    header = [
        f"States: {states}",
        "Start: 0",
        *_propositions(structure, numbers, relevance),
        *([] if time is None else [f"time: {_hoa_string(time_text(time).removeprefix('time '))}"]),
        "acc-name: Buchi",
        "Acceptance: 1 Inf(0)",
        "properties: trans-labels explicit-labels state-acc deterministic",
    ]
    for atom, excluded in sorted(rivals.items()):
        alias = [*always, str(numbers[atom]), *words(excluded, "!")]
        header.append(f"Alias: @{numbers[atom]} {'&'.join(alias)}")
    text = "\n".join([*header, "--BODY--", *body, "--END--", ""])
    text = f'HOA: v1\nname: {_hoa_string(visible(name))}\ntool: "rvaft" "{checksum(text)}"\n{text}'
    symbols = sum(len(_TOKEN.findall(line)) for line in body)
    return text, Metrics(symbols, states=states, edges=sum(line.startswith("[") for line in body))


def checksum(text: str) -> str:
    """Return the checksum in the line `tool` of the text after it, which shows whether this is unchanged."""
    return sha256(text.encode("utf-8", "surrogatepass")).hexdigest()[:16]


def _propositions(structure: Structure, numbers: Mapping[int, int], relevance: Relevance | None) -> Iterator[str]:
    atoms = len(structure.patterns)
    names = [ALIVE] if relevance is None else [ALIVE, RELEVANT]
    meanings, taken = [], set(names)
    for proposition, number in numbers.items():
        if proposition < atoms:
            pattern, time = untimed(structure.patterns[proposition])
            names.append(_fresh(atom_name(structure.names[proposition]), taken))
            taken.add(names[-1])
            meanings.append(
                f"event: {number} {_hoa_string(pattern_text(pattern))}" + (f" {_hoa_string(time)}" if time else "")
            )
        else:
            names.append(f"guard_{number}")
            meanings.append(f"guard: {number} {_hoa_string(guard_text(structure.guards[proposition - atoms]))}")
    yield f"AP: {len(names)} " + " ".join(map(_hoa_string, names))
    yield from meanings
    if relevance is not None:
        yield "relevant: 1"
        for word, fits in (("alphabet", relevance.alphabet), ("ignore", relevance.ignored)):
            for pattern, guard in fits:
                condition = "" if guard is None else f" {_hoa_string(guard_text(guard))}"
                yield f"{word}: {_hoa_string(pattern_text(pattern))}{condition}"


def _fresh(wanted: str, taken: Container[str]) -> str:
    return next(name for number in count(1) if (name := wanted if number == 1 else f"{wanted}_x_{number}") not in taken)


def _hoa_string(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"').replace("\0", "\ufffd")  # no tool reads a zero byte
    return f'"{escaped}"'
