"""Letters: one event for every combination of answers that an event can give to some questions.

Why none is missing: the patterns that an event matches are those that their least event matches (`unification`), and all sets of patterns of
this kind are enumerated (`ClosedSets`). For guards, the equalities that they ask about are patterns of their own; then, for each
set, values are chosen that show every combination of truths of the guards (`regions`).
A letter is never invented: its answers are those that its event gives.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, combinations, islice
from typing import Final, TypeAlias

from cross_check.letters.regions import Choices, Guarded, asked
from cross_check.letters.unification import ROOT, ClosedSets, Demands, Fresh, plain
from rvaft.backend import Observed
from rvaft.errors import TooLarge
from rvaft.model.guards import Guard, holds, renamed
from rvaft.model.guards import variables as guard_variables
from rvaft.model.patterns import Literal, Pattern, Variable, match, rigid_variables, substitute, variables, walk
from rvaft.model.values import Json, Scalar, is_number, key

Answers: TypeAlias = tuple[bool, ...]

VARIABLES: Final = "variables tie events together"
UNBOUND: Final = "a guard has a variable that its pattern does not have"
COMMON: Final[tuple[Scalar, ...]] = (1, 2, "a")

_SETS: Final = 8
"""So many closed sets for each letter allowed: the patterns added for guards tell more apart than the questions do."""
_SAMPLED: Final = 256


@dataclass(frozen=True, slots=True)
class Letters:
    """Events, `{}` first: whatever it matches, every event matches.

    `gap` is empty where every event there is gives the same answers as one of these; otherwise it says why that is not known.
    `twins` has, for each event, the number of one before it that gives the same answers with other values, or its own.
    """

    events: tuple[Json, ...]
    gap: str
    twins: tuple[int, ...] = ()


def letters(observed: Iterable[Observed], *, limit: int = 4096) -> Letters:
    """The letters of some questions; raises `TooLarge` for more than `limit` of them.

    >>> from rvaft.language.parser import parse_guard, parse_pattern
    >>> from cross_check.letters import untied
    >>> letters([untied(Observed(parse_pattern("{v: V}"), parse_guard("V > 3")))]).events
    ({}, {'v': 4})
    """
    questions = tuple(dict.fromkeys(observed))
    own = [question for question in questions if not ties(question)]
    found, gap = _complete(own, limit)
    if len(own) == len(questions):
        return Letters(found, gap)
    shared = [question for question in questions if ties(question)]
    more = {key(event): event for event in islice(_samples(shared), 64 * _SAMPLED)}
    known = {key(event) for event in found}
    new = [event for name, event in more.items() if name not in known]
    return Letters((*found, *new[: min(_SAMPLED, limit)]), VARIABLES)


def with_twins(observed: Iterable[Observed], *, limit: int = 4096) -> Letters:
    """The letters as if no variable tied events together, with a twin behind each in which whatever value can be another one is."""
    questions = tuple(dict.fromkeys(observed))
    if not any(map(ties, questions)):
        return letters(questions, limit=limit)
    own = tuple(dict.fromkeys(map(untied, questions)))
    guards = [question.when for question in own if question.when is not None]
    if any(len(guard_variables(guard)) > 1 or asked(guard).calculated for guard in guards):
        return Letters(({},), VARIABLES)
    found, gap = _complete(own, limit)
    literals = [part.value for one in own for part in walk(one.pattern) if isinstance(part, Literal)]
    constants = [one.value for guard in guards for some in asked(guard).constants.values() for one in some]
    tests = list(map(_test, guards))
    events: list[Json] = []
    twins: list[int] = []
    for event in found:
        events += [event, _exchanged(event, _others(event, literals, constants, tests))]
        twins += [len(twins), len(twins)]
    return Letters(tuple(events), gap, tuple(twins))


def answers(questions: Iterable[Observed], event: Json) -> Answers:
    """The answers of an event to questions that share no variables with other events."""
    return tuple(_answer(question, event) for question in questions)


def _answer(question: Observed, event: Json) -> bool:
    binding = match(question.pattern, event, {})
    if binding is None or question.when is None:
        return binding is not None
    return set(guard_variables(question.when)) <= binding.keys() and holds(question.when, binding)


def ties(question: Observed) -> bool:
    """Whether a variable of the question belongs to other events too."""
    names = (*variables(question.pattern), *(() if question.when is None else guard_variables(question.when)))
    return not all(name.startswith("_") for name in names)


def untied(question: Observed, names: Sequence[str] | None = None) -> Observed:
    """The same question with variables of its own, these or all of them: some value each, whatever they are elsewhere."""
    guard = () if question.when is None else guard_variables(question.when)
    every = (*rigid_variables(question.pattern), *guard) if names is None else names
    own = {name: f"_{name}" for name in every if not name.startswith("_")}
    pattern = substitute(question.pattern, {name: Variable(other) for name, other in own.items()})
    return Observed(pattern, None if question.when is None else renamed(question.when, own))


# -- letters that leave nothing out ---------------------------------------------------------------------------------


def _complete(questions: Iterable[Observed], limit: int) -> tuple[tuple[Json, ...], str]:
    patterns: dict[Pattern, None] = {}
    guarded: list[Guarded] = []
    kept: list[Observed] = []
    gap = ""
    for question in questions:
        if question.when is None:
            patterns[plain(question.pattern)] = None
        elif not set(guard_variables(question.when)) <= set(variables(question.pattern)):
            gap = UNBOUND
            continue
        elif guard_variables(question.when):
            guarded.append(Guarded(question.pattern, question.when, asked(question.when)))
            patterns.update(dict.fromkeys(guarded[-1].refined()))
        elif holds(question.when, {}):
            patterns[plain(question.pattern)] = None
        kept.append(question)
    found = _events(tuple(patterns), guarded, kept, limit)
    return found, next((one.asked.gap for one in guarded if one.asked.gap), gap)


def _events(
    patterns: tuple[Pattern, ...], guarded: list[Guarded], questions: list[Observed], limit: int
) -> tuple[Json, ...]:
    apart = any(isinstance(part, Variable) for pattern in patterns for part in walk(pattern))
    fresh = Fresh((*patterns, *(one.pattern for one in guarded)), apart=apart)
    choices = Choices(guarded, patterns, fresh) if guarded else None
    found: dict[Answers | int, Json] = {}
    for closed, least in ClosedSets(patterns, fresh, limit=_SETS * limit):
        for event in (least,) if choices is None else choices.events(closed, least):
            found.setdefault(closed if choices is None else answers(questions, event), event)
            if len(found) > limit:
                raise TooLarge("letters, the combinations of answers that an event can give", limit=limit)
    return tuple(found.values())


# -- twins ----------------------------------------------------------------------------------------------------------
#
# The values of a class are those that every guard judges alike; literals of patterns are alone. Whoever asks nothing but these questions
# cannot tell a trace from one in which the values of a class have changed places. So if after every trace two values of a class lead
# to one state, that state is the same under every such change, and all values of the class lead to it.

Test: TypeAlias = Callable[[Json], bool]


def _test(guard: Guard) -> Test:
    names = guard_variables(guard)
    return lambda value: holds(guard, dict.fromkeys(names, value))


def _others(
    event: Json, literals: Iterable[Json], constants: Iterable[Json], tests: Sequence[Test]
) -> dict[object, Json]:
    """For each value in an event another one of its class, by key, where the class has one."""
    used = {key(value) for value in (*literals, *_scalars(event))}
    fixed = {key(value) for value in literals}
    # of every class that has two values, two are among these and those of the event
    tried = [near for constant in (*constants, *_scalars(event), "", 0) for near in _near(constant)]
    found: dict[object, Json] = {}
    for value in _scalars(event):
        if key(value) in fixed or key(value) in found:
            continue
        truths = [test(value) for test in tests]
        for near in tried:
            if key(near) not in used and [test(near) for test in tests] == truths:
                found[key(value)] = near
                used.add(key(near))
                break
    return found


def _near(value: Json) -> Iterator[Json]:
    """A value and the next ones of its kind."""
    yield value
    if isinstance(value, str):
        yield from (value + "'", value + "\0", value + "\0\0")
    elif is_number(value):
        yield from (value + 1, value - 1)
        for towards in (math.inf, -math.inf):
            step = float(value)
            for _ in range(2):
                step = math.nextafter(step, towards)
                yield step


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


# -- events for questions whose variables tie several events together: a few values for each variable, no completeness -----


def _samples(questions: Sequence[Observed]) -> Iterator[Json]:
    """Events that match one question or two at once; each round gives the variables other values."""
    names = list(dict.fromkeys(name for question in questions for name in variables(question.pattern)))
    fresh = Fresh((question.pattern for question in questions), apart=False)
    together = [*((question,) for question in questions), *combinations(questions, 2)]
    values = _values(questions)
    for rounds in (0, 1):  # all variables alike, then different
        for first in range(len(values)):
            by: dict[str, Pattern] = {
                name: Literal(values[(first + rounds * number) % len(values)]) for number, name in enumerate(names)
            }
            for some in together:
                demands = Demands(fresh)
                fits = all(demands.demand(substitute(question.pattern, by)) is not None for question in some)
                built = demands.values({}) if fits else None
                if built is not None:
                    yield built[ROOT]


def _values(questions: Sequence[Observed]) -> list[Scalar]:
    """The constants of guards with their neighbours, and some more."""
    found: list[Scalar] = [*COMMON]
    for question in questions:
        if question.when is None or not guard_variables(question.when):
            continue
        for constants in asked(question.when).constants.values():
            for constant in (one.value for one in constants):
                found.append(constant)
                if isinstance(constant, (int, float)) and is_number(constant):
                    found += [constant - 1, constant + 1]
    return list({key(one): one for one in found}.values())
