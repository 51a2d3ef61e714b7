"""The leading comment of a text: what each atom is, and the shared subformulas.

Lines, one each:

    atom NAME := PATTERN when GUARD when GUARD      an event under guards, each true while one of its variables is unbound
    relevant NAME := PATTERN when GUARD             several lines: events that fit one of them, for some values of the variables,
    ignored NAME := PATTERN when GUARD              and none of these
    NAME := FORMULA                                 a shared subformula, of atoms and of what was defined above

Patterns and guards are written as in the language of trees. The comment starts with `/* rvaft`; any other comment is just that.
"""

import re
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from backends.ltlf.formulas import FALSE, TRUE, Formulas
from rvaft.errors import LanguageError, ToolMissing
from rvaft.language.parser import parse_guard, parse_pattern
from rvaft.model.expressions import guard_text, pattern_text
from rvaft.model.guards import Guard, Operation, Operator
from rvaft.model.patterns import Anything, ObjectPattern, Pattern

OPENING: Final = "/* rvaft"
CLOSING: Final = "*/"
_STRING: Final = re.compile(r'"(?:[^"\\]|\\.)*"')
_LINE: Final = re.compile(r"\s*(?:(atom|relevant|ignored)\s+)?([a-z_][a-z0-9_]*)\s*:=\s*(.*\S)\s*")
_STRING_OR_WHEN: Final = re.compile(r'"(?:[^"\\]|\\.)*"|[{}\[\]]|(?<!\w)when(?!\w)')


@dataclass(frozen=True, slots=True)
class Observation:
    """An event pattern under guards."""

    pattern: Pattern
    guards: tuple[Guard, ...] = ()

    @property
    def when(self) -> Guard | None:
        """One guard that holds when all do."""
        several = len(self.guards) > 1
        return Operation(Operator.AND, self.guards) if several else next(iter(self.guards), None)

    def __str__(self) -> str:
        whens = "".join(f" when {guard_text(guard)}" for guard in self.guards)
        return _STRING.sub(
            lambda string: (
                string.group().replace("*/", "*\\u002f").replace("/*", "\\u002f*")
            ),  # they would end the comment
            pattern_text(self.pattern) + whens,
        )


@dataclass(slots=True)
class Header:
    """What a leading comment says."""

    atoms: dict[str, Observation] = field(default_factory=dict)
    relevant: dict[str, list[Observation]] = field(default_factory=dict)
    ignored: dict[str, list[Observation]] = field(default_factory=dict)
    definitions: dict[str, str] = field(default_factory=dict)
    places: dict[str, tuple[int, int]] = field(default_factory=dict)
    """Of each definition the line and column of its formula."""

    def __str__(self) -> str:
        lines = [OPENING]
        lines += [f"atom {name} := {observation}" for name, observation in self.atoms.items()]
        for kind, several in (("relevant", self.relevant), ("ignored", self.ignored)):
            lines += [f"{kind} {name} := {entry}" for name, entries in several.items() for entry in entries]
        lines += [f"{name} := {formula}" for name, formula in self.definitions.items()]
        return "\n".join([*lines, CLOSING]) + "\n"


def split(text: str) -> tuple[Header, str]:
    """The header of a text (empty where it has none) and the text with the header blanked out, places unchanged.

    Raises `LanguageError` for a line that says none of the things above, or says them twice.
    """
    header = Header()
    start = len(text) - len(text.lstrip())
    if not re.match(re.escape(OPENING) + r"(?!\w)", text[start:]):
        return header, text
    end = text.find(CLOSING, start)
    if end < 0:
        raise _malformed("the comment is not closed: write */ after its last line", text, 1, start + 1)
    inside = _blank(text[: start + len(OPENING)]) + text[start + len(OPENING) : end]
    for number, line in enumerate(inside.split("\n"), 1):
        if line.strip():
            _read_line(header, line, number)
    return header, _blank(text[: end + len(CLOSING)]) + text[end + len(CLOSING) :]


def _blank(text: str) -> str:
    return re.sub(r".", " ", text)


def _read_line(header: Header, line: str, number: int) -> None:
    found = _LINE.fullmatch(line)
    if found is None:
        message = "a line of the header reads `atom NAME := PATTERN when GUARD` or `NAME := FORMULA`"
        raise _malformed(message, line, number, len(line) - len(line.lstrip()) + 1)
    kind, name, what = found.groups()
    column = found.start(3) + 1
    several = {"relevant": header.relevant, "ignored": header.ignored}
    if (name in header.atoms or name in header.definitions) or (kind not in several and name in header.relevant):
        raise _malformed(f"{name} is defined twice", line, number, found.start(2) + 1)
    if kind is None:
        header.definitions[name] = what
        header.places[name] = (number, column)
    elif kind == "atom":
        header.atoms[name] = _observation(what, line, number, column)
    else:
        several[kind].setdefault(name, []).append(_observation(what, line, number, column))


def _observation(text: str, line: str, number: int, column: int) -> Observation:
    parts: list[Any] = []
    for start, piece in _pieces(text):
        try:
            parts.append(parse_guard(piece) if parts else parse_pattern(piece))
        except LanguageError as error:
            raise _malformed(error.message, line, number, column + start + error.column - 1) from None
        if not isinstance(parts[0], ObjectPattern | Anything):
            message = "an event is an object: expected a pattern such as { field: 1 }, or _"
            raise _malformed(message, line, number, column)
    return Observation(parts[0], tuple(parts[1:]))


def _pieces(text: str) -> Iterator[tuple[int, str]]:
    """What stands before, between and after the words `when` outside strings and brackets, with its offset."""
    start, depth = 0, 0
    for token in _STRING_OR_WHEN.finditer(text):
        if token.group() in "{[":
            depth += 1
        elif token.group() in "}]":
            depth -= 1
        elif token.group() == "when" and depth == 0:
            yield start, text[start : token.start()]
            start = token.end()
    yield start, text[start:]


def _malformed(message: str, source: str, line: int, column: int) -> LanguageError:
    return LanguageError(message, file="<ltlf>", line=line, column=column, source=source)


# Text in Spot's LTLf syntax, read by Spot's own parser, as formulas of the core.

REMEDY: Final = "run `pip install spottl` (Linux x86-64, glibc 2.34 or later, Python below 3.14)"
_CARET: Final = re.compile(r"^>>> (?P<text>.*)\n(?P<pad> *)\^+\n(?P<message>.+)$", re.DOTALL)


def _equal(f: Formulas, a: int, b: int) -> int:
    both = f.conjunction([a, b])
    return f.disjunction([both, f.conjunction([f.negation(a), f.negation(b)])])


def _unless(f: Formulas, a: int, b: int) -> int:
    """`a W b`."""
    return f.negation(f.until(f.negation(b), f.negation(f.disjunction([a, b]))))


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
    "R": lambda f, a, b: f.negation(f.until(f.negation(a), f.negation(b))),
    "W": _unless,
    "M": lambda f, a, b: f.until(b, f.conjunction([a, b])),
}
"""Spot's operators on finite traces, where `X` is the weak next and `X[!]` the strong one."""


def spot() -> Any:
    """Spot's Python module; raises `ToolMissing`."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # one that is turned into an error while Spot loads ends in a crash
            import spot as module  # noqa: PLC0415 -- takes a second to load, and is not there on every machine
    except ImportError as error:
        raise ToolMissing("Spot", remedy=REMEDY) from error
    return module


def formula_of(text: str, formulas: Formulas) -> tuple[Header, int]:
    """What the header of a text says, and its formula; raises `LanguageError` and `ToolMissing`."""
    header, rest = split(text)
    known: dict[str, int] = {}

    def atom(name: str) -> int:
        if name in header.definitions and name not in known:
            unknown = next(one for one in header.definitions if one not in known)  # the one that is being read
            raise _malformed(f"{name} is used before it is defined", "", *header.places[unknown])
        return known[name] if name in known else formulas.atom(name)

    for name, definition in header.definitions.items():
        known[name] = _parsed(definition, formulas, atom, header.places[name])
    skipped = len(rest) - len(rest.lstrip())
    place = _after(rest[:skipped], 1, 1)
    if not rest.strip():
        raise _malformed("there is no formula after the comment" if skipped else "there is no formula", "", *place)
    return header, _parsed(rest[skipped:].rstrip(), formulas, atom, place)


def _parsed(text: str, formulas: Formulas, atom: Callable[[str], int], place: tuple[int, int]) -> int:
    """The formula that a text stands for, which begins at that place; `atom` gives the formula of a name."""
    try:
        root = spot().formula(text.replace("\n", " "))
    except SyntaxError as error:  # Spot writes the text, a caret below the fault, and what it is, for each fault
        found = _CARET.match(str(error).strip("\n").split("\n\n")[0])
        if found is None:
            raise _formula_malformed("no formula of Spot's LTLf syntax", text, place) from None
        offset = min(max(len(found["pad"]) - len(">>> "), 0), len(text))
        raise _formula_malformed(found["message"].strip().replace("\n", " "), text, place, offset) from None
    known: dict[int, int] = {}
    todo = [root]
    while todo:
        current = todo[-1]
        missing = [inner for inner in current if inner.id() not in known]
        todo.extend(missing)
        if not missing:
            todo.pop()
            if current.id() not in known:
                kind = current.kindstr()
                if kind != "ap" and kind not in _OPERATORS:
                    raise _formula_malformed(f"{kind} is no operator of LTL on finite traces", text, place)
                operands = [known[inner.id()] for inner in current]
                made = atom(current.ap_name()) if kind == "ap" else _OPERATORS[kind](formulas, *operands)
                known[current.id()] = made
    return known[root.id()]


def _after(text: str, line: int, column: int) -> tuple[int, int]:
    """The place behind a text that begins at a place."""
    breaks = text.count("\n")
    return line + breaks, len(text) - text.rfind("\n") if breaks else column + len(text)


def _formula_malformed(message: str, text: str, place: tuple[int, int], offset: int = 0) -> LanguageError:
    line, column = _after(text[:offset], *place)
    rows = (" " * (place[1] - 1) + text).split("\n")
    return _malformed(message, rows[line - place[0]], line, column)
