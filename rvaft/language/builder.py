"""From reductions of the grammar to statements: one method per rule, run while the text is parsed.

Nothing here recurses: the parser keeps the stack, so a text may nest as deep as it likes until a rule refuses it.
"""

import json
import math
from dataclasses import dataclass
from typing import Any, Final, Generic, TypeAlias, TypeVar

from lark import Token, Transformer

from rvaft.language.words import shown
from rvaft.model.guards import MAX_DEPTH, Guard, Operation, Operator
from rvaft.model.nodes import Argument, Causality, Gate, Kind, On
from rvaft.model.patterns import Anything, ListPattern, Literal, ObjectPattern, Pattern, Variable
from rvaft.model.values import Scalar

# What a text says, statement by statement, before the statements of all files are merged into a draft.

T_co = TypeVar("T_co", covariant=True)


@dataclass(frozen=True, slots=True)
class At(Generic[T_co]):
    """A value and its line and column, from 1."""

    value: T_co
    line: int
    column: int


@dataclass(frozen=True, slots=True)
class GateClause:
    """`or a b`, `2of3 a b c`, `vot2 a b c`."""

    gate: Gate
    children: tuple[At[str], ...]
    threshold: int | None = None
    out_of: int | None = None


@dataclass(frozen=True, slots=True)
class OnClause:
    """`on move(Waypoint, _)`."""

    on: On


@dataclass(frozen=True, slots=True)
class WhenClause:
    """`when Value >= 250`."""

    guard: Guard


@dataclass(frozen=True, slots=True)
class KindClause:
    """`fault` or `attack`."""

    kind: Kind


@dataclass(frozen=True, slots=True)
class LabelClause:
    """`label "text for people"`."""

    text: str


@dataclass(frozen=True, slots=True)
class AttributeClause:
    """`lambda=0.1`; the value is kept as text."""

    key: str
    value: str


Clause: TypeAlias = GateClause | OnClause | WhenClause | KindClause | LabelClause | AttributeClause


@dataclass(frozen=True, slots=True)
class NodeStatement:
    """`NAME [gate and children] [clauses];`."""

    name: At[str]
    clauses: tuple[At[Clause], ...]


@dataclass(frozen=True, slots=True)
class ToplevelStatement:
    """`toplevel NAME;`."""

    name: At[str]


@dataclass(frozen=True, slots=True)
class ParamStatement:
    """`param NAME;`: Galileo's declaration of a parameter of its rates."""

    name: At[str]


@dataclass(frozen=True, slots=True)
class CausalityStatement:
    """`causality top_down;` or `causality bottom_up;`."""

    causality: At[Causality]


@dataclass(frozen=True, slots=True)
class ImportStatement:
    """`import "file";`."""

    path: At[str]


@dataclass(frozen=True, slots=True)
class PruneStatement:
    """`prune NAME NAME;`."""

    names: tuple[At[str], ...]


@dataclass(frozen=True, slots=True)
class IgnoreStatement:
    """`ignore CALL [when GUARD];`."""

    on: At[On]
    when: Guard | None


@dataclass(frozen=True, slots=True)
class EventStatement:
    """`event NAME(parameters) = { pattern };`."""

    name: At[str]
    parameters: tuple[str, ...]
    pattern: Pattern


@dataclass(frozen=True, slots=True)
class TopicStatement:
    """`topic NAME type TYPE from NODE, NODE;`."""

    name: At[str]
    type: At[str]
    publishers: tuple[At[str], ...]


Statement: TypeAlias = (
    NodeStatement
    | ToplevelStatement
    | ParamStatement
    | CausalityStatement
    | ImportStatement
    | PruneStatement
    | IgnoreStatement
    | EventStatement
    | TopicStatement
)

# Building patterns and guards bottom-up: nesting is counted while it grows, and slips are raised with their place.

CONSTANTS: Final[dict[str, Scalar]] = {"true": True, "false": False, "null": None}


class Slip(Exception):
    """Something that the grammar allows and the language does not, at a line and a column."""

    def __init__(self, message: str, token: Token) -> None:
        self.message = message
        self.line = token.line or 1
        self.column = token.column or 1
        super().__init__(message)


@dataclass(frozen=True, slots=True)
class PatternTerm:
    """A pattern under construction, how deep it is, and the words in it."""

    pattern: Pattern
    depth: int = 0
    words: tuple[Token, ...] = ()


@dataclass(frozen=True, slots=True)
class GuardTerm:
    """A guard under construction, how deep it is, and whether it is a number written without sign."""

    guard: Guard
    depth: int = 0
    unsigned: bool = False


def text_of(token: Token) -> str:
    """The string that a quoted token stands for; a JSON string."""
    try:
        text: str = json.loads(token)
    except ValueError:
        raise Slip("unknown escape in a string: a backslash is written \\\\", token) from None
    if any("\ud800" <= character <= "\udfff" for character in text):
        raise Slip("half of a surrogate pair in a string: write the whole character", token)
    return text


def number_of(token: Token, *, negative: bool = False) -> int | float:
    """The number that a token stands for: integers exact, the rest finite doubles."""
    try:
        number = int(token) if token.isdigit() else float(token)
    except ValueError:  # Python reads no more digits than sys.get_int_max_str_digits
        raise Slip(f"a number of {len(token)} digits is too long", token) from None
    if not math.isfinite(number):
        raise Slip(f"the number {shown(token)} is too large for a double", token)
    return -number if negative else number


def integer_of(digits: str, token: Token) -> int:
    """A count written in decimal digits."""
    try:
        return int(digits)
    except ValueError:
        raise Slip(f"a number of {len(digits)} digits is too long", token) from None


def _nested(depth: int, what: str, token: Token) -> int:
    if depth >= MAX_DEPTH:
        raise Slip(f"this {what} is nested deeper than {MAX_DEPTH}", token)
    return depth + 1


def object_of(brace: Token, fields: list[tuple[Token, PatternTerm]]) -> PatternTerm:
    """An object pattern."""
    named: dict[str, Pattern] = {}
    for key, inner in fields:
        name = text_of(key) if key.type == "STRING" else str(key)
        if name in named:
            raise Slip(f"the field {shown(name)} stands twice in one object", key)
        named[name] = inner.pattern
    depth = _nested(max((inner.depth for _, inner in fields), default=0), "pattern", brace)
    return PatternTerm(ObjectPattern(tuple(named.items())), depth, _words([inner for _, inner in fields]))


def list_of(bracket: Token, items: list[PatternTerm]) -> PatternTerm:
    """A list pattern."""
    depth = _nested(max((inner.depth for inner in items), default=0), "pattern", bracket)
    return PatternTerm(ListPattern(tuple(inner.pattern for inner in items)), depth, _words(items))


def _words(items: list[PatternTerm]) -> tuple[Token, ...]:
    return tuple(word for inner in items for word in inner.words)


def word_of(word: Token) -> PatternTerm:
    """A variable or parameter in a pattern."""
    return PatternTerm(Variable(str(word)), words=(word,))


def anything() -> PatternTerm:
    """`_`."""
    return PatternTerm(Anything())


def scalar_of(value: Scalar) -> PatternTerm:
    """A literal in a pattern."""
    return PatternTerm(Literal(value))


def operation_of(operator: Operator, operands: list[GuardTerm], token: Token) -> GuardTerm:
    """An operator applied; a minus right before a number belongs to the number."""
    depth = _nested(max(operand.depth for operand in operands), "guard", token)
    if operator is Operator.NEGATE and operands[0].unsigned and isinstance(operands[0].guard, Literal):
        number = operands[0].guard.value
        assert isinstance(number, (int, float))
        return GuardTerm(Literal(-number))
    return GuardTerm(Operation(operator, tuple(operand.guard for operand in operands)), depth)


# ruff: noqa: D102 - what a method is about is the rule of its name in the grammar


Items: TypeAlias = list[Any]


def _at(value: Any, token: Token) -> At[Any]:
    return At(value, token.line or 1, token.column or 1)


def _quoted(token: Token) -> str:
    return text_of(token) if token.startswith('"') else str(token)


def _between_commas(items: Items) -> Items:
    return items[::2]


class Build(Transformer[Token, Any]):
    """The callbacks of the grammar's rules."""

    # -- whole texts ------------------------------------------------------------------------------------------------

    def tree(self, items: Items) -> list[Statement]:
        return items

    def only_pattern(self, items: Items) -> Pattern:
        term: PatternTerm = items[0]
        return term.pattern

    def only_guard(self, items: Items) -> Guard:
        term: GuardTerm = items[0]
        return term.guard

    # -- statements -------------------------------------------------------------------------------------------------

    def toplevel(self, items: Items) -> ToplevelStatement:
        return ToplevelStatement(items[1])

    def param(self, items: Items) -> ParamStatement:
        return ParamStatement(items[1])

    def causality(self, items: Items) -> CausalityStatement:
        return CausalityStatement(_at(Causality(items[1]), items[0]))

    def import_(self, items: Items) -> ImportStatement:
        return ImportStatement(_at(text_of(items[1]), items[1]))

    def prune(self, items: Items) -> PruneStatement:
        return PruneStatement(tuple(items[1:-1]))

    def ignore(self, items: Items) -> IgnoreStatement:
        _, call, _, guard, _ = items
        return IgnoreStatement(call, None if guard is None else guard.guard)

    def event(self, items: Items) -> EventStatement:
        name, words, term = items[1], items[3] or [], items[6]
        parameters: list[str] = []
        for word in words:
            _check_parameter(word, parameters)
            parameters.append(str(word))
        for word in term.words:
            if word not in parameters:
                raise Slip(f"{shown(word)} is no parameter of {shown(name.value)}; text stands in quotes", word)
        return EventStatement(name, tuple(parameters), term.pattern)

    def topic(self, items: Items) -> TopicStatement:
        _, name, _, type_, _, publishers, _ = items
        return TopicStatement(_at(text_of(name), name), _at(text_of(type_), type_), tuple(publishers or ()))

    def publishers(self, items: Items) -> Items:
        return _between_commas(items)

    def parameters(self, items: Items) -> Items:
        return _between_commas(items)

    # -- nodes ------------------------------------------------------------------------------------------------------

    def node(self, items: Items) -> NodeStatement:
        name, *clauses, _ = items
        return NodeStatement(name, tuple(clause for clause in clauses if clause is not None))

    def gate(self, items: Items) -> At[Clause]:
        token, *children = items
        threshold = out_of = None
        if token.type == "K_OF_N":
            k, n = token.split("of")
            threshold, out_of = integer_of(k, token), integer_of(n, token)
        elif token.type == "VOT_K":
            threshold = integer_of(token.removeprefix("vot"), token)
        gate = Gate.VOT if threshold is not None else Gate(token)
        return _at(GateClause(gate, tuple(children), threshold, out_of), token)

    def on(self, items: Items) -> At[Clause]:
        call: At[On] = items[1]
        return At(OnClause(call.value), call.line, call.column)

    def when(self, items: Items) -> At[Clause]:
        return _at(WhenClause(items[1].guard), items[0])

    def kind(self, items: Items) -> At[Clause]:
        return _at(KindClause(Kind(items[0])), items[0])

    def label(self, items: Items) -> At[Clause]:
        return _at(LabelClause(text_of(items[1])), items[0])

    def attribute(self, items: Items) -> At[Clause]:
        key, _, value = items
        return _at(AttributeClause(_quoted(key), value), key)

    def call(self, items: Items) -> At[On]:
        name, arguments = items[0], items[2] or []
        return At(On(name.value, tuple(arguments)), name.line, name.column)

    def arguments(self, items: Items) -> list[Argument]:
        return [_argument(term.pattern) for term in _between_commas(items)]

    def name(self, items: Items) -> At[str]:
        return _at(_quoted(items[0]), items[0])

    event_name = name

    def value(self, items: Items) -> str:
        return _quoted(items[0])

    # -- patterns ---------------------------------------------------------------------------------------------------

    def variable(self, items: Items) -> PatternTerm:
        return word_of(items[0])

    def anything(self, _items: Items) -> PatternTerm:
        return anything()

    def string(self, items: Items) -> PatternTerm:
        return scalar_of(text_of(items[0]))

    def number(self, items: Items) -> PatternTerm:
        return scalar_of(number_of(items[-1], negative=len(items) > 1))

    def constant(self, items: Items) -> PatternTerm:
        return scalar_of(CONSTANTS[items[0]])

    def mapping(self, items: Items) -> PatternTerm:
        return object_of(items[0], items[1] or [])

    def fields(self, items: Items) -> Items:
        return _between_commas(items)

    def field(self, items: Items) -> tuple[Token, PatternTerm]:
        return items[0], items[2]

    def sequence(self, items: Items) -> PatternTerm:
        return list_of(items[0], items[1] or [])

    def items(self, items: Items) -> Items:
        return _between_commas(items)

    # -- guards -----------------------------------------------------------------------------------------------------

    def junction(self, items: Items) -> GuardTerm:
        return operation_of(Operator(items[1]), _between_commas(items), items[1])

    def binary(self, items: Items) -> GuardTerm:
        left, token, right = items
        return operation_of(Operator(token), [left, right], token)

    def unary(self, items: Items) -> GuardTerm:
        token, operand = items
        return operation_of(Operator.NOT if token.type == "NOT" else Operator.NEGATE, [operand], token)

    def guard_variable(self, items: Items) -> GuardTerm:
        return GuardTerm(Variable(str(items[0])))

    def guard_string(self, items: Items) -> GuardTerm:
        return GuardTerm(Literal(text_of(items[0])))

    def guard_number(self, items: Items) -> GuardTerm:
        return GuardTerm(Literal(number_of(items[0])), unsigned=True)

    def guard_constant(self, items: Items) -> GuardTerm:
        return GuardTerm(Literal(CONSTANTS[items[0]]))

    def parentheses(self, items: Items) -> GuardTerm:
        term: GuardTerm = items[1]
        return GuardTerm(term.guard, term.depth)


def _argument(pattern: Pattern) -> Argument:
    match pattern:
        case Literal() | Variable() | Anything():
            return pattern
        case _:  # the grammar has no other arguments
            raise AssertionError(pattern)


def _check_parameter(word: Token, before: Items) -> None:
    if word in CONSTANTS or not "a" <= word[0] <= "z":
        lower = word.lstrip("_")[:1].lower() + word.lstrip("_")[1:]
        mend = f", as in {shown(lower)}" if lower not in ("", word, *CONSTANTS) else ""
        raise Slip(f"{shown(word)} is no name for a parameter, which starts with a lower-case letter{mend}", word)
    if word in before:
        raise Slip(f"the parameter {shown(word)} stands twice in one event type", word)
