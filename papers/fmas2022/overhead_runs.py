"""Timed runs of the simulation with and without monitors."""

import gc
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from time import perf_counter, process_time, process_time_ns
from typing import Final, TypedDict

from papers.fmas2022.mission import Event, Mission, Mode
from papers.languages.measurement import no_collection
from rvaft.api import monitor
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import Monitor
from rvaft.stream.monitor_set import Per, columns

SEMANTICS: Final = Semantics.SCATTERED
"""A mission has many events between those of a match; `strict` and `projected` fail at the second
event.
"""
NONE: Final = "none"
SETUPS: Final = (NONE, Per.TREE.value, Per.KIND.value, Per.BRANCH.value)
"""No monitor, and the options (a), (c) and (b) of section 4.3 of the paper: one for the tree, per
kind, per branch.
"""


@dataclass(frozen=True, slots=True)
class Run:
    """One mission under one setup; times in seconds.

    - `mission`: simulated time.
    - `made`: CPU time to create the monitors.
    - `cpu`, `wall`: times of the mission's loop.
    - `verdicts`: the last verdict of each monitor.
    - `dearest`: the CPU time of monitors for the slowest event, measured in another run;
      `dearest_event` is its number, from 1, and `dearest_on` its topic.
    - `detected`: the number of the first detecting event, or 0.
    """

    mode: Mode
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
    dearest: float
    dearest_event: int
    dearest_on: str
    detected: int


def runs(
    tree: RVAFT, waypoints: Sequence[int], repetitions: int, *, mode: Mode = Mode.NOMINAL, seed: int = 1
) -> Iterator[Run]:
    """Yield runs of every setup on missions of these sizes, repeated.

    Setups alternate with a rotating start, so that machine slowdowns affect all alike. A first
    round is discarded. The garbage collector is off, as in `timeit`.
    """
    watched = {setup: _watched(tree, setup) for setup in SETUPS}
    with no_collection():
        for repetition in range(repetitions + 1):
            first = repetition % len(SETUPS)
            for number in waypoints:
                for setup in SETUPS[first:] + SETUPS[:first]:
                    run = _run(Mission(number, mode, seed), setup, repetition, watched[setup])
                    if repetition:
                        yield run
            gc.collect()


def _watched(tree: RVAFT, setup: str) -> tuple[RVAFT, ...]:
    if setup == NONE:
        return ()
    per = Per(setup)
    return tuple(column.part for column in (columns(tree, per) if per is Per.TREE else columns(tree, per)[1:]))


def _run(mission: Mission, setup: str, repetition: int, trees: Sequence[RVAFT]) -> Run:
    start = process_time()
    monitors = _monitors(trees)
    made = process_time() - start
    steps, events, last = [one.step for one in monitors], 0, Event()
    wall, cpu = perf_counter(), process_time()
    for last in mission.events():  # the mission's loop: the simulation yields events, and each monitor reads them
        events += 1
        for step in steps:
            step(last)
    cpu, wall = process_time() - cpu, perf_counter() - wall
    return Run(
        mode=mission.mode,
        waypoints=mission.waypoints,
        setup=setup,
        repetition=repetition,
        monitors=len(monitors),
        events=events,
        mission=last["time"],
        made=made,
        cpu=cpu,
        wall=wall,
        verdicts="".join(one.verdict.symbol for one in monitors),
        **_singly(mission.events(), _monitors(trees)),
    )


def _monitors(trees: Iterable[RVAFT]) -> list[Monitor]:
    return [monitor(tree, semantics=SEMANTICS) for tree in trees]


class _Singly(TypedDict):
    """The fields of a `Run` that need the clock at every event, which takes time itself."""

    dearest: float
    dearest_event: int
    dearest_on: str
    detected: int


def _singly(events: Iterable[Event], monitors: Sequence[Monitor]) -> _Singly:
    dearest, event, topic, detected = 0, 0, "", 0
    for number, message in enumerate(events, 1):
        start = process_time_ns()
        for one in monitors:
            one.step(message)
        took = process_time_ns() - start
        if monitors and took > dearest:
            name = message.get("name", "")  # only commands have a name
            dearest, event, topic = took, number, f"{message['topic']} {name}".rstrip()
        if not detected and any(one.verdict is Verdict.TRUE for one in monitors):
            detected = number
    return _Singly(dearest=dearest / 1e9, dearest_event=event, dearest_on=topic, detected=detected)
