"""Plainer counterexamples: ordinary times and values, and the value that makes the difference."""

import json
from collections import Counter
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from itertools import chain, product
from random import Random
from string import ascii_lowercase
from typing import Final, TypeAlias, cast

from cross_check.generate.times import SECOND, with_time, written
from rvaft.model import guards, patterns
from rvaft.model.assumptions import described, places, used_events
from rvaft.model.nodes import ValueType
from rvaft.model.patterns import Literal, Variable
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json, at, key

Trace: TypeAlias = tuple[Json, ...]
Field: TypeAlias = tuple[str, ...]

_BEGIN: Final = 1_767_225_600 * SECOND
"""The beginning of 2026."""
_ABSENT: Final = cast("Json", object())
_NUMBERS: Final = (ValueType.INTEGER, ValueType.NUMBER)


def plainer(tree: RVAFT, trace: Trace, differs: Callable[[Trace], bool]) -> tuple[Trace, str]:
    """Return a trace of the same length with ordinary times and values on which `differs` holds,
    and what the difference depends on (or an empty text).

    >>> import rvaft
    >>> tree = rvaft.loads("event e(u) = { u: u }; top sand a b; a on e(U); b on e(U);")
    >>> plainer(tree, ({"u": {"k": 1}}, {"u": []}), lambda trace: trace[0] != trace[1])
    (({'u': 'a'}, {'u': 'b'}), 'they agree if u of event 1 is "b" instead of "a"')
    """
    trace = next(filter(differs, _timed(tree, trace)), trace)
    fields, literals, reason = _fields(tree), _literals(tree), ""
    for value in _values(trace, fields).values():
        where = [one for one in product(range(len(trace)), fields) if key(_at(trace, *one)) == key(value)]
        made = _changed(trace, where, _fresh(tree, trace, fields, fields[where[0][1]]))
        if differs(made):
            trace = made
        elif not isinstance(value, str) and key(value) not in literals:
            number, field = where[0]
            reason = f"they agree if {'.'.join(field)} of event {number + 1} is a text instead of {described(value)}"
    return trace, reason or _dependence(tree, trace, fields, differs)


def _dependence(tree: RVAFT, trace: Trace, fields: Mapping[Field, ValueType], differs: Callable[[Trace], bool]) -> str:
    """Return a value of one event that, replaced by that of another event, removes the difference.

    Rare values come first. Values that are literals of the tree do not count.
    """
    literals, values = _literals(tree), {one: _at(trace, *one) for one in product(range(len(trace)), fields)}
    values = {one: value for one, value in values.items() if value is not _ABSENT and key(value) not in literals}
    times = Counter((field, key(value)) for (_, field), value in values.items())
    chosen = sorted(values, key=lambda one: (times[one[1], key(values[one])], one))
    for number, field in chosen:
        own = values[number, field]
        others = {key(value): value for (_, other), value in values.items() if other == field}
        for same, other in others.items():
            if same != key(own) and not differs(_changed(trace, [(number, field)], other)):
                shown = f"{json.dumps(other, ensure_ascii=False)} instead of {json.dumps(own, ensure_ascii=False)}"
                return f"they agree if {'.'.join(field)} of event {number + 1} is {shown}"
    return ""


def _timed(tree: RVAFT, trace: Trace) -> Iterator[Trace]:
    """Yield the trace with an event a second, then with the same differences of times."""
    if tree.time is None:
        return
    time, random = tree.time, Random(0)  # noqa: S311 (no secret)
    known = [time.read(event) for event in trace]
    least = min((one for one in known if one is not None), default=0)
    each: Sequence[int | None] = [_BEGIN + number * SECOND for number in range(len(trace))]
    for instants in (each, [None if one is None else _BEGIN + one - least for one in known]):
        made = [
            event if one is None else with_time(event, time.field, written(random, time.format, one, plain=True))
            for event, one in zip(trace, instants, strict=True)
        ]
        if None not in made:
            yield tuple(made)


def _fields(tree: RVAFT) -> dict[Field, ValueType]:
    """Return the fields of parameters outside of lists, with their types."""
    found: dict[Field, ValueType] = {}
    for event in (tree.events[name] for name in used_events(tree)):
        for path, part, _ in places(event.pattern):
            if isinstance(part, Variable) and all(isinstance(step, str) for step in path):
                field = tuple(map(str, path))
                if tree.time is None or field != tree.time.field:
                    found.setdefault(field, event.type_of(part.name))
    return {field: type_ for field, type_ in found.items() if type_ not in (ValueType.BOOLEAN, ValueType.TIME)}


def _values(trace: Trace, fields: Mapping[Field, ValueType]) -> dict[object, Json]:
    """Return the different values of fields, in the order of events."""
    every = (_at(trace, *one) for one in product(range(len(trace)), fields))
    return {key(value): value for value in every if value is not _ABSENT}


def _fresh(tree: RVAFT, trace: Trace, fields: Mapping[Field, ValueType], type_: ValueType) -> Json:
    """Return a plain value of a type that neither the tree nor the trace has."""
    taken = _literals(tree) | {*_values(trace, fields)}
    plain: Sequence[Json] = range(1, 100) if type_ in _NUMBERS else ascii_lowercase
    return next((one for one in plain if key(one) not in taken), plain[0])


def _literals(tree: RVAFT) -> frozenset[Hashable]:
    """Return the keys of the literals of patterns and guards."""
    terms = chain(
        *(patterns.walk(pattern) for name in tree.occurrences if (pattern := tree.pattern(name)) is not None),
        *(guards.walk(node.when) for node in tree.nodes.values()),
    )
    return frozenset(key(part.value) for part in terms if isinstance(part, Literal))


def _at(trace: Trace, number: int, field: Field) -> Json:
    return at(trace[number], field, _ABSENT)


def _changed(trace: Trace, where: Sequence[tuple[int, Field]], value: Json) -> Trace:
    made = [*trace]
    for number, field in where:
        made[number] = with_time(made[number], field, value)
    return tuple(made)
