"""Rules about declared types: guards and arguments that no value of the type satisfies."""

from collections.abc import Iterator, Mapping
from itertools import combinations
from typing import Final

from rvaft.core.feasibility import ScenarioSpace
from rvaft.model.assumptions import arguments, has_type, sort_of, variable_types
from rvaft.model.expressions import guard_text
from rvaft.model.guards import (
    COMPARISONS,
    OPERATORS,
    Duration,
    Guard,
    Operation,
    Operator,
    TermSort,
    TimePoint,
    variables,
    walk,
)
from rvaft.model.nodes import Assumption, ValueType
from rvaft.model.patterns import Literal, Variable
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.rules.rule import RuleReport

_NOUNS: Final[Mapping[TermSort, str]] = {
    TermSort.NUMBER: "a number",
    TermSort.TEXT: "a text",
    TermSort.TRUTH: "true or false",
}
"""The sorts that a declared type or a literal fixes."""


def type_mismatch(space: ScenarioSpace) -> Iterator[RuleReport]:
    """No guard and no argument requires a value of another type than declared."""
    tree = space.tree
    types = variable_types(tree)
    known = {name: {sort_of(type_) for type_ in found} for name, found in types.items()}
    for name, found in types.items():
        for (one, first), (other, second) in combinations(found.items(), 2):
            if {sort_of(one), sort_of(other)} <= _NOUNS.keys() and sort_of(one) is not sort_of(other):
                message = f"{name} is of type {one} in {first} and of type {other} in {second}: no value is both"
                yield RuleReport(tree.nodes[second].place("on"), message, (first, second))
    for node in tree.top_down():
        for argument, type_ in arguments(tree, node.on) if node.on is not None else ():
            if isinstance(argument, Literal) and not _possible(argument.value, type_, tree):
                message = f"{guard_text(argument)} in the event of {node.name} is not of the declared type {type_}"
                yield RuleReport(node.place("on"), message, (node.name,))
        for message in _mismatches(node.when, known):
            yield RuleReport(node.place("when"), f"in the guard of {node.name}, {message}", (node.name,))
    for ignore in tree.ignores:
        local = {one.name: {sort_of(type_)} for one, type_ in arguments(tree, ignore.on) if isinstance(one, Variable)}
        for message in _mismatches(ignore.when, local):
            yield RuleReport(ignore.place, f"in the guard of an `ignore`, {message}")


def _possible(value: Json, type_: ValueType, tree: RVAFT) -> bool:
    return value is None or has_type(value, type_, tree.time)


def _mismatches(guard: Guard | None, known: Mapping[str, set[TermSort]]) -> Iterator[str]:
    """Yield the parts of a guard that are false or undefined for all values of the known sorts."""
    for part in walk(guard):
        if not isinstance(part, Operation):
            continue
        facts = OPERATORS[part.operator]
        sorts = [_sort(operand, known) for operand in part.operands]
        for operand, sort in zip(part.operands, sorts, strict=True):
            if facts.takes is not None and sort in _NOUNS and sort not in facts.takes and variables(operand):
                wanted = " or ".join(noun for sort, noun in _NOUNS.items() if sort in facts.takes)
                yield f"{guard_text(operand)} is {_NOUNS[sort]}, but `{facts.sign.strip()}` takes {wanted}"
        if part.operator in COMPARISONS or part.operator is Operator.IN:
            first, *others = zip(part.operands, sorts, strict=True)
            for operand, sort in others:
                fixed = first[1] in _NOUNS and sort in _NOUNS and first[1] is not sort
                if fixed and (variables(first[0]) or variables(operand)):
                    one, other = guard_text(first[0]), guard_text(operand)
                    yield f"{one} is {_NOUNS[first[1]]} and {other} is {_NOUNS[sort]}, so they do not compare"


def _sort(term: Guard, known: Mapping[str, set[TermSort]]) -> TermSort:
    """Return the only possible sort of a term, or UNKNOWN."""
    match term:
        case Duration() | TimePoint():
            return TermSort.UNKNOWN
        case Literal(bool()):
            return TermSort.TRUTH
        case Literal(str()):
            return TermSort.TEXT
        case Literal(int() | float()):
            return TermSort.NUMBER
        case Literal():
            return TermSort.NULL
        case Variable(name):
            sorts = known.get(name, set())
            return next(iter(sorts)) if len(sorts) == 1 else TermSort.UNKNOWN
        case Operation(operator):
            return OPERATORS[operator].gives


def unused_type(space: ScenarioSpace) -> Iterator[RuleReport]:
    """Declared types come with `assume types`, and the reverse."""
    tree = space.tree
    typed = [event for event in tree.events.values() if event.types]
    if typed and Assumption.TYPES not in tree.assumes:
        message = f"the types of event {typed[0].name} have no effect: add `assume types;`"
        yield RuleReport(typed[0].place, message)
    elif not typed and Assumption.TYPES in tree.assumes:
        root = tree.nodes[tree.root]
        yield RuleReport(root.place(), "`assume types;` has no effect: no event type declares a type", (root.name,))
