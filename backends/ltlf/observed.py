"""What a formula asks of events: the patterns and guards of its atoms, and what its header says of relevance."""

from collections.abc import Iterator, Mapping

from backends.ltlf.formulas import Formulas, Op
from backends.ltlf.header import Header, Observation, split
from backends.ltlf.program import root_of
from rvaft.backend import Observed
from rvaft.guards import Guard, Operation, Operator
from rvaft.guards import variables as guard_variables
from rvaft.patterns import Literal, ObjectPattern, Pattern, Variable, rigid_variables, substitute, variables


def observed(text: str, given: Mapping[str, Pattern]) -> tuple[Observed, ...]:
    """The questions; `given` has the patterns of atoms that the text does not define. Raises `LanguageError`, `ToolMissing`."""
    header, rest = split(text)
    formulas = Formulas()
    root_of(header, rest, formulas)
    names = [row.name for row in formulas.rows if row.op is Op.ATOM]
    return tuple(dict.fromkeys(question for name in names for question in _questions(header, name, given)))


def _questions(header: Header, name: str, given: Mapping[str, Pattern]) -> Iterator[Observed]:
    if name in header.relevant or name in header.ignored:
        for one in (*header.relevant.get(name, ()), *header.ignored.get(name, ())):
            if all(set(guard_variables(guard)) <= set(variables(one.pattern)) for guard in one.guards):
                yield _apart(one)
    elif name in header.atoms:
        atom = header.atoms[name]
        # a guard on a variable that the atom cannot share with others never has its value, and counts as true
        guards = [g for g in atom.guards if not any(variable.startswith("_") for variable in guard_variables(g))]
        yield Observed(atom.pattern, _all(guards))
    else:
        yield Observed(given.get(name, ObjectPattern((("event", Literal(name)),))))


def _apart(observation: Observation) -> Observed:
    """With variables of its own: some values will do."""
    taken = variables(observation.pattern)
    by: dict[str, Pattern] = {}
    for name in rigid_variables(observation.pattern):
        own = f"_{name}"
        while own in taken:
            own = f"_{own}"
        by[name] = Variable(own)
    guards = [_renamed(guard, by) for guard in observation.guards]
    return Observed(substitute(observation.pattern, by), _all(guards))


def _renamed(guard: Guard, by: Mapping[str, Pattern]) -> Guard:
    match guard:
        case Variable(name):
            renamed = by.get(name, guard)
            assert isinstance(renamed, Variable)
            return renamed
        case Operation(operator, operands):
            return Operation(operator, tuple(_renamed(operand, by) for operand in operands))
        case _:
            return guard


def _all(guards: list[Guard]) -> Guard | None:
    """One guard that holds when all do."""
    if len(guards) > 1:
        return Operation(Operator.AND, tuple(guards))
    return guards[0] if guards else None
