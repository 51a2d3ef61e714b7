"""Text in Spot's LTLf syntax, read by Spot's own parser, as formulas of the core.

In Spot's LTLf `X` is the weak next and `X[!]` the strong one. On finite traces: G f = !F!f, f R g = !(!f U !g),
f W g = !(!g U !(f | g)), f M g = g U (f & g), X f = !X[!]!f.
"""

import re
import warnings
from collections.abc import Callable
from typing import Any, Final

from backends.ltlf.formulas import FALSE, TRUE, Formulas
from rvaft.errors import LanguageError, ToolMissing

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
        raise _malformed(str(error), text, line, column) from None
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


def _malformed(complaint: str, text: str, line: int, column: int) -> LanguageError:
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
