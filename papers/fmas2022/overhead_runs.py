"""What monitors cost a mission: runs of the simulation with and without them, timed."""

import gc
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from time import perf_counter, process_time
from typing import Final

from papers.fmas2022.mission import Event, Mission
from rvaft.api import monitor
from rvaft.monitoring.columns import Per, columns, parts
from rvaft.monitors import Monitor
from rvaft.tree import RVAFT
from rvaft.verdict import Semantics, Verdict

SEMANTICS: Final = Semantics.SCATTERED
"""A mission is full of events between those of a match: under `strict` and `projected` all is lost with the second one."""
NONE: Final = "none"
SETUPS: Final = (NONE, Per.TREE.value, Per.KIND.value, Per.BRANCH.value)
"""No monitor, and the options (a), (c) and (b) of the paper's section 4.3: one for the tree, for each kind, for each branch."""


@dataclass(frozen=True, slots=True)
class Run:
    """One mission under one setup: how much it had to say, and what it took, in seconds.

    `mission` is simulated time. `made` is the processor's time to make the monitors, `cpu` and `wall` are that of the mission's loop.
    `verdicts` has the sign of each monitor's last verdict.
    """

    waypoints: int
    setup: str
    repetition: int
    monitors: int
    events: int
    mission: float
    made: float
    cpu: float
    wall: float
    verdicts: str


def runs(tree: RVAFT, waypoints: Sequence[int], repetitions: int, *, seed: int = 1) -> Iterator[Run]:
    """Every setup on missions of so many waypoints, as often as said.

    Setups take turns, and each turn another one begins, so that what slows the machine down for a while slows all alike. A round before
    the first is thrown away. The collector of cyclic garbage rests meanwhile, as in `timeit`.
    """
    watched = {setup: _watched(tree, setup) for setup in SETUPS}
    with _no_collection():
        for repetition in range(repetitions + 1):
            first = repetition % len(SETUPS)
            for number in waypoints:
                for setup in SETUPS[first:] + SETUPS[:first]:
                    run = _run(Mission(number, seed=seed), setup, repetition, watched[setup])
                    if repetition:
                        yield run
            gc.collect()


def _watched(tree: RVAFT, setup: str) -> tuple[RVAFT, ...]:
    """The tree or its parts, one for each monitor."""
    if setup == NONE:
        return ()
    per = Per(setup)
    return tuple(column.part for column in (columns(tree) if per is Per.TREE else parts(tree, per)))


def _run(mission: Mission, setup: str, repetition: int, trees: Sequence[RVAFT]) -> Run:
    start = process_time()
    monitors = [monitor(tree, semantics=SEMANTICS) for tree in trees]
    made = process_time() - start
    wall, cpu = perf_counter(), process_time()
    events, last = _loop(mission.events(), [one.step for one in monitors])
    cpu, wall = process_time() - cpu, perf_counter() - wall
    return Run(
        mission.waypoints, setup, repetition, len(monitors), events, last["time"], made, cpu, wall, _signs(monitors)
    )


def _loop(events: Iterable[Event], steps: Sequence[Callable[[Event], Verdict]]) -> tuple[int, Event]:
    """The mission's loop: let the simulation say its events, and each monitor read them. How many there were, and the last."""
    count = 0
    event: Event = {}
    for event in events:
        count += 1
        for step in steps:
            step(event)
    return count, event


def _signs(monitors: Iterable[Monitor]) -> str:
    return "".join(one.verdict.symbol for one in monitors)


@contextmanager
def _no_collection() -> Iterator[None]:
    was = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was:
            gc.enable()
