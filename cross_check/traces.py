"""The traces of a comparison: words over the letters, and random traces, guided and disturbed."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import chain, product
from random import Random
from typing import Final, TypeAlias

from cross_check.generate.disturbances import disturbed, with_constant
from cross_check.generate.times import walked
from cross_check.generate.traces import WILD, NoTraceFound, Scenarios, guided, random_trace
from cross_check.generate.values import places, put
from cross_check.letters import Letters, letters, with_twins
from cross_check.participants import Participant, literals, times_matter
from cross_check.results import Job
from rvaft.backend import Observed
from rvaft.core.restriction import property_of
from rvaft.core.scenarios import fewest_events
from rvaft.errors import TooLarge
from rvaft.model.patterns import Anything
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json

Trace: TypeAlias = Sequence[Json]

SHORTEST: Final = 8
"""Minimum of the default length of traces."""
LONGEST: Final = 500
"""Maximum of the default length of traces."""
_UNDEFINED: Final = 16
"""One of this many traces contains a non-finite number."""


@dataclass(frozen=True, slots=True)
class Effort:
    """The effort of a comparison.

    - `states`: limit of a proof (0: no proof).
    - `words`: limit of events in enumerated traces.
    - `traces`: number of random traces, and of those with the constants of a text of a person.
    - `length`: their maximum length (None: enough for a detection).
    - `recheck`: run the traces also for proved participants.
    - `seconds`: time limit of each translation, proof and test run; what exceeds it is no agreement.
    - `work`: number of steps of the reference for all traces (None: no limit).
    """

    states: int = 20_000
    words: int = 2_000
    traces: int = 20
    recheck: bool = True
    length: int | None = None
    seconds: float | None = None
    work: int | None = None
    seed: str = "0"


ONE_TREE: Final = Effort(traces=200)
"""For trees given by the user."""
AGAINST: Final = Effort(traces=1_000, seconds=600, work=3_000_000)
"""For specifications by users: finding one missing condition takes many traces."""
CATALOGUE: Final = Effort(words=100, traces=16, recheck=False)
"""For each small tree of the catalogue."""
RANDOM: Final = Effort(states=300, words=0)
"""For each of many random trees; more trees find more than more traces."""


def trials(
    part: RVAFT, job: Job, effort: Effort, participants: Sequence[Participant], *, words: bool
) -> Iterator[Trace]:
    """Yield the test traces of a tree, the same for the same seed.

    With `words`, all words up to some length over the letters come before the random traces.
    """
    prop = property_of(part)
    longest = effort.length or max(SHORTEST, min(fewest_events(prop.parts)[prop.root].events + 2, LONGEST))
    clock = Random(f"{job.title} {job.semantics}".encode(errors="surrogateescape"))  # noqa: S311 (no secret)
    for word in _words(participants, effort.words, longest) if words else ():
        yield walked(clock, part, word) if times_matter(part) else word
    random = Random(f"{effort.seed} {job.title} {job.semantics}".encode(errors="surrogateescape"))  # noqa: S311
    trees = [part, *(participant.tree for participant in participants if participant.tree is not None)]
    questions = [question for participant in participants for question in participant.observed or ()]
    guards = [node.when for tree in trees for node in tree.top_down() if node.when is not None]
    guards += [question.when for question in questions if question.when is not None]
    constants = [value for guard in guards for value in literals(Observed(Anything(), guard))]
    values = [value for question in questions for value in literals(Observed(question.pattern))] + constants
    manner = replace(WILD, longest=longest, attempts=5)
    scenarios = [*map(Scenarios, trees)]
    for number in range(effort.traces):
        tree, known = trees[number // 4 % len(trees)], scenarios[number // 4 % len(trees)]
        try:
            broken = bool(tree.absences) and number % 4 == 2
            trace = None if number % 4 == 0 else guided(random, tree, job.semantics, manner, known, broken=broken)
        except NoTraceFound:
            trace = None
        if trace is None:
            trace = random_trace(random, tree, max_length=min(longest, SHORTEST))
        elif number % 4 != 1:
            edited = None if number % 4 == 2 else with_constant(random, trace, constants)
            trace = trace if broken else edited or disturbed(random, trace, tree, values)
        yield _undefined(clock, trace) if number % _UNDEFINED == _UNDEFINED - 1 else trace


def _undefined(random: Random, trace: Sequence[Json]) -> Trace:
    inside = [path for path, value in places(list(trace)) if len(path) > 1 and not isinstance(value, (dict, list))]
    return put(list(trace), random.choice(inside), math.nan) if inside else trace


def _words(participants: Iterable[Participant], events: int, longest: int) -> Iterator[Trace]:
    try:
        alphabet = letters_of(participant.observed or () for participant in participants).events
    except TooLarge:
        return
    length, many = 0, 1
    while many * len(alphabet) * (length + 1) <= events and length < longest:
        length, many = length + 1, many * len(alphabet)
    for size in range(length + 1 if length else 0):
        yield from product(alphabet, repeat=size)


def letters_of(observed: Iterable[Iterable[Observed]], *, proof: bool = False) -> Letters:
    """Return the letters of several participants, with twins for a `proof`; raises `TooLarge`."""
    found = _remembered(frozenset(chain.from_iterable(observed)), proof=proof)
    if isinstance(found, TooLarge):  # raised anew, as an error that is kept would keep its callers' frames
        raise TooLarge(found.what, limit=found.limit)
    return found


@lru_cache(maxsize=16)
def _remembered(questions: frozenset[Observed], *, proof: bool) -> Letters | TooLarge:
    try:
        return (with_twins if proof else letters)(sorted(questions, key=repr))
    except TooLarge as error:
        return error.with_traceback(None)
