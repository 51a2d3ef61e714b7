"""Which events an event type matches, and what that binds.

Declarations of one name are alternatives in their order; `|` in a pattern stands for several patterns, those of the first
field varying slowest. `any` and `none` are there unless declared, and a declared `any` is wider.
"""

from collections.abc import Iterator, Mapping
from typing import Any, Final, TypeAlias

from backends.rml.reading.data import truth
from backends.rml.reading.syntax import (
    Constant,
    Declaration,
    Either,
    Fields,
    Ignored,
    Items,
    Name,
    Parameter,
    TypeUse,
    Unevaluated,
    Value,
)
from rvaft.values import Json, equal

Bound: TypeAlias = Mapping[str, Json]


class _Mark:
    """A value that equals nothing but itself."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __repr__(self) -> str:
        return self._name


UNBOUND: Final = _Mark("UNBOUND")
"""What an event type leaves a variable that occurs in it and that the match does not bind."""
_UNEVALUATED: Final = _Mark("UNEVALUATED")

ANY: Final = Declaration("any", (), negated=False, values=(Fields(()),))
NONE: Final = Declaration("none", (), negated=True, parents=(TypeUse("any"),))


class Types:
    """The event types of one specification."""

    def __init__(self, declarations: tuple[Declaration, ...]) -> None:
        self._by_name: dict[tuple[str, int], list[Declaration]] = {}
        for declaration in (*declarations, ANY, NONE):
            self._by_name.setdefault((declaration.name, len(declaration.parameters)), []).append(declaration)

    def matches(self, use: TypeUse, event: Json) -> Iterator[dict[str, Json]]:
        """What each way to match binds, for every variable among the arguments: a value or `UNBOUND`."""
        wanted = [p.name for p in use.parameters if isinstance(p, Name)]
        for found in self._declared(use, event, {}):
            yield {name: found.get(name, UNBOUND) for name in wanted}
            if not wanted:
                return

    def _declared(self, use: TypeUse, event: Json, bound: Bound) -> Iterator[Bound]:
        """The ways a use matches, as bindings of the variables around it."""
        for declaration in self._by_name.get((use.name, len(use.parameters)), ()):
            inner = _inward(declaration, use, bound)
            if inner is not None:
                for found in self._one(declaration, event, inner):
                    yield from _outward(declaration, use, found, bound)

    def _one(self, declaration: Declaration, event: Json, inner: Bound) -> Iterator[Bound]:
        guard = declaration.guard
        if not declaration.negated:
            ways = self._parts(declaration, event, inner)
        else:
            ways = iter([inner] if next(self._parts(declaration, event, inner), None) is None else [])
        for found in ways:
            if guard is None or truth(guard, found) is True:
                yield found

    def _parts(self, declaration: Declaration, event: Json, inner: Bound) -> Iterator[Bound]:
        for value in declaration.values:
            yield from _ways(value, event, inner)
        for parent in declaration.parents:
            yield from self._declared(parent, event, inner)


def _inward(declaration: Declaration, use: TypeUse, bound: Bound) -> Bound | None:
    """The parameters that the arguments give a value; None where one parameter is given two."""
    inner: dict[str, Json] = {}
    for name, given in zip(declaration.parameters, use.parameters, strict=True):
        value = _given(given, bound)
        if value is not UNBOUND and not equal(inner.setdefault(name, value), value):
            return None
    return inner


def _given(given: Parameter, bound: Bound) -> Json:
    match given:
        case Constant(value):
            return value
        case Name(name):
            return bound.get(name, UNBOUND)
        case Unevaluated():
            return _UNEVALUATED
        case _:
            return UNBOUND


def _outward(declaration: Declaration, use: TypeUse, found: Bound, bound: Bound) -> Iterator[Bound]:
    """What a match of the declaration binds around the use, with patterns among the arguments matched in turn."""
    ways: list[Bound] = [bound]
    for name, given in zip(declaration.parameters, use.parameters, strict=True):
        if name in found and isinstance(given, (Name, Fields, Items)):
            ways = [after for before in ways for after in _ways(given, found[name], before)]
    yield from ways


def _ways(pattern: Value, value: Json, bound: Bound) -> Iterator[Bound]:
    """The ways a pattern matches a value, by an explicit stack of what is still to match."""
    stack: list[tuple[Any, Bound]] = [((pattern, value, None), bound)]
    while stack:
        todo, bound = stack.pop()
        if todo is None:
            yield bound
            continue
        pattern, value, rest = todo
        match pattern:
            case Ignored():
                stack.append((rest, bound))
            case Constant(expected):
                if equal(expected, value):
                    stack.append((rest, bound))
            case Name(name):
                if name not in bound:
                    stack.append((rest, {**bound, name: value}))
                elif equal(bound[name], value):
                    stack.append((rest, bound))
            case Either(values):
                stack.extend(((one, value, rest), bound) for one in reversed(values))
            case Fields(fields):
                if isinstance(value, Mapping) and all(name in value for name, _ in fields):
                    for name, inner in reversed(fields):
                        rest = (inner, value[name], rest)
                    stack.append((rest, bound))
            case Items(items, more):
                # the published `[...]` wants at least one item, `[x, ...]` at least as many as there are patterns
                least = max(len(items), 1) if more else len(items)
                if isinstance(value, list) and (len(value) >= least if more else len(value) == least):
                    for inner, one in reversed(list(zip(items, value, strict=False))):
                        rest = (inner, one, rest)
                    stack.append((rest, bound))
