"""Declared types and assumptions about logs (semantics, section 1.4), and the check of a log.

An assumption does not change the meaning of a tree. Translations rely on it, and monitors report
the events that break it.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import takewhile
from math import inf, isfinite
from typing import Any, Final, NamedTuple, Protocol, TypeAlias, assert_never, cast

from rvaft.model.event_time import EventTime, duration_text
from rvaft.model.guards import UNDEFINED, Guard, Operation, Operator, TermSort, value, walk
from rvaft.model.nodes import Assumption, On, ValueType
from rvaft.model.patterns import Anything, ListPattern, Literal, ObjectPattern, Pattern, SomeItem, Variable
from rvaft.model.tree import RVAFT
from rvaft.model.values import EXACT_INTEGERS, Exact, Json, equal, is_finite, is_number
from rvaft.support.terminal import readable_json

Path: TypeAlias = tuple[str | int, ...]
"""The keys and indexes that lead to a value in an event."""

_ABSENT: Final = object()
_SORTS: Final[Mapping[ValueType, TermSort]] = {
    ValueType.TEXT: TermSort.TEXT,
    ValueType.INTEGER: TermSort.NUMBER,
    ValueType.NUMBER: TermSort.NUMBER,
    ValueType.BOOLEAN: TermSort.TRUTH,
    ValueType.TIME: TermSort.UNKNOWN,
    ValueType.ANY: TermSort.UNKNOWN,
}
_TEXT_TESTS: Final = frozenset(
    {
        Operator.EQ,
        Operator.NE,
        Operator.IN,
        Operator.STARTSWITH,
        Operator.ENDSWITH,
        Operator.CONTAINS,
        Operator.LIKE,
    }
)
"""The operators that compare a text with a literal, and so may depend on its case."""


class Violation(NamedTuple):
    """An event that breaks an assumption: the number of the event, and what is wrong with it.

    `path` leads to the value, which should be of the type `wanted` or, for the assumption `case`,
    equal to `literal`.
    """

    assumption: Assumption
    event: int
    message: str
    path: Path = ()
    wanted: ValueType = ValueType.ANY
    literal: str | None = None

    def __str__(self) -> str:
        return f"assumption '{self.assumption}' broken: event {self.event}: {self.message}"


def sort_of(type_: ValueType) -> TermSort:
    """Return the sort of the values of a type; UNKNOWN for `time` and `any`."""
    return _SORTS[type_]


def arguments(tree: RVAFT, on: On) -> Iterator[tuple[Pattern, ValueType]]:
    """Yield the arguments of a call with the declared types of their parameters."""
    event = tree.events[on.event]
    yield from zip(on.arguments, map(event.type_of, event.parameters), strict=True)


def variable_types(tree: RVAFT) -> Mapping[str, Mapping[ValueType, str]]:
    """Return the declared types of each variable, each with the first node that states it.

    >>> import rvaft
    >>> tree = rvaft.loads("event size(n: integer) = { n: n }; top and a b; a on size(N); b on size(N);")
    >>> {name: [*types] for name, types in variable_types(tree).items()}
    {'N': [<ValueType.INTEGER: 'integer'>]}
    """
    found: dict[str, dict[ValueType, str]] = {}
    for node in tree.top_down():
        for argument, type_ in arguments(tree, node.on) if node.on is not None else ():
            if isinstance(argument, Variable) and type_ is not ValueType.ANY:
                found.setdefault(argument.name, {}).setdefault(type_, node.name)
    return found


@dataclass(frozen=True, slots=True)
class Declared:
    """What a translation may rely on for an event: the types at paths, and which paths have a value.

    It holds for events that match the literals of the event type, and says nothing about others.
    """

    types: tuple[tuple[Path, ValueType], ...] = ()
    present: frozenset[Path] = frozenset()

    def type_of(self, path: Path) -> ValueType:
        """Return the declared type of the value at a path, or ANY."""
        return dict(self.types).get(path, ValueType.ANY)

    def sort_of(self, path: Path) -> TermSort:
        """Return the sort of the value at a path, or UNKNOWN."""
        return sort_of(self.type_of(path))


def declared(tree: RVAFT, node: str, assumes: Collection[Assumption]) -> Declared:
    """Return what some assumptions say of the event of a node.

    >>> import rvaft
    >>> tree = rvaft.loads("event size(n: integer) = { n: n }; assume types; top on size(3);")
    >>> declared(tree, "top", tree.assumes).type_of(("n",)).value
    'integer'
    """
    on = tree.nodes[node].on
    if on is None:
        return Declared()
    parameters = _shape(tree, on.event).parameters
    types = tuple((path, type_) for path, _, type_ in parameters if type_ is not ValueType.ANY)
    return Declared(
        types if Assumption.TYPES in assumes else (),
        frozenset(path for path, _, _ in parameters) if Assumption.PRESENT in assumes else frozenset(),
    )


def has_type(found: Json, type_: ValueType, time: EventTime | None = None) -> bool:
    """Whether a value belongs to a type; `time` is the declaration of the tree, for the type `time`."""
    match type_:
        case ValueType.ANY:
            return True
        case ValueType.TEXT:
            return isinstance(found, str)
        case ValueType.NUMBER:
            return is_number(found) and is_finite(found)
        case ValueType.INTEGER:
            return is_number(found) and (isinstance(found, int) or found.is_integer())
        case ValueType.BOOLEAN:
            return isinstance(found, bool)
        case ValueType.TIME:
            return time is not None and time.reads(found)
        case _:
            assert_never(type_)


def is_inexact(value: Json) -> bool:
    """Whether a value breaks the assumption `exact`: an integer, however written, of 2**53 or more.

    >>> is_inexact(9007199254740992.0), is_inexact(1e300), is_inexact(9007199254740991), is_inexact(0.5)
    (True, True, False, False)
    """
    return is_number(value) and EXACT_INTEGERS <= abs(value) < inf  # so large a double has no fraction


@dataclass(frozen=True, slots=True)
class _Shape:
    """An event type apart from its values: its literals, the lengths of lists, and its parameters."""

    literals: tuple[tuple[Path, Json], ...]
    lengths: tuple[tuple[Path, int], ...]
    parameters: tuple[tuple[Path, str, ValueType], ...]

    def fits(self, event: Json) -> bool:
        """Whether the literals match, and the lists around literals have the right length."""
        return all(equal(_at(event, path), literal) for path, literal in self.literals) and all(
            isinstance(found := _at(event, path), list) and len(found) == length for path, length in self.lengths
        )


_TYPES: Final[Mapping[ValueType, frozenset[type]]] = {
    ValueType.TEXT: frozenset({str}),
    ValueType.NUMBER: frozenset({int, float, Exact}),
    ValueType.INTEGER: frozenset({int}),
    ValueType.BOOLEAN: frozenset({bool}),
}
"""The Python types all of whose finite values belong to a type."""


class Columns(Protocol):
    """Events with the same fields, by columns."""

    events: Sequence[Mapping[str, Json]]

    def values(self, field: str) -> Sequence[Json]:
        """Return the values of a field."""

    def types(self, field: str) -> set[type]:
        """Return the Python types of the values."""


class AssumptionCheck:
    """Finds the events of one trace that break the assumptions of a tree.

    >>> import rvaft
    >>> tree = rvaft.loads('event sent(n: integer) = { event: "sent", n: n }; assume types; top on sent(_);')
    >>> check = AssumptionCheck(tree)
    >>> [str(one) for one in check.broken({"event": "sent", "n": "7"})]
    ["assumption 'types' broken: event 1: n is a text, not of type integer"]
    """

    def __init__(self, tree: RVAFT, assumptions: Iterable[Assumption] | None = None) -> None:
        self.assumptions = tree.assumes if assumptions is None else tree.assumes & frozenset(assumptions)
        self._time = tree.time
        self._shapes = [_shape(tree, name) for name in used_events(tree)]
        self._tests = [*_case_tests(tree)] if Assumption.CASE in self.assumptions else []
        self._latest: int | None = None
        self.number = 0

    @property
    def paths(self) -> Iterator[Path]:
        """The paths of all values that are checked, without those of times."""
        for shape in self._shapes:
            yield from (path for path, _ in (*shape.literals, *shape.lengths))
            yield from (path for path, _, _ in shape.parameters)
        yield from (path for path, _, _ in self._tests)

    @property
    def is_flat(self) -> bool:
        """Whether all values are those of fields of an event, and each event is checked by itself."""
        flat = all(len(path) == 1 and isinstance(path[0], str) for path in self.paths)
        return flat and self.assumptions <= {Assumption.TYPES, Assumption.PRESENT, Assumption.EXACT}

    @property
    def literals(self) -> Iterator[Mapping[str, Json]]:
        """The literals of each event type, by field, of a check that is flat."""
        return ({str(path[0]): literal for path, literal in shape.literals} for shape in self._shapes)

    def is_kept(self, events: Columns) -> bool:
        """Whether events with the same fields and literals keep the assumptions; False is uncertain.

        The check must be flat.
        """
        first = events.events[0]
        parameters = (one for shape in self._shapes if shape.fits(first) for one in shape.parameters)
        fields = ((str(path[0]), type_) for path, _, type_ in parameters)
        return all(self._is_kept(events, field, type_, present=field in first) for field, type_ in fields)

    def _is_kept(self, events: Columns, field: str, type_: ValueType, *, present: bool) -> bool:
        types = events.types(field) if present else {type(None)}
        if type(None) in types:
            return Assumption.PRESENT not in self.assumptions and len(types) == 1
        if Assumption.TYPES in self.assumptions and not types <= _TYPES.get(type_, types):
            return False
        timed = Assumption.TYPES in self.assumptions and type_ is ValueType.TIME
        if timed and (self._time is None or not all(map(self._time.reads, events.values(field)))):
            return False
        inexact = Assumption.EXACT in self.assumptions and not types.isdisjoint({int, float, Exact})
        return not (inexact and any(map(is_inexact, events.values(field))))

    def broken(self, event: Json) -> tuple[Violation, ...]:
        """Return the assumptions that the next event breaks, each at most once per cause."""
        self.number += 1
        return tuple(dict.fromkeys(self._broken(event)))

    def _broken(self, event: Json) -> Iterator[Violation]:
        assumed, number = self.assumptions, self.number
        for shape in self._shapes:
            if not shape.fits(event):
                continue
            for path, _, type_ in shape.parameters:
                found = _at(event, path)
                name = _written(path)
                if found is _ABSENT or found is None:
                    if Assumption.PRESENT in assumed:
                        message = f"{name} is {'absent' if found is _ABSENT else 'null'}"
                        yield Violation(Assumption.PRESENT, number, message, path, type_)
                    continue
                if Assumption.TYPES in assumed and not has_type(found, type_, self._time):
                    message = f"{name} is {described(found)}, not of type {type_}"
                    yield Violation(Assumption.TYPES, number, message, path, type_)
                if Assumption.EXACT in assumed and is_inexact(found):
                    message = f"{name} is {found}, which a double may not hold exactly"
                    yield Violation(Assumption.EXACT, number, message, path, type_)
        for path, differs, text in self._tests:
            found = _at(event, path)
            if isinstance(found, str) and differs(found):
                message = f"{_written(path)} is {shortened(found)}, which matches {shortened(text)} only without case"
                yield Violation(Assumption.CASE, number, message, path, literal=text)
        if Assumption.ORDER in assumed and self._time is not None:
            late, self._latest = self._time.is_late(event, self._latest)
            if late:
                message = f"it is more than {duration_text(self._time.late or 0)} older than an event before it"
                yield Violation(Assumption.ORDER, number, message, self._time.field)


def fields_read(tree: RVAFT) -> Iterator[tuple[str, ...]]:
    """Yield the fields that a check of the tree's assumptions reads, up to the first list."""
    if tree.assumes - {Assumption.ORDER}:
        check = AssumptionCheck(tree)
        for path in check.paths:
            names = tuple(takewhile(lambda step: isinstance(step, str), path))
            yield cast("tuple[str, ...]", names)


def first_violation(tree: RVAFT, trace: Iterable[Json], assumptions: Iterable[Assumption]) -> Violation | None:
    """Return the first violation of some stated assumptions in a trace, or None."""
    check = AssumptionCheck(tree, assumptions)
    return next((violation for event in trace for violation in check.broken(event)), None)


def used_events(tree: RVAFT) -> list[str]:
    """Return the event types of reachable nodes and of `ignore` declarations."""
    calls = [*(node.on for node in tree.top_down()), *(ignore.on for ignore in tree.ignores)]
    calls += [clause.on for _, clause, _ in tree.absences]
    return [*dict.fromkeys(on.event for on in calls if on is not None)]


def _shape(tree: RVAFT, name: str) -> _Shape:
    event = tree.events[name]
    literals: list[tuple[Path, Json]] = []
    lengths: list[tuple[Path, int]] = []
    parameters: list[tuple[Path, str, ValueType]] = []
    for path, part, around in places(event.pattern):
        match part:
            case Literal(constant):
                literals.append((path, constant))
                lengths.extend(one for one in around if one not in lengths)
            case Variable(parameter):
                parameters.append((path, parameter, event.type_of(parameter)))
            case Anything() | ObjectPattern() | ListPattern() | SomeItem():
                pass
            case _:
                assert_never(part)
    return _Shape(tuple(literals), tuple(lengths), tuple(parameters))


def places(
    pattern: Pattern, path: Path = (), around: tuple[tuple[Path, int], ...] = ()
) -> Iterator[tuple[Path, Pattern, tuple[tuple[Path, int], ...]]]:
    """Yield the parts of a pattern with their paths, and the lists around them with their lengths.

    The parts inside `[..., P, ...]` have no path.
    """
    yield path, pattern, around
    match pattern:
        case ObjectPattern(fields):
            for name, inner in fields:
                yield from places(inner, (*path, name), around)
        case ListPattern(items):
            for number, inner in enumerate(items):
                yield from places(inner, (*path, number), (*around, (path, len(items))))
        case Literal() | Variable() | Anything() | SomeItem():
            pass
        case _:
            assert_never(pattern)


def _case_tests(tree: RVAFT) -> Iterator[tuple[Path, Callable[[str], bool], str]]:
    """Yield tests of texts in events: the path, whether a text differs in case alone, and the literal."""
    guards = [*(node.when for node in tree.top_down()), *(clause.when for _, clause, _ in tree.absences)]
    patterns = [*(tree.pattern(name) for name in tree.occurrences), *(pattern for _, _, pattern in tree.absences)]
    local = [(tree.instantiate(ignore.on), [ignore.when]) for ignore in tree.ignores]
    for pattern, tests in [*((pattern, guards) for pattern in patterns if pattern is not None), *local]:
        for path, part, _ in places(pattern):
            match part:
                case Literal(str() as text):
                    yield path, _other_case(text), text
                case Variable(name):
                    for guard in tests:
                        yield from ((path, *one) for one in _guard_tests(guard, name))
                case Literal() | Anything() | ObjectPattern() | ListPattern() | SomeItem():
                    pass
                case _:
                    assert_never(part)


def _guard_tests(guard: Guard | None, name: str) -> Iterator[tuple[Callable[[str], bool], str]]:
    for part in walk(guard):
        if not isinstance(part, Operation) or part.operator not in _TEXT_TESTS or Variable(name) not in part.operands:
            continue
        texts = [one.value for one in part.operands if isinstance(one, Literal) and isinstance(one.value, str)]
        if part.operator in (Operator.EQ, Operator.NE, Operator.IN):
            yield from ((_other_case(text), text) for text in texts)
        elif texts:
            yield _other_outcome(part.operator, texts[0], first=part.operands[0] == Variable(name)), texts[0]


def _fold(text: str) -> str:
    """Return a text in one case: texts that are equal in upper, lower or folded case are equal."""
    return text.upper().casefold()


def _other_case(text: str) -> Callable[[str], bool]:
    folded = _fold(text)
    return lambda found: found != text and _fold(found) == folded


def _other_outcome(operator: Operator, text: str, *, first: bool) -> Callable[[str], bool]:
    """Return whether the result changes with the case; the found text is the `first` operand, or the second."""

    def outcome(found_: str, own: str) -> Any:
        operands = (Literal(found_), Literal(own)) if first else (Literal(own), Literal(found_))
        found = value(Operation(operator, operands), {})
        assert found is not UNDEFINED
        return found

    return lambda found: outcome(found, text) is not outcome(_fold(found), _fold(text))


def _at(event: Json, path: Sequence[str | int]) -> Any:
    """Return the value at a path, or `_ABSENT`."""
    found: Any = event
    for step in path:
        inside = isinstance(found, Mapping) and step in found
        if not inside and not (isinstance(step, int) and isinstance(found, list) and step < len(found)):
            return _ABSENT
        found = found[step]
    return found


def _written(path: Path) -> str:
    return "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in path).removeprefix(".")


def shortened(text: str) -> str:
    """Return a text of an event for a message, cut to 40 characters."""
    return readable_json(text if len(text) <= 40 else f"{text[:39]}…")


def described(found: Json) -> str:
    """Return a value of an event in the words of types, for a message."""
    match found:
        case None:
            return "null"
        case bool():
            return "a boolean"
        case str():
            return "a text"
        case float() if not isfinite(found):
            return "not finite"
        case int() | float():
            return f"the number {found}"
        case list():
            return "a list"
        case _:
            return "an object"
