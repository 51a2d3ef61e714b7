"""The cross-checker finds everybody who has translated another tree, with the reference alone."""

from collections.abc import Callable, Hashable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from importlib.util import find_spec
from itertools import permutations
from typing import Any

import pytest

from cross_check import traces
from cross_check.campaign import Entry, catalogue, in_turn
from cross_check.comparison import Comparison, Enlist
from cross_check.participants import (
    ENGINE,
    REFERENCE,
    Absent,
    Participant,
    engine_of,
    faithful_backends,
    reference_of,
    translated,
)
from cross_check.results import Job, Result, Status
from rvaft import RVAFT, Monitor, Semantics, Verdict
from rvaft.backend import backend
from rvaft.core.restriction import restrict
from rvaft.model.values import Json
from tests.faults.wrong_trees import MISREADINGS, MISTAKES
from tests.tables import rows, sampled

CATALOGUE = tuple(catalogue())
PARTICIPANTS = (ENGINE, *(name for name in faithful_backends() if name != "kql"))
"""KQL needs types, which these trees do not declare; `tests/backends/kql` has its own faults."""
NEEDS_SPOT = [pytest.mark.spot, pytest.mark.skipif(find_spec("spot") is None, reason="needs Spot")]


PRESENT = [pytest.param(name, marks=NEEDS_SPOT if name in ("automaton", "ltlf") else []) for name in PARTICIPANTS]


class Misled(Monitor):
    """A monitor that reads other events than there are."""

    def __init__(self, inner: Monitor, reads: Callable[[Json], Json]) -> None:
        super().__init__()
        self.inner, self.reads = inner, reads

    def fork(self) -> "Misled":
        twin = super().fork()
        twin.inner = self.inner.fork()
        return twin

    @property
    def state(self) -> Hashable:
        return self.inner.state

    def _advance(self, event: Json) -> Verdict:
        return self.inner.step(self.reads(event))


def compared(
    entry: Entry, semantics: Semantics, participant: str, given: RVAFT, meant: Semantics | None = None, **others: Any
) -> Result:
    """What the comparison of a tree says of a participant that was given another one, or another
    semantics, or reads other events.
    """
    job = Job(entry.name, semantics, entry.branch, entry.kind)
    expected = partial(reference_of, entry.tree, semantics, branch=entry.branch, kind=entry.kind)
    make = partial(engine_of, given) if participant == ENGINE else partial(translated, participant, given)

    def enlist() -> Participant | Absent:
        found = make(meant or semantics)
        if isinstance(found, Participant) and others:
            reads = partial(others["misread"], entry.tree)
            return replace(found, start=lambda: Misled(found.start(), reads), observed=None)
        return found

    candidates: list[tuple[str, Enlist]] = [(REFERENCE, expected), (participant, enlist)]
    found = Comparison(entry.tree, job, traces.CATALOGUE).run(candidates)[1]
    # A text that assumes that no event is late does not express the tree.
    return replace(found, status=Status.NOT_EXPRESSIBLE) if "assumes order" in found.why else found


def is_shown(participant: str, wrong: Callable[[RVAFT], RVAFT], **others: Any) -> bool | None:
    """Whether a mistake shows on some tree where the right one does not; None where the language
    can say none of them.
    """
    unseen: list[tuple[Entry, Semantics, RVAFT, RVAFT]] = []
    asking = [entry for entry in CATALOGUE if entry.tree.time or any(node.when for node in entry.tree.top_down())]
    asking.sort(key=lambda entry: entry.tree.time is None)
    for entry in asking if others else CATALOGUE:
        right = restrict(entry.tree, branch=entry.branch, kind=entry.kind)
        given = wrong(right)
        for semantics in Semantics if given != right or others else ():
            result = compared(entry, semantics, participant, given, **others)
            if result.status is Status.DIFFERS:
                truth = compared(entry, semantics, participant, right).status
                assert truth.agrees or truth is Status.NOT_EXPRESSIBLE, "it differs with the right tree too"
                if truth.agrees:
                    return True
            elif result.status is not Status.NOT_EXPRESSIBLE:
                unseen.append((entry, semantics, right, given))
    said = participant == ENGINE or any(
        compared(entry, semantics, participant, right).status is not Status.NOT_EXPRESSIBLE
        and (others or compared(entry, semantics, ENGINE, given).status is Status.DIFFERS)
        for entry, semantics, right, given in unseen
    )
    return False if said else None


UNSAID: Mapping[str, list[str]] = dict(rows(__file__, "unsaid.txt"))
"""The mistakes of a language that can say none of the trees in which they would show."""
NO_DETECTION: frozenset[str] = frozenset(
    {
        "an or of which more may come",
        "exactly K for at least K",
        "`ignore` forgotten",
        "an `ignore` without its guard",
        "the events of one branch alone relevant",
        "an event relevant whatever its guard says",
        "the events of gates not relevant",
    }
)
"""Mistakes about relevance, and about more than is needed: where events are skipped at will, no
detection is another.
"""


NOT_SIGMA: frozenset[str] = frozenset({"two variables taken for one", "`<` for `<=`"})
"""Mistakes in guards, and in variables of some events, which Sigma cannot say; in the other trees
they only rename, or change what is relevant.
"""


def mistakes(participant: str) -> Iterator[str]:
    """The mistakes that a participant can make."""
    skips = participant != ENGINE and backend(participant).semantics == {Semantics.SCATTERED}
    for mistake in MISTAKES:
        same = participant == "sigma" and mistake in NOT_SIGMA
        if not (same or mistake in UNSAID.get(participant, ()) or (skips and mistake in NO_DETECTION)):
            yield mistake


PAIRS = [
    pytest.param(
        *one.values, name, marks=[*one.marks, *([pytest.mark.ci] if (number + place) % (12 if number else 2) else [])]
    )
    for number, one in enumerate(PRESENT)
    for place, name in enumerate(mistakes(str(one.values[0])))
]
"""Each mistake that a participant can make; half of those of the engine, and most others, are left to `.ci/run`."""


@pytest.mark.parametrize(("participant", "mistake"), PAIRS)
def test_a_wrong_tree_shows(participant: str, mistake: str) -> None:
    assert is_shown(participant, MISTAKES[mistake]), "no verdict differs"


@pytest.mark.ci
def test_a_run_without_arguments_finds_the_mistakes_of_the_engine() -> None:
    """Although each tree of the catalogue is compared under one semantics only."""
    pairs = [
        (one, semantics, restrict(one.tree, branch=one.branch, kind=one.kind)) for one, semantics in in_turn(CATALOGUE)
    ]
    for mistake in mistakes(ENGINE):
        given = ((entry, semantics, right, MISTAKES[mistake](right)) for entry, semantics, right in pairs)
        found = (compared(entry, one, ENGINE, wrong).status for entry, one, right, wrong in given if wrong != right)
        assert Status.DIFFERS in found, mistake


@pytest.mark.ci
@pytest.mark.parametrize(
    "participant", [pytest.param(*one.values, marks=one.marks) for one in PRESENT if one.values[0] in UNSAID]
)
def test_of_what_is_not_asked_nothing_can_be_said(participant: str) -> None:
    assert [name for name in UNSAID[participant] if is_shown(participant, MISTAKES[name]) is not None] == []


@pytest.mark.ci
@pytest.mark.parametrize("mistake", sampled(zip(MISREADINGS), 2))
def test_a_wrong_reading_of_events_shows(mistake: str) -> None:
    assert is_shown(ENGINE, lambda tree: tree, misread=MISREADINGS[mistake]), "no verdict differs"


@pytest.mark.parametrize(("right", "wrong"), [*permutations(Semantics, 2)])
def test_another_semantics_shows(right: Semantics, wrong: Semantics) -> None:
    found = (compared(entry, right, ENGINE, entry.tree, wrong).status for entry in CATALOGUE if entry.branch is None)
    assert Status.DIFFERS in found
