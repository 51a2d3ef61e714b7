"""Prolog text as plain terms, in the form that `writing` makes."""

import re
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any, Final

from lark import Lark, Token, Transformer, v_args
from lark.exceptions import UnexpectedCharacters, UnexpectedInput

from backends.rml.prolog.writing import HEADER
from rvaft.errors import LanguageError
from rvaft.values import Json

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
    grammar = files("backends.rml.prolog").joinpath("grammar.lark").read_text(encoding="utf-8")
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
