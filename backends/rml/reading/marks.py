"""Hashable stand-ins for data in terms: two have the same mark only where nothing can ever tell them apart.

Finer than `rvaft.values.key`: 1 and 1.0 are equal, but calculate differently once they are large.
"""

from collections.abc import Hashable, Mapping

from backends.rml.reading import syntax as s
from rvaft.values import Json


def mark(value: Json | s.Name) -> Hashable:
    """A stand-in for a value or a variable."""
    out: list[Hashable] = []
    todo = [value]
    while todo:
        match todo.pop():
            case str(text):
                out.append(text)
            case bool() | float() | int() | None as scalar:
                out.append((type(scalar), scalar))
            case Mapping() as fields:
                out.append((Mapping, tuple(fields)))
                todo.extend(fields.values())
            case list(items):
                out.append((list, len(items)))
                todo.extend(items)
            case other:
                out.append(other)
    return out[0] if len(out) == 1 else tuple(out)


def marks(environment: tuple[tuple[str, Json], ...]) -> Hashable:
    """A stand-in for what variables stand for."""
    return tuple((name, mark(value)) for name, value in environment)


def mark_use(use: s.TypeUse) -> Hashable:
    """A stand-in for an event type with arguments."""
    return use.name, tuple(mark(p.value) if isinstance(p, s.Constant) else p for p in use.parameters)
