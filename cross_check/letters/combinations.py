"""Letters: one event for every combination of answers that an event can give to some questions.

Why none is missing: the patterns that an event matches are those that their least event matches (`least`), and all sets of patterns of
this kind are enumerated (`closed`). For guards, the equalities that they ask about are patterns of their own; then, for each
set, values are chosen that show every combination of truths of the guards (`guarded`, `regions`, `asked`).
A letter is never invented: its answers are those that its event gives.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, islice
from typing import Final, TypeAlias

from cross_check.letters.regions import Choices, Guarded, asked
from cross_check.letters.unification import ROOT, ClosedSets, Demands, Fresh, plain
from rvaft.backend import Observed
from rvaft.errors import TooLarge
from rvaft.model.guards import holds
from rvaft.model.guards import variables as guard_variables
from rvaft.model.patterns import Literal, Pattern, Variable, match, substitute, variables, walk
from rvaft.model.values import Json, Scalar, is_number, key

# Events for questions whose variables tie several events together: a few values for each variable, no completeness.

COMMON: Final[tuple[Scalar, ...]] = (1, 2, "a")


def samples(questions: Sequence[Observed]) -> Iterator[Json]:
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


VARIABLES: Final = "variables tie events together"
UNBOUND: Final = "a guard has a variable that its pattern does not have"

_SETS: Final = 8
"""So many closed sets for each letter allowed: the patterns added for guards tell more apart than the questions do."""
_SAMPLED: Final = 256

Answers: TypeAlias = tuple[bool, ...]


@dataclass(frozen=True, slots=True)
class Letters:
    """Events, `{}` first: whatever it matches, every event matches.

    `gap` is empty where every event there is gives the same answers as one of these; otherwise it says why that is not known.
    """

    events: tuple[Json, ...]
    gap: str


def letters(observed: Iterable[Observed], *, limit: int = 4096) -> Letters:
    """The letters of some questions; raises `TooLarge` for more than `limit` of them."""
    questions = tuple(dict.fromkeys(observed))
    own = [question for question in questions if not _shares(question)]
    found, gap = _complete(own, limit)
    if len(own) == len(questions):
        return Letters(found, gap)
    shared = [question for question in questions if _shares(question)]
    more = {key(event): event for event in islice(samples(shared), 64 * _SAMPLED)}
    known = {key(event) for event in found}
    new = [event for name, event in more.items() if name not in known]
    return Letters((*found, *new[: min(_SAMPLED, limit)]), VARIABLES)


def answers(questions: Iterable[Observed], event: Json) -> Answers:
    """The answers of an event to questions that share no variables with other events."""
    return tuple(_answer(question, event) for question in questions)


def _answer(question: Observed, event: Json) -> bool:
    binding = match(question.pattern, event, {})
    if binding is None or question.when is None:
        return binding is not None
    return set(guard_variables(question.when)) <= binding.keys() and holds(question.when, binding)


def _shares(question: Observed) -> bool:
    """Whether a variable of the question belongs to other events too."""
    names = (*variables(question.pattern), *(() if question.when is None else guard_variables(question.when)))
    return not all(name.startswith("_") for name in names)


def _complete(questions: Iterable[Observed], limit: int) -> tuple[tuple[Json, ...], str]:
    patterns: dict[Pattern, None] = {}
    guarded: list[Guarded] = []
    asked: list[Observed] = []
    gap = ""
    for question in questions:
        if question.when is None:
            patterns[plain(question.pattern)] = None
        elif not set(guard_variables(question.when)) <= set(variables(question.pattern)):
            gap = UNBOUND
            continue
        elif guard_variables(question.when):
            guarded.append(Guarded.of(question.pattern, question.when))
            patterns.update(dict.fromkeys(guarded[-1].refined()))
        elif holds(question.when, {}):
            patterns[plain(question.pattern)] = None
        asked.append(question)
    found = _events(tuple(patterns), guarded, asked, limit)
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
