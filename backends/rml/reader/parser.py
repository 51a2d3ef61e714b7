"""From RML text to `syntax.RmlProgram`, by the published grammar."""

import math
import re
from collections.abc import Iterator
from functools import cache, lru_cache
from importlib.resources import files
from typing import Any, Final

from lark import Lark, Token, Transformer, Tree, v_args
from lark.exceptions import UnexpectedCharacters, UnexpectedEOF, UnexpectedInput, UnexpectedToken, VisitError

from backends.rml.reader import syntax as s
from rvaft.errors import LanguageError

_ESCAPES: Final = {"t": "\t", "r": "\r", "n": "\n", "'": "'", "\\": "\\"}
_SIGNS: Final = {
    "any_of": "||", "all_of": "&&", "ne": "!=", "eq": "==", "ge": ">=", "gt": ">", "le": "<=", "lt": "<",
    "sub": "-", "add": "+", "div": "/", "mul": "*", "neg": "neg", "pow": "^",
}  # fmt: skip
"""The operators of data, by the names that the grammar gives them."""


def _string(token: str) -> str:
    """What a quoted string stands for."""
    return re.sub(r"\\(.)", lambda escape: _ESCAPES[escape[1]], token[1:-1])


def _place(token: Token) -> s.Position:
    return token.line or 1, token.column or 1


def refusal(message: str, place: s.Position = (1, 1)) -> LanguageError:
    """The error for a text that is no RML, or that cannot run."""
    return LanguageError(message, file="<rml>", line=place[0], column=place[1])


def _parameter(given: s.Parameter) -> s.Parameter:
    """An argument of an event type: a number may have a sign, nothing else is calculated."""
    match given:
        case s.Apply("neg", (s.Constant(int() | float() as value),)) if not isinstance(value, bool):
            return s.Constant(-value)
        case _:
            return given


def _pattern(alternative: s.Value | s.TypeUse) -> s.Value:
    """A name beside a pattern, where no event type can stand, is a variable for the whole event."""
    if not isinstance(alternative, s.TypeUse):
        return alternative
    if alternative.parameters:
        raise refusal(f"the event type {alternative.name} cannot stand beside a pattern", alternative.place)
    return s.Name(alternative.name)


@v_args(inline=True)
class _RmlSyntax(Transformer[Token, Any]):
    """From the rules of the grammar to the values of `syntax`; rules without a method are operators on their parts."""

    def __default__(self, rule: str, parts: Any, _meta: Any) -> Any:
        if rule.startswith("_"):  # a rule of Lark's own, for a repetition
            return Tree(rule, parts)
        return s.Apply(_SIGNS[rule], tuple(parts)) if rule in _SIGNS else s.Expression(str(rule), tuple(parts))

    def start(self, *parts: s.Declaration | s.Equation) -> s.RmlProgram:
        equations: dict[str, s.Equation] = {}
        for equation in (part for part in parts if isinstance(part, s.Equation)):
            if equations.setdefault(equation.name, equation) is not equation:
                raise refusal(f"{equation.name} is defined twice", equation.place)
        return s.RmlProgram(tuple(part for part in parts if isinstance(part, s.Declaration)), equations)

    # -- event types
    def declaration(self, use: s.TypeUse, no: Token | None, found: Any, guard: s.Data | None) -> s.Declaration:
        names = tuple(parameter.name for parameter in use.parameters if isinstance(parameter, s.Name))
        if len(names) < len(use.parameters):
            raise refusal(f"the parameters of {use.name} must be names where it is declared", use.place)
        if not all(isinstance(one, s.TypeUse) for one in found):
            found = tuple(map(_pattern, found))
        return s.Declaration(use.name, names, no is not None, found, guard)

    def alternatives(self, *alternatives: Any) -> tuple[Any, ...]:
        return alternatives

    parameters = choices = generics = alternatives

    def type(self, name: Token, parameters: tuple[Any, ...] = ()) -> s.TypeUse:
        return s.TypeUse(str(name), tuple(map(_parameter, parameters)), _place(name))

    def values(self, *values: s.Value) -> s.Value:
        return values[0] if len(values) == 1 else s.Either(values)

    def group(self, value: s.Value) -> s.Value:
        return value

    def object(self, *fields: Any) -> s.Fields:
        given: dict[str, s.Value] = {}
        for name, place, value in (field for field in fields if field is not None):
            if name in given:
                raise refusal(f"the field {name!r} is given twice", place)
            given[name] = value
        return s.Fields(tuple(given.items()))

    def field(self, name: Token, value: s.Value) -> tuple[str, s.Position, s.Value]:
        return (_string(name) if name.type == "STRING" else str(name)), _place(name), value

    def list(self, *items: s.Value) -> s.Items:
        return s.Items(items)

    def open_list(self, *items: s.Value) -> s.Items:
        return s.Items(items, more=True)

    # -- data
    def string(self, token: Token) -> s.Constant:
        return s.Constant(_string(token))

    def ignored(self) -> s.Ignored:
        return s.Ignored()

    def integer(self, token: Token) -> s.Constant:
        try:
            return s.Constant(int(token))
        except ValueError:
            raise refusal("a number with too many digits", _place(token)) from None

    def float(self, token: Token) -> s.Constant:
        if math.isinf(value := float(token)):
            raise refusal("a number that is too large", _place(token))
        return s.Constant(value)

    def boolean(self, word: Token) -> s.Constant:
        return s.Constant(word == "true")

    def null(self) -> s.Constant:
        return s.Constant(None)

    def variable(self, token: Token) -> s.Name:
        return s.Name(str(token))

    def pow_neg(self, base: s.Data, exponent: s.Data) -> s.Apply:
        return s.Apply("^", (base, s.Apply("neg", (exponent,))))

    def call(self, function: Token, *operands: s.Data) -> s.Apply:
        if len(operands) != (2 if function in ("min", "max") else 1):
            raise refusal(f"{function} has the wrong number of arguments", _place(function))
        return s.Apply(str(function), operands)

    # -- expressions
    def times(self, body: s.Expression, number: s.Constant) -> s.Expression:
        return s.Expression("times", (body,), number.value)

    def event(self, use: s.TypeUse) -> s.Expression:
        return s.Expression("event", (), use)

    def filter(self, use: s.TypeUse, inside: s.Expression, outside: s.Expression | None = None) -> s.Expression:
        return s.Expression("filter", (inside, outside or s.Expression("all")), use)

    def block(self, *parts: Any) -> s.Expression:
        *variables, whole = parts
        for name in reversed(variables):
            whole = s.Expression("block", (whole,), str(name))
        body: s.Expression = whole
        return body

    def conditional(self, condition: s.Data, yes: s.Expression, no: s.Expression) -> s.Expression:
        return s.Expression("if", (yes, no), (condition, ()))

    def reference(self, name: Token, *arguments: s.Data | None) -> s.Expression:
        given = tuple(argument for argument in arguments if argument is not None)
        return s.Expression("call", (), (str(name), given, ()), _place(name))

    def equation(self, name: Token, parameters: tuple[Token, ...] | None, body: s.Expression) -> s.Equation:
        return s.Equation(str(name), tuple(map(str, parameters or ())), body, _place(name))


_WORDS: Final = {
    "SEMICOLON": "';'",
    "LOWER": "a name in lower case",
    "UPPER": "the name of an equation (upper case)",
    "_MATCHES": "'matches'",
    "RPAR": "')'",
    "RBRACE": "'}'",
    "EQUAL": "'='",
    "COMMA": "','",
    "COLON": "':'",
    "STRING": "a string in single quotes",
    "INT": "a number",
    "FLOAT": "a number",
    "$END": "the end",
}
_REMEMBERED: Final = 64
"""Texts of which the parts are kept: whoever runs a text asks several things of it."""
_LITERALS: Final = {"LOWER", "INT", "FLOAT", "BOOLEAN", "_NULL", "STRING", "_IGNORED"}


@lru_cache(maxsize=_REMEMBERED)
def parse(text: str) -> s.RmlProgram:
    """The specification; raises `LanguageError` with line, column and what was expected.

    >>> list(parse("a matches {e: 'a'}; Main = a all;").equations)
    ['Main']
    """
    try:
        program: Any = _parser().parse(text, start="start")
    except UnexpectedInput as error:
        raise _language_error(text, error) from None
    except VisitError as error:
        raise error.orig_exc from None
    assert isinstance(program, s.RmlProgram)
    return program


@cache
def _parser() -> Lark:
    grammar = files("backends.rml.reader").joinpath("grammar.lark").read_text(encoding="utf-8")
    starts = ["start", "parameters", "choices"]
    return Lark(grammar, parser="lalr", lexer="basic", start=starts, transformer=_RmlSyntax(), postlex=_LookAhead())


class _LookAhead:
    """Tells a parenthesis that opens parameters from one that groups, and a brace that opens a block from one that counts."""

    always_accept = ()

    def process(self, stream: Iterator[Token]) -> Iterator[Token]:
        tokens = list(stream)
        closing: dict[int, int] = {}
        opened: list[int] = []
        for index, token in enumerate(tokens):
            if token.type == "LPAR":
                opened.append(index)
            elif token.type == "RPAR" and opened:
                closing[opened.pop()] = index
        for index, token in enumerate(tokens):
            opens = index in closing and index and tokens[index - 1].type == "LOWER"
            if opens and _are_parameters(tokens[index + 1 : closing[index]]):
                yield Token.new_borrow_pos("_CALL", token.value, token)
            elif token.type == "LBRACE" and index + 1 < len(tokens) and tokens[index + 1].type == "_LET":
                yield Token.new_borrow_pos("_BLOCK", token.value, token)
            else:
                yield token


def _are_parameters(tokens: list[Token]) -> bool:
    """Whether the tokens between two parentheses can be read as parameters of an event type."""
    if all(token.type in _LITERALS if index % 2 == 0 else token.type == "COMMA" for index, token in enumerate(tokens)):
        return len(tokens) % 2 == 1
    return _derives("parameters", tokens) or _derives("choices", tokens)


def _derives(start: str, tokens: list[Token]) -> bool:
    parser = _parser().parse_interactive("", start=start)
    try:
        for token in (*tokens, Token("$END", "")):
            parser.feed_token(token)
    except (UnexpectedInput, LanguageError):
        return False
    return True


def _language_error(text: str, error: UnexpectedInput) -> LanguageError:
    lines = text.splitlines() or [""]
    line, column = error.line, error.column
    if isinstance(error, UnexpectedCharacters):
        message = f"unexpected character {error.char!r}"
    elif isinstance(error, UnexpectedToken) and error.token.type != "$END":
        message = f"unexpected {str(error.token)!r}; expected {_expected(error.accepts or error.expected)}"
    else:
        line, column = len(lines), len(lines[-1]) + 1
        expected = error.expected if isinstance(error, UnexpectedEOF | UnexpectedToken) else ()
        message = f"the specification ends too early; expected {_expected(expected)}"
    source = lines[line - 1] if 0 < line <= len(lines) else ""
    return LanguageError(message, file="<rml>", line=line, column=column, source=source[:200])


def _expected(terminals: Any) -> str:
    return " or ".join(sorted({_WORDS[name] for name in terminals if name in _WORDS} or {"something else"}))
