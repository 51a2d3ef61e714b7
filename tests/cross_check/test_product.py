"""Proofs: what the product of states shows, on monitors made for the purpose."""

import math
from collections.abc import Hashable
from functools import partial

import pytest

from cross_check.letters import Letters
from cross_check.participants import Participant
from cross_check.product import Exploration
from rvaft import Monitor, TooLarge, Verdict
from rvaft.backend import Observed
from rvaft.model.patterns import ObjectPattern, Variable
from rvaft.model.values import Json, is_finite

A: Json = {"event": "a"}


class Counting(Monitor):
    """⊤ at the n-th `a`, or before any event; ⊥ at the first other event, if `strict`."""

    def __init__(self, needed: int, *, strict: bool = False, fails_at: int | None = None) -> None:
        super().__init__()
        self.left = needed
        self.strict = strict
        self.fails_at = fails_at
        self._verdict = Verdict.UNKNOWN if needed else Verdict.TRUE

    @property
    def state(self) -> Hashable:
        return self.left

    def _advance(self, event: Json) -> Verdict:
        if event != A:
            return Verdict.FALSE if self.strict else Verdict.UNKNOWN
        self.left -= 1
        if self.left == self.fails_at:
            raise TooLarge("states of a test", limit=1)
        return Verdict.TRUE if self.left == 0 else Verdict.UNKNOWN


STRICT = partial(Counting, strict=True)


@pytest.mark.parametrize(
    ("monitors", "limit", "complete", "differ", "failed"),
    [
        ([partial(Counting, 3)] * 2, 100, True, {}, []),
        # a difference is a shortest trace, and each that differs has one of its own
        ([partial(Counting, 3), partial(Counting, 5), partial(Counting, 3)], 100, True, {1: (A, A, A)}, []),
        ([partial(Counting, 2), partial(Counting, 1), partial(STRICT, 2)], 100, True, {1: (A,), 2: ({},)}, []),
        ([partial(Counting, 1), partial(Counting, 0)], 100, True, {1: ()}, []),
        # a limit leaves it open, unless it is just enough
        ([partial(Counting, 50)] * 2, 10, False, {}, []),
        ([partial(Counting, 3)] * 2, 4, True, {}, []),
        ([partial(Counting, 3)] * 2, 3, False, {}, []),
        # who fails is named and the others go on; without the first nothing is compared
        ([partial(Counting, 3), partial(Counting, 3, fails_at=1), partial(Counting, 4)], 100, True, {2: (A,) * 3}, [1]),
        ([partial(Counting, 3, fails_at=2), partial(Counting, 3)], 100, False, {}, [0]),
    ],
)
def test_what_is_shown(
    monitors: list[partial[Counting]], limit: int, complete: bool, differ: dict[int, object], failed: list[int]
) -> None:
    participants = [Participant(str(number), monitor) for number, monitor in enumerate(monitors)]
    found = Exploration(participants, Letters(({}, A), ""), limit=limit)
    assert (found.complete, found.differ, list(found.failed)) == (complete, differ, failed)


def test_who_knows_json_alone_is_not_asked_of_other_numbers() -> None:
    letters = Letters(({}, {"event": math.nan}, A), "")
    other = partial(Counting, 2, strict=True)
    for alone in (False, True):
        participants = [Participant("", partial(Lenient, 2)), Participant("", other, json_alone=alone)]
        found = Exploration(participants, letters, limit=100)
        assert found.complete
        assert found.differ == ({} if alone else {1: ({"event": letters.events[1]["event"]},)})


class Lenient(Counting):
    """The same, but numbers that are not finite are passed over."""

    def _advance(self, event: Json) -> Verdict:
        if event == A or is_finite(event):
            return Verdict.FALSE if event != A else super()._advance(event)
        return Verdict.UNKNOWN


class Remembering(Monitor):
    """⊤ at the second event; the state holds the value of the first, if asked to, and means nothing."""

    def __init__(self, *, remembers: bool) -> None:
        super().__init__()
        self.remembers = remembers
        self.events: list[Json] = []

    @property
    def state(self) -> Hashable:
        return len(self.events), str(self.events[0]) if self.remembers and self.events else ""

    def _advance(self, event: Json) -> Verdict:
        self.events = [*self.events, event]
        return Verdict.TRUE if len(self.events) == 2 else Verdict.UNKNOWN


def test_who_remembers_a_value_may_tie_events_together() -> None:
    letters = Letters(({"v": 1}, {"v": 2}), "", (0, 0))
    asked = (Observed(ObjectPattern((("v", Variable("V")),))),)
    first = Participant("first", lambda: Remembering(remembers=True))
    others = [Participant("", partial(Remembering, remembers=one), observed=asked) for one in (True, False)]
    found = Exploration([first, *others], letters, limit=100)
    assert (found.tied, found.complete, found.differ) == ({1}, True, {})
