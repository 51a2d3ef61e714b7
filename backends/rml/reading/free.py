"""Which variables an equation can use: those that occur in it, or in equations it refers to, outside a block of their own.

Equations see the variables of the place they are unfolded at (scope is dynamic), so this is what has to travel with them.
"""

from collections.abc import Mapping

from backends.rml.reading import syntax as s


def free_variables(program: s.Program) -> Mapping[str, frozenset[str]]:
    """For each equation the variables it can use, its parameters left out."""
    found: dict[str, frozenset[str]] = {name: frozenset() for name in program.equations}
    users: dict[str, set[str]] = {name: set() for name in program.equations}
    for equation in program.equations.values():
        for part in s.bottom_up(equation.body):
            if isinstance(part, s.Reference) and part.name in users:
                users[part.name].add(equation.name)
    waiting = list(program.equations)
    while waiting:
        equation = program.equations[waiting.pop()]
        now = _free(equation.body, found) - set(equation.parameters)
        if now != found[equation.name]:
            found[equation.name] = now
            waiting.extend(users[equation.name])
    return found


def _free(body: s.Expression, known: Mapping[str, frozenset[str]]) -> frozenset[str]:
    done: dict[int, frozenset[str]] = {}
    for part in s.bottom_up(body):
        below = frozenset[str]().union(*(done[id(child)] for child in s.children(part)))
        match part:
            case s.Occurs(use) | s.Filtered(use):
                below |= s.used_names(use)
            case s.Block(variable):
                below -= {variable}
            case s.Conditional(condition):
                below |= s.names(condition)
            case s.Reference(name, arguments):
                below |= known.get(name, frozenset()).union(*map(s.names, arguments))
        done[id(part)] = below
    return done[id(body)]
