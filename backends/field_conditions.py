"""Conditions on one event, for languages that compare fields with constants.

A dialect is a subclass with a template per kind of test; it refuses tests without a template.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping
from enum import Enum
from typing import ClassVar, TypeAlias

from rvaft.core.conditions import (
    ComparisonTest,
    ConditionTest,
    EqualityTest,
    SortTest,
    TruthConditions,
    TruthTest,
    spelled,
)
from rvaft.errors import NotExpressible, Reason
from rvaft.model.assumptions import Declared
from rvaft.model.guards import OPERATORS, Guard, Operation, Operator, TermSort, variables
from rvaft.model.patterns import Anything, ListPattern, Literal, ObjectPattern, Pattern, SomeItem, Variable
from rvaft.model.values import Json, is_finite

FieldPath: TypeAlias = tuple[str | int, ...]
"""Path to a value, outermost first: field names and list indices."""


class DialectTest(Enum):
    """Tests that a dialect may lack."""

    TWO_FIELDS = "whether two fields are equal"
    CONTAINER = "whether a value is an object, or how long a list is"
    CALCULATION = "anything but a comparison of one field with a constant"
    NULL = "null"
    SURROGATE = "half of a surrogate pair"
    FIELD_NAME = "a field of this name"
    TEXT_FUNCTION = "this function of texts"


class FieldConditions(ABC):
    """The conditions of one language; `{p}` in a template is a path, `{v}` a literal.

    >>> from rvaft.errors import unwritten
    >>> class Dialect(FieldConditions):
    ...     exists, equals, differs, is_truth = "has {p}", "{p} = {v}", "{p} != {v}", "{p} = {v}"
    ...     reasons = {DialectTest.CALCULATION: unwritten("it calculates nothing")}
    ...     def path(self, way): return ".".join(map(str, way))
    ...     def literal(self, value): return repr(value)
    >>> from rvaft.language.parser import parse_guard, parse_pattern
    >>> Dialect().of(parse_pattern("{ a: 1, b: X }"), [parse_guard("X > 5")])
    'a = 1 and has b and b > 5'
    """

    always: ClassVar[str] = "true"
    never: ClassVar[str] = "false"
    conjunction: ClassVar[str] = " and "
    disjunction: ClassVar[str] = " or "
    exists: ClassVar[str]
    equals: ClassVar[str]
    differs: ClassVar[str]
    """A test that a field has a value other than `{v}`."""
    compares: ClassVar[str] = "{p} {sign} {v}"
    is_truth: ClassVar[str]
    length: ClassVar[str | None] = None
    """A test that a list has `{n}` items; None without lists."""
    functions: ClassVar[Mapping[Operator, str]] = {}
    """Templates of the functions of strings."""
    denied: ClassVar[str] = "not {t}"
    """A test that a function `{t}` of the string at a path is false, and not undefined."""
    plainly_differs: ClassVar[str] = ""
    """`differs` for a value that is assumed to be there and of the type of `{v}`, if it is simpler."""
    plainly_denied: ClassVar[str] = ""
    """`denied` for a string that is assumed to be there, if it is simpler."""
    comparing_asks: ClassVar[bool] = False
    """Whether a comparison implies that the field exists."""
    reasons: ClassVar[Mapping[DialectTest, Reason]]
    declared: Declared = Declared()
    """What the log is assumed to keep for the event of the condition."""
    _ways: dict[str, FieldPath]
    """The paths of variables."""

    @abstractmethod
    def path(self, way: FieldPath) -> str:
        """Return a path in the language; raises `NotExpressible`."""

    @abstractmethod
    def literal(self, value: Json) -> str:
        """Return a constant in the language; raises `NotExpressible`."""

    def lacks(self, what: DialectTest) -> NotExpressible:
        """Return the refusal for a missing test."""
        return NotExpressible(self.reasons[what])

    def of(self, pattern: Pattern, guards: Iterable[Guard] = (), declared: Declared = Declared()) -> str:  # noqa: B008
        """Return the condition that an event matches a pattern and satisfies guards over its own
        values.

        `declared` says what the log is assumed to keep. Raises `NotExpressible`.
        """
        self.declared, self._ways = declared, {}
        paths: dict[str, str] = {}
        tests = list(self._tests(pattern, (), paths))
        conditions = [(variables(guard), self.guard(guard, paths)) for guard in guards]
        compared = {names[0] for names, text in conditions if len(names) == 1 and text not in (self.always, self.never)}
        implied = compared if self.comparing_asks else set[str]()
        return self.all([*(text for name, text in tests if name not in implied), *(text for _, text in conditions)])

    def paths(self, pattern: Pattern) -> dict[str, str]:
        """Return the paths of the variables of a pattern."""
        self._ways = {}
        found: dict[str, str] = {}
        for _ in self._tests(pattern, (), found):
            pass
        return found

    def _tests(self, pattern: Pattern, way: FieldPath, paths: dict[str, str]) -> Iterator[tuple[str, str]]:
        """Yield each test of a pattern with its variable, if any; add the paths of variables to
        `paths`.
        """
        match pattern:
            case Variable(name) if name in paths:
                raise self.lacks(DialectTest.TWO_FIELDS)
            case Variable() | Anything():
                name = pattern.name if isinstance(pattern, Variable) else ""
                if name:
                    paths[name], self._ways[name] = self.path(way), way
                there = not way or way in self.declared.present
                yield name, self.always if there else self.exists.format(p=self.path(way))
            case Literal(value):
                yield "", self.equals.format(p=self.path(way), v=self.literal(value)) if way else self.never
            case ObjectPattern(fields) if fields or not way:
                for name, inner in fields:
                    yield from self._tests(inner, (*way, name), paths)
            case ListPattern(items) if items and self.length is not None:
                yield "", self.length.format(p=self.path(way), n=len(items)) if way else self.never
                for place, inner in enumerate(items):
                    yield from self._tests(inner, (*way, place), paths)
            case ObjectPattern() | ListPattern() | SomeItem():
                raise self.lacks(DialectTest.CONTAINER)

    def guard(self, guard: Guard, paths: Mapping[str, str]) -> str:
        """Return a condition that is true exactly when the guard holds."""
        return spelled(
            TruthConditions.declared(self.declared, self._ways).of(guard),
            lambda test: self.test(test, paths),
            lambda every, parts: self.all(parts) if every else self.any(parts),
        )

    def test(self, test: ConditionTest, paths: Mapping[str, str]) -> str:
        """Return the text of one test."""
        match test:
            case TruthTest(Variable(name), wanted):
                return self.is_truth.format(p=paths[name], v=self.literal(wanted))
            case TruthTest(Operation(operator, (Variable(name), Literal(str() as value))), wanted):
                found = self.function(operator, paths[name], value, wanted=True)
                if wanted:
                    return found
                if self.plainly_denied and self._is_plain(name, value):
                    return self.plainly_denied.format(t=found, p=paths[name])
                return self.function(operator, paths[name], value, wanted=False)
            case EqualityTest(Variable(name), Literal(value), wanted) | EqualityTest(
                Literal(value), Variable(name), wanted
            ):
                template = self.equals if wanted else self.differs
                if not wanted and self.plainly_differs and self._is_plain(name, value):
                    template = self.plainly_differs
                return template.format(p=paths[name], v=self.literal(value)) if is_finite(value) else self.never
            case ComparisonTest(_, Variable(name), sign, Literal(value)):
                compared = self.compares.format(p=paths[name], sign=sign, v=self.literal(value))
                return compared if is_finite(value) else self.never
            case ComparisonTest(sort, Literal() as left, sign, Variable() as right):
                mirrored = OPERATORS[Operator(sign)].mirrored
                assert mirrored is not None, "the sign of a comparison"
                return self.test(ComparisonTest(sort, right, mirrored.value, left), paths)
            case TruthTest() | EqualityTest() | ComparisonTest() | SortTest():
                raise self.lacks(DialectTest.CALCULATION)

    def _is_plain(self, name: str, value: Json) -> bool:
        """Whether a variable is assumed to have a value of the sort of another value."""
        way = self._ways[name]
        sort = self.declared.sort_of(way)
        known = sort is not TermSort.UNKNOWN and sort is TruthConditions().sort(Literal(value))
        return known and way in self.declared.present

    def function(self, operator: Operator, path: str, text: str, *, wanted: bool) -> str:
        """Return a test that a function of the string at a path and a constant equals `wanted`."""
        if operator not in self.functions:
            raise self.lacks(DialectTest.CALCULATION)
        found = self.functions[operator].format(p=path, v=self.literal(text))
        return found if wanted else self.denied.format(t=found, p=path)

    def all(self, texts: Iterable[str]) -> str:
        """Return the conjunction without duplicates."""
        return conjunction(texts, self.conjunction, self.always, self.never)

    def any(self, texts: Iterable[str]) -> str:
        """Return the disjunction without duplicates, in parentheses."""
        return disjunction(texts, self.disjunction, self.always, self.never, self.operand)

    def operand(self, text: str) -> str:
        """Return a condition as an operand of a disjunction."""
        return text


def conjunction(texts: Iterable[str], word: str, always: str, never: str) -> str:
    """Return the conjunction of conditions without duplicates.

    >>> conjunction(["a", "true", "b", "a"], " and ", "true", "false"), conjunction([], " and ", "true", "false")
    ('a and b', 'true')
    """
    found = list(dict.fromkeys(text for text in texts if text != always))
    return never if never in found else word.join(found) or always


def disjunction(texts: Iterable[str], word: str, always: str, never: str, operand: Callable[[str], str] = str) -> str:
    """Return the disjunction of conditions without duplicates, in parentheses if there are several.

    `operand` formats each of them.

    >>> disjunction(["a", "false", "b"], " or ", "true", "false"), disjunction([], " or ", "true", "false")
    ('(a or b)', 'false')
    """
    found = list(dict.fromkeys(text for text in texts if text != never))
    if always in found:
        return always
    return f"({word.join(map(operand, found))})" if len(found) > 1 else next(iter(found), never)
