"""Letters: one event per combination of answers to some questions (patterns with guards).

Completeness: the patterns that an event matches are those that their least event matches
(`unification`), and all such sets are enumerated (`closed_sets`). Equalities in guards become
patterns. For each set, values are chosen that show every combination of truth values of the guards
(`regions`).
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, combinations, islice
from typing import Final, TypeAlias

from cross_check.letters.regions import Choices, Guarded, GuardFacts, plain
from cross_check.letters.unification import ROOT, Demands, Fresh, closed_sets
from rvaft.backend import Observed
from rvaft.errors import TooLarge
from rvaft.model.guards import holds
from rvaft.model.guards import variables as guard_variables
from rvaft.model.patterns import Literal, Pattern, SomeItem, Variable, substitute, variables, walk
from rvaft.model.values import Json, Scalar, is_number, key

__all__ = ["TIMES", "UNBOUND", "VARIABLES", "Answers", "Letters", "answers", "letters", "ties", "with_twins"]

Answers: TypeAlias = tuple[bool, ...]

VARIABLES: Final = "variables may tie events together"
TIMES: Final = "times tie events together"
UNBOUND: Final = "a guard has a variable that is not in its pattern"
SOME: Final = "a pattern asks for some item of a list"

_SETS: Final = 8
"""Closed sets per letter of the limit: patterns added for guards distinguish more than the
questions.
"""
_SAMPLED: Final = 256


@dataclass(frozen=True, slots=True)
class Letters:
    """Events, starting with `{}`, whose matching patterns match every event.

    `gap` is empty if every event has the answers of one of these; otherwise it is the reason why
    this is unknown. `twins` holds for each event the index of an earlier event with the same
    answers and other values, or its own index.
    """

    events: tuple[Json, ...]
    gap: str
    twins: tuple[int, ...] = ()


def letters(observed: Iterable[Observed], *, limit: int = 4096) -> Letters:
    """Return the letters of some questions; raises `TooLarge` beyond `limit`.

    >>> from rvaft.language.parser import parse_guard, parse_pattern
    >>> letters([Observed(parse_pattern("{v: V}"), parse_guard("V > 3")).untied()]).events
    ({}, {'v': 4})
    """
    every = tuple(dict.fromkeys(observed))
    questions = tuple(question for question in every if not _asks_for_some_item(question))
    if len(questions) < len(every):
        return Letters(letters(questions, limit=limit).events, SOME)
    shared = [question for question in questions if ties(question)]
    found, gap = _complete([question for question in questions if not ties(question)], limit)
    if not shared:
        return Letters(found, gap)
    more = {key(event): event for event in islice(_samples(shared), 64 * _SAMPLED)}
    known = {key(event) for event in found}
    new = [event for name, event in more.items() if name not in known]
    return Letters((*found, *new[: min(_SAMPLED, limit)]), VARIABLES)


def with_twins(observed: Iterable[Observed], *, limit: int = 4096) -> Letters:
    """Return the letters without joins, each followed by a twin with other values where possible.

    A class contains the values with equal truth in every guard; literals of patterns are
    singletons. Participants that use only these questions cannot distinguish traces in which the
    values of a class are permuted. If two values of a class always lead to one state, all its
    values do.
    """
    questions = tuple(dict.fromkeys(observed))
    if not any(map(ties, questions)) or any(map(_asks_for_some_item, questions)):
        return letters(questions, limit=limit)
    own = tuple(dict.fromkeys(map(Observed.untied, questions)))
    guards = [question.when for question in own if question.when is not None]
    if any(len(guard_variables(guard)) > 1 or GuardFacts(guard).calculated for guard in guards):
        return Letters(({},), VARIABLES)
    found, gap = _complete(own, limit)
    literals = [part.value for one in own for part in walk(one.pattern) if isinstance(part, Literal)]
    constants = [one.value for guard in guards for some in GuardFacts(guard).constants.values() for one in some]

    def truths(value: Json) -> list[bool]:
        return [holds(guard, dict.fromkeys(guard_variables(guard), value)) for guard in guards]

    def others(event: Json) -> dict[object, Json]:
        """Return for each value in an event another value of its class, if any."""
        fixed = set(map(key, literals))
        used = fixed | set(map(key, _scalars(event)))
        # these values and those of the event include two of each class with two values
        tried = [near for constant in (*constants, *_scalars(event), "", 0) for near in _near(constant)]
        found: dict[object, Json] = {}
        for value in _scalars(event):
            if key(value) not in fixed and key(value) not in found:
                alike = (near for near in tried if key(near) not in used and truths(near) == truths(value))
                for near in islice(alike, 1):
                    found[key(value)] = near
                    used.add(key(near))
        return found

    events = tuple(chain.from_iterable((event, _exchanged(event, others(event))) for event in found))
    return Letters(events, gap, tuple(number - number % 2 for number, _ in enumerate(events)))


def answers(questions: Iterable[Observed], event: Json) -> Answers:
    """Return the answers of an event to questions without shared variables."""
    return tuple(question.fits(event) for question in questions)


def _asks_for_some_item(question: Observed) -> bool:
    return any(isinstance(part, SomeItem) for part in walk(question.pattern))


def ties(question: Observed) -> bool:
    """Return whether a variable of the question is shared with other events."""
    names = (*variables(question.pattern), *guard_variables(question.when))
    return not all(name.startswith("_") for name in names)


def _complete(questions: Iterable[Observed], limit: int) -> tuple[tuple[Json, ...], str]:
    patterns: dict[Pattern, None] = {}
    guarded: list[Guarded] = []
    kept: list[Observed] = []
    gap = ""
    for question in questions:
        names = guard_variables(question.when)
        if not set(names) <= set(variables(question.pattern)):
            gap = UNBOUND
            continue
        kept.append(question)
        if question.when is not None and names:
            guarded.append(Guarded(question.pattern, question.when, GuardFacts(question.when)))
            patterns.update(dict.fromkeys(guarded[-1].refined()))
        elif question.when is None or holds(question.when, {}):
            patterns[plain(question.pattern)] = None
    every = tuple(patterns)
    apart = any(isinstance(part, Variable) for pattern in every for part in walk(pattern))
    fresh = Fresh((*every, *(one.pattern for one in guarded)), apart=apart)
    choices = Choices(guarded, every, fresh) if guarded else None
    found: dict[Answers | int, Json] = {}
    for closed, least in closed_sets(every, fresh, limit=_SETS * limit):
        for event in (least,) if choices is None else choices.events(closed, least):
            found.setdefault(closed if choices is None else answers(kept, event), event)
            if len(found) > limit:
                raise TooLarge("letters, the combinations of answers that an event can give", limit=limit)
    return tuple(found.values()), next((one.facts.gap for one in guarded if one.facts.gap), gap)


def _near(value: Json) -> Iterator[Json]:
    yield value
    if isinstance(value, str):
        yield from (value + "'", value + "\0", value + "\0\0")
    elif is_number(value):
        yield from (value + 1, value - 1)
        for towards in (math.inf, -math.inf):
            step = math.nextafter(float(value), towards)
            yield from (step, math.nextafter(step, towards))


def _scalars(event: Json) -> Iterator[Scalar]:
    inner = event.values() if isinstance(event, dict) else event if isinstance(event, list) else None
    if inner is None:
        yield event
    else:
        yield from chain.from_iterable(map(_scalars, inner))


def _exchanged(event: Json, by: dict[object, Json]) -> Json:
    if isinstance(event, dict):
        return {name: _exchanged(value, by) for name, value in event.items()}
    return [_exchanged(value, by) for value in event] if isinstance(event, list) else by.get(key(event), event)


def _samples(questions: Sequence[Observed]) -> Iterator[Json]:
    """Yield events that match one or two questions with shared variables; incomplete.

    Each round uses other values.
    """
    tried: list[Scalar] = [1, 2, "a"]
    for guard in (question.when for question in questions if question.when is not None):
        for constant in (one.value for constants in GuardFacts(guard).constants.values() for one in constants):
            tried.append(constant)
            if isinstance(constant, (int, float)) and is_number(constant):
                tried += [constant - 1, constant + 1]
    values = list({key(one): one for one in tried}.values())
    names = list(dict.fromkeys(name for question in questions for name in variables(question.pattern)))
    fresh = Fresh((question.pattern for question in questions), apart=False)
    for rounds in (0, 1):  # equal values for all variables, then different ones
        for first in range(len(values)):
            by: dict[str, Pattern] = {
                name: Literal(values[(first + rounds * number) % len(values)]) for number, name in enumerate(names)
            }
            for some in (*((question,) for question in questions), *combinations(questions, 2)):
                demands = Demands(fresh)
                fits = all(demands.demand(substitute(question.pattern, by)) is not None for question in some)
                built = demands.values({}) if fits else None
                if built is not None:
                    yield built[ROOT]
