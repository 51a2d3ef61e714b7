"""The parts of an RML specification as immutable values, and the one walk over them.

Sequences, unions, shuffles and conjunctions are flat, so that long ones are not deep; nothing compares or hashes the nested values and
nothing recurses over them, so depth costs no recursion.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias, TypeVar

from rvaft.model.values import Json

Position: TypeAlias = tuple[int, int]
"""A line and a column."""


@dataclass(frozen=True, slots=True)
class Constant:
    """A string, a number, a boolean or null."""

    value: Json


@dataclass(frozen=True, slots=True)
class Name:
    """A variable."""

    name: str


@dataclass(frozen=True, slots=True, eq=False)
class Apply:
    """An operator or a function applied; `operator` is as it is written, `neg` for the unary minus.

    As the argument of an event type it is not calculated, and no value equals it.
    """

    operator: str
    operands: tuple["Data", ...]


@dataclass(frozen=True, slots=True)
class Ignored:
    """`_`."""


@dataclass(frozen=True, slots=True)
class Fields:
    """An object that has at least these fields."""

    fields: tuple[tuple[str, "Value"], ...]


@dataclass(frozen=True, slots=True)
class Items:
    """A list that starts with these items; of exactly this length unless `more`."""

    items: tuple["Value", ...]
    more: bool = False


@dataclass(frozen=True, slots=True)
class Either:
    """`v1 | v2 | …` inside a pattern."""

    values: tuple["Value", ...]


Data: TypeAlias = Constant | Name | Apply
Value: TypeAlias = Constant | Name | Ignored | Fields | Items | Either
Parameter: TypeAlias = Value | Apply


@dataclass(frozen=True, slots=True)
class TypeUse:
    """An event type with arguments."""

    name: str
    parameters: tuple[Parameter, ...] = ()
    place: Position = field(default=(1, 1), compare=False)

    @property
    def signature(self) -> tuple[str, int]:
        """What its declarations are found by."""
        return self.name, len(self.parameters)

    @property
    def variables(self) -> frozenset[str]:
        """The variables among the arguments."""
        return frozenset(parameter.name for parameter in self.parameters if isinstance(parameter, Name))


@dataclass(frozen=True, slots=True, eq=False)
class Declaration:
    """`name(parameters) [not] matches … [with guard];` — the alternatives are patterns, or else other event types."""

    name: str
    parameters: tuple[str, ...]
    negated: bool
    alternatives: tuple[Value | TypeUse, ...]
    guard: Data | None = None

    @property
    def signature(self) -> tuple[str, int]:
        """What uses of it are found by."""
        return self.name, len(self.parameters)


ANY = Declaration("any", (), negated=False, alternatives=(Fields(()),))
NONE = Declaration("none", (), negated=True, alternatives=(TypeUse("any"),))


@dataclass(frozen=True, slots=True, eq=False)
class Expression:
    """An operator, its parts, and data that depends on the operator.

    `empty`, `all`; `event` (a `TypeUse`); `cat`, `and`, `or`, `shuffle`; `star`, `plus`, `optional`, `closure`, `times` (the number);
    `filter` (a `TypeUse`; the parts are inside and outside); `block` (the variable); `if` (the condition; the parts are yes and no);
    `call` (the name of an equation and its arguments). Those of `if` and `call` end with what is known of the variables: nothing yet.
    """

    operator: str
    parts: tuple["Expression", ...] = ()
    data: Any = None
    place: Position = (1, 1)


@dataclass(frozen=True, slots=True, eq=False)
class Equation:
    """`Name<parameters> = body;`."""

    name: str
    parameters: tuple[str, ...]
    body: Expression
    place: Position = (1, 1)


@dataclass(frozen=True, slots=True, eq=False)
class RmlProgram:
    """A whole specification."""

    declarations: tuple[Declaration, ...]
    equations: Mapping[str, Equation]


Part: TypeAlias = Data | Value | TypeUse | Declaration | Expression
P = TypeVar("P")
R = TypeVar("R")


def inside(part: Part) -> Sequence[Part]:
    """What a part is made of, in order; of an expression the parts, then its data."""
    match part:
        case Apply(_, parts) | Items(parts) | Either(parts) | TypeUse(_, parts):
            return parts
        case Fields(fields):
            return [value for _, value in fields]
        case Declaration(alternatives=parts, guard=guard):
            return parts if guard is None else (*parts, guard)
        case Expression("event" | "filter", parts, use):
            return (*parts, use)
        case Expression("if", parts, (condition, _)):
            return (*parts, condition)
        case Expression("call", _, (_, arguments, _)):
            return tuple(arguments)
        case Expression(_, parts):
            return parts
        case Constant() | Name() | Ignored():
            return ()


def walk(*roots: Part) -> Iterator[Part]:
    """All parts, wholes before parts, what comes last first."""
    todo = list(roots)
    while todo:
        yield (part := todo.pop())
        todo.extend(inside(part))


def expressions(root: Expression) -> Iterator[Expression]:
    """The expressions in an expression, parts before wholes, in order."""
    return reversed([part for part in walk(root) if isinstance(part, Expression)])


def names(data: Data) -> frozenset[str]:
    """The variables in a data expression."""
    return frozenset(part.name for part in walk(data) if isinstance(part, Name))


def fold(root: P, step: Callable[[P, list[R]], R], below: Callable[[P], Sequence[P]] = inside) -> R:  # type: ignore[assignment]
    """The value of a tree, from the values of what is below each part; without recursion."""
    order, todo = list[P](), [root]
    while todo:
        order.append(part := todo.pop())
        todo.extend(below(part))
    done = list[R]()
    for part in reversed(order):
        first = len(done) - len(below(part))
        done[first:] = [step(part, done[first:])]
    return done[0]
