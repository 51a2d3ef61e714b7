"""Deviations of the published RML compiler and monitor from this reader.

Comparisons with the published tools leave out the pairs of text and trace that a row concerns. The
predicates are conservative: they may include pairs that agree, but miss none that differ. Row
numbers are identifiers only.

The table omits what cannot be compared. The compiler refuses field names that are blank or not
ASCII, and integers beyond 32 bits. The monitor does not terminate on event types derived from
themselves, nor on recursive equations that are repeated `{0}` times or lack generic arguments.
"""

from collections.abc import Iterable
from functools import cache
from typing import Any, Final, NamedTuple

from backends.rml.reader import syntax as s
from backends.rml.reader.parser import parse
from rvaft.model.values import EXACT_INTEGERS, Json, is_number

_COMPARISONS: Final = frozenset(("==", "!=", "<", "<=", ">", ">="))
_INEXACT: Final = frozenset(("/", "^", "*", "sin", "cos", "tan"))
_SPECIAL: Final = frozenset(("^", "sin", "cos", "tan", "abs", "min", "max"))


class Deviation(NamedTuple):
    """The behaviour of the published tools, and of this reader."""

    number: int
    title: str
    published: str
    here: str


DEVIATIONS: Final = (
    Deviation(
        1,
        "guards over what is no number",
        "a string, a boolean, null, a list or an object in a `with` is an error that ends the monitor, "
        "with exit code 0",
        "two strings compare by code points; otherwise the event does not match",
    ),
    Deviation(
        2,
        "tolerance of guards",
        "a `with` compares doubles up to 1e-10, integers included",
        "integers are exact, the rest are IEEE doubles, compared exactly",
    ),
    Deviation(
        3,
        "unbound variables in guards",
        "a `with` over a variable that has no value yet holds, and is forgotten",
        "it does not hold",
    ),
    Deviation(
        4,
        "1 and 1.0",
        "they differ in patterns, in arguments and as values of variables; in a `with` they are equal",
        "they are equal, as in JSON",
    ),
    Deviation(
        5,
        "objects as values of variables",
        "a variable for an object matches every object that has at least its fields",
        "a variable matches what equals its value",
    ),
    Deviation(
        7,
        "guards of `not` types",
        "`not matches P with G` is ¬P ∧ G, and G holds where its variables have no value",
        "G does not hold there",
    ),
    Deviation(
        12,
        "`t | all`",
        "an operand that has become `all` is forgotten: the other one alone decides from then on",
        "it is kept, so that any event can be taken",
    ),
    Deviation(
        12,
        "`if` and the arguments of equations",
        "Prolog calculates: strings of one letter are numbers, and what has no value is an error that ends the monitor",
        "no rule applies where a condition has no value; an argument without value is false",
    ),
)


def touching(text: str, trace: Iterable[Json]) -> list[Deviation]:
    """Return the deviations that may show when the text runs on the trace; raises `LanguageError`.

    >>> [row.title for row in touching("a matches {v: 1}; Main = a all;", [{"v": 1.0}])]
    ['1 and 1.0']
    """
    program, events = parse(text), list(trace)
    parts = [*s.walk(*program.declarations, *(equation.body for equation in program.equations.values()))]
    fields = _fields(events)
    numbers = [p.value for p in parts if isinstance(p, s.Constant) and is_number(p.value)]
    numbers += [value for _, value in fields if is_number(value)]
    exact = all(isinstance(number, int) and abs(number) < EXACT_INTEGERS for number in numbers)
    floats = {number for number in numbers if isinstance(number, float)}
    guarded = [declaration for declaration in program.declarations if declaration.guard is not None]
    within_guards = [part.operator for part in s.walk(*guarded) if isinstance(part, s.Apply)]
    conditions, arguments = _calculated(parts)
    calculates = any(isinstance(data, s.Apply) for data in (*conditions, *arguments))
    whole = any(
        isinstance(one, s.Name) for d in program.declarations for one in d.alternatives
    )  # a variable for the event
    nested = any(isinstance(value, dict) for _, value in fields)
    touched = (
        bool(guarded)
        and (_meets_no_number(program, parts) or not all(map(is_number, _bindable(parts, fields, whole, events)))),
        bool(guarded) and (not exact or not _INEXACT.isdisjoint(within_guards)),
        _leaves_unbound(program),
        bool(floats) and (calculates or any(isinstance(n, int) and n in floats for n in numbers)),
        whole or (nested and any(isinstance(part, s.Name) for part in parts)),
        any(declaration.negated for declaration in guarded),
        _forgets_all(program, parts),
        _calculates_as_prolog(program, conditions, arguments, exact),
    )
    return [row for row, touches in zip(DEVIATIONS, touched, strict=True) if touches]


def _fields(events: list[Json]) -> list[tuple[str, Json]]:
    found, todo = list[tuple[str, Json]](), [*events]
    while todo:
        match todo.pop():
            case dict() as fields:
                found += fields.items()
                todo += fields.values()
            case list(items):
                found += [("", item) for item in items]
                todo += items
    return found


def _calculated(parts: Iterable[s.Part]) -> tuple[list[s.Data], list[s.Data]]:
    expressions = [part for part in parts if isinstance(part, s.Expression)]
    conditions = [part.data[0] for part in expressions if part.operator == "if"]
    return conditions, [a for part in expressions if part.operator == "call" for a in part.data[1]]


def _bindable(parts: list[s.Part], fields: list[tuple[str, Json]], whole: bool, events: list[Json]) -> list[Json]:
    def has_variable(part: s.Part, below: list[bool]) -> bool:
        return isinstance(part, s.Name) or (isinstance(part, s.Items | s.Either) and any(below))

    given = (field for part in parts if isinstance(part, s.Fields) for field in part.fields)
    names = {name for name, value in given if s.fold(value, has_variable)}
    return [*(value for name, value in fields if name in names), *(events if whole else ())]


# The predicates, conservatively true.


def _kind(part: s.Data, operands: list[str]) -> str:
    """Return `truth` for connectives of comparisons, `number` for arithmetic, else nothing."""
    match part:
        case s.Constant(value):
            return "number" if is_number(value) else ""
        case s.Name():
            return "number"
        case s.Apply(sign):
            wanted = "truth" if sign in ("&&", "||") else "number"
            kind = "truth" if wanted == "truth" or sign in _COMPARISONS else "number"
            return kind if all(operand == wanted for operand in operands) else ""


def _meets_no_number(program: s.RmlProgram, parts: list[s.Part]) -> bool:
    data: list[tuple[Any, str]] = [(d.guard, "truth") for d in program.declarations if d.guard is not None]
    data += [(argument, "number") for argument in _calculated(parts)[1]]
    given = [parameter for part in parts if isinstance(part, s.TypeUse) for parameter in part.parameters]
    return (
        any(s.fold(one, _kind) != wanted for one, wanted in data)
        or any(isinstance(p, s.Apply | s.Fields | s.Items) for p in given)
        or not all(is_number(p.value) for p in given if isinstance(p, s.Constant))
    )


def _leaves_unbound(program: s.RmlProgram) -> bool:
    known = program.declared

    @cache
    def bound(declaration: s.Declaration) -> frozenset[str]:
        ways = [frozenset[str]() if declaration.negated else taken(one) for one in declaration.alternatives]
        return frozenset.intersection(*ways)

    def taken(one: s.Value | s.TypeUse) -> frozenset[str]:
        if not isinstance(one, s.TypeUse):
            return s.fold(one, bound_by)
        parents = [(zip(d.parameters, one.parameters, strict=True), bound(d)) for d in known.get(s.signature(one), ())]
        ways = [frozenset(p.name for name, p in pairs if isinstance(p, s.Name) and name in b) for pairs, b in parents]
        return frozenset.intersection(*ways) if ways else frozenset()

    def bound_by(part: s.Part, below: list[frozenset[str]]) -> frozenset[str]:
        if isinstance(part, s.Name):
            return frozenset([part.name])
        return frozenset() if isinstance(part, s.Either) else frozenset[str]().union(*below)

    return any(d.guard is not None and not s.names(d.guard) <= bound(d) for d in program.declarations)


def _forgets_all(program: s.RmlProgram, parts: list[s.Part]) -> bool:
    shuffles = [part for part in parts if isinstance(part, s.Expression) and part.operator == "shuffle"]
    called = program.reachable([name for shuffle in shuffles for name in s.references(shuffle)])
    roots = [*shuffles, *(equation.body for equation in called)]
    return any(part.operator in ("all", "filter") for root in roots for part in s.expressions(root))


def _calculates_as_prolog(
    program: s.RmlProgram, conditions: list[s.Data], arguments: list[s.Data], exact: bool
) -> bool:
    parts = [*s.walk(*conditions, *arguments)]
    if all(isinstance(part, s.Constant) for part in parts):
        return False

    def may_lack_values(equation: s.Equation) -> bool:
        inside = [*s.walk(equation.body)]
        own_conditions, own_arguments = _calculated(inside)
        let = {part.data for part in inside if isinstance(part, s.Expression) and part.operator == "block"}
        return not s.names(*own_conditions, *own_arguments) <= {*equation.parameters} - let

    return (
        not exact
        or any(s.fold(condition, _kind) != "truth" for condition in conditions)
        or any(s.fold(argument, _kind) != "number" for argument in arguments)
        or any(isinstance(part, s.Apply) and part.operator in _SPECIAL for part in parts)
        or any(map(may_lack_values, program.equations.values()))
    )
