"""Events for questions whose variables tie several events together: a few values for each variable, no completeness."""

from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import Final

from cross_check.letters.asked import asked
from cross_check.letters.least import ROOT, Demands, Fresh
from rvaft.backend import Observed
from rvaft.guards import variables as guard_variables
from rvaft.patterns import Literal, Pattern, substitute, variables
from rvaft.values import Json, Scalar, is_number, key

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
