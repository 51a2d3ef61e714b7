"""The traces of a comparison: words over the letters, and random traces that are led through a scenario and then disturbed."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain, product
from random import Random
from typing import Final, TypeAlias

from cross_check.generate import NoTraceFound, disturbed, guided, with_constant
from cross_check.generate.traces import random_trace
from cross_check.letters import Letters, letters, with_twins
from cross_check.participants import Participant, literals
from cross_check.results import Job
from rvaft.analysis.scenarios import least_events
from rvaft.backend import Observed
from rvaft.errors import TooLarge
from rvaft.model.patterns import Anything
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json

Trace: TypeAlias = Sequence[Json]

SHORTEST: Final = 8
"""Traces are at least so long, unless a length is asked for."""
LONGEST: Final = 500
"""And at most so long."""


@dataclass(frozen=True, slots=True)
class Effort:
    """How hard to look.

    `states` bounds the combinations of states of a proof (0: prove nothing), `words` the events in the enumerated traces,
    `traces` is the number of random ones, `length` their greatest length (None: enough for a detection); with `recheck` what is
    proved runs them too. `seconds` bounds each translation, each proof and each participant's run of the traces.
    """

    states: int = 20_000
    words: int = 2_000
    traces: int = 20
    recheck: bool = True
    length: int | None = None
    seconds: float | None = None
    seed: str = "0"


@dataclass(frozen=True, slots=True)
class Trials:
    """What to try on the part of a tree that is compared, for these participants; the same for the same seed."""

    part: RVAFT
    job: Job
    effort: Effort
    participants: Sequence[Participant]

    def traces(self, *, words: bool) -> Iterator[Trace]:
        """All words up to some length over the letters, if they are wanted, and random traces."""
        if words:
            yield from self._words()
        trees = [self.part, *(participant.tree for participant in self.participants if participant.tree is not None)]
        seed = f"{self.effort.seed} {self.job.title} {self.job.semantics}"
        random = Random(seed.encode(errors="surrogateescape"))  # noqa: S311 (no secret)
        values, constants = self._values(trees)
        for number in range(self.effort.traces):
            tree = trees[number // 4 % len(trees)]
            trace = None if number % 4 == 0 else self._guided(random, tree)
            if trace is None:
                yield random_trace(random, tree, max_length=min(self._longest, SHORTEST))
            elif number % 4 == 1:
                yield trace
            elif number % 4 == 2:
                yield disturbed(random, trace, tree, values)
            else:
                yield with_constant(random, trace, constants) or disturbed(random, trace, tree, values)

    @property
    def _longest(self) -> int:
        return self.effort.length or max(SHORTEST, min(least_events(self.part) + 2, LONGEST))

    def _words(self) -> Iterator[Trace]:
        """All sequences of letters, shorter before longer, as long as there are not too many events in them."""
        try:
            alphabet = letters_of(participant.observed or () for participant in self.participants).events
        except TooLarge:
            return
        length, many, longest = 0, 1, self._longest
        while many * len(alphabet) * (length + 1) <= self.effort.words and length < longest:
            length, many = length + 1, many * len(alphabet)
        for size in range(length + 1 if length else 0):
            yield from product(alphabet, repeat=size)

    def _guided(self, random: Random, tree: RVAFT) -> list[Json] | None:
        """A trace that is led through a scenario, where one is found."""
        try:
            return guided(random, tree, self.job.semantics, longest=self._longest, attempts=5)
        except NoTraceFound:
            return None

    def _values(self, trees: Sequence[RVAFT]) -> tuple[list[Json], list[Json]]:
        """What all participants compare with: everything, and the constants of guards alone."""
        questions = [question for participant in self.participants for question in participant.observed or ()]
        guards = [node.when for tree in trees for node in tree.top_down() if node.when is not None]
        guards += [question.when for question in questions if question.when is not None]
        constants = [value for guard in guards for value in literals(Observed(Anything(), guard))]
        return [v for question in questions for v in literals(Observed(question.pattern))] + constants, constants


def letters_of(observed: Iterable[Iterable[Observed]]) -> Letters:
    """The letters of several participants together, as far as there are any; raises `TooLarge`."""
    return _remembered(frozenset(chain.from_iterable(observed)), proof=False)


def proof_letters(observed: Iterable[Iterable[Observed]]) -> Letters:
    """The letters of several participants together, each with its twin where a variable may tie events together; raises `TooLarge`."""
    return _remembered(frozenset(chain.from_iterable(observed)), proof=True)


@lru_cache(maxsize=16)
def _remembered(questions: frozenset[Observed], *, proof: bool) -> Letters:
    return (with_twins if proof else letters)(sorted(questions, key=repr))
