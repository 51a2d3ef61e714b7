"""RML specifications as immutable values, their traversal, and static checks.

Sequences, unions, shuffles and conjunctions are flat. Nested values are not compared or hashed, and
traversals do not recurse, so that depth is unlimited.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, TypeAlias, TypeVar

from rvaft.errors import LanguageError, TooLarge
from rvaft.model.values import Json

DERIVATION_LIMIT: Final = 100
"""Maximum length of a chain of derived event types."""
Position: TypeAlias = tuple[int, int]
"""A line and a column."""


@dataclass(frozen=True, slots=True)
class Constant:
    """A string, a number, a Boolean or null."""

    value: Json


@dataclass(frozen=True, slots=True)
class Name:
    """A variable."""

    name: str


@dataclass(frozen=True, slots=True, eq=False)
class Apply:
    """An applied operator or function in its RML spelling; `neg` is the unary minus.

    As an argument of an event type it is not evaluated, and equals no value.
    """

    operator: str
    operands: tuple["Data", ...]


@dataclass(frozen=True, slots=True)
class Wildcard:
    """The pattern `_`."""


@dataclass(frozen=True, slots=True)
class Fields:
    """An object with at least these fields."""

    fields: tuple[tuple[str, "Value"], ...]


@dataclass(frozen=True, slots=True)
class Items:
    """A list that starts with these items; of exactly this length unless `more`."""

    items: tuple["Value", ...]
    more: bool = False


@dataclass(frozen=True, slots=True)
class Either:
    """The pattern `v1 | v2 | …`."""

    values: tuple["Value", ...]


Data: TypeAlias = Constant | Name | Apply
Value: TypeAlias = Constant | Name | Wildcard | Fields | Items | Either
Parameter: TypeAlias = Value | Apply


@dataclass(frozen=True, slots=True)
class TypeUse:
    """An event type with arguments."""

    name: str
    parameters: tuple[Parameter, ...] = ()
    place: Position = field(default=(1, 1), compare=False)

    @property
    def variables(self) -> frozenset[str]:
        """The variables among the arguments."""
        return frozenset(parameter.name for parameter in self.parameters if isinstance(parameter, Name))


@dataclass(frozen=True, slots=True, eq=False)
class Declaration:
    """`name(parameters) [not] matches alternatives [with guard];`, of patterns or event types."""

    name: str
    parameters: tuple[str, ...]
    negated: bool
    alternatives: tuple[Value | TypeUse, ...]
    guard: Data | None = None


def signature(one: TypeUse | Declaration) -> tuple[str, int]:
    """Return the key of an event type: name and number of parameters."""
    return one.name, len(one.parameters)


EVERYWHERE: Final = (
    Declaration("any", (), negated=False, alternatives=(Fields(()),)),
    Declaration("none", (), negated=True, alternatives=(TypeUse("any"),)),
)
"""The predefined event types; a declaration of the same name adds alternatives."""


@dataclass(frozen=True, slots=True, eq=False)
class Expression:
    """An operator, its parts, and data that depends on the operator.

    - `event`: a `TypeUse`
    - `times`: the number
    - `filter`: a `TypeUse`; the parts are inside and outside
    - `block`: the variable
    - `if`: the condition; the parts are yes and no
    - `call`: the name of an equation and its arguments
    - `empty`, `all`, `cat`, `and`, `or`, `shuffle`, `star`, `plus`, `optional`, `closure`: no data

    The data of `if` and `call` ends with an environment, which is empty here.
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

    @property
    def declared(self) -> Mapping[tuple[str, int], list[Declaration]]:
        """The declarations of each event type, including predefined ones."""
        found: dict[tuple[str, int], list[Declaration]] = {}
        for declaration in (*self.declarations, *EVERYWHERE):
            found.setdefault(signature(declaration), []).append(declaration)
        return found

    def reachable(self, names: Iterable[str] = ("Main",)) -> Iterator[Equation]:
        """Yield the given equations and all equations reachable from them."""
        seen = dict.fromkeys(names)
        waiting = list(seen)
        while waiting:
            yield (equation := self.equations[waiting.pop()])
            fresh = dict.fromkeys(used for used in references(equation.body) if used not in seen)
            seen.update(fresh)
            waiting += fresh

    def settle(self, is_new: Callable[[str], bool]) -> None:
        """Call `is_new` for each equation until a fixpoint; users of a changed equation are
        repeated.
        """
        users: dict[str, list[str]] = {name: [] for name in self.equations}
        for equation in self.equations.values():
            for used in references(equation.body):
                users.get(used, []).append(equation.name)
        waiting = list(users)
        while waiting:
            if is_new(name := waiting.pop()):
                waiting.extend(users[name])


# Traversals.

Part: TypeAlias = Data | Value | TypeUse | Declaration | Expression
P = TypeVar("P")
R = TypeVar("R")


def inside(part: Part) -> Sequence[Part]:
    """Return the children of a part in order; for an expression its parts, then its data."""
    match part:
        case Expression("event" | "filter", parts, use):
            return (*parts, use)
        case Expression("if", parts, (condition, _)):
            return (*parts, condition)
        case Expression("call", _, (_, arguments, _)):
            return tuple(arguments)
        case Expression(_, parts):
            return parts
        case Apply(_, parts) | Items(parts) | Either(parts) | TypeUse(_, parts):
            return parts
        case Fields(fields):
            return [value for _, value in fields]
        case Declaration(alternatives=parts, guard=guard):
            return parts if guard is None else (*parts, guard)
        case Constant() | Name() | Wildcard():
            return ()


def walk(*roots: Part) -> Iterator[Part]:
    """Yield all parts, parents first, last children first."""
    todo = list(roots)
    while todo:
        yield (part := todo.pop())
        todo.extend(inside(part))


def expressions(root: Expression) -> Iterator[Expression]:
    """Return all nested expressions, children first, in order."""
    return reversed([part for part in walk(root) if isinstance(part, Expression)])


def references(body: Expression) -> list[str]:
    """Return the equations that an expression refers to."""
    return [part.data[0] for part in expressions(body) if part.operator == "call"]


def names(*data: Data) -> frozenset[str]:
    """Return the variables in data expressions."""
    return frozenset(part.name for part in walk(*data) if isinstance(part, Name))


def fold(
    root: P,
    step: Callable[[P, list[R]], R],
    below: Callable[[P], Sequence[P]] = inside,  # type: ignore[assignment]
) -> R:
    """Return the value of a tree, computed bottom-up without recursion."""
    order, todo = list[tuple[P, int]](), [root]
    while todo:
        parts = below(part := todo.pop())
        order.append((part, len(parts)))
        todo.extend(parts)
    done = list[R]()
    for part, count in reversed(order):
        first = len(done) - count
        done[first:] = [step(part, done[first:])]
    return done[0]


# Static checks. The published compiler makes them too, except for types derived from themselves, on
# which its monitor does not terminate.


def refusal(message: str, place: Position = (1, 1)) -> LanguageError:
    """Return the error for a malformed text, or one that cannot run."""
    return LanguageError(message, file="<rml>", line=place[0], column=place[1])


def check(program: RmlProgram) -> None:
    """Raise `LanguageError` for undefined or non-contractive equations and cyclic types, and
    `TooLarge`.
    """
    if "Main" not in program.equations:
        raise refusal("the specification has no equation Main")
    _check_derived(program)
    for equation in program.equations.values():
        for part in expressions(equation.body):
            if part.operator == "call" and part.data[0] not in program.equations:
                raise refusal(f"undefined equation {part.data[0]}", part.place)
            for given in part.data.parameters if isinstance(part.data, TypeUse) else ():
                text = isinstance(given, Constant) and isinstance(given.value, str)
                if text or isinstance(given, Wildcard | Fields | Items):
                    reason = (
                        "an argument in an expression cannot be a string, `_`, list or object; derive an event type"
                    )
                    raise refusal(f"{part.data.name}: {reason}", part.data.place)
    _check_contractive(program)


def _check_derived(program: RmlProgram) -> None:
    import networkx as nx  # noqa: PLC0415 -- slow to import

    graph = nx.DiGraph()
    for declaration in program.declarations:
        parents = [parent for parent in declaration.alternatives if isinstance(parent, TypeUse)]
        for parent in parents:
            if any(isinstance(part, Either) for part in walk(parent)):
                raise refusal(f"{parent.name}: `|` is not allowed inside an argument", parent.place)
        for parent in parents:
            if signature(parent) == signature(declaration):
                raise refusal(f"the event type {declaration.name} is derived from itself", parent.place)
            graph.add_edge(signature(declaration), signature(parent), place=parent.place)
    cycle = next((c for c in nx.strongly_connected_components(graph) if len(c) > 1), None)
    if cycle is not None:
        name = min(cycle)
        place = min(place for _, parent, place in graph.out_edges(name, data="place") if parent in cycle)
        raise refusal(f"the event type {name[0]} is derived from itself", place)
    if nx.dag_longest_path_length(graph, weight=None) > DERIVATION_LIMIT:
        raise TooLarge("event types derived from each other in a row", limit=DERIVATION_LIMIT)


_Beginning: TypeAlias = tuple[bool, frozenset[str]]
"""Whether an expression may halt at once, and the equations that it may unfold before any event."""


def _check_contractive(program: RmlProgram) -> None:
    halting = dict.fromkeys(program.equations, False)

    def beginning(part: Expression, below: list[_Beginning]) -> _Beginning:
        first = below
        match part:
            case Expression("call", data=(name, _, _)):
                return halting[name], frozenset([name])
            case Expression("cat"):
                first = below[: next((i for i, (halts, _) in enumerate(below, 1) if not halts), len(below))]
                halts = len(first) == len(below) and first[-1][0]
            case Expression("event"):
                halts = False
            case Expression("star" | "optional" | "closure") | Expression("times", data=0):
                halts = True
            case Expression("or"):
                halts = any(halts for halts, _ in below)
            case _:
                halts = all(halts for halts, _ in below)
        return halts, frozenset[str]().union(*(names for _, names in first))

    def of(name: str) -> _Beginning:
        return fold(program.equations[name].body, beginning, lambda part: part.parts)

    def is_new(name: str) -> bool:
        before, halting[name] = halting[name], halting[name] or of(name)[0]
        return halting[name] is not before

    program.settle(is_new)
    import networkx as nx  # noqa: PLC0415 -- slow to import

    graph = nx.DiGraph((name, unfolded) for name in program.equations for unfolded in of(name)[1])
    known = {equation.name for equation in program.reachable()}
    for cycle in nx.strongly_connected_components(graph):
        name = min(cycle)
        if cycle & known and (len(cycle) > 1 or graph.has_edge(name, name)):
            raise refusal(f"{name} unfolds without an event (it is not contractive)", program.equations[name].place)
