"""The minimal automaton as a Graphviz graph for readers.

- A label has a line per alternative; continuation lines are indented.
- `a, b` is one event that matches both patterns; all guards in brackets hold with it.
- `else` is an event that is on no other edge of the state.
- ⊤ is detection; from ⊥ no detection is possible.
- States keep their numbers from the HOA text, without unreachable states and infeasible letters.
- Under `projected` the letters are relevant events.
"""

from collections import deque
from collections.abc import Iterable
from typing import Final

from backends.automaton.determinise import DETECTED, HOPELESS, Automaton, StateRow
from backends.automaton.hoa_writer import Cube, cubes, title_of
from backends.automaton.letters import FeasibleLetters
from backends.automaton.structure import Structure
from rvaft.core.property import Property
from rvaft.errors import TooLarge
from rvaft.export.dot import html, html_lines, table, title
from rvaft.export.layout import wrapped_code
from rvaft.model.expressions import name_text, on_text
from rvaft.model.guards import variables
from rvaft.model.patterns import rigid_variables
from rvaft.model.verdict import Semantics
from rvaft.support.bits import bits, mask_of
from rvaft.support.budget import Work

READABLE: Final = 100
"""Default maximum of drawn states."""
BEFORE: Final = 100
"""States allowed before minimisation, per state of the limit."""
_LINES: Final = 10
"""Label lines allowed per state of the limit."""
_WIDTH: Final = 24
_QUIET: Final = "#8a8a8a"


def diagram(
    automaton: Automaton,
    structure: Structure,
    letters: FeasibleLetters,
    *,
    prop: Property,
    semantics: Semantics,
    limit: int,
) -> str:
    """Return the graph; raises `TooLarge` beyond `limit` states or ten label lines per state."""
    number = {state: index for index, state in enumerate(automaton.in_order())}
    automaton = possible(automaton, structure)
    order = automaton.in_order()
    if len(order) > limit:
        raise TooLarge(f"{len(order)} states are too many to draw", limit=limit)
    states, edges, written, work = [], [], 0, Work(limit)
    looks = {
        DETECTED: "label=<⊤>, shape=doublecircle",
        HOPELESS: f'label=<⊥>, style=filled, fillcolor="#e4e4e4", color="{_QUIET}"',
    }
    for state in order:
        states.append(f"s{number[state]} [{looks.get(state, f'label=<{number[state]}>')}];")
        leaving = {} if state in looks else _edges(automaton.rows[state], structure, letters, prop, work)
        for target, lines in leaving.items():
            written += len(lines)
            look = f', color="{_QUIET}", fontcolor="{_QUIET}", style=dashed' if target == HOPELESS else ""
            label = table(
                lines, space=2, cell='align="left" bgcolor="white"'
            )  # the white background covers edges behind the label
            edges.append(f"s{number[state]} -> s{number[target]} [label=<{label}>{look}];")
    if written > _LINES * limit:
        raise TooLarge(f"{written} labels are too many to draw, {_LINES} allowed for each state", limit=limit)
    caption = [title_of(prop, semantics)]
    caption += ["Events that are not relevant change nothing."] if semantics.projects else []
    caption += ["A guard holds as long as one of its variables has no value."] if structure.guards else []
    lines = [
        'graph [margin=0, ranksep=0.25, nodesep=0.15, charset="UTF-8"];',
        'node [fontname="Helvetica", fontsize=10, shape=circle, margin="0.03", width=0.3, height=0.3];',
        'edge [fontname="Helvetica", fontsize=10, arrowsize=0.6];',
        'start [shape=point, style=invis, width=0, height=0, label=""];',
        *states,
        f"start -> s{number[automaton.start]};",
        *edges,
        f"label=<{table(html(line, 3 * _WIDTH) for line in caption)}>;",
        'labelloc=b; labeljust=l; fontname="Helvetica"; fontsize=10;',
    ]
    return "\n".join([f"digraph {title(title_of(prop, semantics))} {{", *(f"  {line}" for line in lines), "}", ""])


def _edges(
    row: StateRow, structure: Structure, letters: FeasibleLetters, prop: Property, work: Work
) -> dict[int, list[str]]:
    leaving, rest = cubes(row, work), row.targets.get(0)
    if len(leaving) == 1:
        return {target: ["any event"] for target in leaving}
    atoms = (1 << len(structure.patterns)) - 1
    guards = dict(zip(structure.guard_bits.values(), structure.written, strict=True))

    def event(atom: int) -> str:
        name = structure.nodes[atom]
        on = prop.tree.nodes[name].on
        return name_text(name) if on is None else on_text(on)

    def line(cube: Cube) -> str:
        excluded = cube.no & atoms
        for atom in bits(cube.yes & atoms):  # omit atoms that exclude each other anyway
            excluded &= letters.together(atom, excluded)
        words = [*map(event, bits(cube.yes & atoms)), *(f"not {event(atom)}" for atom in bits(excluded))]
        conditions = [guards[guard] for guard in bits(cube.yes & ~atoms)]
        conditions += [f"not ({guards[guard]})" for guard in bits(cube.no & ~atoms)]
        events = _hanging(", ".join(words)) if words else ""
        return f"{events}<i>{_hanging('[' + '; '.join(conditions) + ']')}</i>" if conditions else events

    written = {
        target: [line(cube) for cube in joined(alternatives, atoms)]
        for target, alternatives in leaving.items()
        if target != rest
    }
    return written if rest is None else {**written, rest: ["else"]}


def _hanging(text: str) -> str:
    first, *rest = (html_lines([line]) for line in wrapped_code(text, _WIDTH))
    return '<br align="left"/>'.join([first, *(f"&#160;&#160;{line}" for line in rest), ""])


def joined(alternatives: Iterable[Cube], atoms: int) -> list[Cube]:
    """Return equivalent cubes, merging pairs that differ in the sign of one proposition.

    >>> joined([Cube(0b11, 0), Cube(0b01, 0b10), Cube(0b10, 0b01)], 0b11)
    [Cube(yes=1, no=2), Cube(yes=2, no=0)]
    """
    found = dict.fromkeys(alternatives)
    todo = list(found)
    while todo:
        one = todo.pop()
        literals = one.yes | one.no
        for proposition in (*bits(literals & ~atoms), *bits(literals & atoms)) if one in found else ():
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
    """Return the automaton without letters that cannot occur and guards that cannot fail.

    A guard holds while one of its variables is unbound, and only events bind variables, so a letter
    in which such a guard fails cannot occur.
    """
    needs = {bit: frozenset(variables(guard)) for guard, bit in structure.guard_bits.items()}
    atoms = (1 << len(structure.patterns)) - 1
    valued: dict[int, frozenset[str]] = {automaton.start: frozenset()}  # variables that may be bound in each state

    def after(state: int, letter: int) -> frozenset[str]:
        return valued[state].union(*(rigid_variables(structure.patterns[atom]) for atom in bits(letter & atoms)))

    def idle(names: frozenset[str], guards_read: int) -> int:
        return mask_of(guard for guard in bits(guards_read) if not needs[guard] <= names)

    todo = deque(valued)
    while todo:
        state = todo.popleft()
        row = automaton.rows[state]
        for letter, target in row.targets.items():
            names = after(state, letter)
            known = valued.get(target)
            if not idle(names, row.asks[letter & row.sees]) & ~letter and (known is None or not names <= known):
                valued[target] = names | (known or frozenset())
                todo.append(target)
    rows = list(automaton.rows)
    for state in valued.keys() - {DETECTED, HOPELESS}:
        row = rows[state]
        never = {seen: idle(after(state, seen), guards_read) for seen, guards_read in row.asks.items()}
        asks = {seen: guards_read & ~never[seen] for seen, guards_read in row.asks.items()}
        rows[state] = StateRow(row.sees, asks, {})
        for letter, target in row.targets.items():
            if not never[letter & row.sees] & ~letter:
                rows[state].targets[letter & ~never[letter & row.sees]] = target
    return Automaton(automaton.start, rows)
