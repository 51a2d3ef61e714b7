"""What one event is asked, for languages that compare fields with constants.

A pattern and guards over its own values as text.

A dialect is a subclass with a template for each kind of test. What has no template is refused, with
the dialect's reason.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
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
from rvaft.errors import NotExpressible
from rvaft.model.guards import OPERATORS, Guard, Operation, Operator, variables
from rvaft.model.patterns import Anything, ListPattern, Literal, ObjectPattern, Pattern, Variable
from rvaft.model.values import Json, is_finite

FieldPath: TypeAlias = tuple[str | int, ...]
"""The way to a value from the outside in: names of fields, and places in lists."""


class Lack(Enum):
    """What a dialect may have no way to ask."""

    TWO_FIELDS = "whether two fields are equal"
    CONTAINER = "whether a value is an object, or how long a list is"
    CALCULATION = "anything but a comparison of one field with a constant"
    NULL = "null"
    SURROGATE = "half of a surrogate pair"
    FIELD_NAME = "a field of this name"
    TEXT_FUNCTION = "this function of texts"


class FieldConditions(ABC):
    """The conditions of one language; `{p}` in a template is a path, `{v}` a literal.

    >>> class Dialect(FieldConditions):
    ...     exists, equals, differs, is_truth = "has {p}", "{p} = {v}", "{p} != {v}", "{p} = {v}"
    ...     reasons = {Lack.CALCULATION: "it calculates nothing"}
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
    """That a field has a value, and not this one."""
    compares: ClassVar[str] = "{p} {sign} {v}"
    is_truth: ClassVar[str]
    length: ClassVar[str | None] = None
    """That a list has `{n}` items; None where there are no lists."""
    functions: ClassVar[Mapping[Operator, str]] = {}
    """The functions of texts."""
    denied: ClassVar[str] = "not {t}"
    """That a function `{t}` of the text at a path is false, and not undefined."""
    comparing_asks: ClassVar[bool] = False
    """Whether a comparison with a field says that the field exists."""
    reasons: ClassVar[Mapping[Lack, str]]

    @abstractmethod
    def path(self, way: FieldPath) -> str:
        """A path as the language writes it; raises `NotExpressible`."""

    @abstractmethod
    def literal(self, value: Json) -> str:
        """A constant as the language writes it; raises `NotExpressible`."""

    def lacks(self, what: Lack) -> NotExpressible:
        """The refusal for what the language lacks."""
        return NotExpressible(self.reasons[what])

    def of(self, pattern: Pattern, guards: Iterable[Guard] = ()) -> str:
        """The condition of an event that matches a pattern and fulfils guards over its own values.

        Raises `NotExpressible`.
        """
        paths: dict[str, str] = {}
        tests = list(self._tests(pattern, (), paths))
        asked = [(variables(guard), self.guard(guard, paths)) for guard in guards]
        compared = {names[0] for names, text in asked if len(names) == 1 and text not in (self.always, self.never)}
        implied = compared if self.comparing_asks else set[str]()
        return self.all([*(text for name, text in tests if name not in implied), *(text for _, text in asked)])

    def paths(self, pattern: Pattern) -> dict[str, str]:
        """Where the variables of a pattern stand."""
        found: dict[str, str] = {}
        for _ in self._tests(pattern, (), found):
            pass
        return found

    def _tests(self, pattern: Pattern, way: FieldPath, paths: dict[str, str]) -> Iterator[tuple[str, str]]:
        """The tests of a pattern, each with the variable that stands there, if one does; notes the
        paths of variables.
        """
        match pattern:
            case Variable(name) if name in paths:
                raise self.lacks(Lack.TWO_FIELDS)
            case Variable() | Anything():
                name = pattern.name if isinstance(pattern, Variable) else ""
                if name:
                    paths[name] = self.path(way)
                yield name, self.exists.format(p=self.path(way)) if way else self.always
            case Literal(value):
                yield "", self.equals.format(p=self.path(way), v=self.literal(value)) if way else self.never
            case ObjectPattern(fields) if fields or not way:
                for name, inner in fields:
                    yield from self._tests(inner, (*way, name), paths)
            case ListPattern(items) if items and self.length is not None:
                yield "", self.length.format(p=self.path(way), n=len(items)) if way else self.never
                for place, inner in enumerate(items):
                    yield from self._tests(inner, (*way, place), paths)
            case ObjectPattern() | ListPattern():
                raise self.lacks(Lack.CONTAINER)

    def guard(self, guard: Guard, paths: Mapping[str, str]) -> str:
        """What holds of an event exactly where a guard is true; `paths` are those of its variables."""
        return spelled(
            TruthConditions().of(guard),
            lambda test: self.test(test, paths),
            lambda every, parts: self.all(parts) if every else self.any(parts),
        )

    def test(self, test: ConditionTest, paths: Mapping[str, str]) -> str:
        """One test."""
        match test:
            case TruthTest(Variable(name), wanted):
                return self.is_truth.format(p=paths[name], v=self.literal(wanted))
            case TruthTest(Operation(operator, (Variable(name), Literal(str() as value))), wanted):
                return self.function(operator, paths[name], value, wanted=wanted)
            case EqualityTest(Variable(name), Literal(value), wanted) | EqualityTest(
                Literal(value), Variable(name), wanted
            ):
                template = self.equals if wanted else self.differs
                return template.format(p=paths[name], v=self.literal(value)) if is_finite(value) else self.never
            case ComparisonTest(_, Variable(name), sign, Literal(value)):
                compared = self.compares.format(p=paths[name], sign=sign, v=self.literal(value))
                return compared if is_finite(value) else self.never
            case ComparisonTest(sort, Literal() as left, sign, Variable() as right):
                mirrored = OPERATORS[Operator(sign)].mirrored
                assert mirrored is not None, "the sign of a comparison"
                return self.test(ComparisonTest(sort, right, mirrored.value, left), paths)
            case TruthTest() | EqualityTest() | ComparisonTest() | SortTest():
                raise self.lacks(Lack.CALCULATION)

    def function(self, operator: Operator, path: str, text: str, *, wanted: bool) -> str:
        """That a function of the text at a path and a constant is true, or is false."""
        if operator not in self.functions:
            raise self.lacks(Lack.CALCULATION)
        found = self.functions[operator].format(p=path, v=self.literal(text))
        return found if wanted else self.denied.format(t=found, p=path)

    def all(self, texts: Iterable[str]) -> str:
        """The conjunction, each condition once."""
        return conjunction(texts, self.conjunction, self.always, self.never)

    def any(self, texts: Iterable[str]) -> str:
        """The disjunction, each condition once, in parentheses."""
        return disjunction(texts, self.disjunction, self.always, self.never, self.operand)

    def operand(self, text: str) -> str:
        """A condition as an operand of a disjunction."""
        return text


def conjunction(texts: Iterable[str], word: str, always: str, never: str) -> str:
    """The conjunction of conditions, each once.

    >>> conjunction(["a", "true", "b", "a"], " and ", "true", "false"), conjunction([], " and ", "true", "false")
    ('a and b', 'true')
    """
    found = list(dict.fromkeys(text for text in texts if text != always))
    return never if never in found else word.join(found) or always


def disjunction(texts: Iterable[str], word: str, always: str, never: str, operand: Callable[[str], str] = str) -> str:
    """The disjunction of conditions, each once, in parentheses where there are several.

    `operand` writes each of several conditions.

    >>> disjunction(["a", "false", "b"], " or ", "true", "false"), disjunction([], " or ", "true", "false")
    ('(a or b)', 'false')
    """
    found = list(dict.fromkeys(text for text in texts if text != never))
    if always in found:
        return always
    return f"({word.join(map(operand, found))})" if len(found) > 1 else next(iter(found), never)


@contextmanager
def naming(node: str) -> Iterator[None]:
    """Adds the node to a refusal that names none."""
    try:
        yield
    except NotExpressible as refusal:
        raise NotExpressible(refusal.reason, nodes=refusal.nodes or [node]) from None
