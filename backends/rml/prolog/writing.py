"""An RML text in the form the published monitor loads: `match/2` for the event types, `trace_expression/2` for the equations.

Written from the syntax alone; it shares nothing with the reader's own rules. Source: the published compiler, by its output. One
thing is different: the compiler's output calls the monitor's `deep_subdict(Event, Pattern)`, but the copy of the monitor that is
ROSMonitoring's RML oracle has its arguments the other way round (and turns them once more inside nested patterns), so that a
text which suits one matches hardly any event in the other. Here the text brings its own `fits/2`, which does what the published
`deep_subdict` does, and means the same in both.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import product
from typing import Final

from backends.rml.prolog.folding import fold
from backends.rml.reading import syntax as s
from backends.rml.reading.matching import ANY, NONE
from backends.rml.reading.parser import parse
from backends.rml.reading.static import check
from rvaft.values import Json

HEADER: Final = """\
:- module(spec, [trace_expression/2, match/2]).
:- use_module(library(clpr)).
fits(Value, Pattern) :- var(Pattern), !, Pattern = Value.
fits(Value, Pattern) :- is_dict(Pattern), !, is_dict(Value), dict_pairs(Pattern, _, Fields), fields_fit(Fields, Value).
fits([Value|Values], [Pattern|Patterns]) :- !, fits(Value, Pattern), fits(Values, Patterns).
fits(Value, Value).
fields_fit([], _).
fields_fit([Name-Pattern|Fields], Value) :- get_dict(Name, Value, Inner), fits(Inner, Pattern), fields_fit(Fields, Value).
"""
"""How every text begins."""
_DATA: Final = {"==": "=:=", "!=": "=\\=", "<=": "=<", "&&": ",", "||": ";"}
_JOINS: Final = {"cat": "*", "and": "/\\", "or": "\\/", "shuffle": "|"}
_REPEATS: Final = {"star": "star", "plus": "plus", "optional": "optional", "closure": "clos"}
_LEAVES: Final = {"empty": "eps", "all": "1"}


def prolog(text: str) -> str:
    """The specification as a Prolog module; raises `LanguageError`."""
    program = parse(text)
    check(program)
    clauses = [clause for declaration in (*program.declarations, ANY, NONE) for clause in _clauses(declaration)]
    equations = ",\n    ".join(f"{e.name} = {_equation(e)}" for e in program.equations.values())
    return HEADER + "\n".join([*clauses, f"trace_expression('Main', Main) :-\n    {equations}.\n"])


# -- event types -------------------------------------------------------------------------------------------------------


def _clauses(declaration: s.Declaration) -> Iterator[str]:
    head = f"match(Event, {_compound(declaration.name, map(_variable, declaration.parameters))})"
    goals = [f"fits(Event, {one})" for value in declaration.values for one in _alternatives(value)]
    goals += [f"match(Event, {_parent(use)})" for use in declaration.parents]
    guard = [] if declaration.guard is None else [f"{{{_data(declaration.guard, _variable)}}}"]
    if declaration.negated:
        yield f"{head} :- {', '.join([*(f'not({goal})' for goal in goals), *guard])}."
    else:
        yield from (f"{head} :- {', '.join([goal, *guard])}." for goal in goals)


def _parent(use: s.TypeUse) -> str:
    return _compound(use.name, (_given(parameter) for parameter in use.parameters))


def _given(parameter: s.Parameter) -> str:
    if isinstance(parameter, s.Unevaluated):
        return _data(parameter.data, _variable)
    return _alternatives(parameter)[0]


def _alternatives(value: s.Value) -> list[str]:
    """A pattern without `|` for each choice, those of the first field varying slowest."""
    return fold(value, _inside, _choices)


def _inside(value: s.Value) -> Sequence[s.Value]:
    match value:
        case s.Fields(fields):
            return [inner for _, inner in fields]
        case s.Items(items):
            return items
        case s.Either(values):
            return values
        case _:
            return ()


def _choices(value: s.Value, inside: list[list[str]]) -> list[str]:
    match value:
        case s.Fields(fields):
            keys = [_quoted(name, "'") for name, _ in fields]
            return [f"_{{{', '.join(map(':'.join, zip(keys, one, strict=True)))}}}" for one in product(*inside)]
        case s.Items(items, more):
            if not items:
                return ["[_|_]" if more else "[]"]
            return [f"[{', '.join(one)}{'|_' if more else ''}]" for one in product(*inside)]
        case s.Either():
            return [one for choices in inside for one in choices]
        case s.Name(name):
            return [_variable(name)]
        case s.Constant(constant):
            return [_constant(constant)]
        case s.Ignored():
            return ["_"]


# -- expressions -------------------------------------------------------------------------------------------------------


def _equation(equation: s.Equation) -> str:
    body = fold(equation.body, s.children, _expression)
    return f"gen([{', '.join(equation.parameters)}], {body})" if equation.parameters else body


def _expression(part: s.Expression, inside: list[str]) -> str:
    match part:
        case s.Leaf(word):
            return _LEAVES[word]
        case s.Occurs(use):
            return _use(use)
        case s.Joined("cat"):
            return f"({'*('.join(inside)}{')' * len(inside)}"
        case s.Joined(operator):
            first, *rest = inside
            return "(" * len(rest) + first + "".join(f"{_JOINS[operator]}{one})" for one in rest)
        case s.Repeated("times", _, number):
            return f"times({inside[0]}, {number})"
        case s.Repeated(operator):
            return f"{_REPEATS[operator]}({inside[0]})"
        case s.Filtered(use):
            return f"(({_use(use)}>>{inside[0]});{inside[1]})"
        case s.Block(variable):
            return f"var({variable}, {inside[0]})"
        case s.Conditional(condition):
            return f"guarded({_data(condition, _free)}, {inside[0]}, {inside[1]})"
        case s.Reference(name, arguments):
            return f"app({name}, [{', '.join(_data(a, _free) for a in arguments)}])" if arguments else name


def _use(use: s.TypeUse) -> str:
    return _compound(use.name, (_argument(parameter) for parameter in use.parameters))


def _argument(parameter: s.Parameter) -> str:
    match parameter:
        case s.Unevaluated(data):
            return _data(data, _free)
        case s.Name(name):
            return _free(name)
        case value:
            return _alternatives(value)[0]


# -- data and words ----------------------------------------------------------------------------------------------------


def _data(data: s.Data, variable: Callable[[str], str]) -> str:
    def operands(part: s.Data) -> Sequence[s.Data]:
        return part.operands if isinstance(part, s.Apply) else ()

    def written(part: s.Data, inside: list[str]) -> str:
        match part:
            case s.Constant(value):
                return _constant(value)
            case s.Name(name):
                return variable(name)
            case s.Apply("neg"):
                return f"(-{inside[0]})"
            case s.Apply(operator) if operator.isalpha():
                return f"{operator}({', '.join(inside)})"
            case s.Apply(operator):
                return f"({inside[0]} {_DATA.get(operator, operator)} {inside[1]})"

    return fold(data, operands, written)


def _compound(name: str, arguments: Iterable[str]) -> str:
    given = ", ".join(arguments)
    return f"{name}_et({given})" if given else f"{name}_et"


def _variable(name: str) -> str:
    return f"V_{name}"


def _free(name: str) -> str:
    return f"var({name})"


def _constant(value: Json) -> str:
    match value:
        case str():
            return _quoted(value, '"')
        case bool() | None:
            return {True: "true", False: "false", None: "null"}[value]
        case float():
            digits, e, exponent = repr(value).partition("e")
            return digits + (".0" if "." not in digits else "") + e + exponent
        case number:
            return str(number)


def _quoted(text: str, quote: str) -> str:
    special = {"\\": "\\\\", quote: f"\\{quote}", "\n": "\\n", "\t": "\\t", "\r": "\\r"}
    return quote + "".join(special.get(c, c if c.isprintable() else f"\\x{ord(c):x}\\") for c in text) + quote
