"""Which texts and traces each deviation can touch; every predicate is true where it cannot tell."""

from collections.abc import Iterator, Sequence
from itertools import chain
from typing import Final

from backends.rml.reading import syntax as s
from backends.rml.reading.binding import always_bound
from rvaft.values import Json, is_number

_EXACT: Final = 2**53
_CONDITIONS: Final = frozenset(("==", "!=", "<", "<=", ">", ">=", "&&", "||"))
_INEXACT: Final = frozenset(("/", "^", "*", "sin", "cos", "tan"))
_SPECIAL: Final = frozenset(("^", "sin", "cos", "tan", "abs", "min", "max"))


# -- what the predicates look at ---------------------------------------------------------------------------------------


def _guards(program: s.Program) -> list[s.Data]:
    return [d.guard for d in program.declarations if d.guard is not None]


def _expressions(program: s.Program) -> Iterator[s.Expression]:
    return chain.from_iterable(s.bottom_up(equation.body) for equation in program.equations.values())


def _calculated(program: s.Program) -> list[s.Data]:
    """The conditions of `if` and the arguments of equations."""
    conditions = [part.condition for part in _expressions(program) if isinstance(part, s.Conditional)]
    return [*conditions, *_arguments(program)]


def _arguments(program: s.Program) -> list[s.Data]:
    references = (part for part in _expressions(program) if isinstance(part, s.Reference))
    return [argument for reference in references for argument in reference.arguments]


def _parts(data: s.Data) -> Iterator[s.Data]:
    todo = [data]
    while todo:
        yield (part := todo.pop())
        if isinstance(part, s.Apply):
            todo.extend(part.operands)


def _values(trace: Sequence[Json]) -> Iterator[Json]:
    """Every value inside the events, the events themselves left out."""
    todo = list(chain.from_iterable(event.values() for event in trace))
    while todo:
        yield (value := todo.pop())
        if isinstance(value, dict):
            todo.extend(value.values())
        elif isinstance(value, list):
            todo.extend(value)


def _patterns(program: s.Program) -> Iterator[s.Parameter]:
    for declaration in program.declarations:
        for value in declaration.values:
            yield from s.parts_of(value)
        for parameter in chain.from_iterable(parent.parameters for parent in declaration.parents):
            yield from s.parts_of(parameter)
    for part in _expressions(program):
        if isinstance(part, (s.Occurs, s.Filtered)):
            yield from part.use.parameters


def _numbers(program: s.Program, trace: Sequence[Json]) -> Iterator[int | float]:
    written = [p.value for p in _patterns(program) if isinstance(p, s.Constant)]
    data = chain(_guards(program), _calculated(program))
    written += [p.value for one in data for p in _parts(one) if isinstance(p, s.Constant)]
    return (value for value in chain(written, _values(trace)) if is_number(value))


# -- the predicates ----------------------------------------------------------------------------------------------------


def no_number(program: s.Program, trace: Sequence[Json]) -> bool:
    """A guard can meet what is no number."""
    guards = _guards(program)
    if not guards:
        return False
    if not all(_well_typed(guard) for guard in guards) or not all(map(_is_arithmetic, _arguments(program))):
        return True
    uses = [part.use for part in _expressions(program) if isinstance(part, (s.Occurs, s.Filtered))]
    uses += [parent for declaration in program.declarations for parent in declaration.parents]
    for parameter in chain.from_iterable(use.parameters for use in uses):
        constant = isinstance(parameter, s.Constant) and not is_number(parameter.value)
        if constant or isinstance(parameter, (s.Unevaluated, s.Fields, s.Items)):
            return True
    return any(not is_number(value) for event in trace for value in _bindable(event, program))


def _well_typed(guard: s.Data) -> bool:
    """Whether connectives join comparisons, and comparisons compare arithmetic without constants that are no numbers."""
    todo = [guard]
    while todo:
        match todo.pop():
            case s.Apply("&&" | "||", operands):
                todo.extend(operands)
            case s.Apply("==" | "!=" | "<" | "<=" | ">" | ">=", operands):
                if not all(map(_is_arithmetic, operands)):
                    return False
            case _:
                return False
    return True


def _is_arithmetic(data: s.Data) -> bool:
    for part in _parts(data):
        if isinstance(part, s.Constant) and not is_number(part.value):
            return False
        if isinstance(part, s.Apply) and part.operator in _CONDITIONS:
            return False
    return True


def _bindable(event: Json, program: s.Program) -> Iterator[Json]:
    """The values that a variable of a pattern can come to stand for."""
    fields: set[str] = set()
    for part in _patterns(program):
        if isinstance(part, s.Fields):
            fields.update(name for name, value in part.fields if _holds_variable(value))
    yield from (event for d in program.declarations if any(isinstance(value, s.Name) for value in d.values))
    todo = [event]
    while todo:
        value = todo.pop()
        if isinstance(value, dict):
            yield from (inner for name, inner in value.items() if name in fields)
            todo.extend(value.values())
        elif isinstance(value, list):
            todo.extend(value)


def _holds_variable(value: s.Value) -> bool:
    """Whether a variable stands in a pattern, in no field further inside."""
    todo = [value]
    while todo:
        match todo.pop():
            case s.Name():
                return True
            case s.Items(values) | s.Either(values):
                todo.extend(values)
            case _:
                pass
    return False


def inexact(program: s.Program, trace: Sequence[Json]) -> bool:
    """A guard can meet numbers on which doubles and exact numbers differ."""
    guards = _guards(program)
    if not guards:
        return False
    if any(isinstance(p, s.Apply) and p.operator in _INEXACT for guard in guards for p in _parts(guard)):
        return True
    return any(isinstance(number, float) or abs(number) >= _EXACT for number in _numbers(program, trace))


def unbound(program: s.Program, _trace: Sequence[Json]) -> bool:
    """A guard has a variable that a match can leave without a value."""
    bound = always_bound(program)
    return any(d.guard is not None and not s.names(d.guard) <= bound[d] for d in program.declarations)


def two_forms(program: s.Program, trace: Sequence[Json]) -> bool:
    """A number occurs both with and without a decimal point."""
    numbers = list(_numbers(program, trace))
    floats = {number for number in numbers if isinstance(number, float)}
    calculates = any(isinstance(data, s.Apply) for data in _calculated(program))
    return bool(floats) if calculates else any(isinstance(n, int) and n in floats for n in numbers)


def objects(program: s.Program, trace: Sequence[Json]) -> bool:
    """A variable can stand for an object."""
    whole = any(isinstance(value, s.Name) for d in program.declarations for value in d.values)
    nested = any(isinstance(value, dict) for value in _values(trace))
    return whole or (nested and any(isinstance(p, s.Name) for p in _patterns(program)))


def negated_guard(program: s.Program, _trace: Sequence[Json]) -> bool:
    """A `not` type has a guard."""
    return any(d.negated and d.guard is not None for d in program.declarations)


def forgotten(program: s.Program, _trace: Sequence[Json]) -> bool:
    """An operand of `|` can become `all`."""
    shuffles = [p for p in _expressions(program) if isinstance(p, s.Joined) and p.operator == "shuffle"]
    seen: set[str] = set()
    todo: list[s.Expression] = [*shuffles]
    while todo:
        for part in s.bottom_up(todo.pop()):
            if isinstance(part, s.Filtered) or (isinstance(part, s.Leaf) and part.word == "all"):
                return True
            if isinstance(part, s.Reference) and part.name not in seen and part.name in program.equations:
                seen.add(part.name)
                todo.append(program.equations[part.name].body)
    return False


def prolog_arithmetic(program: s.Program, trace: Sequence[Json]) -> bool:
    """A condition or an argument can meet what Prolog calculates otherwise."""
    parts = [part for one in _calculated(program) for part in _parts(one)]
    if all(isinstance(part, s.Constant) for part in parts):
        return False
    constants = [part.value for part in parts if isinstance(part, s.Constant)]
    return (
        not all(_uses_parameters_only(equation) for equation in program.equations.values())
        or not all(map(_is_arithmetic, _arguments(program)))
        or any(isinstance(part, s.Apply) and part.operator in _SPECIAL for part in parts)
        or any(isinstance(v, float) or not is_number(v) or abs(v) >= _EXACT for v in constants)
        or any(isinstance(v, float) or (is_number(v) and abs(v) >= _EXACT) for v in _values(trace))
    )


def _uses_parameters_only(equation: s.Equation) -> bool:
    """Whether its conditions and arguments have a value for certain: no `let` variable can reach them."""
    alone = s.Program((), {equation.name: equation})
    names = frozenset[str]().union(*map(s.names, _calculated(alone)))
    let = {part.variable for part in s.bottom_up(equation.body) if isinstance(part, s.Block)}
    return names <= set(equation.parameters) - let
