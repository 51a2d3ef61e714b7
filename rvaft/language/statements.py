"""What a text says, statement by statement, before the statements of all files are merged into a draft."""

from dataclasses import dataclass
from typing import Generic, TypeAlias, TypeVar

from rvaft.guards import Guard
from rvaft.model import Causality, Gate, Kind, On
from rvaft.patterns import Pattern

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
