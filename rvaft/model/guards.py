"""Guards: the expression type, the table of operators, and evaluation under a binding.

A value is JSON or `UNDEFINED` (wrong types, division by zero, overflow, non-finite results), which
propagates through every operator, except that `and` and `or` short-circuit from the left. The
parser bounds the nesting (`MAX_DEPTH`), and so the recursion here.
"""

import json
import operator as python
import re
import sys
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from enum import Enum, StrEnum, auto
from functools import lru_cache
from typing import Any, Final, NamedTuple, TypeAlias

from rvaft.model.patterns import Binding, Literal, Variable
from rvaft.model.values import NUMBER, OWN_TYPES, Json, equal, is_finite, is_number

MAX_DEPTH: Final = 100


class Operator(StrEnum):
    """The operators, named as written; NEGATE is the unary minus."""

    EQ = "=="
    NE = "!="
    LT = "<"
    LE = "<="
    GT = ">"
    GE = ">="
    ADD = "+"
    SUB = "-"
    MUL = "*"
    DIV = "/"
    NEGATE = "neg"
    NOT = "not"
    AND = "and"
    OR = "or"
    IN = "in"
    STARTSWITH = "startswith"
    ENDSWITH = "endswith"
    CONTAINS = "contains"
    LIKE = "like"
    LOWER = "lower"
    ABS = "abs"
    MIN = "min"
    MAX = "max"
    NUMBER = "number"


class _Undefined(Enum):
    UNDEFINED = auto()

    def __repr__(self) -> str:
        return "UNDEFINED"


UNDEFINED: Final = _Undefined.UNDEFINED


class TermSort(StrEnum):
    """The sort of a term's values.

    A variable is UNKNOWN, or the TIME of an event. A VOID term is undefined under every binding.
    """

    NUMBER = "number"
    TIME = "time"
    TEXT = "text"
    TRUTH = "truth"
    NULL = "null"
    UNKNOWN = "unknown"
    VOID = "void"


class OperatorFacts(NamedTuple):
    """The properties of an operator; the reference and the backends have their own.

    - `takes`: the sorts of operands (None: any); other operands make it undefined.
    - `gives`: the sort of the result.
    - `function`: the result for defined operands (None: operands are evaluated lazily).
    - `arity`: the number of operands (None: two or more).
    - `negated`: the complement of a comparison on defined operands.
    - `mirrored`: the comparison with exchanged sides.
    - `means`: the definition by other operators, from the operands (None: it has none). It includes
      where the operator is undefined; without a `function` it is also how the operator is evaluated.
    """

    level: int
    sign: str
    function: Callable[..., Json] | None
    takes: frozenset[TermSort] | None
    gives: TermSort
    arity: int | None = 2
    compare: Callable[[Any, Any], bool] | None = None
    negated: Operator | None = None
    mirrored: Operator | None = None
    means: "Callable[..., Guard] | None" = None


def _equality(left: Json, right: Json) -> Json:
    return equal(left, right) if is_finite(left) and is_finite(right) else UNDEFINED


def _denied(truth: Json) -> Json:
    return not truth if isinstance(truth, bool) else UNDEFINED


def _ordered(compare: Callable[[Any, Any], bool]) -> Callable[[Json, Json], Json]:

    def compared(left: Json, right: Json) -> Json:
        if is_number(left) and is_number(right):
            return compare(left, right) if is_finite(left) and is_finite(right) else UNDEFINED
        return compare(left, right) if isinstance(left, str) and isinstance(right, str) else UNDEFINED

    return compared


def _calculating(calculate: Callable[..., Any]) -> Callable[..., Json]:
    """Return an operation on numbers; a double with an integral value is that integer."""

    def calculated(*arguments: Json) -> Json:
        numbers = []
        for argument in arguments:
            if type(argument) is not int:
                if not is_number(argument) or argument - argument != 0:
                    return UNDEFINED
                numbers.append(int(argument) if argument.is_integer() else argument)
            else:
                numbers.append(argument)
        try:
            result = calculate(*numbers)
        except (ZeroDivisionError, OverflowError):
            return UNDEFINED
        return result if is_finite(result) else UNDEFINED

    return calculated


def _texts(calculate: Callable[..., Any]) -> Callable[..., Json]:

    def calculated(*arguments: Json) -> Json:
        return calculate(*arguments) if all(isinstance(argument, str) for argument in arguments) else UNDEFINED

    return calculated


@lru_cache(maxsize=1_000)
def _glob(glob: str) -> re.Pattern[str]:
    """Return a linear-time pattern for a whole text.

    Atomic groups match the pieces between stars from the left without backtracking.
    """
    first, *others = [["." if sign == "?" else re.escape(sign) for sign in piece] for piece in re.split(r"\*+", glob)]
    inner = "".join(f"(?>.*?{''.join(piece)})" for piece in others[:-1])
    last = "".join(f"(?=.{{{len(piece)}}})(?>.*)(?<={''.join(piece)})" for piece in others[-1:])
    return re.compile("".join(first) + inner + last, re.DOTALL)


def _number(value: Json) -> Json:
    if isinstance(value, str) and NUMBER.fullmatch(value):
        try:
            value = json.loads(value)
        except ValueError:  # more digits than Python reads
            return UNDEFINED
    return value if is_number(value) and is_finite(value) else UNDEFINED


def _listed(value: Json, *listed: Json) -> Json:
    return any(equal(value, item) for item in listed) if is_finite(value) else UNDEFINED


def _one_of(value: "Guard", *listed: "Guard") -> "Guard":
    alternatives = tuple(Operation(Operator.EQ, (value, one)) for one in listed)
    return alternatives[0] if len(alternatives) == 1 else Operation(Operator.OR, alternatives)


def _like(text: str, glob: str) -> bool:
    return _glob(glob).fullmatch(text) is not None


def _lower(text: str) -> str:
    return "".join(map(str.lower, text))


MAX_GLOB: Final = 1_000
"""The maximum length of a glob, in characters."""

_O = Operator
_TRUTHS: Final = frozenset({TermSort.TRUTH})
_NUMERALS: Final = frozenset({TermSort.NUMBER})
_STRINGS: Final = frozenset({TermSort.TEXT})
_ORDERED: Final = frozenset({TermSort.NUMBER, TermSort.TEXT})


def _comparison(
    sign: str, function: Callable[..., Json], compare: Callable[[Any, Any], bool], negated: Operator, mirrored: Operator
) -> OperatorFacts:
    takes = None if mirrored.value == sign else _ORDERED
    return OperatorFacts(4, sign, function, takes, TermSort.TRUTH, 2, compare, negated, mirrored)


OPERATORS: Final[Mapping[Operator, OperatorFacts]] = {
    _O.OR: OperatorFacts(1, "or", None, _TRUTHS, TermSort.TRUTH, None),
    _O.AND: OperatorFacts(2, "and", None, _TRUTHS, TermSort.TRUTH, None),
    _O.NOT: OperatorFacts(3, "not ", _denied, _TRUTHS, TermSort.TRUTH, 1),
    _O.EQ: _comparison("==", _equality, python.eq, _O.NE, _O.EQ),
    _O.NE: _comparison("!=", lambda left, right: _denied(_equality(left, right)), python.ne, _O.EQ, _O.NE),
    _O.LT: _comparison("<", _ordered(python.lt), python.lt, _O.GE, _O.GT),
    _O.LE: _comparison("<=", _ordered(python.le), python.le, _O.GT, _O.GE),
    _O.GT: _comparison(">", _ordered(python.gt), python.gt, _O.LE, _O.LT),
    _O.GE: _comparison(">=", _ordered(python.ge), python.ge, _O.LT, _O.LE),
    _O.ADD: OperatorFacts(5, "+", _calculating(python.add), _NUMERALS, TermSort.NUMBER),
    _O.SUB: OperatorFacts(5, "-", _calculating(python.sub), _NUMERALS, TermSort.NUMBER),
    _O.MUL: OperatorFacts(6, "*", _calculating(python.mul), _NUMERALS, TermSort.NUMBER),
    _O.DIV: OperatorFacts(6, "/", _calculating(python.truediv), _NUMERALS, TermSort.NUMBER),
    _O.NEGATE: OperatorFacts(7, "-", _calculating(python.neg), _NUMERALS, TermSort.NUMBER, 1),
    _O.IN: OperatorFacts(4, "in", _listed, None, TermSort.TRUTH, None, means=_one_of),
    _O.STARTSWITH: OperatorFacts(8, "startswith", _texts(str.startswith), _STRINGS, TermSort.TRUTH),
    _O.ENDSWITH: OperatorFacts(8, "endswith", _texts(str.endswith), _STRINGS, TermSort.TRUTH),
    _O.CONTAINS: OperatorFacts(8, "contains", _texts(str.__contains__), _STRINGS, TermSort.TRUTH),
    _O.LIKE: OperatorFacts(8, "like", _texts(_like), _STRINGS, TermSort.TRUTH),
    _O.LOWER: OperatorFacts(8, "lower", _texts(_lower), _STRINGS, TermSort.TEXT, 1),
    _O.ABS: OperatorFacts(8, "abs", _calculating(abs), _NUMERALS, TermSort.NUMBER, 1),
    _O.MIN: OperatorFacts(8, "min", _calculating(min), _NUMERALS, TermSort.NUMBER, None),
    _O.MAX: OperatorFacts(8, "max", _calculating(max), _NUMERALS, TermSort.NUMBER, None),
    _O.NUMBER: OperatorFacts(8, "number", _number, _ORDERED, TermSort.NUMBER, 1),
}
"""A function (level 8) is written before its operands in parentheses."""

JUNCTIONS: Final = frozenset({Operator.AND, Operator.OR})
"""Operators with two or more operands, evaluated from the left."""
COMPARISONS: Final = frozenset(operator for operator, facts in OPERATORS.items() if facts.negated)
ORDERINGS: Final = COMPARISONS - {Operator.EQ, Operator.NE}
ARITHMETIC: Final = frozenset(operator for operator, facts in OPERATORS.items() if 4 < facts.level < 8)
FUNCTIONS: Final = frozenset(operator for operator, facts in OPERATORS.items() if facts.level == 8)
NUMERIC: Final = frozenset(
    operator for operator, facts in OPERATORS.items() if facts.takes == _NUMERALS and facts.gives is TermSort.NUMBER
)
"""Operators from numbers to a number."""

assert set(OPERATORS) == set(Operator), f"not in OPERATORS: {set(Operator) - set(OPERATORS)}"
assert JUNCTIONS | COMPARISONS | ARITHMETIC | FUNCTIONS | {Operator.NOT, Operator.IN} == set(Operator)
assert all(facts.gives in (TermSort.NUMBER, TermSort.TEXT, TermSort.TRUTH) for facts in OPERATORS.values())
for _operator in COMPARISONS:
    _facts = OPERATORS[_operator]
    assert OPERATORS[_facts.negated or Operator.NOT].negated is _operator
    assert OPERATORS[_facts.mirrored or Operator.NOT].mirrored is _operator


@dataclass(frozen=True, slots=True)
class Operation:
    """An operator applied to operands; IN has the value and the literals.

    Operations with equal operators and operands are equal; 1 and 1.0 are equal operands.
    """

    operator: Operator
    operands: tuple["Guard", ...]


@dataclass(frozen=True, slots=True)
class TimePoint(Variable):
    """`at(NODE)`, `start(NODE)` or `end(NODE)`: a variable bound by event times; `name` is this
    text.

    `number` is 0 in a tree. In a property it is the occurrence of the event (`at`) or the copy of
    the node (`start`, `end`).
    """

    point: str = "at"
    node: str = ""
    number: int = 0

    @classmethod
    def of(cls, point: str, node: str, number: int = 0) -> "TimePoint":
        """Return the time point of a node.

        >>> TimePoint.of("start", "login").name, TimePoint.of("at", "login", 2).name
        ('start(login)', 'at(login)#2')
        """
        name = f"{point}({node})"
        return cls(f"{name}#{number}" if number else name, point, node, number)


POINTS: Final = ("at", "start", "end")


@dataclass(frozen=True, slots=True, eq=False)
class Duration(Literal):
    """A literal written with a unit; its value is in nanoseconds."""


Guard: TypeAlias = Literal | Variable | Operation


def variables(guard: Guard | None) -> tuple[str, ...]:
    """Return the variables of a guard in order of first occurrence."""
    return tuple(dict.fromkeys(part.name for part in walk(guard) if isinstance(part, Variable)))


def time_points(guard: Guard | None) -> tuple[TimePoint, ...]:
    """Return the time points of a guard in order of first occurrence."""
    return tuple(dict.fromkeys(part for part in walk(guard) if isinstance(part, TimePoint)))


def walk(guard: Guard | None) -> Iterator[Guard]:
    """Iterate over the guard and all its parts in preorder; over nothing for None."""
    todo = [] if guard is None else [guard]
    while todo:
        part = todo.pop()
        yield part
        if isinstance(part, Operation):
            todo.extend(reversed(part.operands))


def conjuncts(guard: Guard | None) -> tuple[Guard, ...]:
    """Return the conjuncts of a guard, nested conjunctions flattened; none for None."""
    if isinstance(guard, Operation) and guard.operator is Operator.AND:
        return tuple(part for operand in guard.operands for part in conjuncts(operand))
    return () if guard is None else (guard,)


def substitute(guard: Guard, by: Mapping[str, Guard]) -> Guard:
    """Return the guard with the variables in `by` replaced."""
    match guard:
        case Variable(name):
            return by.get(name, guard)
        case Operation(operator, operands):
            return Operation(operator, tuple(substitute(operand, by) for operand in operands))
        case Literal():
            return guard


def renamed(guard: Guard, names: Mapping[str, str]) -> Guard:
    """Return the guard with renamed variables.

    >>> renamed(Operation(Operator.LT, (Variable("X"), Literal(3))), {"X": "Speed"})
    Operation(operator=<Operator.LT: '<'>, operands=(Variable(name='Speed'), Literal(value=3)))
    """
    return substitute(guard, {old: Variable(new) for old, new in names.items()})


MAX_EXPANDED: Final = 1_000
"""The maximum number of parts of a guard that `expanded` returns."""


def definition(guard: Guard) -> Guard | None:
    """Return what a guard means by the definition of its operator, if it has one; else None.

    >>> definition(Operation(Operator.IN, (Variable("X"), Literal(1))))
    Operation(operator=<Operator.EQ: '=='>, operands=(Variable(name='X'), Literal(value=1)))
    """
    means = OPERATORS[guard.operator].means if isinstance(guard, Operation) else None
    return means(*guard.operands) if means is not None and isinstance(guard, Operation) else None


def expanded(guard: Guard, known: Collection[Operator]) -> Guard:
    """Return the guard with operators replaced by their definitions, if all operators there are known.

    A known operator stays, and so does a guard that would have more than `MAX_EXPANDED` parts.
    """
    size = 0

    def of(part: Guard) -> Guard:
        nonlocal size
        size += 1
        if not isinstance(part, Operation) or size > MAX_EXPANDED:
            return part
        meaning = None if part.operator in known else definition(part)
        if meaning is not None and {*_operators(meaning)} - {*_operators(part)} <= {*known}:
            return of(meaning)
        operands = tuple(map(of, part.operands))
        return part if all(map(python.is_, operands, part.operands)) else Operation(part.operator, operands)

    found = of(guard)
    return guard if size > MAX_EXPANDED else found


def _operators(guard: Guard) -> Iterator[Operator]:
    return (part.operator for part in walk(guard) if isinstance(part, Operation))


def folded(guard: Guard) -> Guard:
    """Return the guard with constant parts replaced by their values, if defined.

    >>> folded(Operation(Operator.GT, (Variable("X"), Operation(Operator.ADD, (Literal(1), Literal(2))))))
    Operation(operator=<Operator.GT: '>'>, operands=(Variable(name='X'), Literal(value=3)))
    """
    if not isinstance(guard, Operation):
        return guard
    if variables(guard):
        return Operation(guard.operator, tuple(folded(operand) for operand in guard.operands))
    constant = value(guard, {})
    return guard if constant is UNDEFINED else Literal(constant)


def holds(guard: Guard, binding: Binding) -> bool:
    """Whether the guard's value is `true`; raises `KeyError` for an unbound variable."""
    return value(guard, binding) is True


def value(guard: Guard, binding: Binding) -> Json:
    """Return the value of a guard, or UNDEFINED; never raises for JSON values.

    >>> value(Operation(Operator.DIV, (Variable("X"), Literal(2))), {"X": 3})
    1.5
    >>> value(Operation(Operator.LT, (Variable("X"), Literal(2))), {"X": "a"})
    UNDEFINED
    """
    return evaluation(guard)(binding)


def evaluation(guard: Guard) -> Callable[[Binding], Json]:
    """Return the function from bindings to `value`s of a guard."""
    match guard:
        case Literal(constant):
            return lambda _: constant
        case Variable(name):
            return python.itemgetter(name)
        case Operation(operator, operands):
            calculate, parts = OPERATORS[operator].function, [evaluation(operand) for operand in operands]
            means = OPERATORS[operator].means
    if calculate is None and means is not None:
        names = [str(number) for number, _ in enumerate(parts)]
        body = evaluation(means(*map(Variable, names)))
        return lambda binding: body({name: part(binding) for name, part in zip(names, parts, strict=True)})
    if calculate is None:
        decides = operator is Operator.OR

        def decide(binding: Binding) -> Json:
            for part in parts:
                truth = part(binding)
                if not isinstance(truth, bool):
                    return UNDEFINED
                if truth is decides:
                    return decides
            return not decides

        return decide
    function = calculate

    def evaluate(binding: Binding) -> Json:
        arguments = [part(binding) for part in parts]
        return UNDEFINED if UNDEFINED in arguments else function(*arguments)

    if len(parts) != 2:
        return evaluate
    first, second = parts

    def evaluate_two(binding: Binding) -> Json:
        left, right = first(binding), second(binding)
        return UNDEFINED if left is UNDEFINED or right is UNDEFINED else function(left, right)

    return evaluate_two


def is_total(guard: Guard) -> bool:
    """Whether a guard is defined for all JSON values of its variables.

    >>> is_total(Operation(Operator.NE, (Variable("X"), Literal("a"))))
    True
    >>> is_total(Operation(Operator.LT, (Variable("X"), Literal("a"))))
    False
    """
    match guard:
        case Operation(Operator.EQ | Operator.NE | Operator.IN, (Variable(), *others)):
            return all(isinstance(operand, Literal) and is_finite(operand.value) for operand in others)
        case Operation(Operator.NOT | Operator.AND | Operator.OR, parts):
            return all(map(is_total, parts))
        case _:
            return False


Predicate: TypeAlias = Callable[[Mapping[str, Json]], bool]

_NUMBERS: Final = (int, float)
_LARGEST: Final = sys.float_info.max


def predicate(guard: Guard) -> Predicate:
    """Return `holds` as a function, faster for many events.

    The fastest cases are comparisons of a variable with a constant of its type, and their
    conjunctions.
    """
    match guard:
        case Operation(Operator.AND, operands):
            parts = tuple(predicate(operand) for operand in operands)
            return lambda binding: all(part(binding) for part in parts)
        case Operation(operator, (Variable(name), Literal(constant))) if compare := OPERATORS[operator].compare:
            evaluate = evaluation(guard)
            if type(constant) not in (str, *_NUMBERS):
                return lambda binding: evaluate(binding) is True
            other = (int if type(constant) is str else str) if operator in (Operator.EQ, Operator.NE) else None

            def with_number(binding: Mapping[str, Json]) -> bool:
                value = binding[name]
                kind = type(value)
                if kind is int or kind is other or (kind is float and -_LARGEST <= value <= _LARGEST):
                    found: bool = compare(value, constant)
                    return found
                return evaluate(binding) is True

            def with_text(binding: Mapping[str, Json]) -> bool:
                value = binding[name]
                kind = type(value)
                return bool(compare(value, constant)) if kind is str or kind is other else evaluate(binding) is True

            return with_text if type(constant) is str else with_number
        case Operation(operator, (left, right)) if compares := OPERATORS[operator].compare:
            first, second, evaluate = evaluation(left), evaluation(right), evaluation(guard)

            def with_both(binding: Mapping[str, Json]) -> bool:
                one, other = first(binding), second(binding)
                if type(one) is type(other) and (
                    type(one) in OWN_TYPES or (type(one) is float and one - one == other - other == 0)
                ):
                    return bool(compares(one, other))
                return evaluate(binding) is True

            return with_both
        case _:
            compiled = evaluation(guard)
            return lambda binding: compiled(binding) is True
