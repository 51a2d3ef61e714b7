"""What a pattern asks of one observation: the comparisons that an event pattern and the guards on its values come to.

Guards have three values: where one cannot be calculated neither it nor its negation holds. So what is said is when it is true, or when it is false.
"""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from decimal import Decimal
from typing import Final, TypeAlias

from rvaft.core.conditions import (
    ComparisonTest,
    ConditionTest,
    EqualityTest,
    TruthConditions,
    TruthTest,
    spelled,
)
from rvaft.model.guards import OPERATORS, Guard, Operation, Operator, variables
from rvaft.model.patterns import ListPattern, Literal, ObjectPattern, Pattern, Variable
from rvaft.model.values import Json

_WORD: Final = re.compile(r"[a-z_][a-z0-9_]*", re.ASCII)
_MADE: Final = re.compile(r"[^\0-\x7f]|[;K`]")
"""Signs that Unicode's form NFC makes of others, or may."""
_OPEN: Final = re.compile(r"[A-PR-Za-pr-z<=>]\Z")
"""What it joins with a mark behind it."""
_NFC: Final = "LIKE and MATCHES compare what Unicode's form NFC makes of a string, not the string"

Test: TypeAlias = str | bool
"""A comparison expression, or one that always or never holds."""


class Unsaid(Exception):
    """Why no comparison says it."""


def comparisons(pattern: Pattern, conditions: Iterable[Guard], path_of: Callable[[tuple[str, ...]], str]) -> Test:
    """What an event that fits a pattern under guards over its own values is asked; raises `Unsaid`."""
    paths: dict[str, str] = {}
    found: list[tuple[str, Test]] = []
    todo: list[tuple[tuple[str, ...], Pattern]] = [((), pattern)]
    while todo:
        way, part = todo.pop(0)
        match part:
            case ObjectPattern(inner) if inner or not way:
                todo[:0] = [((*way, name), below) for name, below in inner]
            case ObjectPattern() | ListPattern():
                raise Unsaid("no comparison asks for the length of a list, or whether a value is an object")
            case Literal(value):
                found.append(("", f"{path_of(way)} = {literal(value)}"))
            case Variable(name) if name in paths:
                raise Unsaid("no comparison is of two properties, and two have to be equal")
            case _:
                name, path = getattr(part, "name", ""), path_of(way)
                paths |= {name: path} if name else {}
                found.append((name, f"({path} = '' OR {path} != '')"))
    said = [(variables(one), _spelled(one, paths)) for one in conditions]
    alone = {
        names[0] for names, test in said if len(names) == 1 and isinstance(test, str)
    }  # to compare asks for it, too
    return _all([*(test for name, test in found if name not in alone), *(test for _, test in said)])


def step(name: str) -> str:
    """A step of an object path; raises `Unsaid`."""
    return name if _WORD.fullmatch(name) and name not in ("true", "false") else literal(name)


def literal(value: Json) -> str:
    """A constant as a pattern writes it; raises `Unsaid`."""
    match value:
        case bool():
            return "true" if value else "false"
        case int() | float():
            text = format(Decimal(repr(value)), "f")
            return text if isinstance(value, int) or "." in text else f"{text}.0"
        case str() if not any("\ud800" <= sign <= "\udfff" for sign in value):
            return "'" + re.sub(r"([\\'])", r"\\\1", value) + "'"
        case _:
            raise Unsaid("STIX has no null" if value is None else "half a surrogate pair is no text")


def _matched(path: str, pieces: Sequence[str], *, wanted: bool) -> Test:
    """That a text has these pieces one after the other, the first and the last at its ends; raises `Unsaid`."""
    if any(map(_MADE.search, pieces)) or any(map(_OPEN.search, pieces[:-1])):
        raise Unsaid(_NFC)
    first, *inner, last = map(re.escape, pieces)
    regex = (
        f"^{first}"
        + "".join(rf"(?>[\s\S]*?{piece})" for piece in inner)
        + (rf"[\s\S]*{last}(?![\s\S])" if last else "")
    )
    test = f"MATCHES {literal(regex)}"
    return f"{path} {test}" if wanted else f"{path} >= '' AND {path} NOT {test}"


def _all(tests: Iterable[Test]) -> Test:
    some = list(dict.fromkeys(tests))
    return False not in some and (" AND ".join(test for test in some if isinstance(test, str)) or True)


def _any(tests: Iterable[Test]) -> Test:
    some = list(dict.fromkeys(tests))
    ways = [test for test in some if isinstance(test, str)]
    return True in some or (f"({' OR '.join(ways)})" if len(ways) > 1 else next(iter(ways), False))


def _spelled(guard: Guard, paths: Mapping[str, str]) -> Test:
    """When a guard is true."""

    def test(one: ConditionTest) -> Test:
        match one:
            case TruthTest(Variable(name), wanted):
                return f"{paths[name]} = {literal(wanted)}"
            case TruthTest(Operation(operator, (Variable(name), Literal(str() as text))), wanted):
                return _of_text(paths[name], operator, text, wanted=wanted)
            case EqualityTest(Variable(name), Literal(value), wanted) | EqualityTest(
                Literal(value), Variable(name), wanted
            ):
                return f"{paths[name]} {'=' if wanted else '!='} {literal(value)}"
            case ComparisonTest(_, Variable(name), sign, Literal(value)):
                return f"{paths[name]} {sign} {literal(value)}"
            case ComparisonTest(sort, Literal() as left, sign, Variable() as right):
                return test(ComparisonTest(sort, right, str(OPERATORS[Operator(sign)].mirrored), left))
            case _:
                raise Unsaid("a comparison is of one property and a constant, and calculates nothing")

    return spelled(TruthConditions().of(guard), test, lambda every, parts: (_all if every else _any)(parts))


def _of_text(path: str, operator: Operator, text: str, *, wanted: bool) -> Test:
    """What a function of texts says of a property."""
    match operator:
        case Operator.LIKE if re.fullmatch(r"[^*?]*\*+", text):
            return _of_text(path, Operator.STARTSWITH, text.rstrip("*"), wanted=wanted)
        case Operator.STARTSWITH:
            kept = text.rstrip("\U0010ffff")
            ends = [literal(text)] + ([literal(kept[:-1] + chr(ord(kept[-1]) + 1))] if kept else [])
            tests = [
                f"{path} {sign} {end}" for sign, end in zip((">=", "<") if wanted else ("<", ">="), ends, strict=False)
            ]
            return _all(tests) if wanted else _any(tests)
        case Operator.ENDSWITH:
            return _matched(path, ["", text], wanted=wanted)
        case Operator.CONTAINS:
            return _matched(path, ["", text, ""], wanted=wanted)
        case Operator.LIKE if "*" in text and "?" not in text:
            return _matched(path, re.split(r"\*+", text), wanted=wanted)
        case _:
            raise Unsaid(_NFC)
