"""A parser from RML text to `syntax`, by the published grammar."""

import math
import re
from collections.abc import Iterable, Iterator
from functools import cache, lru_cache
from importlib.resources import files
from typing import Any, Final

from lark import Lark, Token, Transformer, Tree
from lark.exceptions import UnexpectedCharacters, UnexpectedEOF, UnexpectedInput, UnexpectedToken, VisitError

from backends.rml.reader import syntax as s
from rvaft.errors import LanguageError

_ESCAPES: Final = {"t": "\t", "r": "\r", "n": "\n", "'": "'", "\\": "\\"}
_SIGNS: Final = {
    "any_of": "||", "all_of": "&&", "ne": "!=", "eq": "==", "ge": ">=", "gt": ">", "le": "<=", "lt": "<",
    "sub": "-", "add": "+", "div": "/", "mul": "*", "neg": "neg", "pow": "^",
}  # fmt: skip
"""Operators, by rule names of the grammar."""
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
_LITERALS: Final = {"LOWER", "INT", "FLOAT", "BOOLEAN", "_NULL", "STRING", "_IGNORED"}


def _string(token: str) -> str:
    return re.sub(r"\\(.)", lambda escape: _ESCAPES[escape[1]], token[1:-1])


def _place(token: Token) -> s.Position:
    return token.line or 1, token.column or 1


def _declaration(use: s.TypeUse, no: Token | None, found: Any, guard: s.Data | None) -> s.Declaration:
    names = tuple(parameter.name for parameter in use.parameters if isinstance(parameter, s.Name))
    if len(names) < len(use.parameters):
        raise s.refusal(f"the parameters of {use.name} must be names where it is declared", use.place)
    types = [one for one in found if isinstance(one, s.TypeUse)]
    if len(types) < len(found):  # a name beside a pattern is a variable for the whole event
        for one in types:
            if one.parameters:
                raise s.refusal(f"the event type {one.name} cannot stand beside a pattern", one.place)
        found = tuple(s.Name(one.name) if isinstance(one, s.TypeUse) else one for one in found)
    return s.Declaration(use.name, names, no is not None, found, guard)


def _argument(given: s.Parameter) -> s.Parameter:
    match given:
        case s.Apply("neg", (s.Constant(int() | float() as value),)) if not isinstance(value, bool):
            return s.Constant(-value)
        case _:
            return given


def _number(token: Token) -> int | float:
    try:
        value = int(token) if token.type == "INT" else float(token)
    except ValueError:
        raise s.refusal("a number with too many digits", _place(token)) from None
    if math.isinf(value):
        raise s.refusal("a number that is too large", _place(token))
    return value


def _distinct(named: Iterable[tuple[str, s.Position, Any]], message: str) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, place, value in named:
        if name in found:
            raise s.refusal(message.format(name), place)
        found[name] = value
    return found


class _RmlSyntax(Transformer[Token, Any]):
    """Maps grammar rules to `syntax`; other rules become operators on their parts."""

    def __default__(self, rule: str, parts: list[Any], _meta: Any) -> Any:
        match str(rule), parts:
            case "start", _:
                equations = [(part.name, part.place, part) for part in parts if isinstance(part, s.Equation)]
                declarations = tuple(part for part in parts if isinstance(part, s.Declaration))
                return s.RmlProgram(declarations, _distinct(equations, "{} is defined twice"))
            case "declaration", _:
                return _declaration(*parts)
            case "alternatives" | "parameters" | "choices" | "generics", _:
                return tuple(parts)
            case "type", [name, *given]:
                return s.TypeUse(str(name), tuple(map(_argument, *given)) if given else (), _place(name))
            case "either", _:
                return s.Either(tuple(parts))
            case "object", _:
                return s.Fields(tuple(_distinct(filter(None, parts), "the field {!r} is given twice").items()))
            case "field", [name, value]:
                return (_string(name) if name.type == "STRING" else str(name)), _place(name), value
            case "list" | "open_list", _:
                return s.Items(tuple(parts), more=rule == "open_list")
            case "ignored", _:
                return s.Wildcard()
            case "null", _:
                return s.Constant(None)
            case "string", [token]:
                return s.Constant(_string(token))
            case "number", [token]:
                return s.Constant(_number(token))
            case "boolean", [word]:
                return s.Constant(word == "true")
            case "variable", [token]:
                return s.Name(str(token))
            case "pow_neg", [base, exponent]:
                return s.Apply("^", (base, s.Apply("neg", (exponent,))))
            case "function", [name, *operands]:
                if len(operands) != (2 if name in ("min", "max") else 1):
                    raise s.refusal(f"{name} has the wrong number of arguments", _place(name))
                return s.Apply(str(name), tuple(operands))
            case "times", [body, number]:
                return s.Expression("times", (body,), number.value)
            case "event", [use]:
                return s.Expression("event", (), use)
            case "filter", [use, inside, *outside]:
                return s.Expression("filter", (inside, *(outside or [s.Expression("all")])), use)
            case "block", [*variables, whole]:
                for name in reversed(variables):
                    whole = s.Expression("block", (whole,), str(name))
                return whole
            case "conditional", [condition, yes, no]:
                return s.Expression("if", (yes, no), (condition, ()))
            case "call", [name, *given]:
                return s.Expression("call", (), (str(name), tuple(filter(None, given)), ()), _place(name))
            case "equation", [name, generics, body]:
                return s.Equation(str(name), tuple(map(str, generics or ())), body, _place(name))
            case name, _ if name in _SIGNS:
                return s.Apply(_SIGNS[name], tuple(parts))
            case name, _:  # Lark's own rules for repetitions begin with `_`
                return Tree(name, parts) if name.startswith("_") else s.Expression(name, tuple(parts))


@lru_cache(maxsize=64)
def parse(text: str) -> s.RmlProgram:
    """Return the specification (cached).

    Raises `LanguageError` with line and column for malformed texts and those that cannot run, and
    `TooLarge`.

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
    s.check(program)
    return program


@cache
def _parser() -> Lark:
    grammar = files("backends.rml.reader").joinpath("grammar.lark").read_text(encoding="utf-8")
    starts = ["start", "parameters", "choices"]
    return Lark(grammar, parser="lalr", lexer="basic", start=starts, transformer=_RmlSyntax(), postlex=_LookAhead())


class _LookAhead:
    """Distinguishes parentheses of parameters from groups, and braces of blocks from repetition
    counts.
    """

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
    if all(token.type in _LITERALS if index % 2 == 0 else token.type == "COMMA" for index, token in enumerate(tokens)):
        return len(tokens) % 2 == 1
    for start in ("parameters", "choices"):
        parser = _parser().parse_interactive("", start=start)
        try:
            for token in (*tokens, Token("$END", "")):
                parser.feed_token(token)
        except (UnexpectedInput, LanguageError):
            continue
        return True
    return False


def _language_error(text: str, error: UnexpectedInput) -> LanguageError:
    def expected(terminals: Any) -> str:
        return " or ".join(sorted({_WORDS[name] for name in terminals if name in _WORDS} or {"something else"}))

    lines = text.splitlines() or [""]
    line, column = error.line, error.column
    if isinstance(error, UnexpectedCharacters):
        message = f"unexpected character {error.char!r}"
    elif isinstance(error, UnexpectedToken) and error.token.type != "$END":
        message = f"unexpected {str(error.token)!r}; expected {expected(error.accepts or error.expected)}"
    else:
        line, column = len(lines), len(lines[-1]) + 1
        terminals = error.expected if isinstance(error, UnexpectedEOF | UnexpectedToken) else ()
        message = f"the specification ends too early; expected {expected(terminals)}"
    source = lines[line - 1] if 0 < line <= len(lines) else ""
    return LanguageError(message, file="<rml>", line=line, column=column, source=source[:200])
