"""Random questions, and random events that have to do with them."""

from random import Random
from typing import Final

from cross_check.letters import untied
from rvaft.backend import Observed
from rvaft.language.parser import parse_guard, parse_pattern
from rvaft.model.guards import Guard, Operation, Operator
from rvaft.model.patterns import (
    Anything,
    ListPattern,
    Literal,
    ObjectPattern,
    Pattern,
    Variable,
    variables,
)
from rvaft.model.values import Json, Scalar

FIELDS: Final = ("x", "y", "z")
LITERALS: Final[tuple[Scalar, ...]] = (0, 1, 2, "a", "b", True, None, 1.5)
VALUES: Final[tuple[Json, ...]] = (
    *(0, 1, 2, 1.5, -1, 3, 0.5, 1.0, 1.25, 1.75, 1.9, 4, 6, 5, 100, 2**53 + 1, -0.0),
    *("", "a", "b", "aa", "A", "c", "ab", True, False, None),
)
COMPARISONS: Final = (Operator.EQ, Operator.NE, Operator.LT, Operator.LE, Operator.GT, Operator.GE)
STEPS: Final = (Operator.ADD, Operator.SUB, Operator.MUL, Operator.DIV)


def question(text: str) -> Observed:
    """A question as it is written in a tree, `PATTERN when GUARD`, with variables of its own."""
    pattern, _, guard = text.partition(" when ")
    return untied(Observed(parse_pattern(pattern), parse_guard(guard) if guard else None))


def random_question(random: Random, *, calculating: bool) -> Observed:
    """A pattern, half of the time with a guard on its variables."""
    pattern = _object(random, 2)
    names = variables(pattern)
    return Observed(pattern, _guard(random, names, calculating) if names and random.random() < 0.5 else None)


def _object(random: Random, depth: int) -> Pattern:
    names = random.sample(FIELDS, random.randint(0 if depth < 2 else 1, 2))
    return ObjectPattern(tuple((name, _inner(random, depth - 1)) for name in names))


def _inner(random: Random, depth: int) -> Pattern:
    dice = random.random()
    if dice < 0.3:
        return Literal(random.choice(LITERALS))
    if dice < 0.65:
        return Variable(random.choice(("_1", "_2", "_3")))
    if dice < 0.75 or not depth:
        return Anything()
    if dice < 0.85:
        return ListPattern(tuple(_inner(random, depth - 1) for _ in range(random.randint(0, 2))))
    return _object(random, depth)


def _guard(random: Random, names: tuple[str, ...], calculating: bool, depth: int = 1) -> Guard:
    dice = random.random()
    if depth and dice < 0.3:
        both = (_guard(random, names, calculating, 0), _guard(random, names, calculating, 0))
        return Operation(random.choice((Operator.AND, Operator.OR)), both)
    if depth and dice < 0.4:
        return Operation(Operator.NOT, (_guard(random, names, calculating, 0),))
    if dice < 0.45:
        return Variable(random.choice(names))
    left: Guard = Variable(random.choice(names))
    right: Guard = Variable(random.choice(names)) if random.random() < 0.3 else Literal(random.choice(LITERALS))
    if calculating and random.random() < 0.3:
        left = Operation(random.choice(STEPS), (left, Literal(random.choice((2, 3, 0.5, -1)))))
        right = Literal(random.choice(LITERALS))
    return Operation(random.choice(COMPARISONS), (left, right) if random.random() < 0.7 else (right, left))


def random_value(random: Random, depth: int) -> Json:
    """Any value, mostly a scalar."""
    dice = random.random()
    if depth and dice < 0.12:
        return [random_value(random, depth - 1) for _ in range(random.randint(0, 3))]
    if depth and dice < 0.3:
        names = random.sample((*FIELDS, "w"), random.randint(0, 3))
        return {name: random_value(random, depth - 1) for name in names}
    return random.choice(VALUES)


def random_event(random: Random, questions: list[Observed]) -> Json:
    """Any event, or one that fits some of the patterns at once; values often repeat."""
    if random.random() < 0.5:
        pool = [random_value(random, 2) for _ in range(2)]
        names = random.sample(FIELDS, random.randint(1, 3))
        return {name: random.choice(pool) if random.random() < 0.35 else random_value(random, 2) for name in names}
    event: Json = {}
    for one in random.sample(questions, random.randint(1, min(3, len(questions)))):
        event = _merged(event, _fitting(random, one.pattern, {}))
    return event


def _fitting(random: Random, pattern: Pattern, chosen: dict[str, Json]) -> Json:
    match pattern:
        case Literal(value):
            return value
        case Variable(name):
            return chosen.setdefault(name, random_value(random, 1))
        case Anything():
            return random_value(random, 1)
        case ObjectPattern(fields):
            return {name: _fitting(random, inner, chosen) for name, inner in fields}
        case ListPattern(items):
            return [_fitting(random, item, chosen) for item in items]


def _merged(one: Json, other: Json) -> Json:
    if isinstance(one, dict) and isinstance(other, dict):
        return {**one, **{name: _merged(one[name], value) if name in one else value for name, value in other.items()}}
    return other
