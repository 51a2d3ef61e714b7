"""The `rml-prolog` backend: what `rml` emits, in the form that RML's monitors load."""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from importlib.resources import files
from itertools import product
from time import perf_counter
from typing import Any, ClassVar, Final, TypeVar

from lark import Lark, Token, Transformer, v_args
from lark.exceptions import UnexpectedCharacters, UnexpectedInput

from backends.rml.backend import RmlBackend
from backends.rml.reader import syntax as s
from backends.rml.reader.event_types import ANY, NONE
from backends.rml.reader.monitor import RmlMonitor, Rules
from backends.rml.reader.parser import parse
from backends.rml.reader.static_checks import check
from rvaft.backend import Backend, Highlighting, Specification
from rvaft.errors import LanguageError
from rvaft.model.patterns import Pattern
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics
from rvaft.monitors import Monitor

# A fold over any tree of values, without recursion.

T = TypeVar("T")
R = TypeVar("R")


def fold(root: T, children: Callable[[T], Sequence[T]], step: Callable[[T, list[R]], R]) -> R:
    """The value of a tree from the values of its children."""
    order, todo = list[T](), [root]
    while todo:
        order.append(part := todo.pop())
        todo.extend(reversed(children(part)))
    done: list[R] = []
    for part in reversed(order):
        done.append(step(part, [done.pop() for _ in children(part)]))
    return done.pop()


# An RML text in the form the published monitor loads: `match/2` for the event types, `trace_expression/2` for the equations.
#
# Written from the syntax alone; it shares nothing with the reader's own rules. Source: the published compiler, by its output. One
# thing is different: the compiler's output calls the monitor's `deep_subdict(Event, Pattern)`, but the copy of the monitor that is
# ROSMonitoring's RML oracle has its arguments the other way round (and turns them once more inside nested patterns), so that a
# text which suits one matches hardly any event in the other. Here the text brings its own `fits/2`, which does what the published
# `deep_subdict` does, and means the same in both.

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


# Prolog text as plain terms, in the form that `writing` makes.

_ESCAPE: Final = re.compile(r"\\(?:x([0-9a-f]+)\\|(.))")
_CONTROLS: Final = {"n": "\n", "t": "\t", "r": "\r"}


@dataclass(frozen=True, slots=True, eq=False)
class Term:
    """`kind` says what it is, `word` is its name or operator, `value` that of a constant, `names` are the fields of an object."""

    kind: str
    word: str = ""
    parts: tuple["Term", ...] = ()
    value: Json = None
    names: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Clause:
    """A head and its goals."""

    head: Term
    goals: tuple[Term, ...]


def clauses(text: str) -> list[Clause]:
    """The clauses behind the header; raises `LanguageError` for what is not in this form."""
    if not text.startswith(HEADER):
        raise refusal("the text does not begin as rvaft writes it")
    try:
        found: Any = _parser().parse(text[len(HEADER) :])
    except UnexpectedInput as error:
        what = error.char if isinstance(error, UnexpectedCharacters) else str(getattr(error, "token", "")) or "the end"
        line, column = (error.line, error.column) if error.line > 0 else (text.count("\n") - HEADER.count("\n") + 1, 1)
        raise refusal(f"unexpected {what!r}", line + HEADER.count("\n"), column) from None
    return list(found)


def refusal(message: str, line: int = 1, column: int = 1) -> LanguageError:
    """The error for a text in any other form."""
    message += "; only Prolog that rvaft has written is read here, the published monitor runs any (`rml-published`)"
    return LanguageError(message, file="<rml-prolog>", line=line, column=column)


@cache
def _parser() -> Lark:
    grammar = files("backends.rml").joinpath("prolog_grammar.lark").read_text(encoding="utf-8")
    return Lark(grammar, parser="lalr", transformer=_Build())


def _unquoted(token: str) -> str:
    return _ESCAPE.sub(lambda m: chr(int(m[1], 16)) if m[1] else _CONTROLS.get(m[2], m[2]), token[1:-1])


def _terms(parts: tuple[Any, ...]) -> tuple[Term, ...]:
    return tuple(part for part in parts if isinstance(part, Term))


def _plain(kind: str) -> Any:
    def build(_self: "_Build", *parts: Any) -> Term:
        return Term(kind, parts=_terms(parts))

    return v_args(inline=True)(build)


@v_args(inline=True)
class _Build(Transformer[Token, Any]):
    """One method per rule; no logic beyond building the value."""

    guard = _plain("guard")
    ignored = _plain("ignored")
    list = _plain("list")
    open_list = _plain("open list")
    group = _plain("group")
    negative = _plain("negative")

    def start(self, *found: Clause) -> Any:
        return [*found]

    def clause(self, head: Term, *goals: Any) -> Clause:
        return Clause(head, _terms(goals))

    def equation(self, name: Token, body: Term) -> Term:
        return Term("equation", str(name), (body,))

    def compound(self, name: Token, *parts: Any) -> Term:
        return Term("compound", str(name), _terms(parts))

    def name(self, name: Token) -> Term:
        return Term("name", _unquoted(name) if name.type == "QUOTED" else str(name))

    def variable(self, name: Token) -> Term:
        return Term("variable", str(name))

    def string(self, token: Token) -> Term:
        return Term("constant", value=_unquoted(token))

    def number(self, token: Token) -> Term:
        return Term("constant", value=float(token) if "." in token else int(token))

    def field(self, name: Token, value: Term) -> tuple[str, Term]:
        return _unquoted(name), value

    def object(self, *fields: Any) -> Term:
        given = [field for field in fields if isinstance(field, tuple)]
        return Term("object", parts=tuple(part for _, part in given), names=tuple(name for name, _ in given))

    def operator(self, token: Token) -> str:
        return str(token)

    def operation(self, left: Term, operator: str, right: Term) -> Term:
        return Term("operation", operator, (left, right))


# The Prolog form back to the syntax of RML: the inverse of `writing`, so that RML's own rules run what was written.
#
# Alternatives of a pattern come back as declarations of their own, which means the same.

_READING_DATA: Final = {"=:=": "==", "=\\=": "!=", "=<": "<=", ",": "&&", ";": "||"}
_READING_JOINS: Final = {"/\\": "and", "\\/": "or", "|": "shuffle"}
_READING_REPEATS: Final = {"star": "star", "plus": "plus", "optional": "optional", "clos": "closure"}
_WORDS: Final[dict[str, bool | None]] = {"true": True, "false": False, "null": None}
_ADDED: Final = 2  # the event types `any` and `none`, which every specification has anyway


def read(text: str) -> Monitor:
    """A fresh monitor of a text in Prolog form, under the rules of the `rml` reader; raises `LanguageError`."""
    return RmlMonitor(_rules(text))


@lru_cache(maxsize=256)
def _rules(text: str) -> Rules:
    return Rules(program(text))


@lru_cache(maxsize=256)
def program(text: str) -> s.Program:
    """The specification that a text in Prolog form says; raises `LanguageError`."""
    *types, last = clauses(text)
    declarations = [_declaration(clause) for clause in types]
    if last.head.word != "trace_expression" or len(declarations) < _ADDED:
        raise refusal("there is no trace_expression at the end")
    equations = {goal.word: _reading_equation(goal) for goal in last.goals if goal.kind == "equation"}
    found = s.Program(tuple(declarations[:-_ADDED]), equations)
    check(found)
    return found


# -- event types -------------------------------------------------------------------------------------------------------


def _declaration(clause: Clause) -> s.Declaration:
    if clause.head.word != "match" or len(clause.head.parts) != 2:
        raise refusal(f"a clause for {clause.head.word}")
    use = _reading_use(clause.head.parts[1])
    negated = clause.goals[0].word == "not"
    values: list[s.Value] = []
    parents: list[s.TypeUse] = []
    guard = None
    for goal in clause.goals:
        match goal:
            case Term("guard", parts=(condition,)):
                guard = _reading_data(condition)
            case Term("compound", "not", (Term("compound", ("fits" | "match") as way, (_, what)),)) if negated:
                values += [_value(what)] if way == "fits" else []
                parents += [_reading_use(what)] if way == "match" else []
            case Term("compound", "fits", (_, what)) if not negated:
                values.append(_value(what))
            case Term("compound", "match", (_, what)) if not negated:
                parents.append(_reading_use(what))
            case _:
                raise refusal(f"the goal {goal.word or goal.kind} in a clause for {use.name}")
    names = tuple(parameter.name for parameter in use.parameters if isinstance(parameter, s.Name))
    return s.Declaration(use.name, names, negated, tuple(values), tuple(parents), guard)


def _reading_use(term: Term) -> s.TypeUse:
    name = term.word.removesuffix("_et")
    if term.kind not in ("name", "compound") or name == term.word:
        raise refusal(f"{term.word or term.kind} is no event type")
    return s.TypeUse(name, tuple(map(_parameter, term.parts)))


def _parameter(term: Term) -> s.Parameter:
    calculated = term.kind in ("operation", "negative") or (term.kind == "compound" and term.word != "var")
    return s.Unevaluated(_reading_data(term)) if calculated else _value(term)


def _value(root: Term) -> s.Value:
    def inside(term: Term) -> Sequence[Term]:
        return term.parts if term.kind in ("object", "list", "open list") else ()

    def build(term: Term, parts: list[s.Value]) -> s.Value:
        match term.kind:
            case "object":
                return s.Fields(tuple(zip(term.names, parts, strict=True)))
            case "open list" if [part.kind for part in term.parts] == ["ignored"]:
                return s.Items((), more=True)  # `[_|_]` asks for at least one item, as `[...]` does
            case "list" | "open list":
                return s.Items(tuple(parts), more=term.kind == "open list")
            case "ignored":
                return s.Ignored()
            case _:
                return _datum(term)

    return fold(root, inside, build)


# -- data --------------------------------------------------------------------------------------------------------------


def _datum(term: Term) -> s.Constant | s.Name:
    match term:
        case Term("constant", value=value):
            return s.Constant(value)
        case Term("name", word) if word in _WORDS:
            return s.Constant(_WORDS[word])
        case Term("variable", word) if word.startswith("V_"):
            return s.Name(word.removeprefix("V_"))
        case Term("compound", "var", (Term("name", name),)):
            return s.Name(name)
        case _:
            raise refusal(f"{term.word or term.kind} where a value should stand")


def _reading_data(root: Term) -> s.Data:
    def operands(term: Term) -> Sequence[Term]:
        named = term.kind == "compound" and term.word != "var"
        return term.parts if named or term.kind in ("operation", "negative", "group") else ()

    def build(term: Term, parts: list[s.Data]) -> s.Data:
        match term.kind:
            case "group":
                return parts[0]
            case "negative":
                return s.Apply("neg", tuple(parts))
            case "operation":
                return s.Apply(_READING_DATA.get(term.word, term.word), tuple(parts))
            case _:
                return s.Apply(term.word, tuple(parts)) if parts else _datum(term)

    return fold(root, operands, build)


# -- expressions -------------------------------------------------------------------------------------------------------


def _reading_equation(goal: Term) -> s.Equation:
    match goal.parts[0]:
        case Term("compound", "gen", (Term("list", parts=names), body)):
            return s.Equation(goal.word, tuple(name.word for name in names), _reading_expression(body), (1, 1))
        case body:
            return s.Equation(goal.word, (), _reading_expression(body), (1, 1))


def _reading_expression(root: Term) -> s.Expression:
    return fold(root, _reading_inside, _built)


def _reading_inside(term: Term) -> Sequence[Term]:
    match term:
        case Term("group", parts=parts):
            return parts
        case Term("operation", ";", (Term("operation", ">>", (_, kept)), rest)):
            return kept, rest
        case Term("operation", "*"):
            return _sequence(term)
        case Term("operation", word) if word in _READING_JOINS:
            return _operands(term)
        case Term("compound", "times", (body, _)):
            return (body,)
        case Term("compound", "var", (_, body)):
            return (body,)
        case Term("compound", "guarded", (_, *branches)):
            return branches
        case Term("compound", word, parts) if word in _READING_REPEATS:
            return parts
        case _:
            return ()


def _sequence(term: Term) -> list[Term]:
    """The parts of `(a*(b*(c)))`: what stands in parentheses of its own is the last one."""
    parts = []
    while term.kind == "operation" and term.word == "*":
        parts.append(term.parts[0])
        term = term.parts[1]
    return [*parts, term]


def _operands(term: Term) -> list[Term]:
    r"""The parts of `((a/\b)/\c)`."""
    parts, word = list[Term](), term.word
    while term.kind == "operation" and term.word == word:
        parts.append(term.parts[1])
        term = term.parts[0]
    return [term, *reversed(parts)]


def _built(term: Term, parts: list[s.Expression]) -> s.Expression:
    match term:
        case Term("group"):
            return parts[0]
        case Term("constant", value=1):
            return s.Leaf("all")
        case Term("name", "eps"):
            return s.Leaf("empty")
        case Term("variable", word):
            return s.Reference(word)
        case Term("operation", ";", (Term("operation", ">>", (use, _)), _)):
            return s.Filtered(_reading_use(use), *parts)
        case Term("operation", "*"):
            return s.Joined("cat", tuple(parts))
        case Term("operation", word) if word in _READING_JOINS:
            return s.Joined(_READING_JOINS[word], tuple(parts))
        case Term("compound", "times", (_, Term("constant", value=int() as number))):
            return s.Repeated("times", parts[0], number)
        case Term("compound", "var", (Term("name", name), _)):
            return s.Block(name, parts[0])
        case Term("compound", "guarded", (condition, _, _)):
            return s.Conditional(_reading_data(condition), *parts)
        case Term("compound", "app", (Term("variable", name), Term("list", parts=arguments))):
            return s.Reference(name, tuple(map(_reading_data, arguments)))
        case Term("compound", word) if word in _READING_REPEATS:
            return s.Repeated(_READING_REPEATS[word], parts[0])
        case _:
            return s.Occurs(_reading_use(term))


# The `rml-prolog` backend: the text of `rml` as the Prolog module that the published monitor loads.


class RmlPrologBackend(Backend):
    """What the published RML compiler would make of the text of `rml`, ready to load without a compiler.

    The published monitor and ROSMonitoring's RML oracle both load it. It expresses what `rml` expresses, within the same limit.
    """

    name: ClassVar[str] = "rml-prolog"
    language: ClassVar[str] = "rml-prolog"
    suffix: ClassVar[str] = ".pl"
    highlighting: ClassVar[Highlighting] = Highlighting(
        "RMLProlog",
        # Terms without any space are as long as lines can get.
        r"""
\lstdefinelanguage{RMLProlog}[]{Prolog}{
  breakatwhitespace=false,
}
""",
    )
    form_of: ClassVar[str] = RmlBackend.name
    default_limit: ClassVar[int] = RmlBackend.default_limit

    def translate(self, tree: RVAFT, semantics: Semantics, *, limit: int | None = None) -> Specification:
        """The tree as a Prolog module; raises `NotExpressible` and `TooLarge`."""
        start = perf_counter()
        made = RmlBackend().translate(tree, semantics, limit=limit)
        text = prolog(made.text)
        return Specification(text, self.language, replace(made.metrics, seconds=perf_counter() - start), self.read)

    def read(self, text: str, *, atoms: Mapping[str, Pattern] | None = None) -> Monitor:  # noqa: ARG002
        """A monitor that runs a text that this backend has written, under the rules of RML; raises `LanguageError` for other Prolog.

        Only the published monitor itself runs any Prolog form, be it written by hand or by the published compiler.
        """
        return read(text)

    def masked(self, text: str, trace: Sequence[Json]) -> tuple[str, ...]:
        """As that of `rml`."""
        from backends.rml.reader.deviations import touching  # noqa: PLC0415 -- imported on use

        return tuple(deviation.title for deviation in touching(program(text), trace))


__all__ = ["RmlPrologBackend"]
