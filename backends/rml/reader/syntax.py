"""The parts of an RML specification as immutable values.

Sequences, unions, shuffles and conjunctions are flat, so that long ones are not deep; nothing compares or hashes these values, so
depth costs no recursion.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

from rvaft.model.values import Json

# -- data expressions ------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Constant:
    """A number, a boolean or null."""

    value: Json


@dataclass(frozen=True, slots=True)
class Name:
    """A variable."""

    name: str


@dataclass(frozen=True, slots=True, eq=False)
class Apply:
    """An operator or a function applied; `operator` is as it is written, `neg` for the unary minus."""

    operator: str
    operands: tuple["Data", ...]


Data: TypeAlias = Constant | Name | Apply

# -- event types -----------------------------------------------------------------------------------------------------


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


@dataclass(frozen=True, slots=True, eq=False)
class Unevaluated:
    """An expression as the argument of an event type: it is not calculated, and no value equals it."""

    data: Data


Value: TypeAlias = Constant | Name | Ignored | Fields | Items | Either
Parameter: TypeAlias = Value | Unevaluated


@dataclass(frozen=True, slots=True)
class TypeUse:
    """An event type with arguments; `place` is its line and column."""

    name: str
    parameters: tuple[Parameter, ...] = ()
    place: tuple[int, int] = field(default=(1, 1), compare=False)


@dataclass(frozen=True, slots=True, eq=False)
class Declaration:
    """`name(parameters) [not] matches … [with guard];` — from patterns (`values`) or from other event types (`parents`)."""

    name: str
    parameters: tuple[str, ...]
    negated: bool
    values: tuple[Value, ...] = ()
    parents: tuple[TypeUse, ...] = ()
    guard: Data | None = None


# -- expressions -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class Leaf:
    """`empty`, `all`, or nothing at all."""

    word: str


@dataclass(frozen=True, slots=True, eq=False)
class Occurs:
    """One event of a type."""

    use: TypeUse


@dataclass(frozen=True, slots=True, eq=False)
class Joined:
    """Parts joined by an operator: `cat`, `and`, `or` or `shuffle`."""

    operator: str
    parts: tuple["Expression", ...]


@dataclass(frozen=True, slots=True, eq=False)
class Repeated:
    """`star`, `plus`, `optional`, `closure`, or `times` with a number."""

    operator: str
    body: "Expression"
    number: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class Filtered:
    """`type >> inside : outside`."""

    use: TypeUse
    inside: "Expression"
    outside: "Expression"


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """`{let x; body}`, one variable at a time."""

    variable: str
    body: "Expression"


@dataclass(frozen=True, slots=True, eq=False)
class Conditional:
    """`if (condition) yes else no`."""

    condition: Data
    yes: "Expression"
    no: "Expression"


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """An equation by its name, with arguments where it is generic; `place` is its line and column."""

    name: str
    arguments: tuple[Data, ...] = ()
    place: tuple[int, int] = field(default=(1, 1))


Expression: TypeAlias = Leaf | Occurs | Joined | Repeated | Filtered | Block | Conditional | Reference


@dataclass(frozen=True, slots=True, eq=False)
class Equation:
    """`Name<parameters> = body;`."""

    name: str
    parameters: tuple[str, ...]
    body: Expression
    place: tuple[int, int]


@dataclass(frozen=True, slots=True, eq=False)
class Program:
    """A whole specification."""

    declarations: tuple[Declaration, ...]
    equations: Mapping[str, Equation]


def children(expression: Expression) -> tuple[Expression, ...]:
    """The direct parts of an expression."""
    match expression:
        case Joined(_, parts):
            return parts
        case Repeated(_, body) | Block(_, body):
            return (body,)
        case Filtered(_, inside, outside):
            return inside, outside
        case Conditional(_, yes, no):
            return yes, no
        case _:
            return ()


def bottom_up(expression: Expression) -> Iterator[Expression]:
    """All parts of an expression, parts before wholes."""
    order: list[Expression] = []
    todo = [expression]
    while todo:
        order.append(todo.pop())
        todo.extend(children(order[-1]))
    return reversed(order)


def operands(joined: Joined) -> tuple[Expression, ...]:
    """The parts of a join, those that are joined by the same operator replaced by theirs.

    Sequences stay as they are: `(a all) b` ends with `a`, while `a (all b)` waits for one more event.
    """
    if joined.operator == "cat":
        return joined.parts
    found: list[Expression] = []
    todo: list[Expression] = [joined]
    while todo:
        part = todo.pop()
        if isinstance(part, Joined) and part.operator == joined.operator:
            todo.extend(reversed(part.parts))
        else:
            found.append(part)
    return tuple(found)


def names(data: Data) -> frozenset[str]:
    """The variables in a data expression."""
    found: set[str] = set()
    todo = [data]
    while todo:
        match todo.pop():
            case Name(name):
                found.add(name)
            case Apply(_, parts):
                todo.extend(parts)
            case Constant():
                pass
    return frozenset(found)


def used_names(use: TypeUse) -> frozenset[str]:
    """The variables among the arguments of an event type."""
    return frozenset(parameter.name for parameter in use.parameters if isinstance(parameter, Name))


def parts_of(parameter: Parameter) -> Iterator[Parameter]:
    """A pattern and all patterns inside it."""
    todo = [parameter]
    while todo:
        yield (part := todo.pop())
        match part:
            case Fields(fields):
                todo.extend(value for _, value in reversed(fields))
            case Items(values) | Either(values):
                todo.extend(reversed(values))
            case _:
                pass
