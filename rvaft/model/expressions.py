"""Names, patterns and guards as text that the parser reads back."""

import json
import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from typing import Final

from rvaft.errors import LanguageError
from rvaft.model.event_time import EventTime, duration_text
from rvaft.model.guards import (
    COMPARISONS,
    FUNCTIONS,
    MAX_DEPTH,
    OPERATORS,
    Duration,
    Guard,
    Operation,
    Operator,
    TimePoint,
)
from rvaft.model.nodes import Argument, Assumption, Gate, Node, On, Side, Without
from rvaft.model.patterns import Anything, ListPattern, Literal, ObjectPattern, Pattern, SomeItem, Variable
from rvaft.model.values import Scalar, has_surrogate
from rvaft.support.terminal import readable_json

STATEMENTS: Final = ("toplevel", "event", "ignore", "import", "prune", "causality", "param")
TOPIC: Final = "topic"
"""A keyword only before a string, `type` and a string; otherwise a possible name of a node."""
GATES: Final = tuple(gate.value for gate in Gate if not gate.counts)
"""The gates that are written as a word, all but votes."""
CLAUSES: Final = ("on", "when", "fault", "attack", "label", "times", "within", "without")
OPERATOR_WORDS: Final = ("and", "or", "not")
DYNAMIC: Final = frozenset(
    {"xor", "nor", "nand", "not", "por", "pxor", "sor", "seq", "mutex", "inhibit"}
    | {"spare", "wsp", "csp", "hsp", "fdep", "pdep", "rdep"}
).difference(GATES)
"""Gates of other fault-tree languages, reserved so that a missing semicolon is reported."""

RESERVED: Final = frozenset({*STATEMENTS, *GATES, *CLAUSES, *OPERATOR_WORDS, *DYNAMIC})

WORD: Final = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_NUMBERED_GATE: Final = re.compile(r"vot[0-9]+")
_VALUE: Final = re.compile(r'(?!=)(?:(?!//|/\*)[^\s;"#])+')
_ATOM: Final = 8
"""The precedence level of an atomic text."""


def bare_name(name: str) -> bool:
    """Whether a node's name needs no quotes."""
    return bool(WORD.fullmatch(name)) and name not in RESERVED and name != TOPIC and not _NUMBERED_GATE.fullmatch(name)


def quoted(text: str) -> str:
    """Return a text as a JSON string; raises `LanguageError` for an unpaired surrogate."""
    if has_surrogate(text):
        raise LanguageError("an unpaired surrogate cannot be written")
    return readable_json(text)


def name_text(name: str) -> str:
    """Return a node's name, quoted if necessary."""
    return name if bare_name(name) else quoted(name)


def word_text(word: str) -> str:
    """Return the name of a field or event type, quoted if necessary."""
    return word if WORD.fullmatch(word) else quoted(word)


def time_text(time: EventTime) -> str:
    """Return a `time` statement without `late` and semicolon."""
    return f"time {'.'.join(map(name_text, time.field))} as {time.format}"


def assumptions_text(assumptions: Collection[Assumption], time: EventTime | None) -> str:
    """Return assumptions as an `assume` statement lists them.

    >>> assumptions_text({Assumption.CASE, Assumption.TYPES}, None)
    'types, case'
    """
    late = "" if time is None or time.late is None else f" {duration_text(time.late)}"
    return ", ".join(
        f"{one}{late}" if one is Assumption.ORDER else one.value for one in Assumption if one in assumptions
    )


def literal_text(value: Scalar) -> str:
    """Return a literal; raises `LanguageError` for a number that the language cannot write."""
    if isinstance(value, str):
        return quoted(value)
    try:
        return json.dumps(value, allow_nan=False)
    except ValueError:
        raise LanguageError("a number that is not finite, or has too many digits, cannot be written") from None


def pattern_text(pattern: Pattern, depth: int = 0) -> str:
    """Return a pattern as text for `parse_pattern`.

    Raises `LanguageError` beyond 100 levels of nesting.
    """
    if depth > MAX_DEPTH:
        raise LanguageError(f"a pattern nested deeper than {MAX_DEPTH} cannot be written")
    match pattern:
        case Literal(value):
            return literal_text(value)
        case Variable(name):
            return name
        case Anything():
            return "_"
        case ObjectPattern(()):
            return "{}"
        case ObjectPattern(fields):
            inner = ", ".join(f"{word_text(name)}: {pattern_text(part, depth + 1)}" for name, part in fields)
            return f"{{ {inner} }}" if depth == 0 else f"{{{inner}}}"
        case ListPattern(items):
            return f"[{', '.join(pattern_text(item, depth + 1) for item in items)}]"
        case SomeItem(item):
            return f"[..., {pattern_text(item, depth + 1)}, ...]"


SIGNS: Final = {operator: facts.sign for operator, facts in OPERATORS.items()}


@dataclass(frozen=True, slots=True)
class Style:
    """The notation of guards and events; `signs` of prefix operators include their space."""

    node: Callable[[str], str] = name_text
    event: Callable[[str], str] = word_text
    variable: Callable[[str], str] = str
    literal: Callable[[Scalar], str] = literal_text
    word: Callable[[str], str] = " {}".format
    """A word after an event: ` without`."""
    anything: str = "_"
    """The argument that matches any value."""
    signs: Mapping[Operator, str] = field(default_factory=SIGNS.copy)
    brackets: tuple[str, str] = ("(", ")")
    point: str = "{}({})"
    """The format of `at`, `start` or `end` of a node."""
    duration: Callable[[int], str] = duration_text
    listed: tuple[str, str] = ("(", ")")
    """The brackets around the literals after `in`."""
    fraction: Callable[[str, str], str | None] | None = None
    """The notation of a quotient with stacked operands."""
    minus_level: int = OPERATORS[Operator.NEGATE].level
    """The precedence level of a minus before an operand or a number."""
    not_operand: int = OPERATORS[Operator.NOT].level
    """The minimum level of an operand of `not` without brackets."""


SUM_LEVEL: Final = OPERATORS[Operator.ADD].level
SIGNED_LEVEL: Final = OPERATORS[Operator.NEGATE].level
PLAIN: Final = Style()


def count_text(node: Node) -> str:
    """Return the number of a leaf's events: `times 20 distinct Port`, or nothing for a single event."""
    parts = [f"times {node.times}"] if node.times > 1 or node.own_values else []
    parts += [f"distinct {', '.join(node.distinct)}"] if node.distinct else []
    return " ".join([*parts, *([f"each {', '.join(node.each)}"] if node.each else [])])


def without_text(clause: Without, style: Style = PLAIN) -> str:
    """Return a `without` as the language writes it: `without beat(Robot) for 2 s after`."""
    when = "" if clause.when is None else f"{style.word('when')} {guard_text(clause.when, style)}"
    duration = "" if clause.duration is None else f"{style.word('for')} {style.duration(clause.duration)}"
    side = "" if clause.side is Side.DURING else style.word(clause.side)
    return f"{style.word('without').lstrip()} {on_text(clause.on, style)}{when}{duration}{side}"


def on_text(on: On, style: Style = PLAIN) -> str:
    """Return an event type applied to arguments: `move(Waypoint, _)`."""

    def argument_text(argument: Argument) -> str:
        match argument:
            case Variable(name):
                return style.variable(name)
            case Literal(value):
                return style.literal(value)
            case Anything():
                return style.anything

    return f"{style.event(on.event)}({', '.join(map(argument_text, on.arguments))})"


def event_text(node: Node, style: Style = PLAIN) -> str:
    """Return the runtime event of a node; the default event is the node's name."""
    return style.node(node.name) if node.on is None else on_text(node.on, style)


def guard_text(guard: Guard, style: Style = PLAIN) -> str:
    """Return a guard with minimal brackets; `parse_guard` reads the plain style back.

    Raises `LanguageError` beyond 100 levels of nesting.
    """
    return _guard(guard, style, 0)[0]


def _guard(guard: Guard, style: Style, depth: int) -> tuple[str, int]:
    """Return the text, and the level of its outermost operator."""
    if depth > MAX_DEPTH:
        raise LanguageError(f"a guard nested deeper than {MAX_DEPTH} cannot be written")
    match guard:
        case TimePoint(point=point, node=node):
            return style.point.format(point, style.node(node)), _ATOM
        case Duration(int(nanoseconds)):
            return style.duration(nanoseconds), _ATOM
        case Variable(name):
            return style.variable(name), _ATOM
        case Literal(value):
            text = style.literal(value)
            return text, style.minus_level if text.startswith(style.signs[Operator.NEGATE]) else _ATOM
        case Operation(operator, operands):
            parts = [_guard(operand, style, depth + 1) for operand in operands]
    level, sign = OPERATORS[operator].level, style.signs[operator]

    def least(needed: int, part: tuple[str, int]) -> str:
        text, own = part
        return text if own >= needed else f"{style.brackets[0]}{text}{style.brackets[1]}"

    match operator:
        case Operator.NOT:
            return f"{sign}{least(style.not_operand, parts[0])}", level
        case Operator.NEGATE:
            # -1 is a number; the operator applied to the number 1 is -(1)
            number = parts[0][1] == _ATOM and parts[0][0][0].isdigit()
            return f"{sign}{least(_ATOM + 1 if number else level, parts[0])}", style.minus_level
        case Operator.AND | Operator.OR:
            return f" {sign} ".join(least(level + 1, part) for part in parts), level
        case Operator.IN:
            listed = ", ".join(text for text, _ in parts[1:])
            return f"{least(level + 1, parts[0])} {sign} {style.listed[0]}{listed}{style.listed[1]}", level
        case _ if operator in FUNCTIONS:
            return f"{sign}({', '.join(least(SUM_LEVEL, part) for part in parts)})", _ATOM
        case Operator.DIV if style.fraction and (stacked := style.fraction(parts[0][0], parts[1][0])) is not None:
            return stacked, SIGNED_LEVEL
        case _:  # arithmetic is left-associative; comparisons do not chain
            left, right = parts
            return f"{least(level + (operator in COMPARISONS), left)} {sign} {least(level + 1, right)}", level


def bare_value(value: str) -> bool:
    """Whether the value of a Galileo attribute needs no quotes."""
    return value.isprintable() and _VALUE.fullmatch(value) is not None


def value_text(value: str) -> str:
    """Return the value of a Galileo attribute, quoted if necessary."""
    return value if bare_value(value) else quoted(value)
