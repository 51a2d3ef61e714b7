"""Which variables an equation can use: those that occur in it, or in equations it refers to, outside a block of their own.

Equations see the variables of the place they are unfolded at (scope is dynamic), so this is what has to travel with them.
Each body is walked once; what it finds is handed on along the references until nothing is new.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

from backends.rml.reading import syntax as s


@dataclass(slots=True)
class _Uses:
    """What a body uses itself, and the equations it refers to, each with the variables of blocks around the reference."""

    variables: set[str] = field(default_factory=set)
    references: dict[tuple[str, frozenset[str]], None] = field(default_factory=dict)


def free_variables(program: s.Program) -> Mapping[str, frozenset[str]]:
    """For each equation the variables it can use, its parameters left out."""
    found: dict[str, set[str]] = {}
    users: dict[str, list[tuple[str, frozenset[str]]]] = {name: [] for name in program.equations}
    for name, equation in program.equations.items():
        uses = _uses(equation)
        found[name] = uses.variables
        for used, hidden in uses.references:
            if used in users:
                users[used].append((name, hidden))
    waiting = list(program.equations)
    while waiting:
        name = waiting.pop()
        for user, hidden in users[name]:
            more = found[name] - hidden - found[user]
            if more:
                found[user] |= more
                waiting.append(user)
    return {name: frozenset(names) for name, names in found.items()}


def _uses(equation: s.Equation) -> _Uses:
    uses = _Uses()
    todo: list[tuple[s.Expression, frozenset[str]]] = [(equation.body, frozenset(equation.parameters))]
    while todo:
        part, hidden = todo.pop()
        match part:
            case s.Occurs(use) | s.Filtered(use):
                uses.variables |= s.used_names(use) - hidden
            case s.Block(variable):
                hidden |= {variable}
            case s.Conditional(condition):
                uses.variables |= s.names(condition) - hidden
            case s.Reference(name, arguments):
                uses.variables |= frozenset[str]().union(*map(s.names, arguments)) - hidden
                uses.references[name, hidden] = None
            case _:
                pass
        todo.extend((child, hidden) for child in s.children(part))
    return uses
