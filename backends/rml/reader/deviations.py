"""Where this reader means the language and the published compiler and monitor do something else, in one table.

Comparisons with the published tools leave out the pairs of text and trace that a row touches; nothing else may differ. The
predicates are conservative: they may name a pair that does not differ, never the other way round. The numbers only name the rows.
Not in the table, because nothing can be compared: the published compiler refuses field names that are blank or not ASCII and
integers beyond 32 bits, and its monitor does not return from an event type derived from itself, nor from a recursive equation
that is repeated `{0}` times or is generic and lacks its arguments.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Final

from backends.rml.reader import syntax as s
from backends.rml.reader.event_types import always_bound
from backends.rml.reader.parser import parse
from rvaft.model.values import Json, is_number

# Which texts and traces each deviation can touch; every predicate is true where it cannot tell.

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


@dataclass(frozen=True, slots=True)
class Deviation:
    """One row: what the published tools do, what this reader does, and whether a text and a trace are touched by it."""

    number: int
    title: str
    published: str
    reader: str
    predicate: Callable[[s.Program, Sequence[Json]], bool]

    def touches(self, text: str | s.Program, trace: Iterable[Json]) -> bool:
        """Whether this deviation can show; raises `LanguageError` for a text that is not RML."""
        return self.predicate(parse(text) if isinstance(text, str) else text, list(trace))


def touching(text: str | s.Program, trace: Iterable[Json]) -> list[Deviation]:
    """The deviations that can show when the text runs on the trace."""
    program, events = parse(text) if isinstance(text, str) else text, list(trace)
    return [deviation for deviation in DEVIATIONS if deviation.touches(program, events)]


DEVIATIONS: Final = (
    Deviation(
        1,
        "guards over what is no number",
        "a string, a boolean, null, a list or an object in a `with` is an error that ends the monitor, with exit code 0",
        "two strings compare by code points; otherwise the event does not match",
        no_number,
    ),
    Deviation(
        2,
        "tolerance of guards",
        "a `with` compares doubles up to 1e-10, integers included",
        "integers are exact, the rest are IEEE doubles, compared exactly",
        inexact,
    ),
    Deviation(
        3,
        "unbound variables in guards",
        "a `with` over a variable that has no value yet holds, and is forgotten",
        "it does not hold",
        unbound,
    ),
    Deviation(
        4,
        "1 and 1.0",
        "they differ in patterns, in arguments and as values of variables; in a `with` they are equal",
        "they are equal, as in JSON",
        two_forms,
    ),
    Deviation(
        5,
        "objects as values of variables",
        "a variable that stands for an object matches every object that has at least its fields",
        "a variable matches what equals its value",
        objects,
    ),
    Deviation(
        7,
        "guards of `not` types",
        "`not matches P with G` means ¬P ∧ G, and G holds where its variables have no value (see 3)",
        "it means ¬P ∧ G too, and G does not hold there",
        negated_guard,
    ),
    Deviation(
        12,
        "`t | all`",
        "an operand of `|` that has become `all` is forgotten: the other one alone decides from then on",
        "it is kept, so that any event can be taken",
        forgotten,
    ),
    Deviation(
        12,
        "`if` and the arguments of equations",
        "Prolog calculates: strings of one letter are numbers, and what has no value is an error that ends the monitor",
        "no rule applies where a condition has no value; an argument without value is false",
        prolog_arithmetic,
    ),
)
