"""What monitors cost a mission: runs of the simulation with and without them, timed."""

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
"""A mission is full of events between those of a match: under `strict` and `projected` all is lost with the second one."""
NONE: Final = "none"
SETUPS: Final = (NONE, Per.TREE.value, Per.KIND.value, Per.BRANCH.value)
"""No monitor, and the options (a), (c) and (b) of the paper's section 4.3: one for the tree, for each kind, for each branch."""


@dataclass(frozen=True, slots=True)
class Run:
    """One mission under one setup: how much it had to say, and what it took, in seconds.

    `mission` is simulated time. `made` is the processor's time to make the monitors, `cpu` and `wall` are that of the mission's loop.
    `verdicts` has the sign of each monitor's last verdict. `dearest` is the processor's time that the monitors need for the one event that
    costs them most, in another run through the same mission; `dearest_event` is its number, from 1, and `dearest_on` its topic.
    `detected` is the number of the event at which the first monitor detects something, 0 where none does.
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
    """Every setup on missions of so many waypoints, as often as said.

    Setups take turns, and each turn another one begins, so that what slows the machine down for a while slows all alike. A round before
    the first is thrown away. The collector of cyclic garbage rests meanwhile, as in `timeit`.
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
    """The tree or its parts, one for each monitor."""
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
    for last in mission.events():  # the mission's loop: the simulation says its events, and each monitor reads them
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
    """The part of a `Run` for which the clock is read at every event, which takes time itself."""

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
            name = message.get("name", "")  # a command has one
            dearest, event, topic = took, number, f"{message['topic']} {name}".rstrip()
        if not detected and any(one.verdict is Verdict.TRUE for one in monitors):
            detected = number
    return _Singly(dearest=dearest / 1e9, dearest_event=event, dearest_on=topic, detected=detected)
