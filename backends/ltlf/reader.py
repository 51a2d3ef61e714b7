"""LTLf texts in Spot's syntax, with a leading comment that defines atoms and shared subformulas.

Lines of the comment:

    atom NAME := PATTERN at T when GUARD when GUARD   an event under guards; a guard with an unbound
                                        variable is true; `at T` binds the time in nanoseconds, or null
    relevant NAME := PATTERN when GUARD alternatives for relevant events, for some values of variables
    ignored NAME := PATTERN when GUARD  exceptions to `relevant`
    time FIELD as FORMAT                the time of an event
    NAME := FORMULA                     a shared subformula over atoms and earlier definitions

Patterns and guards are written as in trees. The comment starts with `/* rvaft`; other comments are
ignored.
"""

import re
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Final

from backends.ltlf.formulas import FALSE, TRUE, Formulas
from rvaft.core.times import timed
from rvaft.errors import LanguageError, error_at, installed
from rvaft.language.parser import parse_guard, parse_pattern, parse_time
from rvaft.model.event_time import EventTime
from rvaft.model.expressions import guard_text, pattern_text, time_text
from rvaft.model.guards import Guard, Operation, Operator
from rvaft.model.patterns import Anything, ObjectPattern, Pattern
from rvaft.model.values import Json

_OPENING: Final = re.compile(r"(?:\s*/\*(?! rvaft(?!\w)).*?\*/)*\s*/\* rvaft(?!\w)", re.DOTALL)
_STRING: Final = re.compile(r'"(?:[^"\\]|\\.)*"')
_CONTENT: Final = re.compile(r"[^\n]*\S")
_LINE: Final = re.compile(r"\s*(?:(?:(atom|relevant|ignored)\s+)?([a-z_][a-z0-9_]*)\s*:=\s*(.*\S)|(time\s.*\S))")
_STRING_OR_WORD: Final = re.compile(r'"(?:[^"\\]|\\.)*"|[{}\[\]]|(?<!\w)(?:when|at)(?!\w)')
_VARIABLE: Final = re.compile(r"\s*([A-Za-z_]\w*)\s*", re.ASCII)


@dataclass(frozen=True, slots=True)
class Observation:
    """An event pattern under guards; `time` is the variable for the time of the event."""

    pattern: Pattern
    guards: tuple[Guard, ...] = ()
    time: str | None = None

    @property
    def observed(self) -> Pattern:
        """The pattern with the time variable, for events with the key `TIME`."""
        return self.pattern if self.time is None else timed(self.pattern, self.time)

    @property
    def when(self) -> Guard | None:
        """The conjunction of the guards, or None."""
        several = len(self.guards) > 1
        return Operation(Operator.AND, self.guards) if several else next(iter(self.guards), None)

    def __str__(self) -> str:
        at = "" if self.time is None else f" at {self.time}"
        return _in_comment(pattern_text(self.pattern) + at + "".join(f" when {guard_text(one)}" for one in self.guards))


def _in_comment(text: str) -> str:
    return _STRING.sub(lambda found: found[0].replace("*/", "*\\u002f").replace("/*", "\\u002f*"), text)


@dataclass(slots=True)
class Header:
    """The content of a leading comment."""

    atoms: dict[str, Observation] = field(default_factory=dict)
    relevant: dict[str, list[Observation]] = field(default_factory=dict)
    ignored: dict[str, list[Observation]] = field(default_factory=dict)
    definitions: dict[str, str] = field(default_factory=dict)
    places: dict[str, int] = field(default_factory=dict)
    """For each definition, the offset of its formula in the text."""
    time: EventTime | None = None

    def stamped(self, event: Json) -> Json:
        """Return the event, with its time at the key `TIME` if the header defines times."""
        return event if self.time is None else self.time.stamped(event)

    def __str__(self) -> str:
        lines = [] if self.time is None else [_in_comment(time_text(self.time))]
        lines += [f"atom {name} := {observation}" for name, observation in self.atoms.items()]
        for kind, several in (("relevant", self.relevant), ("ignored", self.ignored)):
            lines += [f"{kind} {name} := {entry}" for name, entries in several.items() for entry in entries]
        lines += [f"{name} := {formula}" for name, formula in self.definitions.items()]
        return "\n".join(["/* rvaft", *lines, "*/"]) + "\n"


def split(text: str) -> tuple[Header, int]:
    """Return the header of a text (empty if missing) and its end.

    Raises `LanguageError` for malformed or repeated lines.
    """
    header = Header()
    several = {"relevant": header.relevant, "ignored": header.ignored}
    opening = _OPENING.match(text)
    if opening is None:
        return header, 0
    end = text.find("*/", opening.end())
    if end < 0:
        start = len(text) - len(text.lstrip())
        raise _malformed("the comment is not closed: write */ after its last line", text, start)
    for line in _CONTENT.finditer(text, opening.end(), end):
        found = _LINE.fullmatch(text, *line.span())
        if found is None:
            message = "a line of the header reads `atom NAME := PATTERN when GUARD` or `NAME := FORMULA`"
            raise _malformed(message, text, line.end() - len(line[0].lstrip()))
        kind, name, what, time = found.groups()
        if time is not None:
            if header.time is not None:
                raise _malformed("the time of events is defined twice", text, found.start(4))
            header.time = _read(parse_time, text, *found.span(4))
            continue
        if name in header.atoms or name in header.definitions or (kind not in several and name in header.relevant):
            raise _malformed(f"{name} is defined twice", text, found.start(2))
        if kind is None:
            header.definitions[name] = what
            header.places[name] = found.start(3)
        elif kind == "atom":
            header.atoms[name] = _observation(text, *found.span(3))
        else:
            several[kind].setdefault(name, []).append(_observation(text, *found.span(3)))
    return header, end + 2


def _observation(text: str, start: int, stop: int) -> Observation:
    words: list[tuple[str, int, int]] = []
    depth = 0
    for token in _STRING_OR_WORD.finditer(text, start, stop):
        depth += (token[0] in "{[") - (token[0] in "}]")
        if depth == 0 and token[0] in ("when", "at"):
            words.append((token[0], *token.span()))
    parts: list[Any] = []
    time: str | None = None
    ends = [begin for _, begin, _ in words] + [stop]
    for (word, _, begin), end in zip([("", start, start), *words], ends, strict=True):
        match word:
            case "at" if len(parts) == 1 and time is None:
                found = _VARIABLE.fullmatch(text, begin, end)
                if found is None:
                    raise _malformed("expected the name of a variable after `at`", text, begin)
                time = found[1]
            case "at":
                raise _malformed("`at` stands once, right after the pattern", text, begin)
            case _:
                parts.append(_read(parse_guard if parts else parse_pattern, text, begin, end))
        if not isinstance(parts[0], ObjectPattern | Anything):
            raise _malformed("an event is an object: expected a pattern such as { field: 1 }, or _", text, start)
    return Observation(parts[0], tuple(parts[1:]), time)


def _read(parser: Callable[[str], Any], text: str, start: int, stop: int) -> Any:
    try:
        return parser(text[start:stop])
    except LanguageError as error:
        raise _malformed(error.message, text, start + error.column - 1) from None


_malformed: Final = partial(error_at, file="<ltlf>")


# Formulas, parsed by Spot.

_REMEDY: Final = "run `pip install spottl` (Linux x86-64, glibc 2.34 or later, Python below 3.14)"
_CARET: Final = re.compile(r"^>>> (?P<text>.*)\n(?P<pad> *)\^+\n(?P<message>.+)$", re.DOTALL)


def _equal(f: Formulas, a: int, b: int) -> int:
    return f.disjunction([f.conjunction([a, b]), f.conjunction([f.negation(a), f.negation(b)])])


def _released(f: Formulas, a: int, b: int) -> int:
    return f.negation(f.until(f.negation(a), f.negation(b)))


_OPERATORS: Final[Mapping[str, Callable[..., int]]] = {
    "tt": lambda _: TRUE,
    "ff": lambda _: FALSE,
    "Not": Formulas.negation,
    "And": lambda f, *operands: f.conjunction(operands),
    "Or": lambda f, *operands: f.disjunction(operands),
    "Implies": lambda f, a, b: f.disjunction([f.negation(a), b]),
    "Equiv": _equal,
    "Xor": lambda f, a, b: f.negation(_equal(f, a, b)),
    "strong_X": Formulas.next,
    "X": lambda f, a: f.negation(f.next(f.negation(a))),
    "F": Formulas.eventually,
    "G": lambda f, a: f.negation(f.eventually(f.negation(a))),
    "U": Formulas.until,
    "R": _released,
    "W": lambda f, a, b: _released(f, b, f.disjunction([a, b])),
    "M": lambda f, a, b: f.until(b, f.conjunction([a, b])),
}
"""Spot's operators on finite traces: `X` is the weak next, `X[!]` the strong one."""


def spot() -> Any:
    """Return Spot's Python module; raises `ToolMissing`."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a warning that becomes an error while Spot loads crashes the process
        return installed("spot", "Spot", _REMEDY)


def formula_of(text: str, formulas: Formulas) -> tuple[Header, int]:
    """Return the header and the formula of a text; raises `LanguageError` and `ToolMissing`."""
    header, end = split(text)
    known: dict[str, int] = {}

    def atom(name: str) -> int:
        if name in header.definitions and name not in known:
            unknown = next(one for one in header.definitions if one not in known)  # the definition that is being read
            raise _malformed(f"{name} is used before it is defined", text, header.places[unknown])
        return known[name] if name in known else formulas.atom(name)

    def parsed(start: int, formula: str) -> int:
        try:
            root = spot().formula(formula.replace("\n", " "))
        except SyntaxError as error:  # Spot prints for each error the text, a caret and a message
            found = _CARET.match(str(error).strip("\n").split("\n\n")[0])
            if found is None:
                raise _malformed("not a formula in Spot's LTLf syntax", text, start) from None
            offset = min(max(len(found["pad"]) - len(">>> "), 0), len(formula))
            raise _malformed(found["message"].strip().replace("\n", " "), text, start + offset) from None
        made: dict[int, int] = {}
        todo = [root]
        while todo:
            current = todo[-1]
            missing = [inner for inner in current if inner.id() not in made]
            todo.extend(missing)
            if not missing:
                todo.pop()
                kind = current.kindstr()
                if kind == "ap":
                    made[current.id()] = atom(current.ap_name())
                elif kind in _OPERATORS:
                    made[current.id()] = _OPERATORS[kind](formulas, *(made[inner.id()] for inner in current))
                else:
                    raise _malformed(f"{kind} is not an operator of LTL on finite traces", text, start)
        return made[root.id()]

    for name, definition in header.definitions.items():
        known[name] = parsed(header.places[name], definition)
    start = len(text) - len(text[end:].lstrip())
    if start == len(text):
        raise _malformed("there is no formula after the comment" if text else "there is no formula", text, start)
    return header, parsed(start, text[start:].rstrip())
