"""What a pattern asks of one observation: the comparisons that an event pattern and the guards on its values come to.

Guards have three values: where one cannot be calculated neither it nor its negation holds. So what is said is when it is true, or when it is false.
"""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from decimal import Decimal
from functools import partial
from typing import Final, TypeAlias

from rvaft.model.guards import COMPARISONS, OPERATORS, ORDERINGS, Guard, Operation, Operator, folded, variables
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
    asked = [folded(condition) for condition in conditions]
    alone = {names[0] for one in asked if len(names := variables(one)) == 1}  # to compare a value asks for it, too
    tests: list[Test] = []
    todo: list[tuple[tuple[str, ...], Pattern]] = [((), pattern)]
    while todo:
        way, part = todo.pop(0)
        match part:
            case ObjectPattern(inner) if inner or not way:
                todo[:0] = [((*way, name), below) for name, below in inner]
            case ObjectPattern() | ListPattern():
                raise Unsaid("no comparison asks for the length of a list, or whether a value is an object")
            case Literal(value):
                tests.append(_compared(path_of(way), Operator.EQ, value))
            case Variable(name) if name in paths:
                raise Unsaid("no comparison is of two properties, and two have to be equal")
            case _:
                path = path_of(way)
                paths |= {part.name: path} if isinstance(part, Variable) else {}
                tests += [] if alone & {getattr(part, "name", None)} else [f"({path} = '' OR {path} != '')"]
    return _all([*tests, *(_truth(paths, condition, wanted=True) for condition in asked)])


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


def _compared(path: str, operator: Operator, value: Json) -> Test:
    if operator in ORDERINGS and (value is None or isinstance(value, bool)):
        return False
    return f"{path} {'=' if operator is Operator.EQ else operator} {literal(value)}"


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


def _truth(paths: Mapping[str, str], guard: Guard, *, wanted: bool) -> Test:
    """When a guard has this truth value."""
    inner = partial(_truth, paths)
    match guard:
        case Literal(value):
            return value is wanted
        case Variable(name):
            return _compared(paths[name], Operator.EQ, wanted)
        case Operation() if not variables(guard):  # what is undefined stays as it is
            return False
        case Operation(Operator.NOT, (one,)):
            return inner(one, wanted=not wanted)
        case Operation(Operator.AND | Operator.OR as operator, (first, *others)):  # read from the left while all are so
            rest = Operation(operator, tuple(others)) if others[1:] else others[0]
            if wanted is (operator is Operator.AND):
                return _all([inner(first, wanted=wanted), inner(rest, wanted=wanted)])
            return _any(
                [inner(first, wanted=wanted), _all([inner(first, wanted=not wanted), inner(rest, wanted=wanted)])]
            )
        case Operation(operator, (Variable(name), Literal(value))) if operator in COMPARISONS:
            return _compared(paths[name], operator if wanted else OPERATORS[operator].negated or operator, value)
        case Operation(operator, (Literal(), Variable()) as sides) if operator in COMPARISONS:
            return inner(Operation(OPERATORS[operator].mirrored or operator, sides[::-1]), wanted=wanted)
        case Operation(Operator.IN, (one, *listed)):
            tests = [inner(Operation(Operator.EQ, (one, it)), wanted=wanted) for it in listed]
            return _any(tests) if wanted else _all(tests)
        case Operation(Operator.LIKE, (Variable() as one, Literal(str() as glob))) if re.fullmatch(r"[^*?]*\*+", glob):
            return inner(Operation(Operator.STARTSWITH, (one, Literal(glob.rstrip("*")))), wanted=wanted)
        case Operation(Operator.STARTSWITH, (Variable() as one, Literal(str() as start))):
            kept = start.rstrip("\U0010ffff")
            behind = [Operation(Operator.LT, (one, Literal(kept[:-1] + chr(ord(kept[-1]) + 1))))] if kept else []
            tests = [inner(each, wanted=wanted) for each in (Operation(Operator.GE, (one, Literal(start))), *behind)]
            return _all(tests) if wanted else _any(tests)
        case Operation(Operator.ENDSWITH, (Variable(name), Literal(str() as end))):
            return _matched(paths[name], ["", end], wanted=wanted)
        case Operation(Operator.CONTAINS, (Variable(name), Literal(str() as piece))):
            return _matched(paths[name], ["", piece, ""], wanted=wanted)
        case Operation(Operator.LIKE, (Variable(name), Literal(str() as glob))) if "?" not in glob and "*" in glob:
            return _matched(paths[name], re.split(r"\*+", glob), wanted=wanted)
        case Operation(Operator.LIKE, (Variable(), Literal(str()))):
            raise Unsaid(_NFC)
        case _:
            raise Unsaid("a comparison is of one property and a constant, and calculates nothing")
