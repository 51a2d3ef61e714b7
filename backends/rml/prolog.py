"""The Prolog form of RML texts, as the module that RML monitors load; there is no reader.

`match/2` defines the event types, `trace_expression/2` the equations, as in the output of the
published compiler.

One difference: compiler output calls the monitor's `deep_subdict(Event, Pattern)`. ROSMonitoring's
monitor swaps the arguments, again in nested patterns, so a text for one monitor fails in the other.
The text here therefore includes its own `fits/2`, with the meaning of the published `deep_subdict`.
"""

from collections.abc import Iterable, Iterator
from itertools import product
from typing import ClassVar, Final

from backends.rml import RmlBackend, RmlCapabilities
from backends.rml.reader import syntax as s
from backends.rml.reader.parser import parse
from rvaft.backend import Highlighting, SpecificationText
from rvaft.core.property import Part, Property
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics

HEADER: Final = """\
:- module(spec, [trace_expression/2, match/2]).
:- use_module(library(clpr)).
fits(Value, Pattern) :- var(Pattern), !, Pattern = Value.
fits(Value, Pattern) :- is_dict(Pattern), !, is_dict(Value), dict_pairs(Pattern, _, Fields), fields_fit(Fields, Value).
fits([Value|Values], [Pattern|Patterns]) :- !, fits(Value, Pattern), fits(Values, Patterns).
fits(Value, Value).
fields_fit([], _).
fields_fit([Name-Pattern|Fields], Value) :-
    get_dict(Name, Value, Inner), fits(Inner, Pattern), fields_fit(Fields, Value).
"""
_DATA: Final = {"==": "=:=", "!=": "=\\=", "<=": "=<", "&&": ",", "||": ";"}
_JOINS: Final = {"and": "/\\", "or": "\\/", "shuffle": "|"}


def prolog(text: str) -> str:
    """Return an RML text as a Prolog module; raises `LanguageError`.

    >>> print(prolog("a matches {e: 'a'}; Main = a all;").splitlines()[-1])
        Main = (a_et*(1)).
    """
    program = parse(text)
    clauses = [clause for declaration in (*program.declarations, *s.EVERYWHERE) for clause in _clauses(declaration)]
    equations = ",\n    ".join(f"{e.name} = {_equation(e)}" for e in program.equations.values())
    return HEADER + "\n".join([*clauses, f"trace_expression('Main', Main) :-\n    {equations}.\n"])


def _clauses(declaration: s.Declaration) -> Iterator[str]:
    head = f"match(Event, {_type(declaration.name, [f'V_{name}' for name in declaration.parameters])})"
    goals: list[str] = []
    for one in declaration.alternatives:
        if isinstance(one, s.TypeUse):
            goals.append(f"match(Event, {_use(one, 'V_{}')})")
        else:
            goals += [f"fits(Event, {pattern})" for pattern in _patterns(one, "V_{}")]
    guard = [] if declaration.guard is None else [f"{{{_data(declaration.guard, 'V_{}')}}}"]
    if declaration.negated:
        yield f"{head} :- {', '.join([*(f'not({goal})' for goal in goals), *guard])}."
    else:
        yield from (f"{head} :- {', '.join([goal, *guard])}." for goal in goals)


def _equation(equation: s.Equation) -> str:
    body = s.fold(equation.body, _expression, lambda part: part.parts)
    return f"gen([{', '.join(equation.parameters)}], {body})" if equation.parameters else body


def _expression(part: s.Expression, inside: list[str]) -> str:
    match part.operator, part.data:
        case "empty", _:
            return "eps"
        case "all", _:
            return "1"
        case "event", use:
            return _use(use, "var({})")
        case "cat", _:
            return f"({'*('.join(inside)}{')' * len(inside)}"
        case "and" | "or" | "shuffle", _:
            first, *rest = inside
            return "(" * len(rest) + first + "".join(f"{_JOINS[part.operator]}{one})" for one in rest)
        case "times", number:
            return f"times({inside[0]}, {number})"
        case "closure", _:
            return f"clos({inside[0]})"
        case "filter", use:
            return f"(({_use(use, 'var({})')}>>{inside[0]});{inside[1]})"
        case "block", variable:
            return f"var({variable}, {inside[0]})"
        case "if", (condition, _):
            return f"guarded({_data(condition, 'var({})')}, {inside[0]}, {inside[1]})"
        case "call", (name, arguments, _):
            return f"app({name}, [{', '.join(_data(a, 'var({})') for a in arguments)}])" if arguments else name
        case "star" | "plus" | "optional", _:
            return f"{part.operator}({inside[0]})"
        case _:
            raise AssertionError(part.operator)


# Event types, data and literals; `variable` is a template for variables.


def _use(use: s.TypeUse, variable: str) -> str:
    return _type(use.name, (_patterns(parameter, variable)[0] for parameter in use.parameters))


def _type(name: str, arguments: Iterable[str]) -> str:
    given = ", ".join(arguments)
    return f"{name}_et({given})" if given else f"{name}_et"


def _patterns(value: s.Parameter, variable: str) -> list[str]:
    """Return one pattern per combination of `|` alternatives; the first field varies slowest."""

    def choices(part: s.Part, inside: list[list[str]]) -> list[str]:
        match part:
            case s.Fields(fields):
                keys = [_prolog_text(name, "'") for name, _ in fields]
                return [f"_{{{', '.join(map(':'.join, zip(keys, one, strict=True)))}}}" for one in product(*inside)]
            case s.Items((), more):
                return ["[_|_]" if more else "[]"]
            case s.Items(_, more):
                return [f"[{', '.join(one)}{'|_' if more else ''}]" for one in product(*inside)]
            case s.Either():
                return [one for found in inside for one in found]
            case s.Wildcard():
                return ["_"]
            case s.Constant() | s.Name():
                return [_data(part, variable)]
            case _:
                raise AssertionError(part)

    return [_data(value, variable)] if isinstance(value, s.Apply) else s.fold(value, choices)


def _data(data: s.Data, variable: str) -> str:
    def written(part: s.Data, inside: list[str]) -> str:
        match part:
            case s.Constant(value):
                return _constant(value)
            case s.Name(name):
                return variable.format(name)
            case s.Apply("neg"):
                return f"(-{inside[0]})"
            case s.Apply(operator) if operator.isalpha():
                return f"{operator}({', '.join(inside)})"
            case s.Apply(operator):
                return f"({inside[0]} {_DATA.get(operator, operator)} {inside[1]})"

    return s.fold(data, written)


def _constant(value: Json) -> str:
    match value:
        case str():
            return _prolog_text(value, '"')
        case bool() | None:
            return {True: "true", False: "false", None: "null"}[value]
        case float():
            digits, e, exponent = repr(value).partition("e")
            return digits + (".0" if "." not in digits else "") + e + exponent
        case number:
            return str(number)


def _prolog_text(text: str, quote: str) -> str:
    special = {"\\": "\\\\", quote: f"\\{quote}", "\n": "\\n", "\t": "\\t", "\r": "\\r"}
    return quote + "".join(special.get(c, c if c.isprintable() else f"\\x{ord(c):x}\\") for c in text) + quote


class RmlPrologBackend(RmlCapabilities):
    """The output of the published RML compiler for the text of `rml`, without running the compiler.

    The published monitor and ROSMonitoring's RML oracle load it. `read` runs the RML text that it
    was written from.
    """

    name: ClassVar[str] = "rml-prolog"
    language: ClassVar[str] = "rml-prolog"
    suffix: ClassVar[str] = ".pl"
    remark: ClassVar[str] = "% {}\n"
    highlighting: ClassVar[Highlighting] = Highlighting(
        "RMLProlog",
        # terms without spaces may be very long
        r"""
\lstdefinelanguage{RMLProlog}[]{Prolog}{
  breakatwhitespace=false,
}
""",
    )
    says: ClassVar[frozenset[type[Part]]] = RmlBackend.says
    form_of: ClassVar[str] = RmlBackend.name
    readable: ClassVar[bool] = False

    def write(self, prop: Property, semantics: Semantics, limit: int) -> SpecificationText:
        """Return the Prolog module."""
        made = RmlBackend().write(prop, semantics, limit)
        return SpecificationText(prolog(made.text), made.metrics, lambda _: RmlBackend().read(made.text))
