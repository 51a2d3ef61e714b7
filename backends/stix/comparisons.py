"""Comparison expressions for one observation, from an event pattern and guards on its values."""

import re
from collections.abc import Callable, Mapping, Sequence
from decimal import Decimal
from typing import ClassVar, Final

from backends.field_conditions import DialectTest, FieldConditions, FieldPath
from backends.stix.observations import EVENT
from rvaft.errors import NotExpressible, Reason, cannot, unwritten
from rvaft.model.guards import Operator
from rvaft.model.values import Json, has_surrogate

_WORD: Final = re.compile(r"[a-z_][a-z0-9_]*", re.ASCII)
_MADE: Final = re.compile(r"[^\0-\x7f]|[;K`]")
"""Characters that Unicode normalisation (NFC) may change or produce."""
_OPEN: Final = re.compile(r"[A-PR-Za-pr-z<=>]\Z")
"""Characters that NFC may combine with a following mark."""
NO_NULL: Final = cannot("STIX has no null")
ONE_OBSERVATION: Final = cannot("a pattern cannot compare two observations")


class StixConditions(FieldConditions):
    """The comparison expressions of STIX; `path_of` returns an object path."""

    always, never = f"{EVENT}:type = '{EVENT}'", f"{EVENT}:type != '{EVENT}'"
    conjunction, disjunction = " AND ", " OR "
    exists, equals, differs, is_truth = "({p} = '' OR {p} != '')", "{p} = {v}", "{p} != {v}", "{p} = {v}"
    comparing_asks = True
    reasons: ClassVar[Mapping[DialectTest, Reason]] = {
        DialectTest.TWO_FIELDS: unwritten("a comparison compares one property with a constant"),
        DialectTest.CONTAINER: unwritten(
            "comparisons are not written for the length of a list, or for whether a value is an object"
        ),
        DialectTest.CALCULATION: unwritten("a comparison has one property and a constant, and no arithmetic"),
        DialectTest.NULL: NO_NULL,
        DialectTest.SURROGATE: unwritten("half of a surrogate pair is not a string"),
        DialectTest.TEXT_FUNCTION: unwritten("LIKE and MATCHES normalise strings to Unicode NFC before comparison"),
    }

    def __init__(self, path_of: Callable[[tuple[str, ...]], str]) -> None:
        self._path_of = path_of

    def path(self, way: FieldPath) -> str:
        """Return an object path."""
        return self._path_of(tuple(map(str, way)))

    def literal(self, value: Json) -> str:
        """Return a constant of STIX."""
        return literal(value)

    def function(self, operator: Operator, path: str, text: str, *, wanted: bool) -> str:
        """Return the test of a string function on a property."""
        match operator:
            case Operator.LIKE if re.fullmatch(r"[^*?]*\*+", text):
                return self.function(Operator.STARTSWITH, path, text.rstrip("*"), wanted=wanted)
            case Operator.STARTSWITH:
                kept = text.rstrip("\U0010ffff")
                ends = [text, *([kept[:-1] + chr(ord(kept[-1]) + 1)] if kept else [])]
                signs = (">=", "<") if wanted else ("<", ">=")
                tests = [f"{path} {sign} {literal(end)}" for sign, end in zip(signs, ends, strict=False)]
                return self.all(tests) if wanted else self.any(tests)
            case Operator.ENDSWITH:
                return self._matched(path, ["", text], wanted=wanted)
            case Operator.CONTAINS:
                return self._matched(path, ["", text, ""], wanted=wanted)
            case Operator.LIKE if "*" in text and "?" not in text:
                return self._matched(path, re.split(r"\*+", text), wanted=wanted)
            case _:
                raise self.lacks(DialectTest.TEXT_FUNCTION)

    def _matched(self, path: str, pieces: Sequence[str], *, wanted: bool) -> str:
        """Return the test that a string consists of these pieces, with any text between them."""
        if any(map(_MADE.search, pieces)) or any(map(_OPEN.search, pieces[:-1])):
            raise self.lacks(DialectTest.TEXT_FUNCTION)
        first, *inner, last = map(re.escape, pieces)
        middle = "".join(rf"(?>[\s\S]*?{piece})" for piece in inner)
        end = rf"[\s\S]*{last}(?![\s\S])" if last else ""
        test = f"MATCHES {literal(f'^{first}{middle}{end}')}"
        return f"{path} {test}" if wanted else f"{path} >= '' AND {path} NOT {test}"


def step(name: str) -> str:
    """Return a step of an object path; raises `NotExpressible`."""
    return name if _WORD.fullmatch(name) and name not in ("true", "false") else literal(name)


def literal(value: Json) -> str:
    """Return a constant; raises `NotExpressible`."""
    match value:
        case bool():
            return "true" if value else "false"
        case int() | float():
            text = format(Decimal(repr(value)), "f")
            return text if isinstance(value, int) or "." in text else f"{text}.0"
        case str() if not has_surrogate(value):
            return "'" + re.sub(r"([\\'])", r"\\\1", value) + "'"
        case None:
            raise NotExpressible(StixConditions.reasons[DialectTest.NULL])
        case _:
            raise NotExpressible(StixConditions.reasons[DialectTest.SURROGATE])
