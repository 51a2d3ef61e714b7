"""The parse tree of one query, with replacements where the package `eql` deviates from
Elasticsearch.

Elasticsearch is case-sensitive unless an operator ignores case, which concerns ASCII letters only.
`?` is a wildcard. A test of a missing field is neither true nor false. A missing field is no key of
`by`, unless written `?field`. Other queries are refused.
"""

import operator
import re
from collections.abc import Callable, Mapping
from contextlib import suppress
from copy import copy
from functools import lru_cache, partial
from ipaddress import ip_address, ip_network
from typing import Any, Final, Never

from lark import Token, Visitor
from lark.exceptions import UnexpectedInput

from rvaft.errors import error_at, installed
from rvaft.model.values import Json, equal

FILE: Final = "<eql>"
CATEGORY: Final = "ofCategory"
OPTIONAL: Final = "optional"
"""Functions that test the category of an event, and that mark optional fields of `by`."""
_REFUSED: Final = {
    "join": "Elasticsearch has no join",
    "named_subquery": "Elasticsearch has no descendant queries",
    "fork_param": "Elasticsearch has no fork",
    "method": "Elasticsearch has no methods",
    "MULT_OP": "the package eql divides differently from Elasticsearch",
}
_NAMES: Final = "startsWith endsWith stringContains add concat length multiply string substring subtract"
_FUNCTIONS: Final = {"cidrmatch": "inNetwork"} | {one.lower(): one for one in _NAMES.split()}
_PREDICATES: Final = {
    ":": "likeAnyCase",
    "like~": "likeAnyCase",
    "regex~": "regexAnyCase",
    "in~": "amongAnyCase",
    "in": "among",
}
_LARGEST_SAMPLE: Final = 5
_ANY_CASE: Final = re.ASCII | re.IGNORECASE
_SMALL: Final = {ord(one): one.lower() for one in "ABCDEFGHIJKLMNOPQRSTUVWXYZ"}
_ESCAPE: Final = re.compile(r"\\u\{(\w+)\}|\\(.)")
_ESCAPED: Final = dict(zip("btnfr", "\b\t\n\f\r", strict=True))
_UNLIKE: Final = (
    r'["#@&<>~$\\]|\(\?|[?*+}][?*+{]|(?<!\[)\^|\[\^?[]-]|\[[^]]*\[|-\]|--|\{(?!\d+(,\d*)?\})|(^|[(|])\||\|(\)|$)'
)
"""Constructs of regular expressions that differ between Lucene and Python, escapes aside."""


def _wildcards(text: str) -> str:
    return "".join({"*": ".*", "?": "."}.get(sign) or re.escape(sign) for sign in text)


@lru_cache(maxsize=1_000)
def _pattern(written: Callable[[str], str], flags: int, patterns: tuple[str, ...]) -> re.Pattern[str]:
    return re.compile("|".join(f"(?:{written(one)})" for one in patterns), re.DOTALL | flags)


def _matches(written: Callable[[str], str], flags: int, text: Json, *patterns: str) -> bool:
    return isinstance(text, str) and bool(_pattern(written, flags, patterns).fullmatch(text))


def _of_texts(test: Callable[[str, str], bool], text: Json, other: Json) -> bool:
    return isinstance(text, str) and isinstance(other, str) and test(text, other)


def _in_network(text: Json, *networks: str) -> bool | None:
    try:
        address = ip_address(text if isinstance(text, str) else "")
    except ValueError:
        return None
    address = getattr(address, "ipv4_mapped", None) or address
    return any(address in ip_network(one, strict=False) for one in networks)


def _unless_missing(function: Callable[..., Json]) -> Callable[..., Json]:
    return lambda *given: None if None in given else function(*given)


_ASKED: Final[Mapping[str, Callable[..., Json]]] = {
    "like": partial(_matches, _wildcards, 0),
    "likeAnyCase": partial(_matches, _wildcards, _ANY_CASE),
    "regex": partial(_matches, str, 0),
    "regexAnyCase": partial(_matches, str, _ANY_CASE),
    "among": lambda value, *listed: any(equal(value, one) for one in listed),
    "amongAnyCase": partial(_matches, re.escape, _ANY_CASE),
    "startsWith": partial(_of_texts, str.startswith),
    "endsWith": partial(_of_texts, str.endswith),
    "stringContains": partial(_of_texts, operator.contains),
    "anyCase": lambda value: value.translate(_SMALL) if isinstance(value, str) else value,
    "inNetwork": _in_network,
    CATEGORY: operator.contains,
}
FUNCTIONS: Final = {name: _unless_missing(asked) for name, asked in _ASKED.items()}
"""Replacements for functions of the engine; None is neither true nor false."""


class _Rewriting(Visitor[Token]):
    """Replaces deviating functions in a parse tree; refuses the others."""

    def __init__(self, source: str) -> None:
        self._source = source

    def _refuse(self, part: Any, message: str) -> Never:
        token = next(part.scan_values(lambda _: True), None) if hasattr(part, "children") else part
        raise error_at(message, self._source, getattr(token, "start_pos", 0), FILE)

    def __default__(self, tree: Any) -> None:
        for part in (tree, *tree.children):
            kind = getattr(part, "type", None) or getattr(part, "data", None)
            if kind in _REFUSED and part != "*":
                self._refuse(part, _REFUSED[kind])

    def string(self, tree: Any) -> None:
        (token,) = tree.children
        if token.type == "DQ_STRING":
            try:
                text = _ESCAPE.sub(lambda one: chr(int(one[1], 16)) if one[1] else _ESCAPED.get(one[2], one[2]), token)
            except (ValueError, OverflowError):
                self._refuse(token, "there is no such character")
            tree.children = [Token.new_borrow_pos("RAW_TQ_STRING", f'""{text}""', token)]

    def in_set(self, tree: Any) -> None:
        value, token, *listed = tree.children
        if not isinstance(listed[0], Token) and listed[0].data == "expressions":
            listed = listed[0].children
        for one in listed:
            text = _text(one)
            if one.data.endswith("field") or (text is None and token not in ("in", "in~")):
                self._refuse(one, f"`{token}` compares with constants; only `in` takes other constants than strings")
            if token.startswith("regex") and not _is_lucenes(text or "", any_case=token.endswith("~")):
                self._refuse(one, "Lucene and Python may differ on this regular expression")
        self._call(tree, _PREDICATES.get(token, str(token)), [value, *listed])

    string_predicate = in_set

    def not_in_set(self, tree: Any) -> None:
        self.in_set(inside := copy(tree))
        tree.data, tree.children = "not_expr", [Token("NOT_OP", "not"), inside]

    def function_call(self, tree: Any) -> None:
        name, given = tree.children
        called, arguments = _FUNCTIONS.get(name.lower().removesuffix("~")), given.children if given else []
        if called is None or (name.endswith("~") and called not in ("startsWith", "endsWith", "stringContains")):
            self._refuse(
                name, f"{name}: not a function of Elasticsearch, or one with another meaning in the package eql"
            )
        if name.endswith("~"):
            arguments = [self._call(copy(tree), "anyCase", [one]) for one in arguments]
        try:
            networks = [_text(one) for one in arguments[1:]] if called == "inNetwork" else ["::"]
            [ip_network(one or "", strict=False) for one in networks or [""]]
        except ValueError:
            self._refuse(name, f"{name} takes constant networks, such as 10.0.0.0/8")
        self._call(tree, called, arguments)

    def join_values(self, tree: Any) -> None:
        for one in tree.children[0].children:
            if one.data == "field" and one.children[0].type == "OPTIONAL_FIELD":
                self._call(one, OPTIONAL, [copy(one)])

    def _call(self, tree: Any, name: str, arguments: list[Any]) -> Any:
        tree.data, tree.children = "function_call", [Token("NAME", name), type(tree)("expressions", arguments)]
        return tree


def _is_lucenes(regex: str, *, any_case: bool) -> bool:
    """Return whether Lucene, which ignores the case flag in brackets, and Python agree on an
    expression.
    """
    signs = re.sub(r"\\[^\w\s]", "'", regex)
    with suppress(re.error):
        return not re.search(_UNLIKE + r"|\[[^]]*[A-Za-z]" * any_case, signs) and bool(re.compile(regex))
    return False


def _text(part: Any) -> str | None:
    token = next(part.scan_values(lambda _: True), "") if part.data == "literal" else ""
    return str(token[3:-3]) if token.startswith('"') else None


@lru_cache(maxsize=1_000)
def parsed(source: str) -> Any:
    """Return the parsed query without its pipes; `head` and `tail` change no first detection."""
    eql = installed("eql", "eql", "pip install '.[eql]' in a checkout of rvaft")
    options = {"elasticsearch_syntax": True, "allow_runs": True, "allow_negation": True, "allow_sample": True}
    options |= {"reject_field_comparisons": True, "check_functions": False, "optimized": False}
    with eql.utils.ParserConfig(**options, allowed_pipes={"head", "tail"}):
        try:
            tree = _Rewriting(source).visit(eql.parser.lark_parser.parse(f"{source}\n", start="piped_query"))
            query = eql.parser.LarkToEQL(f"{source}\n").visit(tree).first
        except UnexpectedInput as error:
            raise error_at("not an EQL query", source, max(error.pos_in_stream or 0, 0), FILE) from None
        except eql.EqlParseError as error:
            raise error_at(error.error_msg, source, place(source, error.line, error.column), FILE) from None
        except RecursionError:
            raise error_at("this query is nested too deeply", source, 0, FILE) from None
    terms = [*getattr(query, "queries", ())]
    if any(map(is_missing, terms)):
        *before, last = map(is_missing, terms)
        if last or not all(before) or isinstance(query, eql.ast.Sample) or query.close:
            raise error_at("missing events are read before a single event alone", source, source.find("!["), FILE)
    if getattr(query, "close", None) and is_missing(query.close):
        raise error_at("Elasticsearch ignores the `!` of `until`", source, source.rfind("!["), FILE)
    if isinstance(query, eql.ast.Sample) and len(query.queries) > _LARGEST_SAMPLE:
        raise error_at(f"a sample has at most {_LARGEST_SAMPLE} events here", source, 0, FILE)
    return query


def is_missing(term: Any) -> bool:
    """Return whether a term of a sequence is a missing event."""
    return bool((term.data or {}).get("is_negated"))


def place(text: str, line: int, column: int) -> int:
    """Return the offset of a line and column, all counted from 0."""
    return min(sum(len(one) + 1 for one in text.split("\n")[:line]) + column, len(text))
