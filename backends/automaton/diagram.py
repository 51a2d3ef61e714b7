"""The minimal automaton as a graph for Graphviz, for people: edges say events and guards.

A label has its alternatives one below the other, what goes on from the line before is indented; `a, b` is one event that is both, and
all guards in brackets hold with it. Where an event that is on no other edge of the state leads is `else`. ⊤ has detected, from ⊥
nothing can be. States have their numbers in the HOA text; those that no events lead to, and what no event does, are not drawn. Under
`projected` the letters are the relevant events.
"""

from collections import deque
from collections.abc import Iterable, Mapping
from typing import Final

from backends.automaton.determinise import DETECTED, HOPELESS, Automaton, StateRow
from backends.automaton.hoa_writer import Cube, cubes, title_of
from backends.automaton.letters import FeasibleLetters
from backends.automaton.structure import Structure
from rvaft.errors import TooLarge
from rvaft.export.dot import html, html_lines, table, title
from rvaft.export.layout import wrapped_code
from rvaft.model.expressions import guard_text, name_text, on_text
from rvaft.model.guards import variables
from rvaft.model.patterns import rigid_variables
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics
from rvaft.support.bits import bits, mask_of

READABLE: Final = 100
"""The most states that are drawn unless more are asked for; with more than that nobody follows an edge."""
EDGES: Final = 10
"""How many edges, and how many lines in all labels, each state of the limit allows."""
BEFORE: Final = 100
"""How many states there may be before the automaton is minimal, for each state of the limit."""
_WIDTH: Final = 24
"""Columns of text in a label."""
_NEXT: Final = '<br align="left"/>'
_QUIET: Final = "#8a8a8a"
"""What leads to ⊥ is there, but does not catch the eye."""


def diagram(
    automaton: Automaton,
    structure: Structure,
    letters: FeasibleLetters,
    *,
    tree: RVAFT,
    semantics: Semantics,
    limit: int,
) -> str:
    """The graph; raises `TooLarge` beyond `limit` states, or `EDGES` lines of labels for each of them."""
    number = {state: index for index, state in enumerate(automaton.in_order())}
    automaton = possible(automaton, structure)
    order = automaton.in_order()
    if len(order) > limit:
        raise TooLarge(f"{len(order)} states are too many to draw", limit=limit)
    words = _Words(structure, letters, tree)
    lines: list[str] = []
    written = 0
    for state in order:
        if state not in (DETECTED, HOPELESS):
            for target, label in words.edges(automaton.rows[state]).items():
                written += len(label)
                lines.append(_edge(number[state], number[target], label, quiet=target == HOPELESS))
    if written > EDGES * limit:
        raise TooLarge(f"{written} labels are too many to draw, {EDGES} allowed for each state", limit=limit)
    return "\n".join(
        [
            f"digraph {title(title_of(tree, semantics))} {{",
            '  graph [margin=0, ranksep=0.25, nodesep=0.15, charset="UTF-8"];',
            '  node [fontname="Helvetica", fontsize=10, shape=circle, margin="0.03", width=0.3, height=0.3];',
            '  edge [fontname="Helvetica", fontsize=10, arrowsize=0.6];',
            '  start [shape=point, style=invis, width=0, height=0, label=""];',
            *(f"  {_state(state, number[state])}" for state in order),
            f"  start -> s{number[automaton.start]};",
            *(f"  {line}" for line in lines),
            f"  label=<{_caption(tree, semantics, guarded=words.guarded)}>;",
            '  labelloc=b; labeljust=l; fontname="Helvetica"; fontsize=10;',
            "}",
            "",
        ]
    )


def _state(state: int, number: int) -> str:
    if state == DETECTED:
        return f"s{number} [label=<⊤>, shape=doublecircle];"
    if state == HOPELESS:
        return f's{number} [label=<⊥>, style=filled, fillcolor="#e4e4e4", color="{_QUIET}"];'
    return f"s{number} [label=<{number}>];"


def _edge(source: int, target: int, label: list[str], *, quiet: bool) -> str:
    look = f', color="{_QUIET}", fontcolor="{_QUIET}", style=dashed' if quiet else ""
    return f"s{source} -> s{target} [label=<{_label(label)}>{look}];"


def _label(alternatives: list[str]) -> str:
    """On white, which covers the lines that pass."""
    return table(alternatives, space=2, cell='align="left" bgcolor="white"')


def _caption(tree: RVAFT, semantics: Semantics, *, guarded: bool) -> str:
    lines = [title_of(tree, semantics)]
    if semantics is Semantics.PROJECTED:
        lines.append("Events that are not relevant change nothing.")
    if guarded:
        lines.append("A guard holds as long as one of its variables has no value.")
    return table(html(line, 3 * _WIDTH) for line in lines)


class _Words:
    """Writes the edges of one automaton."""

    def __init__(self, structure: Structure, letters: FeasibleLetters, tree: RVAFT) -> None:
        self._letters = letters
        self._atoms = (1 << len(structure.patterns)) - 1
        self.guarded = bool(structure.guards)
        self._events = [_event(tree, name) for name in structure.names]
        self._guards = dict(enumerate(map(guard_text, structure.guards), len(structure.names)))

    def edges(self, row: StateRow) -> Mapping[int, list[str]]:
        """For each target of a state the lines of the label."""
        leaving = cubes(row)
        if len(leaving) == 1:
            return {target: ["any event"] for target in leaving}
        rest = row.targets.get(0)
        written = {
            target: [self._cube(cube) for cube in joined(those, self._atoms)]
            for target, those in leaving.items()
            if target != rest
        }
        return written if rest is None else {**written, rest: ["else"]}

    def _cube(self, cube: Cube) -> str:
        excluded = cube.no & self._atoms
        for atom in bits(cube.yes & self._atoms):  # what never holds with it goes without saying
            excluded &= self._letters.together(atom, excluded)
        words = [self._events[atom] for atom in bits(cube.yes & self._atoms)]
        words += [f"not {self._events[atom]}" for atom in bits(excluded)]
        conditions = [self._guards[guard] for guard in bits(cube.yes & ~self._atoms)]
        conditions += [f"not ({self._guards[guard]})" for guard in bits(cube.no & ~self._atoms)]
        events = _hanging(", ".join(words)) if words else ""
        guards = "; ".join(conditions)
        return f"{events}<i>{_hanging(f'[{guards}]')}</i>" if conditions else events


def _hanging(text: str) -> str:
    """Lines from the left, all but the first one indented."""
    first, *rest = (html_lines([line]) for line in wrapped_code(text, _WIDTH))
    return _NEXT.join([first, *(f"&#160;&#160;{line}" for line in rest), ""])


def joined(those: Iterable[Cube], atoms: int) -> list[Cube]:
    """The same letters in fewer cubes: two that differ in one proposition, which holds in one and not in the other, are one without it.

    >>> joined([Cube(0b11, 0), Cube(0b01, 0b10), Cube(0b10, 0b01)], 0b11)
    [Cube(yes=1, no=2), Cube(yes=2, no=0)]
    """
    found = dict.fromkeys(those)
    todo = list(found)
    while todo:
        one = todo.pop()
        said = one.yes | one.no
        for proposition in (*bits(said & ~atoms), *bits(said & atoms)) if one in found else ():
            bit = 1 << proposition
            other, both = Cube(one.yes ^ bit, one.no ^ bit), Cube(one.yes & ~bit, one.no & ~bit)
            if other in found:
                del found[one], found[other]
                if both not in found:
                    found[both] = None
                    todo.append(both)
                break
    return list(found)


def possible(automaton: Automaton, structure: Structure) -> Automaton:
    """The automaton with the same states, without letters that never occur and guards that never fail where they are asked.

    A guard holds until its variables have values, and only events give values. A letter on which a guard fails although no events
    on the way there, and not its own, give a value to each variable of the guard never occurs.
    """
    needs = {bit: frozenset(variables(guard)) for guard, bit in structure.guard_bits.items()}
    atoms = len(structure.patterns)
    valued: dict[int, frozenset[str]] = {automaton.start: frozenset()}  # the variables that may have a value in a state

    def after(state: int, letter: int) -> frozenset[str]:
        true = bits(letter & ((1 << atoms) - 1))
        return valued[state].union(*(rigid_variables(structure.patterns[atom]) for atom in true))

    def never(names: frozenset[str], asked: int) -> int:
        """The guards among those asked for with a variable that has no value yet."""
        return mask_of(guard for guard in bits(asked) if not needs[guard] <= names)

    todo = deque(valued)
    while todo:
        state = todo.popleft()
        row = automaton.rows[state]
        for letter, target in row.targets.items():
            names = after(state, letter)
            if never(names, row.asks[letter & row.sees]) & ~letter:
                continue
            if target not in valued or not names <= valued[target]:
                valued[target] = names | valued.get(target, frozenset())
                todo.append(target)

    def reduced(state: int, row: StateRow) -> StateRow:
        if state in (DETECTED, HOPELESS) or state not in valued:
            return row
        idle = {seen: never(after(state, seen), asked) for seen, asked in row.asks.items()}
        targets = {
            letter & ~idle[letter & row.sees]: target
            for letter, target in row.targets.items()
            if not idle[letter & row.sees] & ~letter
        }
        return StateRow(row.sees, {seen: asked & ~idle[seen] for seen, asked in row.asks.items()}, targets)

    return Automaton(automaton.start, [reduced(state, row) for state, row in enumerate(automaton.rows)])


def _event(tree: RVAFT, name: str) -> str:
    """The event of a node as the tree writes it."""
    on = tree.nodes[name].on
    return name_text(tree.origins.get(name, name)) if on is None else on_text(on)
