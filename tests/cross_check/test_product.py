"""Proofs: what the product of states shows, on monitors made for the purpose."""

from collections.abc import Hashable
from functools import partial

import pytest

from cross_check.letters import Letters
from cross_check.participants import Participant
from cross_check.product import Exploration
from rvaft.backend import Observed
from rvaft.errors import TooLarge
from rvaft.model.patterns import ObjectPattern, Variable
from rvaft.model.values import Json
from rvaft.model.verdict import Verdict
from rvaft.monitors import Monitor

LETTERS: tuple[Json, ...] = ({}, {"event": "a"})


class Counting(Monitor):
    """⊤ at the n-th `a`; ⊥ at the first other event, if `strict`."""

    def __init__(self, needed: int, *, strict: bool = False, fails_at: int | None = None) -> None:
        super().__init__()
        self.left = needed
        self.strict = strict
        self.fails_at = fails_at

    @property
    def state(self) -> Hashable:
        return self.left

    def _advance(self, event: Json) -> Verdict:
        if event != LETTERS[1]:
            return Verdict.FALSE if self.strict else Verdict.UNKNOWN
        self.left -= 1
        if self.left == self.fails_at:
            raise TooLarge("states of a test", limit=1)
        return Verdict.TRUE if self.left == 0 else Verdict.UNKNOWN


def counting(name: str, needed: int, *, strict: bool = False, fails_at: int | None = None) -> Participant:
    return Participant(name, lambda: Counting(needed, strict=strict, fails_at=fails_at))


def test_equal_monitors_are_proved_equal() -> None:
    found = Exploration([counting("one", 3), counting("two", 3)], Letters(LETTERS, ""), limit=100)
    assert (found.complete, found.differ, found.failed) == (True, {}, {})
    assert found.verdicts == 8


def test_a_difference_is_a_shortest_trace() -> None:
    found = Exploration([counting("one", 3), counting("two", 5), counting("three", 3)], Letters(LETTERS, ""), limit=100)
    assert found.differ == {1: ({"event": "a"},) * 3}
    assert found.complete


def test_each_that_differs_has_a_trace_of_its_own() -> None:
    found = Exploration(
        [counting("one", 2), counting("two", 1), counting("three", 2, strict=True)], Letters(LETTERS, ""), limit=100
    )
    assert found.differ == {1: ({"event": "a"},), 2: ({},)}


def test_a_limit_leaves_it_open() -> None:
    found = Exploration([counting("one", 50), counting("two", 50)], Letters(LETTERS, ""), limit=10)
    assert not found.complete
    assert found.differ == {}


def test_a_limit_that_is_just_enough() -> None:
    assert Exploration([counting("one", 3), counting("two", 3)], Letters(LETTERS, ""), limit=4).complete
    assert not Exploration([counting("one", 3), counting("two", 3)], Letters(LETTERS, ""), limit=3).complete


def test_who_fails_is_named_and_the_others_go_on() -> None:
    found = Exploration(
        [counting("one", 3), counting("two", 3, fails_at=1), counting("three", 4)], Letters(LETTERS, ""), limit=100
    )
    assert list(found.failed) == [1]
    assert found.differ == {2: ({"event": "a"},) * 3}


@pytest.mark.parametrize("first", [counting("one", 3, fails_at=2)])
def test_without_the_first_nothing_is_compared(first: Participant) -> None:
    found = Exploration([first, counting("two", 1)], Letters(LETTERS, ""), limit=100)
    assert list(found.failed) == [0]
    assert not found.complete


def test_a_difference_before_any_event() -> None:
    class Done(Counting):
        def __init__(self) -> None:
            super().__init__(1)
            self._verdict = Verdict.TRUE

    found = Exploration([counting("one", 1), Participant("done", Done)], Letters(LETTERS, ""), limit=100)
    assert found.differ == {1: ()}


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
