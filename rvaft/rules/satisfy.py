"""A search for values under which guards hold: around their constants, and around the values already chosen.

What is found is a witness, checked with the guards' own evaluation. Finding none proves nothing.
"""

from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from typing import Final

from rvaft.guards import UNDEFINED, Guard, Operation, Operator, holds, value, variables
from rvaft.patterns import Literal, Variable
from rvaft.rules.literals import COMPARISONS
from rvaft.values import Json, is_number, key

DEFAULT_TRIES: Final = 4_000


def witness(guards: Iterable[Guard], tries: int = DEFAULT_TRIES) -> dict[str, Json] | None:
    """Values under which all guards hold, or None where none were found in so many evaluations (and 20 more for each guard)."""
    todo = list(dict.fromkeys(guards))
    tries += 20 * len(todo)
    names = _order(todo)
    # Each guard is looked at as soon as the last of its variables has a value.
    rank = {name: index for index, name in enumerate(names)}
    due: list[list[Guard]] = [[] for _ in names]
    touching: list[list[Guard]] = [[] for _ in names]
    for guard in todo:
        own = variables(guard)
        if not own:
            if not holds(guard, {}):
                return None
            continue
        due[max(rank[name] for name in own)].append(guard)
        for name in own:
            touching[rank[name]].append(guard)
    constants = _constants(todo)
    binding: dict[str, Json] = {}
    levels: list[Iterator[Json]] = []
    while len(binding) < len(names) or len(levels) < len(names):
        if len(levels) == len(binding):
            levels.append(_candidates(constants, touching[len(levels)], binding))
        name = names[len(levels) - 1]
        for candidate in levels[-1]:
            binding[name] = candidate
            failing = _failing(due[len(levels) - 1], binding)
            if failing is None:
                break
            # What refuses one value most likely refuses the next one too: ask it first.
            due[len(levels) - 1].insert(0, due[len(levels) - 1].pop(failing))
            tries -= failing + 1
            del binding[name]
            if tries < 0:
                return None
        else:
            levels.pop()
            if not levels:
                return None
            del binding[names[len(levels) - 1]]
    return binding


def _failing(guards: list[Guard], binding: dict[str, Json]) -> int | None:
    return next((index for index, guard in enumerate(guards) if not holds(guard, binding)), None)


def _order(guards: Sequence[Guard]) -> list[str]:
    return list(dict.fromkeys(name for guard in guards for name in variables(guard)))


def _constants(guards: Iterable[Guard]) -> list[Json]:
    found: dict[object, Json] = {}
    for guard in guards:
        for part in _parts(guard):
            if isinstance(part, Literal):
                found.setdefault(key(part.value), part.value)
    return list(found.values())


def _parts(guard: Guard) -> Iterator[Guard]:
    todo = [guard]
    while todo:
        part = todo.pop()
        yield part
        if isinstance(part, Operation):
            todo.extend(part.operands)


def _candidates(constants: list[Json], guards: list[Guard], binding: dict[str, Json]) -> Iterator[Json]:
    """Values for one variable, those most likely to do first."""
    seen: set[object] = set()
    for candidate in _in_turn([*_sides(guards, binding), *constants]):
        known = key(candidate)
        if known not in seen:
            seen.add(known)
            yield candidate


def _in_turn(near: list[Json]) -> Iterator[Json]:
    for value_ in near[:4]:
        yield value_
        if is_number(value_):
            yield value_ + 1
            yield value_ - 1
    numbers = sorted({v for v in near if is_number(v) and abs(v) < 1e15} | {0})
    strings = sorted({v for v in near if isinstance(v, str)} | {""})
    yield from (numbers[-1] + 1, numbers[0] - 1)
    yield from near
    yield from _around(numbers)
    yield from _between(strings)
    yield from (True, False, None, [])


def _sides(guards: list[Guard], binding: dict[str, Json]) -> list[Json]:
    """What the variable is compared with, and what solves a sum or difference for it, as far as that has a value now."""
    found: list[Json] = []
    for guard in guards:
        for part in _parts(guard):
            if isinstance(part, Operation) and part.operator in COMPARISONS:
                left, right = (_known(side, binding) for side in part.operands)
                found += [v for v in (left, right) if v is not UNDEFINED]
                for side, goal in ((part.operands[0], right), (part.operands[1], left)):
                    if goal is not UNDEFINED and is_number(goal):
                        found += _solved(side, goal, binding)
    return found


def _solved(side: Guard, goal: Json, binding: dict[str, Json]) -> list[Json]:
    """Values for the unknown operand of an arithmetic operation so that it equals the goal."""
    if not (isinstance(side, Operation) and len(side.operands) == 2):
        return []
    left, right = (_known(operand, binding) for operand in side.operands)
    goal_, left_, right_ = Literal(goal), Literal(left), Literal(right)
    ways: dict[Operator, list[tuple[Operator, Guard, Guard]]] = {}
    if right is not UNDEFINED:
        ways = {
            Operator.ADD: [(Operator.SUB, goal_, right_)],
            Operator.SUB: [(Operator.ADD, goal_, right_)],
            Operator.MUL: [(Operator.DIV, goal_, right_)],
            Operator.DIV: [(Operator.MUL, goal_, right_)],
        }
    elif left is not UNDEFINED:
        ways = {
            Operator.ADD: [(Operator.SUB, goal_, left_)],
            Operator.SUB: [(Operator.SUB, left_, goal_)],
            Operator.MUL: [(Operator.DIV, goal_, left_)],
            Operator.DIV: [(Operator.DIV, left_, goal_)],
        }
    answers = (value(Operation(operator, (a, b)), {}) for operator, a, b in ways.get(side.operator, []))
    return [answer for answer in answers if answer is not UNDEFINED]


def _known(guard: Guard, binding: dict[str, Json]) -> Json:
    if isinstance(guard, Variable):
        return binding.get(guard.name, UNDEFINED)
    return value(guard, binding) if all(name in binding for name in variables(guard)) else UNDEFINED


def _around(numbers: list[Json]) -> Iterator[Json]:
    for number in numbers:
        yield number + 1
        yield number - 1
    for low, high in pairwise(numbers):
        yield (low + high) / 2
    yield 10 * numbers[-1] + 10
    yield 10 * numbers[0] - 10


def _between(strings: list[str]) -> Iterator[Json]:
    yield from strings
    for string in strings:
        yield string + "\0"
        yield string + "~"
    yield strings[-1] + "\U0010ffff"
