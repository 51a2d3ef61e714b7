"""Equality, event patterns, times and guards (definition, section 1)."""

import datetime
import json
import math
import re
import zoneinfo
from collections.abc import Callable, Mapping
from fractions import Fraction
from typing import Any

from rvaft.model.event_time import EventTime, TextFormat
from rvaft.model.guards import Guard, Operation, TimePoint
from rvaft.model.nodes import Node, On
from rvaft.model.patterns import Anything, ListPattern, Literal, ObjectPattern, Pattern, SomeItem, Variable
from rvaft.model.tree import RVAFT

Binding = Mapping[str, Any]
"""The values of variables and, by their text, of time points (None if undefined)."""


def same(left: Any, right: Any) -> bool:
    """Clause: numbers by mathematical value, booleans only equal booleans, objects with the same
    keys, lists elementwise.

    Clause: a number that is not finite equals nothing.
    """
    if not defined(left) or not defined(right):
        return False
    if isinstance(left, bool) or isinstance(right, bool):
        return left is right
    if isinstance(left, (int, float)) and isinstance(right, (int, float)):
        return left == right
    if isinstance(left, dict) and isinstance(right, dict):
        return set(left) == set(right) and all(same(left[k], right[k]) for k in left)
    if isinstance(left, list) and isinstance(right, list):
        return len(left) == len(right) and all(map(same, left, right))
    return type(left) is type(right) and bool(left == right)


def defined(value: Any) -> bool:
    """Clause: NaN and the infinities are undefined, and so is what has one."""
    if isinstance(value, (dict, list)):
        return all(map(defined, value.values() if isinstance(value, dict) else value))
    return not isinstance(value, float) or math.isfinite(value)


def time_of(declaration: EventTime | None, event: Any) -> int | None:
    """Clause: the time of an event is an integer number of nanoseconds, or undefined (None)."""
    if declaration is None:
        return None
    value = event
    for name in declaration.field:
        if not isinstance(value, dict) or name not in value:
            return None
        value = value[name]
    if isinstance(declaration.format, TextFormat):
        return scanned(declaration.format, value) if isinstance(value, str) and len(value) <= 1000 else None
    form = declaration.format.value
    if form == "ros":
        pairs = [("sec", "nanosec"), ("secs", "nsecs")] if isinstance(value, dict) else []
        found = [(value[s], value[n]) for s, n in pairs if type(value.get(s)) is int and type(value.get(n)) is int]
        return found[0][0] * 10**9 + found[0][1] if found else None
    if isinstance(value, str) and len(value) > 1000:
        return None
    if form == "iso8601":
        return instant(value) if isinstance(value, str) else None
    # Clause: a number of these units, or a string that writes one as JSON does; a double is the
    # shortest decimal that denotes it.
    text = value if isinstance(value, str) else repr(value) if type(value) in (int, float) and abs(value) < 1e40 else ""
    if not re.fullmatch(r"-?(0|[1-9][0-9]*)([.][0-9]+)?([eE][-+]?[0-9]+)?", text, re.ASCII):
        return None
    mantissa, _, exponent = text.lower().partition("e")
    # Clauses: `filetime` counts from 1601; rounded to nanoseconds, half to even (as `round` does).
    begin = (datetime.date(1601, 1, 1) - datetime.date(1970, 1, 1)).days * 86_400 * 10**9 if form == "filetime" else 0
    if Fraction(mantissa) == 0 or int(exponent or 0) < -2000:
        return begin
    if int(exponent or 0) > 2000 or abs(number := Fraction(text)) >= 10**31:
        return None
    return begin + round(number * {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1, "filetime": 100}[form])


def scanned(form: TextFormat, text: str) -> int | None:
    """Clause: the directives read from left to right, each the longest text that it can."""
    rest, had = text, dict[str, str]()
    pattern = re.split("(%.| +)", form.pattern.replace("\t", " "))
    pieces = [piece for part in pattern for piece in ([part] if part[:1] in ("%", " ") else part)]
    for number, piece in enumerate(pieces):
        following = pieces[number + 1] if number + 1 < len(pieces) else ""
        name = piece[1:] if piece[:1] == "%" else ""
        if name in ("", "%"):
            wanted = " " if piece[:1] == " " else piece[-1:]
            if not rest.startswith((wanted, "\t") if wanted == " " else wanted):
                return None
            rest = rest.lstrip(" \t") if wanted == " " else rest[1:]
            continue
        found = next((one for one in _spellings(name, rest, following) if rest.startswith(one)), None)
        if found is None:
            return None
        had[name], rest = found, rest[len(found) :]
    return None if rest else _dated(form, had)


def _spellings(name: str, rest: str, following: str) -> list[str]:
    """Return the texts that a directive may read there, the longest first."""
    if name in "aAbB":
        return [one if name in "AB" else one[:3] for one in (DAYS if name in "aA" else MONTHS)]
    if name == "p":
        return ["AM", "PM", "am", "pm"]
    if name == "z":
        found = re.match("[-+][0-9]{2}(:?[0-9]{2})?", rest)
        return [found[0]] if found else ["Z", "z"]
    digits = len(rest) - len(rest.lstrip("0123456789"))
    fixed = following in ("%Y", "%y", "%m", "%d", "%H", "%I", "%M", "%S", "%f") or (
        following != "" and following in "0123456789"
    )
    sizes = {"Y": (4, 4), "y": (2, 2), "f": (1, 9)}
    least, most = sizes.get(name, (2 if fixed else 1, 2))
    return [rest[: min(digits, most)]] if digits >= least else []


DAYS: list[str] = re.findall("[A-Z][a-z]+", "Monday Tuesday Wednesday Thursday Friday Saturday Sunday")
MONTHS: list[str] = re.findall(
    "[A-Z][a-z]+", "January February March April May June July August September October November December"
)


def _dated(form: TextFormat, had: Mapping[str, str]) -> int | None:
    """Clause: without `%z` the zone, or UTC; a skipped time is undefined, and a repeated one is the first."""
    month = next((n for n, one in enumerate(MONTHS, 1) if one[:3] in (had.get("b"), had.get("B", "")[:3])), None)
    hour = int(had.get("H", "0"))
    if "I" in had:
        if not 1 <= int(had["I"]) <= 12:
            return None
        hour = int(had["I"]) % 12 + (12 if had["p"] in ("PM", "pm") else 0)
    try:
        # Clause: two digits are a year from 1969 to 2068.
        short = (int(had["y"]) - 69) % 100 + 1969 if "y" in had else form.year or 0
        day = datetime.date(int(had["Y"]) if "Y" in had else short, month or int(had["m"]), int(had["d"]))
        start = datetime.datetime.combine(day, datetime.time(hour, int(had.get("M", "0"))))
        offset = had.get("z") or form.zone or "Z"
        seconds = int(had.get("S", "0"))
        if seconds > 60:
            return None
        if offset in ("Z", "z") or offset[0] in "+-":
            minutes = [int(one) for one in re.findall("[0-9]{2}", offset)]
            if minutes and (minutes[0] > 23 or minutes[-1] > 59):
                return None
            east = (minutes[0] * 60 + (minutes[1] if len(minutes) > 1 else 0)) * 60 if minutes else 0
            ahead = -east if offset[0] == "-" else east
        else:
            zone = zoneinfo.ZoneInfo(offset)
            first, second = (zone.utcoffset(start.replace(fold=fold)) for fold in (0, 1))
            if first is None or second is None or first < second:  # a gap has the larger offset after it
                return None
            ahead = round(first.total_seconds())
    except (ValueError, OverflowError):
        return None
    whole = (start - datetime.datetime(1970, 1, 1)) // datetime.timedelta(seconds=1)
    return (whole + seconds - ahead) * 10**9 + int(had.get("f", "0").ljust(9, "0"))


def instant(text: str) -> int | None:
    """Clause: a date, `T` or a space, hours and minutes, with or without seconds, decimals and an
    offset; UTC without one.

    Clause: days of 86,400 s; second 60 is the first of the next minute.
    """
    clock = r"(?P<h>[0-9]{2}):(?P<m>[0-9]{2})(:(?P<s>[0-9]{2})([.,](?P<f>[0-9]+))?)?"
    zone = r"(?P<z>[Zz]|(?P<sign>[-+])(?P<zh>[0-9]{2})(:?(?P<zm>[0-9]{2}))?)?"
    found = re.fullmatch(rf"(?P<day>[0-9]{{4}}-[0-9]{{2}}-[0-9]{{2}})[Tt ]{clock}{zone}", text)
    if not found:
        return None
    part = {name: int(found[name] or 0) for name in ("h", "m", "s", "zh", "zm")}
    if part["h"] > 23 or part["m"] > 59 or part["s"] > 60 or part["zh"] > 23 or part["zm"] > 59:
        return None
    try:
        days = (datetime.date.fromisoformat(found["day"]) - datetime.date(1970, 1, 1)).days
    except ValueError:
        return None
    east = -1 if found["sign"] == "-" else 1
    minutes = (days * 24 + part["h"] - east * part["zh"]) * 60 + part["m"] - east * part["zm"]
    return round((minutes * 60 + part["s"] + Fraction(f"0.{found['f'] or 0}")) * 10**9)


def arguments(tree: RVAFT, on: On) -> dict[str, Pattern]:
    """Clause: arguments are variables, `_` (a fresh variable), or literals."""
    parameters = tree.events[on.event].parameters
    fresh = (
        Variable(f"_{name}") if isinstance(a, Anything) else a for name, a in zip(parameters, on.arguments, strict=True)
    )
    return dict(zip(parameters, fresh, strict=True))


def matches(pattern: Pattern, value: Any, binding: Binding, given: Mapping[str, Pattern]) -> list[Binding]:
    """Return the binding extended in each way in which the pattern with the given arguments matches.

    Clause: an object pattern matches an object that has at least its fields, a list pattern a list
    of the same length; `_` and parameters match any value, null included, but not an absent field.
    One used twice demands equal values. Clause: `[..., P, ...]` matches a list in which at least
    one element matches P.
    """
    found = [binding]
    match pattern:
        case Anything():
            return [binding]
        case Literal(expected):
            return [binding] if same(expected, value) else []
        case Variable(name) if name in given:
            return matches(given[name], value, binding, {})
        case Variable(name):
            return [{name: value} | dict(binding)] if name not in binding or same(binding[name], value) else []
        case SomeItem(item):
            elements = value if isinstance(value, list) else []
            return [one for element in elements for one in matches(item, element, binding, given)]
        case ObjectPattern(fields):
            if not isinstance(value, dict) or any(name not in value for name, _ in fields):
                return []
            parts = [(inner, value[name]) for name, inner in fields]
        case ListPattern(items):
            if not isinstance(value, list) or len(value) != len(items):
                return []
            parts = list(zip(items, value, strict=True))
    for inner, part in parts:
        found = [more for one in found for more in matches(inner, part, one, given)]
    return found


def observe(tree: RVAFT, node: Node, event: Any, binding: Binding) -> list[Binding]:
    """Return the binding extended in each way in which the event is the node's runtime event.

    Clause: a leaf with neither event nor guard observes the default event `{"event": "<its
    name>"}`.
    """
    if node.on is None:
        return [binding] if isinstance(event, dict) and "event" in event and same(event["event"], node.name) else []
    found = matches(tree.events[node.on.event].pattern, event, binding, arguments(tree, node.on))
    return [{name: value for name, value in one.items() if not name.startswith("_")} for one in found]


class Undefined(Exception):
    """Clause: wrong types, division by zero, overflow and a result that is not finite are
    *undefined*.
    """


def holds(guard: Guard, binding: Binding) -> bool:
    """Clause: a guard holds when its value is `true`; undefined does not hold and never raises."""
    try:
        return evaluate(guard, binding) is True
    except (Undefined, ZeroDivisionError, OverflowError):
        return False


def evaluate(guard: Guard, binding: Binding) -> Any:
    """Return the value of a guard; raises `Undefined`, `ZeroDivisionError` or `OverflowError`.

    Clause: undefined propagates through every operator, except that `and` and `or` read left to
    right and do not look at the right side when the left decides.
    """
    if isinstance(guard, Literal):
        return guard.value
    if isinstance(guard, TimePoint):
        return typed(binding[guard.name], int)
    if isinstance(guard, Variable):
        if not defined(binding[guard.name]):
            raise Undefined
        return binding[guard.name]
    operator, operands = guard.operator.value, guard.operands
    if operator in ("and", "or"):
        for operand in operands:
            truth = typed(evaluate(operand, binding), bool)
            if truth is (operator == "or"):
                return truth
        return operator == "and"
    values = [evaluate(operand, binding) for operand in operands]
    if operator == "not":
        return not typed(values[0], bool)
    if operator == "neg":
        return -numeric(values[0])
    if operator in FUNCTIONS:
        return FUNCTIONS[operator](*values)
    return binary(operator, *values)


def like(text: Any, glob: Any) -> bool:
    """Clause: `*` stands for any number of characters and `?` for exactly one."""
    typed(text, str), typed(glob, str)
    ends = {0}  # the lengths of the text that the pattern so far may match
    for sign in glob:
        if sign == "*":
            ends = set(range(min(ends), len(text) + 1)) if ends else set()
        else:
            ends = {end + 1 for end in ends if end < len(text) and sign in ("?", text[end])}
    return len(text) in ends


def number(value: Any) -> Any:
    """Clause: a number as it is, and the number that a string writes as JSON writes numbers."""
    if isinstance(value, str):
        try:
            value = json.loads(value) if value[:1] in set("-0123456789") and value == value.strip() else None
        except ValueError:
            raise Undefined from None
    return finite(typed(value, int, float))


def finite(value: Any) -> Any:
    """Return the value; raises `Undefined` if it is not finite."""
    if not defined(value):
        raise Undefined
    return value


FUNCTIONS: Mapping[str, Callable[..., Any]] = {
    "in": lambda value, *listed: any(same(value, one) for one in listed),
    "startswith": lambda text, start: typed(text, str)[: len(typed(start, str))] == start,
    "endswith": lambda text, end: typed(text, str)[max(len(text) - len(typed(end, str)), 0) :] == end,
    "contains": lambda text, part: typed(part, str) in typed(text, str),
    "like": like,
    "lower": lambda text: "".join(character.lower() for character in typed(text, str)),
    "abs": lambda value: abs(numeric(value)),
    "min": lambda *values: min(map(numeric, values)),
    "max": lambda *values: max(map(numeric, values)),
    "number": number,
}
"""Clauses: text and membership in guards; wrong types are undefined here, too."""


def binary(operator: str, left: Any, right: Any) -> Any:
    """Clause: `== !=` on all JSON values; `< <= > >=` between two numbers or two strings; `+ - * /`
    on numbers.
    """
    if operator in ("==", "!="):
        return same(left, right) is (operator == "==")
    if operator in ("<", "<=", ">", ">="):
        if not (isinstance(left, str) and isinstance(right, str)):
            typed(left, int, float), typed(right, int, float)
        below, equal = left < right, left == right
        return {"<": below, "<=": below or equal, ">": not below and not equal, ">=": not below}[operator]
    a, b = numeric(left), numeric(right)
    if operator not in ("+", "-", "*", "/"):
        raise NotImplementedError(f"the reference has no meaning for the operator {operator}")
    result = a + b if operator == "+" else a - b if operator == "-" else a * b if operator == "*" else a / b
    return finite(result)


def numeric(value: Any) -> int | float:
    """Clause: a number is its mathematical value: a double with an integral value is that integer
    in arithmetic.
    """
    number = typed(value, int, float)
    return int(number) if number == math.floor(number) else number


def typed(value: Any, *types: type) -> Any:
    """Return a value of one of the types, else raise `Undefined`; a boolean is no number."""
    if isinstance(value, types) and (isinstance(value, bool) is (types == (bool,))):
        return value
    raise Undefined


def names(term: Guard | Pattern) -> set[str]:
    """Return the variables and time points of a guard or a pattern."""
    match term:
        case Variable(name):
            return {name}
        case Operation(_, operands):
            return {name for operand in operands for name in names(operand)}
        case ObjectPattern(fields):
            return {name for _, inner in fields for name in names(inner)}
        case ListPattern(items):
            return {name for inner in items for name in names(inner)}
        case SomeItem(item):
            return names(item)
        case _:
            return set()


def bound_by(node: Node) -> set[str]:
    """Return the variables that occur in the `on` of a node, but for those of each counted event."""
    own = {*node.own_values}
    return set() if node.on is None else {a.name for a in node.on.arguments if isinstance(a, Variable)} - own
