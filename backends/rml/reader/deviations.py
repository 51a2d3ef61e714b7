"""Where this reader means the language and the published compiler and monitor do something else, in one table.

Comparisons with the published tools leave out the pairs of text and trace that a row touches; nothing else may differ. The
predicates are conservative: they may name a pair that does not differ, never the other way round. The numbers only name the rows.
Not in the table, because nothing can be compared: the published compiler refuses field names that are blank or not ASCII and
integers beyond 32 bits, and its monitor does not return from an event type derived from itself, nor from a recursive equation
that is repeated `{0}` times or is generic and lacks its arguments.
"""

from collections.abc import Callable, Iterable, Sequence
from functools import cache, cached_property
from typing import Final, NamedTuple

from backends.rml.reader import syntax as s
from backends.rml.reader.parser import parse
from rvaft.model.values import Json, is_number

_EXACT: Final = 2**53
_COMPARISONS: Final = frozenset(("==", "!=", "<", "<=", ">", ">="))
_INEXACT: Final = frozenset(("/", "^", "*", "sin", "cos", "tan"))
_SPECIAL: Final = frozenset(("^", "sin", "cos", "tan", "abs", "min", "max"))


def _kind(part: s.Data, operands: list[str]) -> str:
    """`truth` for connectives of comparisons, `number` for arithmetic over variables and numbers, else nothing."""
    match part:
        case s.Constant(value):
            return "number" if is_number(value) else ""
        case s.Name():
            return "number"
        case s.Apply(sign):
            wanted = "truth" if sign in ("&&", "||") else "number"
            kind = "truth" if wanted == "truth" or sign in _COMPARISONS else "number"
            return kind if all(operand == wanted for operand in operands) else ""


def _is_variable(part: s.Part, below: list[bool]) -> bool:
    """Whether a variable stands in a pattern, in no field further inside."""
    return isinstance(part, s.Name) or (isinstance(part, s.Items | s.Either) and any(below))


def _taken(part: s.Part, below: list[frozenset[str]]) -> frozenset[str]:
    """The names that every choice of a pattern binds: what stands in a `|` may stay without a value."""
    if isinstance(part, s.Name):
        return frozenset([part.name])
    return frozenset() if isinstance(part, s.Either) else frozenset[str]().union(*below)


def _calculated(parts: Iterable[s.Part]) -> tuple[list[s.Data], list[s.Data]]:
    """The conditions of `if`, and the arguments of equations."""
    expressions = [part for part in parts if isinstance(part, s.Expression)]
    conditions = [part.data[0] for part in expressions if part.operator == "if"]
    return conditions, [a for part in expressions if part.operator == "call" for a in part.data[1]]


class RunOfText:
    """A text and a trace: what the rows of the table look at."""

    def __init__(self, text: str, trace: Sequence[Json]) -> None:
        self.program = parse(text)
        self.trace = trace
        bodies = [equation.body for equation in self.program.equations.values()]
        self.parts = [*s.walk(*self.program.declarations, *bodies)]
        self.uses = [part for part in self.parts if isinstance(part, s.TypeUse)]
        self.guarded = [d for d in self.program.declarations if d.guard is not None]
        self.conditions, self.arguments = _calculated(self.parts)
        self.variable_event = any(isinstance(one, s.Name) for d in self.program.declarations for one in d.alternatives)

    @cached_property
    def fields(self) -> list[tuple[str, Json]]:
        """Every value inside the events with the name of its field, if it has one."""
        found, todo = list[tuple[str, Json]](), [*self.trace]
        while todo:
            match todo.pop():
                case dict() as fields:
                    found += fields.items()
                    todo += fields.values()
                case list(items):
                    found += [("", item) for item in items]
                    todo += items
        return found

    @cached_property
    def numbers(self) -> list[int | float]:
        """Every number in the text and in the trace."""
        written = [part.value for part in self.parts if isinstance(part, s.Constant)]
        return [value for value in (*written, *(value for _, value in self.fields)) if is_number(value)]

    @property
    def exact(self) -> bool:
        """Whether all numbers are integers that doubles can hold."""
        return all(isinstance(number, int) and abs(number) < _EXACT for number in self.numbers)

    @property
    def bindable(self) -> list[Json]:
        """The values that a variable of a pattern can come to stand for."""
        given = (field for part in self.parts if isinstance(part, s.Fields) for field in part.fields)
        names = {name for name, value in given if s.fold(value, _is_variable)}
        return [*(value for name, value in self.fields if name in names), *(self.trace if self.variable_event else ())]


# -- the predicates, true where they cannot tell -----------------------------------------------------------------------


def _meets_no_number(pair: RunOfText) -> bool:
    """A string, a boolean, null, a list or an object in a `with` is an error that ends the monitor, with exit code 0.

    Here two strings compare by code points; otherwise the event does not match.
    """
    kinds = [*((d.guard, "truth") for d in pair.guarded), *((argument, "number") for argument in pair.arguments)]
    given = [parameter for use in pair.uses for parameter in use.parameters]
    return bool(pair.guarded) and (
        any(s.fold(data, _kind) != wanted for data, wanted in kinds if data is not None)
        or any(isinstance(p, s.Apply | s.Fields | s.Items) for p in given)
        or not all(is_number(p.value) for p in given if isinstance(p, s.Constant))
        or not all(map(is_number, pair.bindable))
    )


def _is_inexact(pair: RunOfText) -> bool:
    """A `with` compares doubles up to 1e-10, integers included.

    Here integers are exact, the rest are IEEE doubles, compared exactly.
    """
    parts = [part for d in pair.guarded for part in s.walk(d) if isinstance(part, s.Apply)]
    return bool(pair.guarded) and (not pair.exact or any(part.operator in _INEXACT for part in parts))


def _leaves_unbound(pair: RunOfText) -> bool:
    """A `with` over a variable that has no value yet holds, and is forgotten.

    Here it does not hold.
    """
    known = pair.program.declared

    @cache
    def bound(declaration: s.Declaration) -> frozenset[str]:
        """The names that stand for a value once the pattern or the parents have matched, however the event type is used."""
        ways = [frozenset[str]() if declaration.negated else taken(one) for one in declaration.alternatives]
        return frozenset.intersection(*ways)

    def taken(one: s.Value | s.TypeUse) -> frozenset[str]:
        if not isinstance(one, s.TypeUse):
            return s.fold(one, _taken)
        parents = [(zip(d.parameters, one.parameters, strict=True), bound(d)) for d in known.get(one.signature, ())]
        ways = [frozenset(p.name for name, p in pairs if isinstance(p, s.Name) and name in b) for pairs, b in parents]
        return frozenset.intersection(*ways) if ways else frozenset()

    return any(d.guard is not None and not s.names(d.guard) <= bound(d) for d in pair.guarded)


def _has_two_forms(pair: RunOfText) -> bool:
    """1 and 1.0 differ in patterns, in arguments and as values of variables; in a `with` they are equal.

    Here they are equal, as in JSON.
    """
    floats = {number for number in pair.numbers if isinstance(number, float)}
    calculates = any(isinstance(data, s.Apply) for data in (*pair.conditions, *pair.arguments))
    return bool(floats) and (calculates or any(isinstance(n, int) and n in floats for n in pair.numbers))


def _binds_objects(pair: RunOfText) -> bool:
    """A variable that stands for an object matches every object that has at least its fields.

    Here a variable matches what equals its value.
    """
    nested = any(isinstance(value, dict) for _, value in pair.fields)
    return pair.variable_event or (nested and any(isinstance(part, s.Name) for part in pair.parts))


def _guards_negation(pair: RunOfText) -> bool:
    """`not matches P with G` means ¬P ∧ G, and G holds where its variables have no value (see 3). Here it does not hold there."""
    return any(declaration.negated for declaration in pair.guarded)


def _forgets_all(pair: RunOfText) -> bool:
    """An operand of `|` that has become `all` is forgotten: the other one alone decides from then on.

    Here it is kept, so that any event can be taken.
    """
    shuffles = [part for part in pair.parts if isinstance(part, s.Expression) and part.operator == "shuffle"]
    called = pair.program.reachable([name for shuffle in shuffles for name in s.references(shuffle)])
    roots = [*shuffles, *(equation.body for equation in called)]
    parts = [part for root in roots for part in s.expressions(root)]
    return any(part.operator in ("all", "filter") for part in parts)


def _calculates_as_prolog(pair: RunOfText) -> bool:
    """Prolog calculates: strings of one letter are numbers, and what has no value is an error that ends the monitor.

    Here no rule applies where a condition has no value; an argument without value is false.
    """
    data = [*pair.conditions, *pair.arguments]
    parts = [part for one in data for part in s.walk(one)]
    if all(isinstance(part, s.Constant) for part in parts):
        return False
    return (
        not pair.exact
        or any(s.fold(condition, _kind) != "truth" for condition in pair.conditions)
        or any(s.fold(argument, _kind) != "number" for argument in pair.arguments)
        or any(isinstance(part, s.Apply) and part.operator in _SPECIAL for part in parts)
        or any(_uses_variables(equation) for equation in pair.program.equations.values())
    )


def _uses_variables(equation: s.Equation) -> bool:
    """Whether a condition or an argument may lack a value: a variable of a `let` can reach it, or none does."""
    parts = [*s.walk(equation.body)]
    conditions, arguments = _calculated(parts)
    let = {part.data for part in parts if isinstance(part, s.Expression) and part.operator == "block"}
    return not frozenset[str]().union(*map(s.names, (*conditions, *arguments))) <= {*equation.parameters} - let


class Deviation(NamedTuple):
    """One row; `touches` tells whether it can show on a text and a trace, and its docstring what happens there and here."""

    number: int
    title: str
    touches: Callable[[RunOfText], bool]


DEVIATIONS: Final = (
    Deviation(1, "guards over what is no number", _meets_no_number),
    Deviation(2, "tolerance of guards", _is_inexact),
    Deviation(3, "unbound variables in guards", _leaves_unbound),
    Deviation(4, "1 and 1.0", _has_two_forms),
    Deviation(5, "objects as values of variables", _binds_objects),
    Deviation(7, "guards of `not` types", _guards_negation),
    Deviation(12, "`t | all`", _forgets_all),
    Deviation(12, "`if` and the arguments of equations", _calculates_as_prolog),
)


def touching(text: str, trace: Iterable[Json]) -> list[Deviation]:
    """The deviations that can show when the text runs on the trace; raises `LanguageError` for a text that is not RML.

    >>> [row.title for row in touching("a matches {v: 1}; Main = a all;", [{"v": 1.0}])]
    ['1 and 1.0']
    """
    pair = RunOfText(text, list(trace))
    return [deviation for deviation in DEVIATIONS if deviation.touches(pair)]
