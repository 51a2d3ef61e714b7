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
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, Final

from backends.ltlf.formulas import FALSE, TRUE, Formulas
from rvaft.errors import LanguageError, ToolMissing
from rvaft.language.parser import parse_guard, parse_pattern
from rvaft.model.expressions import guard_text, pattern_text
from rvaft.model.guards import Guard
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

    def __str__(self) -> str:
        whens = "".join(f" when {guard_text(guard)}" for guard in self.guards)
        return _STRING.sub(_without_comment_signs, pattern_text(self.pattern) + whens)


def _without_comment_signs(string: re.Match[str]) -> str:
    return string.group().replace("*/", "*\\u002f").replace("/*", "\\u002f*")


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
        lines += [f"relevant {name} := {entry}" for name, entries in self.relevant.items() for entry in entries]
        lines += [f"ignored {name} := {entry}" for name, entries in self.ignored.items() for entry in entries]
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
    return re.sub(r"[^\n]", " ", text)


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
    pieces = list(_pieces(text))
    try:
        pattern = parse_pattern(pieces[0][1])
    except LanguageError as error:
        raise _malformed(error.message, line, number, column + error.column - 1) from None
    if not isinstance(pattern, ObjectPattern | Anything):
        raise _malformed("an event is an object: expected a pattern such as { field: 1 }, or _", line, number, column)
    guards: list[Guard] = []
    for start, piece in pieces[1:]:
        try:
            guards.append(parse_guard(piece))
        except LanguageError as error:
            raise _malformed(error.message, line, number, column + start + error.column - 1) from None
    return Observation(pattern, tuple(guards))


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
#
# In Spot's LTLf `X` is the weak next and `X[!]` the strong one. On finite traces: G f = !F!f, f R g = !(!f U !g),
# f W g = !(!g U !(f | g)), f M g = g U (f & g), X f = !X[!]!f.

REMEDY: Final = "run `pip install spottl` (Linux x86-64, glibc 2.34 or later, Python below 3.14)"
_CARET: Final = re.compile(r"^>>> (?P<text>.*)\n(?P<pad> *)\^+\n(?P<message>.+)$", re.DOTALL)


def spot() -> Any:
    """Spot's Python module; raises `ToolMissing`."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # one that is turned into an error while Spot loads ends in a crash
            import spot as module  # noqa: PLC0415 -- takes a second to load, and is not there on every machine
    except ImportError as error:
        raise ToolMissing("Spot", remedy=REMEDY) from error
    return module


def parse(text: str, formulas: Formulas, atom: Callable[[str], int], *, line: int = 1, column: int = 1) -> int:
    """The formula that a text stands for; `atom` gives the formula of a name. The place is that of the text's beginning."""
    module = spot()
    flat = text.replace("\n", " ")
    try:
        parsed = module.formula(flat)
    except SyntaxError as error:
        raise _spot_text_malformed(str(error), text, line, column) from None
    return _converted(parsed, formulas, atom, _Source(text, line, column))


class _Source:
    """Where a text stands, to complain about it."""

    def __init__(self, text: str, line: int, column: int) -> None:
        self.text = text
        self.line = line
        self.column = column

    def error(self, message: str, offset: int = 0) -> LanguageError:
        before = self.text[:offset]
        breaks = before.count("\n")
        column = offset - before.rfind("\n") if breaks else self.column + offset
        rows = self.text.split("\n")
        source = rows[breaks] if breaks else " " * (self.column - 1) + rows[0]
        return LanguageError(message, file="<ltlf>", line=self.line + breaks, column=column, source=source)


def _spot_text_malformed(complaint: str, text: str, line: int, column: int) -> LanguageError:
    """Spot writes the text, a caret below the fault, and what it is, for each fault; the first one counts."""
    first = complaint.strip("\n").split("\n\n")[0]
    found = _CARET.match(first)
    source = _Source(text, line, column)
    if found is None:
        return source.error("no formula of Spot's LTLf syntax")
    offset = min(max(len(found["pad"]) - len(">>> "), 0), len(text))
    return source.error(found["message"].strip().replace("\n", " "), offset)


def _converted(root: Any, formulas: Formulas, atom: Callable[[str], int], source: _Source) -> int:
    known: dict[int, int] = {}
    todo = [root]
    while todo:
        current = todo[-1]
        missing = [inner for inner in current if inner.id() not in known]
        if missing:
            todo.extend(missing)
            continue
        todo.pop()
        if current.id() not in known:
            kind = current.kindstr()
            if kind == "ap":
                known[current.id()] = atom(current.ap_name())
            else:
                operands = [known[inner.id()] for inner in current]
                known[current.id()] = _operator(kind, operands, formulas, source)
    return known[root.id()]


def _operator(kind: str, operands: list[int], f: Formulas, source: _Source) -> int:
    match kind, operands:
        case "tt", []:
            return TRUE
        case "ff", []:
            return FALSE
        case "Not", [a]:
            return f.negation(a)
        case "And", _:
            return f.conjunction(operands)
        case "Or", _:
            return f.disjunction(operands)
        case "Implies", [a, b]:
            return f.disjunction([f.negation(a), b])
        case "Equiv", [a, b]:
            return _equal(f, a, b)
        case "Xor", [a, b]:
            return f.negation(_equal(f, a, b))
        case "strong_X", [a]:
            return f.next(a)
        case "X", [a]:
            return f.negation(f.next(f.negation(a)))
        case "F", [a]:
            return f.eventually(a)
        case "G", [a]:
            return f.negation(f.eventually(f.negation(a)))
        case "U", [a, b]:
            return f.until(a, b)
        case "R", [a, b]:
            return f.negation(f.until(f.negation(a), f.negation(b)))
        case "W", [a, b]:
            return f.negation(f.until(f.negation(b), f.negation(f.disjunction([a, b]))))
        case "M", [a, b]:
            return f.until(b, f.conjunction([a, b]))
        case _:
            raise source.error(f"{kind} is no operator of LTL on finite traces")


def _equal(f: Formulas, a: int, b: int) -> int:
    both = f.conjunction([a, b])
    neither = f.conjunction([f.negation(a), f.negation(b)])
    return f.disjunction([both, neither])
