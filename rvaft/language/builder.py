"""The callbacks that turn reductions of the grammar into statements, one per rule.

No callback recurses. Names stay tokens, with their positions, until a statement is added to a
draft.
"""

import json
import re
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple, TypeAlias, TypeVar

from lark import Token, Transformer

from rvaft.errors import OptionError
from rvaft.language.draft import Count, Draft, DraftNode, DraftTopic, GateUse, Located
from rvaft.model.assumptions import places
from rvaft.model.event_time import EventTime, TextFormat, TimeFormat, scaled
from rvaft.model.guards import (
    COMPARISONS,
    JUNCTIONS,
    MAX_DEPTH,
    MAX_GLOB,
    OPERATORS,
    Duration,
    Operation,
    Operator,
    TimePoint,
    time_points,
)
from rvaft.model.nodes import Assumption, Causality, EventType, Ignore, Kind, On, Place, Side, ValueType, Without
from rvaft.model.patterns import Anything, ListPattern, Literal, ObjectPattern, Pattern, SomeItem, Variable
from rvaft.model.values import Scalar, has_surrogate, is_number
from rvaft.model.verdict import Semantics
from rvaft.support.terminal import visible

# ruff: noqa: D102 - a method handles the grammar rule of its name

T = TypeVar("T")
Items: TypeAlias = list[Any]
CONSTANTS: Final[dict[str, Scalar]] = {"true": True, "false": False, "null": None}
_WORD: Final = re.compile(r"\w+")
WHOLE_NUMBER: Final = "`times` needs an integer of at least 1, as in times 20"
FORMATS: Final = f'{", ".join(TimeFormat)}, or a strptime format such as "%Y/%m/%d %H:%M:%S"'
"""The formats of times for messages."""


def shown(text: str) -> str:
    """Return a piece of text in backquotes: at most 40 characters, control characters escaped."""
    return f"`{visible(text if len(text) <= 40 else text[:37] + '...')}`"


class Slip(Exception):
    """A construct that the grammar allows and the language does not."""

    def __init__(self, message: str, token: Token) -> None:
        self.message = message
        self.position = token.start_pos or 0
        super().__init__(message)


@dataclass(slots=True)
class Page:
    """One file with its draft and its `toplevel` settings."""

    file: str
    draft: Draft
    toplevels: list[Located[str]]

    def place(self, word: "Word") -> Place:
        """Return the position of a word."""
        return Place(self.file, word.line or 1, word.column or 1)

    def located(self, word: "Word", value: T) -> Located[T]:
        """Return a value with the position of a word."""
        return Located(value, self.place(word))

    def names(self, words: Iterable["Word"]) -> tuple[Located[str], ...]:
        """Return names with their positions."""
        return tuple([self.located(word, word.value) for word in words])


class PlainWord(NamedTuple):
    """A word of a statement that the lexer read as one token."""

    value: str
    line: int
    column: int


Word: TypeAlias = Token | PlainWord


Statement: TypeAlias = Callable[[Page], None]
"""Adds a statement to the draft of its page."""


class ImportStatement(NamedTuple):
    """`import "file";`, which is processed before the following statements."""

    path: Token


class Clause(NamedTuple):
    """A clause such as `or a b` or `on move(X)`: the field of `DraftNode`, the start, and the
    value.
    """

    part: str
    start: Word
    value: Any


class Operand(NamedTuple):
    """A pattern or guard under construction; `unsigned` tells an unsigned number.

    `words` are the words of a pattern. `sort` distinguishes a time `point`, a `duration` and a
    `span` between two points from other values.
    """

    value: Any
    depth: int = 0
    words: tuple[Token, ...] = ()
    unsigned: bool = False
    sort: str = "value"


def text_of(token: Token) -> str:
    """Return the string of a quoted token, a JSON string."""
    try:
        text: str = json.loads(token)
    except ValueError:
        raise Slip("unknown escape in a string: a backslash is written \\\\", token) from None
    if has_surrogate(text):
        raise Slip("unpaired surrogate in a string: write the whole character", token)
    return text


def integer_of(digits: str, token: Token) -> int:
    """Return the value of decimal digits, at most `sys.get_int_max_str_digits` of them."""
    try:
        return int(digits)
    except ValueError:
        raise Slip(f"a number of {len(digits)} digits is too long", token) from None


def number_of(token: Token) -> int | float:
    """Return the number of a token: an integer or a double, both in the range of doubles."""
    number = integer_of(token, token) if token.isdigit() else float(token)
    if abs(number) > sys.float_info.max:
        raise Slip(f"the number {shown(token)} is too large for a double", token)
    return number


def _compound(value: Any, parts: Sequence[Operand], what: str, token: Token) -> Operand:
    depth = max((part.depth for part in parts), default=0)
    if depth >= MAX_DEPTH:
        raise Slip(f"this {what} is nested deeper than {MAX_DEPTH}", token)
    return Operand(value, depth + 1, tuple([word for part in parts for word in part.words]))


def _values(parts: Iterable[Operand]) -> tuple[Any, ...]:
    return tuple([part.value for part in parts])


_SUMS: Final[dict[tuple[str, ...], str]] = {
    ("point", "+", "duration"): "point",
    ("point", "-", "duration"): "point",
    ("duration", "+", "point"): "point",
    ("point", "-", "point"): "span",
}
_ALONE: Final = "a time is not a condition: compare it with another time"
_COMPARED: Final = (("point", "point"), ("span", "duration"), ("duration", "span"))


def _sort_of(operands: Sequence[Operand], token: Token) -> str:
    """Return the sort of an operator's result on times and durations, or raise `Slip`."""
    sorts = tuple(operand.sort for operand in operands)
    if set(sorts) == {"value"}:
        return "value"
    if sorts in _COMPARED and token in COMPARISONS:
        return "value"
    if sort := _SUMS.get((sorts[0], str(token), *sorts[1:])):
        return sort
    if token in ("not", *JUNCTIONS):
        raise Slip(_ALONE, token)
    values = [operand.value for operand in operands if operand.sort == "value"]
    numbers = any(isinstance(value, Literal) and is_number(value.value) for value in values)
    if numbers and "duration" not in sorts and token in (*COMPARISONS, "+", "-"):
        raise Slip("a duration has a unit, as in 10 s", token)
    if not {"point", "span"} & {*sorts} and "value" in sorts:
        mend = "a duration is compared with a difference of times, at(b) - at(a) > 5 s; a value with a number"
        raise Slip(mend, token)
    raise Slip("times are compared with times (at(a) <= at(b) + 5 s), and their difference with a duration", token)


def _gate(token: Token, children: Sequence[Word]) -> Clause:
    if not token[0].isdigit() and not token.startswith("vot"):
        return Clause("gates", token, (children, None, None))
    k, _, n = token.removeprefix("vot").partition("of")
    return Clause("gates", token, (children, integer_of(k, token), integer_of(n, token) if n else None))


def _check_parameter(word: Token, before: Items) -> None:
    if word in CONSTANTS or not "a" <= word[0] <= "z":
        lower = word.lstrip("_")[:1].lower() + word.lstrip("_")[1:]
        mend = f", as in {shown(lower)}" if lower not in ("", word, *CONSTANTS) else ""
        raise Slip(f"{shown(word)} is not a valid parameter name: it must start with a lower-case letter{mend}", word)
    if word in before:
        raise Slip(f"the parameter {shown(word)} occurs twice in one event type", word)


class Build(Transformer[Token, Any]):
    """The callbacks of the grammar's rules."""

    def path(self, items: Items) -> Items:
        return items[::2]

    arguments = field = fields = items = parameters = publishers = path

    def only_pattern(self, items: Items) -> Any:
        return items[0].value

    def only_guard(self, items: Items) -> Any:
        return self._condition(items[0], None)

    def _condition(self, term: Operand, token: Token | None) -> Any:
        if term.sort != "value":
            raise Slip(_ALONE, token or Token("START", "", 0))
        return term.value

    # Statements.

    def tree(self, items: Items) -> list[Statement | ImportStatement]:
        return items

    def toplevel(self, items: Items) -> Statement:
        return lambda page: page.toplevels.extend(page.names(items[1:2]))

    def param(self, items: Items) -> Statement:
        return lambda page: page.draft.parameters.extend(page.names(items[1:2]))

    def causality(self, items: Items) -> Statement:
        start, word, _ = items
        return lambda page: page.draft.causalities.append(page.located(start, Causality(word)))

    def semantics(self, items: Items) -> Statement:
        start, word, _ = items
        if word not in tuple(Semantics):
            raise Slip(f"unknown semantics {shown(word)}: known are {', '.join(Semantics)}", word)
        return lambda page: page.draft.semantics.append(page.located(start, Semantics(word)))

    def assumption(self, items: Items) -> tuple[Token, int | None]:
        word, length = items
        if word not in tuple(Assumption):
            raise Slip(f"unknown assumption {shown(word)}: known are {', '.join(Assumption)}", word)
        if (length is not None) is not (word == Assumption.ORDER):
            mend = "it takes no duration" if length is not None else "it needs a duration, as in order 5 min"
            raise Slip(f"the assumption {word}: {mend}", word)
        return word, None if length is None else self.duration([length]).value.value

    def assume(self, items: Items) -> Statement:
        def add(page: Page) -> None:
            for word, lateness in items[1::2]:
                if lateness is None:
                    page.draft.assumes.append(page.located(word, Assumption(word)))
                else:
                    page.draft.orders.append(page.located(word, lateness))

        return add

    def show(self, items: Items) -> Statement:
        return lambda page: page.draft.shows.extend(page.names(items[1::2]))

    def repeat(self, items: Items) -> Statement:
        return lambda page: page.draft.repeats.append(page.located(items[2], items[2].value))

    def moment(self, items: Items) -> tuple[Token, EventTime]:
        start, path, _, form = items
        if isinstance(form, Token):
            if form not in tuple(TimeFormat):
                raise Slip(f"unknown format of times {shown(form)}: known are {FORMATS}", form)
            form = TimeFormat(form)
        return start, EventTime(tuple(name.value for name in path), form)

    def text_format(self, items: Items) -> TextFormat:
        text, _, year, _, zone = items
        if text_of(text) in tuple(TimeFormat):
            raise Slip(f"write the format of times without quotes: {text_of(text)}", text)
        try:
            return TextFormat(
                text_of(text),
                None if year is None else integer_of(year, year),
                None if zone is None else text_of(zone),
            )
        except OptionError as error:
            raise Slip(str(error), text) from None

    def time(self, items: Items) -> Statement:
        (start, time), late = items[0], items[2]
        latest = None if late is None else self.duration([late]).value.value

        return lambda page: page.draft.times.append(
            page.located(start, replace(time, late=latest, place=page.place(start)))
        )

    def import_(self, items: Items) -> ImportStatement:
        return ImportStatement(self.name(items[1:2]))

    def prune(self, items: Items) -> Statement:
        return lambda page: page.draft.prunes.extend(page.names(items[1:-1]))

    def ignore(self, items: Items) -> Statement:
        _, (name, on), token, guard, _ = items
        when = None if guard is None else self._condition(guard, token)
        if time_points(when):
            raise Slip("the guard of an `ignore` applies to one event and cannot use time points of nodes", token)
        return lambda page: page.draft.ignores.append(Ignore(on, when, page.place(name)))

    def parameter(self, items: Items) -> tuple[Token, ValueType]:
        word, _, type_ = items
        if type_ is not None and type_ not in tuple(ValueType):
            raise Slip(f"unknown type {shown(type_)}: known are {', '.join(ValueType)}", type_)
        return word, ValueType.ANY if type_ is None else ValueType(type_)

    def event(self, items: Items) -> Statement:
        name, declared, term = items[1], items[3] or [], items[6]
        words = [word for word, _ in declared]
        for index, word in enumerate(words):
            _check_parameter(word, words[:index])
        parameters = tuple([word.value for word in words])
        types = tuple([type_ for _, type_ in declared])
        for word in term.words:
            if word not in parameters:
                raise Slip(f"{shown(word)} is not a parameter of {shown(name)}; write text in quotes", word)
        typable = {part.name for _, part, _ in places(term.value) if isinstance(part, Variable)}
        for word, type_ in declared:
            if type_ is not ValueType.ANY and word in term.words and word not in typable:
                raise Slip(f"{shown(word)} is only inside `[..., P, ...]`, which has no types; remove the type", word)

        return lambda page: page.draft.events.append(
            EventType(name.value, parameters, term.value, page.place(name), types)
        )

    def topic(self, items: Items) -> Statement:
        words = [self.name(items[1:2]), self.name(items[3:4]), *(items[5] or [])]

        def add(page: Page) -> None:
            name, type_, *publishers = page.names(words)
            page.draft.topics.append(DraftTopic(name, type_, tuple(publishers)))

        return add

    # Nodes.

    def node(self, items: Items) -> Statement:
        name, *clauses, _ = items

        def add(page: Page) -> None:
            node = page.draft.nodes.setdefault(name.value, DraftNode(name.value))
            node.statements.append(page.place(name))
            for part, start, value in filter(None, clauses):
                if part == "gates":
                    children, *numbers = value
                    node.gates.append(page.located(start, GateUse.of(start.value, page.names(children), *numbers)))
                else:
                    getattr(node, part).append(page.located(start, value))

        return add

    def plain_node(self, items: Items) -> Statement:
        """Handle a statement that the lexer read as one token."""
        token = items[0]
        line, column = token.line, token.column
        name, *rest = [PlainWord(found[0], line, column + found.start()) for found in _WORD.finditer(token.value)]
        if not rest:
            return self.node([name, None, None])
        gate, *children = rest
        start = Token("GATE", gate.value, token.start_pos + gate.column - column, line, gate.column)
        return self.node([name, _gate(start, children), None])

    def gate(self, items: Items) -> Clause:
        return _gate(items[0], items[1:])

    def on(self, items: Items) -> Clause:
        return Clause("ons", *items[1])

    def when(self, items: Items) -> Clause:
        return Clause("whens", items[0], self._condition(items[1], items[0]))

    def times(self, items: Items) -> Clause:
        token, number, _, distinct, _, each = items
        count = number_of(number)
        if type(count) is not int or count < 1:
            raise Slip(WHOLE_NUMBER, number)
        return Clause("counts", token, Count(count, distinct or (), each or ()))

    def own_values(self, items: Items) -> tuple[str, ...]:
        return tuple(dict.fromkeys(word.value for word in items[::2]))

    def within(self, items: Items) -> Clause:
        return Clause("withins", items[0], self.duration(items[1:]).value.value)

    def without(self, items: Items) -> Clause:
        return self._without(*items)

    def guarded_without(self, items: Items) -> Clause:
        token, call, when, guard, _, duration, side = items
        return self._without(token, call, when=when, guard=guard, duration=duration, side=side)

    def timed_without(self, items: Items) -> Clause:
        token, call, _, duration, side = items
        return self._without(token, call, duration=duration, side=side)

    def sided_without(self, items: Items) -> Clause:
        token, call, side = items
        return self._without(token, call, side=side)

    def _without(
        self,
        token: Token,
        call: tuple[Token, On],
        *,
        when: Token | None = None,
        guard: Operand | None = None,
        duration: Token | None = None,
        side: Token | None = None,
    ) -> Clause:
        on = call[1]
        condition = None if guard is None else self._condition(guard, when)
        if when is not None and time_points(condition):
            raise Slip("the guard of a `without` applies to one event and cannot use time points of nodes", when)
        length = None if duration is None else self.duration([duration]).value.value
        found = Without(on, condition, Side.DURING if side is None else Side(side), length)
        return Clause("withouts", token, found)

    def kind(self, items: Items) -> Clause:
        return Clause("kinds", items[0], Kind(items[0]))

    def label(self, items: Items) -> Clause:
        return Clause("labels", items[0], text_of(items[1]))

    def attribute(self, items: Items) -> Clause:
        key, _, value = items
        return Clause("attributes", key, (self.name([key]).value, value.value))

    def call(self, items: Items) -> tuple[Token, On]:
        name, arguments = items[0], items[2] or []
        return name, On(name.value, _values(arguments))

    def name(self, items: Items) -> Token:
        token: Token = items[0]
        return token.update(value=text_of(token)) if token.startswith('"') else token

    event_name = value = name

    # Patterns.

    def variable(self, items: Items) -> Operand:
        return Operand(Variable(items[0].value), words=(items[0],))

    def anything(self, _items: Items) -> Operand:
        return Operand(Anything())

    def string(self, items: Items) -> Operand:
        return Operand(Literal(text_of(items[0])))

    def number(self, items: Items) -> Operand:
        number = number_of(items[-1])
        return Operand(Literal(-number if len(items) > 1 else number), unsigned=len(items) == 1)

    def constant(self, items: Items) -> Operand:
        return Operand(Literal(CONSTANTS[items[0]]))

    def mapping(self, items: Items) -> Operand:
        fields: list[Items] = items[1] or []
        named: dict[str, Pattern] = {}
        for key, inner in fields:
            name = self.name([key]).value
            if name in named:
                raise Slip(f"the field {shown(name)} occurs twice in one object", key)
            named[name] = inner.value
        parts = [inner for _, inner in fields]
        return _compound(ObjectPattern(tuple(named.items())), parts, "pattern", items[0])

    def sequence(self, items: Items) -> Operand:
        parts: list[Operand] = items[1] or []
        return _compound(ListPattern(_values(parts)), parts, "pattern", items[0])

    def some_item(self, items: Items) -> Operand:
        return _compound(SomeItem(items[3].value), [items[3]], "pattern", items[0])

    # Guards.

    def binary(self, items: Items) -> Operand:
        operands = items[::2]
        term = _compound(Operation(Operator(items[1]), _values(operands)), operands, "guard", items[1])
        return term._replace(sort=_sort_of(operands, items[1]))

    junction = binary

    def listed(self, items: Items) -> Operand:
        operands = [items[0], *items[3::2]]
        _sort_of(operands, items[1])
        return _compound(Operation(Operator.IN, _values(operands)), operands, "guard", items[1])

    def applied(self, items: Items) -> Operand:
        token, operands = items[0], items[2::2]
        operator, arity = Operator(token), OPERATORS[Operator(token)].arity
        if len(operands) != arity and (arity or len(operands) < 2):
            raise Slip(f"{token} takes {arity or 'two or more'} value{'s' * (arity != 1)}, not {len(operands)}", token)
        if operator is Operator.LIKE:
            glob = operands[1].value
            if not isinstance(glob, Literal) or not isinstance(glob.value, str) or len(glob.value) > MAX_GLOB:
                raise Slip(f"the pattern of like is a string in quotes, of at most {MAX_GLOB} characters", token)
        _sort_of(operands, token)
        return _compound(Operation(operator, _values(operands)), operands, "guard", token)

    def duration(self, items: Items) -> Operand:
        token = items[0]
        number = token.rstrip("abcdefghijklmnopqrstuvwxyz")
        length = scaled(number.strip(), token[len(number) :])
        if length is not None and length < 0:
            raise Slip("a duration cannot be negative; swap the difference: at(a) - at(b)", token)
        if length is None:
            raise Slip(f"{shown(token)} is not a duration: it is too long", token)
        return Operand(Duration(length), sort="duration")

    def time_point(self, items: Items) -> Operand:
        token, _, name, _ = items
        return Operand(TimePoint.of(token.value, name.value), sort="point")

    def unary(self, items: Items) -> Operand:
        token, operand = items
        if token.type != "NOT" and operand.unsigned:  # a minus directly before a number belongs to the number
            return Operand(Literal(-operand.value.value))
        _sort_of([operand], token)
        operator = Operator.NOT if token.type == "NOT" else Operator.NEGATE
        return _compound(Operation(operator, (operand.value,)), [operand], "guard", token)

    def parentheses(self, items: Items) -> Operand:
        term: Operand = items[1]
        return term._replace(unsigned=False)
