"""From RML text to `syntax.Program`, by the published grammar."""

import math
from collections.abc import Iterator
from functools import cache, lru_cache
from importlib.resources import files
from typing import Any, Final

from lark import Lark, Token, Transformer, v_args
from lark.exceptions import UnexpectedCharacters, UnexpectedEOF, UnexpectedInput, UnexpectedToken, VisitError

from backends.rml.reader import syntax as s
from rvaft.errors import LanguageError

# From the rules of the grammar to the values of `syntax`, one method for each rule.

_ESCAPES: Final = {"t": "\t", "r": "\r", "n": "\n", "'": "'", "\\": "\\"}


def _string(token: str) -> str:
    """What a quoted string stands for."""
    parts, escaped = [], False
    for character in token[1:-1]:
        parts.append(_ESCAPES[character] if escaped else "" if character == "\\" else character)
        escaped = not escaped and character == "\\"
    return "".join(parts)


def _place(token: Token) -> tuple[int, int]:
    return token.line or 1, token.column or 1


def _refuse(message: str, place: tuple[int, int]) -> LanguageError:
    return LanguageError(message, file="<rml>", line=place[0], column=place[1])


def _parameter(given: Any) -> s.Parameter:
    """An argument of an event type: only literals and variables have a value."""
    match given:
        case s.Apply("neg", (s.Constant(int() | float() as value),)) if not isinstance(value, bool):
            return s.Constant(-value)
        case s.Apply():
            return s.Unevaluated(given)
        case parameter:
            found: s.Parameter = parameter
            return found


def _whole(use: s.TypeUse) -> s.Value:
    """A name beside a pattern, where no event type can stand, is a variable for the whole event."""
    if use.parameters:
        raise _refuse(f"the event type {use.name} cannot stand beside a pattern", use.place)
    return s.Name(use.name)


@v_args(inline=True)
class _Build(Transformer[Token, Any]):
    """One method per rule; no logic beyond building the value."""

    def start(self, *parts: Any) -> s.Program:
        declarations = tuple(part for part in parts if isinstance(part, s.Declaration))
        equations: dict[str, s.Equation] = {}
        for part in parts:
            if isinstance(part, s.Equation):
                if part.name in equations:
                    raise _refuse(f"{part.name} is defined twice", part.place)
                equations[part.name] = part
        return s.Program(declarations, equations)

    # -- event types
    def declaration(
        self, use: s.TypeUse, no: Token | None, _m: Token, alternatives: Any, _w: Token | None, guard: s.Data | None
    ) -> s.Declaration:
        names = tuple(parameter.name for parameter in use.parameters if isinstance(parameter, s.Name))
        if len(names) < len(use.parameters):
            raise _refuse(f"the parameters of {use.name} must be names where it is declared", use.place)
        parents = tuple(one for one in alternatives if isinstance(one, s.TypeUse))
        if len(parents) == len(alternatives):
            return s.Declaration(use.name, names, no is not None, (), parents, guard)
        values = tuple(_whole(one) if isinstance(one, s.TypeUse) else one for one in alternatives)
        return s.Declaration(use.name, names, no is not None, values, (), guard)

    def alternatives(self, *alternatives: Any) -> tuple[Any, ...]:
        return alternatives

    def type(self, name: Token, _call: Token | None = None, parameters: tuple[Any, ...] = ()) -> s.TypeUse:
        return s.TypeUse(str(name), tuple(map(_parameter, parameters)), _place(name))

    def parameters(self, *parameters: Any) -> tuple[Any, ...]:
        return parameters

    def values(self, *values: s.Value) -> s.Value:
        return values[0] if len(values) == 1 else s.Either(values)

    def group(self, value: s.Value) -> s.Value:
        return value

    def choices(self, *values: s.Value) -> tuple[s.Value, ...]:
        return values

    def object(self, *fields: Any) -> s.Fields:
        names: set[str] = set()
        for name, place, _ in (given := [field for field in fields if field is not None]):
            if name in names:
                raise _refuse(f"the field {name!r} is given twice", place)
            names.add(name)
        return s.Fields(tuple((name, value) for name, _, value in given))

    def field(self, name: Token, value: s.Value) -> tuple[str, tuple[int, int], s.Value]:
        return (_string(name) if name.type == "STRING" else str(name)), _place(name), value

    def empty_list(self) -> s.Items:
        return s.Items(())

    def any_list(self, _e: Token) -> s.Items:
        return s.Items((), more=True)

    def list(self, *items: s.Value) -> s.Items:
        return s.Items(items)

    def open_list(self, *items: Any) -> s.Items:
        return s.Items(items[:-1], more=True)

    # -- data
    def string(self, token: Token) -> s.Constant:
        return s.Constant(_string(token))

    def ignored(self, _t: Token) -> s.Ignored:
        return s.Ignored()

    def integer(self, token: Token) -> s.Constant:
        try:
            return s.Constant(int(token))
        except ValueError:
            raise _refuse("a number with too many digits", _place(token)) from None

    def float(self, token: Token) -> s.Constant:
        if math.isinf(value := float(token)):
            raise _refuse("a number that is too large", _place(token))
        return s.Constant(value)

    def boolean(self, word: Token) -> s.Constant:
        return s.Constant(word == "true")

    def null(self, _t: Token) -> s.Constant:
        return s.Constant(None)

    def variable(self, token: Token) -> s.Name:
        return s.Name(str(token))

    def pow_neg(self, base: s.Data, exponent: s.Data) -> s.Apply:
        return s.Apply("^", (base, s.Apply("neg", (exponent,))))

    def call(self, function: Token, *operands: s.Data) -> s.Apply:
        if len(operands) != (2 if function in ("min", "max") else 1):
            raise _refuse(f"{function} has the wrong number of arguments", _place(function))
        return s.Apply(str(function), operands)

    # -- expressions
    def shuffle(self, *parts: s.Expression) -> s.Expression:
        return parts[0] if len(parts) == 1 else s.Joined("shuffle", parts)

    def union(self, *parts: s.Expression) -> s.Expression:
        return parts[0] if len(parts) == 1 else s.Joined("or", parts)

    def both(self, *parts: s.Expression) -> s.Expression:
        return parts[0] if len(parts) == 1 else s.Joined("and", parts)

    def sequence(self, *parts: s.Expression) -> s.Expression:
        return parts[0] if len(parts) == 1 else s.Joined("cat", parts)

    def star(self, body: s.Expression) -> s.Repeated:
        return s.Repeated("star", body)

    def plus(self, body: s.Expression) -> s.Repeated:
        return s.Repeated("plus", body)

    def optional(self, body: s.Expression) -> s.Repeated:
        return s.Repeated("optional", body)

    def closure(self, body: s.Expression) -> s.Repeated:
        return s.Repeated("closure", body)

    def times(self, body: s.Expression, number: s.Constant) -> s.Repeated:
        return s.Repeated("times", body, number.value)

    def event(self, use: s.TypeUse) -> s.Occurs:
        return s.Occurs(use)

    def filter(self, use: s.TypeUse, inside: s.Expression, outside: s.Expression | None = None) -> s.Filtered:
        return s.Filtered(use, inside, outside or s.Leaf("all"))

    def empty(self, _t: Token) -> s.Leaf:
        return s.Leaf("empty")

    def all(self, _t: Token) -> s.Leaf:
        return s.Leaf("all")

    def block(self, _b: Token, _l: Token, *parts: Any) -> s.Expression:
        body: s.Expression = parts[-1]
        for name in reversed(parts[:-1]):
            body = s.Block(str(name), body)
        return body

    def conditional(
        self, _i: Token, condition: s.Data, yes: s.Expression, _e: Token, no: s.Expression
    ) -> s.Conditional:
        return s.Conditional(condition, yes, no)

    def reference(self, name: Token) -> s.Reference:
        return s.Reference(str(name), (), _place(name))

    def application(self, name: Token, *arguments: s.Data) -> s.Reference:
        return s.Reference(str(name), arguments, _place(name))

    def generics(self, *names: Token) -> tuple[str, ...]:
        return tuple(map(str, names))

    def equation(self, name: Token, parameters: tuple[str, ...] | None, body: s.Expression) -> s.Equation:
        return s.Equation(str(name), parameters or (), body, _place(name))


def _operator(sign: str) -> Any:
    def build(_self: _Build, *operands: s.Data) -> s.Apply:
        return s.Apply(sign, operands)

    return v_args(inline=True)(build)


for _rule, _sign in {
    "or_": "||", "and_": "&&", "ne": "!=", "eq": "==", "ge": ">=", "gt": ">", "le": "<=", "lt": "<",
    "sub": "-", "add": "+", "div": "/", "mul": "*", "neg": "neg", "pow": "^",
}.items():  # fmt: skip
    setattr(_Build, _rule, _operator(_sign))

BUILD: Final = _Build()
"""Builds a `syntax.Program` while the text is parsed; it keeps nothing between two texts."""

_WORDS: Final = {
    "SEMICOLON": "';'",
    "LOWER": "a name in lower case",
    "UPPER": "the name of an equation (upper case)",
    "MATCHES": "'matches'",
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
_LITERALS: Final = {"LOWER", "INT", "FLOAT", "BOOLEAN", "NULL", "STRING", "IGNORED"}


@lru_cache(maxsize=_REMEMBERED)
def parse(text: str) -> s.Program:
    """The specification; raises `LanguageError` with line, column and what was expected."""
    try:
        program = _parser().parse(text, start="start")
    except UnexpectedInput as error:
        raise _language_error(text, error) from None
    except VisitError as error:
        raise error.orig_exc from None
    assert isinstance(program, s.Program)
    return program


@cache
def _parser() -> Lark:
    grammar = files("backends.rml.reader").joinpath("grammar.lark").read_text(encoding="utf-8")
    return Lark(
        grammar,
        parser="lalr",
        lexer="basic",
        start=["start", "parameters", "choices"],
        transformer=BUILD,
        postlex=_LookAhead(),
    )


class _LookAhead:
    """Tells a parenthesis that opens parameters from one that groups, and a brace that opens a block from one that counts."""

    always_accept = ()

    def process(self, stream: Iterator[Token]) -> Iterator[Token]:
        tokens = list(stream)
        closing = _closing(tokens)
        for index, token in enumerate(tokens):
            opens = token.type == "LPAR" and index and tokens[index - 1].type == "LOWER" and index in closing
            if opens and _are_parameters(tokens[index + 1 : closing[index]]):
                yield Token.new_borrow_pos("CALL", token.value, token)
            elif token.type == "LBRACE" and index + 1 < len(tokens) and tokens[index + 1].type == "LET":
                yield Token.new_borrow_pos("BLOCK", token.value, token)
            else:
                yield token


def _closing(tokens: list[Token]) -> dict[int, int]:
    opened: list[int] = []
    closing: dict[int, int] = {}
    for index, token in enumerate(tokens):
        if token.type == "LPAR":
            opened.append(index)
        elif token.type == "RPAR" and opened:
            closing[opened.pop()] = index
    return closing


def _are_parameters(tokens: list[Token]) -> bool:
    """Whether the tokens between two parentheses can be read as parameters of an event type."""
    if all(
        (token.type == "COMMA") is bool(i % 2) and (i % 2 or token.type in _LITERALS) for i, token in enumerate(tokens)
    ):
        return len(tokens) % 2 == 1
    return _derives("parameters", tokens) or _derives("choices", tokens)


def _derives(start: str, tokens: list[Token]) -> bool:
    parser = _parser().parse_interactive("", start=start)
    try:
        for token in tokens:
            parser.feed_token(token)
        parser.feed_token(Token("$END", ""))
    except (UnexpectedInput, LanguageError):
        return False
    return True


def _language_error(text: str, error: UnexpectedInput) -> LanguageError:
    lines = text.splitlines() or [""]
    if isinstance(error, UnexpectedCharacters):
        line, column = error.line, error.column
        message = f"unexpected character {error.char!r}"
    elif isinstance(error, UnexpectedToken) and error.token.type != "$END":
        line, column = error.line, error.column
        message = f"unexpected {str(error.token)!r}; expected {_expected(error.accepts or error.expected)}"
    else:
        line, column = len(lines), len(lines[-1]) + 1
        expected = error.expected if isinstance(error, (UnexpectedEOF, UnexpectedToken)) else ()
        message = f"the specification ends too early; expected {_expected(expected)}"
    source = lines[line - 1] if 0 < line <= len(lines) else ""
    return LanguageError(message, file="<rml>", line=line, column=column, source=source[:200])


def _expected(terminals: Any) -> str:
    words = sorted({_WORDS[name] for name in terminals if name in _WORDS} or {"something else"})
    return " or ".join(words)
