"""Texts of past MTL, run by Reelay: a comment that defines propositions, then a formula.

    /* rvaft
    NAME := PATTERN when GUARD when GUARD
    */

Several lines for one name are alternatives.

Reelay ends the whole process on malformed or too deep formulas, so it receives formulas that are
parsed here. Propositions are evaluated here per event and passed as Booleans.
"""

import re
from collections.abc import Mapping, Sequence
from functools import cache, lru_cache
from threading import Lock
from typing import Any, Final

from lark import Lark, Token
from lark.exceptions import UnexpectedInput
from lark.visitors import Transformer_NonRecursive

from rvaft.backend import Observed
from rvaft.errors import LanguageError, TooLarge, installed
from rvaft.language.diagnostics import error_at
from rvaft.language.parser import parse_guard, parse_pattern
from rvaft.model.guards import Operation, Operator
from rvaft.model.patterns import Literal, ObjectPattern, Pattern
from rvaft.model.values import Json

_DEEPEST: Final = 1_000
_FILE: Final = "<mtl>"
_GO: Final = "{go: true}"
_HEADER: Final = re.compile(r"(?:\s*/\*(?! rvaft\n).*?\*/)*\s*/\* rvaft\n(.*?)\*/", re.DOTALL)
_LINE: Final = re.compile(r"(\w+) := (.*\S)")
_WHEN: Final = re.compile(r'"(?:[^"\\]|\\.)*"|(?<!\w)(when)(?!\w)')
_GRAMMAR: Final = r"""
?start: either
?either: both (_OR both)*
?both: chain (_AND chain)*
?chain: unary | unary "since" bounds? unary -> since
?unary: NOT unary -> negated
    | "once" bounds? unary -> once
    | "historically" bounds? unary -> always
    | "pre" unary -> pre
    | "(" either ")"
    | "{" NAME ":" "true" "}" -> atom
bounds: "[" [NUMBER] ":" [NUMBER] "]"
_OR: "or" | "||"
_AND: "and" | "&&"
NOT: "not" | "!"
NUMBER: /[0-9]{1,9}/
NAME: /[A-Za-z_]\w*/
%ignore /\s+/
"""


@cache
def _parser() -> Lark:
    return Lark(_GRAMMAR, parser="lalr", maybe_placeholders=True)


class _Written(Transformer_NonRecursive[Token, tuple[str, int]]):
    """The formula for Reelay with its depth; `go` is false once between consecutive traces."""

    def __init__(self) -> None:
        super().__init__()
        self.names: dict[str, None] = {}

    def atom(self, parts: list[Any]) -> tuple[str, int]:
        self.names[str(parts[0])] = None
        return f"{{{_called(str(parts[0]))}: true}}", 1

    def bounds(self, parts: list[Any]) -> tuple[str, int]:
        return f"[{parts[0] or ''}:{parts[1] or ''}]", 0

    def negated(self, parts: list[Any]) -> tuple[str, int]:
        return f"(not {parts[-1][0]})", parts[-1][1] + 1

    def pre(self, parts: list[Any]) -> tuple[str, int]:
        return f"(pre({_GO} and {parts[0][0]}))", parts[0][1] + 2

    def once(self, parts: list[Any]) -> tuple[str, int]:
        return self.since([(_GO, 1), *parts])

    def always(self, parts: list[Any]) -> tuple[str, int]:
        return self.negated([self.once([*parts[:-1], self.negated(parts)])])

    def since(self, parts: list[Any]) -> tuple[str, int]:
        (left, one), *bounds, (right, other) = parts
        within = "".join(text for text, _ in bounds)
        return f"(({_GO} and {left}) since{within} ({_GO} and {right}))", max(one, other) + 2

    def either(self, parts: list[Any]) -> tuple[str, int]:
        return f"({' or '.join(text for text, _ in parts)})", 1 + max(depth for _, depth in parts)

    def both(self, parts: list[Any]) -> tuple[str, int]:
        return f"({' and '.join(text for text, _ in parts)})", 1 + max(depth for _, depth in parts)


class MtlProgram:
    """A compiled formula."""

    def __init__(self, formula: str, atoms: Mapping[str, Sequence[Observed]]) -> None:
        (self._monitor, self._lock), self._atoms = _monitor(formula), atoms

    def first_detections(self, traces: Sequence[Sequence[Json]]) -> list[int | None]:
        """Return per trace the number of the first event at which the formula holds, or None."""
        with self._lock:
            return [self._first(trace) for trace in traces]

    def _first(self, trace: Sequence[Json]) -> int | None:
        self._monitor.update({"go": False, **dict.fromkeys(map(_called, self._atoms), False)})
        for number, event in enumerate(trace, 1):
            values = {_called(name): fits(some, event) for name, some in self._atoms.items()}
            if self._monitor.update({"go": True, **values})["value"]:
                return number
        return None


@cache
def _reelay() -> tuple[Any, Any]:
    """Return the extension of Reelay and its monitor options, which are slow to create."""
    extension = installed("reelay._pybind11_module", "Reelay", "pip install '.[mtl]' in a checkout of rvaft")
    return extension, extension.monitor_options("time", "value", False, True)


@lru_cache(maxsize=128)
def _monitor(formula: str) -> tuple[Any, Lock]:
    """Return the monitor of a formula and its lock; Reelay's own constructor parses twice."""
    extension, options = _reelay()
    return extension.discrete_monitor.make(formula, options), Lock()


def _called(name: str) -> str:
    return f"p_{name}"


@lru_cache(maxsize=32)
def compiled(text: str, given: tuple[tuple[str, Pattern], ...]) -> MtlProgram:
    """Return the program of a text; raises `LanguageError`, `TooLarge`, `ToolMissing`."""
    header, defined = _HEADER.match(text), definitions(text)
    start = 0 if header is None else header.end()
    writing = _Written()
    try:
        formula, depth = writing.transform(_parser().parse(text[start:]))
    except UnexpectedInput as error:
        raise error_at("not a formula of past MTL", text, start + max(error.pos_in_stream or 0, 0), _FILE) from None
    if depth > _DEEPEST:
        raise TooLarge("nested operators", limit=_DEEPEST)
    known = dict(given)
    named = {name: Observed(known.get(name) or ObjectPattern((("event", Literal(name)),))) for name in writing.names}
    return MtlProgram(formula, {name: defined.get(name, (one,)) for name, one in named.items()})


def fits(alternatives: Sequence[Observed], event: Json) -> bool:
    """Whether one of the alternative definitions of a proposition fits an event."""
    return any(one.fits(event) for one in alternatives)


def definitions(text: str) -> dict[str, tuple[Observed, ...]]:
    """Return the alternative definitions of each proposition of a header; raises `LanguageError`."""
    found: dict[str, tuple[Observed, ...]] = {}
    header = _HEADER.match(text)
    for line in re.finditer(r"[^\n]*\S", header[1]) if header else ():
        assert header is not None
        begin, content = header.start(1) + line.start(), _LINE.fullmatch(line[0])
        if content is None:
            raise error_at("expected a header line NAME := PATTERN when GUARD", text, begin, _FILE)
        cuts = [when.span(1) for when in _WHEN.finditer(content[2]) if when[1]]
        ends = [*(cut[0] for cut in cuts), len(content[2])]
        try:
            pattern = parse_pattern(content[2][: ends[0]])
            several = [parse_guard(content[2][cut[1] : end]) for cut, end in zip(cuts, ends[1:], strict=True)]
        except LanguageError as error:
            raise error_at(error.message, text, begin + content.start(2), _FILE) from None
        when = Operation(Operator.AND, tuple(several)) if len(several) > 1 else next(iter(several), None)
        found[content[1]] = (*found.get(content[1], ()), Observed(pattern, when))
    return found
