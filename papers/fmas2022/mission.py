"""A simulated remote inspection mission: the messages on the rover's topics.

Messages have the fields of the published log of the case study
(rafaelcaue/rvaft-remote-inspection), with two exceptions from Tables 2 and 3 of the paper: a
command has a `waypoint`, and `goal` is the waypoint sent to the planner, with its pose in
`target_pose`. Results of the planner are added, because the tree uses them.

The simulation is event-driven and does not wait. The last waypoint is contaminated; the mode
selects what happens there. The mission ends when the rover arrives at its next destination: a
`scattered` monitor joins events at any distance, and would match the departure after
decontamination too.

Run `python -m papers.fmas2022.mission --mode attack | rvaft monitor
trees/remote_inspection/pruned.rvaft --semantics scattered`.
"""

import json
import sys
from argparse import ArgumentParser
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from math import hypot
from random import Random
from typing import Final

from papers.fmas2022.command import ended
from rvaft.errors import OptionError
from rvaft.model.values import Json

ENTRANCE: Final = "entrance"
"""The start and the place of decontamination, as named in the tree."""
SPEED: Final = 0.5
"""Metres per second, as in the published log."""
PERIOD: Final = 1.0
"""Seconds between two readings of the radiation sensor."""
_LATENCY: Final = 0.002
_SIDE: Final = 20.0
"""Metres of the square hall; the entrance is in the middle of its southern wall."""
_BACKGROUND: Final = range(4, 11)
_CONTAMINATED: Final = range(257, 400)
"""Radiation in the units of the case study's sensor; the tree regards 250 and more as high."""


class Mode(StrEnum):
    """The events at the contaminated waypoint.

    - `nominal`: the first high reading sends the rover to the entrance.
    - `fault`: the inspection hangs, and the rover continues only after more than 10 s.
    - `attack`: an attacker hides the alarm from the agent, which sends the rover on in time, and
      alters the goal on its way to the planner.
    """

    NOMINAL = "nominal"
    FAULT = "fault"
    ATTACK = "attack"


Event = dict[str, Json]
Place = int | str
"""The number of a waypoint, from 0, or the entrance."""
Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Mission:
    """A mission of at least two waypoints (else `OptionError`); equal ones have equal events."""

    waypoints: int
    mode: Mode = Mode.NOMINAL
    seed: int = 1

    def __post_init__(self) -> None:
        if self.waypoints < 2:
            raise OptionError(
                f"a mission has 2 waypoints or more, not {self.waypoints}: an altered goal is another one"
            )

    def events(self) -> Iterator[Event]:
        """Yield the messages in time order."""
        return _Simulation(self).run()


class _Simulation:
    """The state of rover, agent, planner and attacker; `now` is in seconds."""

    def __init__(self, mission: Mission) -> None:
        self.random = Random(mission.seed)  # noqa: S311 (no secret)
        self.mode = mission.mode
        self.last = mission.waypoints - 1
        self.places: dict[Place, Point] = {ENTRANCE: (0.0, -_SIDE / 2)}
        for number in range(mission.waypoints):
            self.places[number] = (self._between(-_SIDE / 2, _SIDE / 2), self._between(-_SIDE / 2, _SIDE / 2))
        self.now = 10.0
        self.inspecting: Place | None = None
        self._readings = 10
        self._goals = 0
        self._start: Point = self.places[ENTRANCE]
        self._departure = self.now
        self._velocity: Point = (0.0, 0.0)

    def run(self) -> Iterator[Event]:
        for number in range(self.last):
            yield from self._travel(number)
            yield from self._inspect(number, self._between(3.0, 4.0))
        yield from self._travel(self.last)
        match self.mode:
            case Mode.NOMINAL:
                yield from self._alarmed(self.last)
                yield from self._travel(ENTRANCE)
            case Mode.FAULT:
                yield from self._inspect(self.last, self._between(12.0, 15.0))
                yield from self._travel(0)
            case Mode.ATTACK:
                yield from self._inspect(self.last, self._between(3.0, 4.0))
                yield from self._travel(0, altered=1 + self.random.randrange(self.last))

    # Actions of the rover.

    def _travel(self, target: Place, altered: Place | None = None) -> Iterator[Event]:
        """Yield the agent's command, the goal for the planner, readings on the way, and the
        planner's result.
        """
        yield self._command("move", target)
        yield from self._wait(self._between(0.2, 0.6))
        there = target if altered is None else altered
        yield self._goal(there)
        x, y = self.places[there]
        dx, dy = x - self._start[0], y - self._start[1]
        seconds = hypot(dx, dy) / SPEED
        if seconds:
            self._departure, self._velocity = self.now, (dx / seconds, dy / seconds)
        yield from self._wait(seconds)
        self._start, self._velocity = (x, y), (0.0, 0.0)
        yield self._result(there)
        yield from self._wait(self._between(0.2, 0.6))

    def _inspect(self, number: int, seconds: float) -> Iterator[Event]:
        self.inspecting = number
        yield self._command("inspect", number)
        yield from self._wait(seconds)
        self.inspecting = None
        yield {"topic": "inspected", "location": number, "time": self._time, "data": True}
        yield from self._wait(self._between(0.5, 1.0))

    def _alarmed(self, number: int) -> Iterator[Event]:
        self.inspecting = number
        yield self._command("inspect", number)
        yield from self._wait(PERIOD)
        self.inspecting = None

    def _wait(self, seconds: float) -> Iterator[Event]:
        """Advance the time; yield sensor readings."""
        end = self.now + seconds
        while (due := self._readings * PERIOD + _LATENCY) <= end:
            self.now = due
            self._readings += 1
            yield self._radiation()
        self.now = end

    # Messages.

    def _command(self, name: str, place: Place) -> Event:
        return {"topic": "/command", "name": name, "waypoint": place, "time": self._time}

    def _goal(self, place: Place) -> Event:
        self._goals += 1
        x, y = self.places[place]
        return {
            "goal": place,
            "target_pose": {"header": self._header("map", 0), "pose": _pose(x, y)},
            "topic": "/move_base/goal",
            "header": self._header("", self._goals),
            "goal_id": {"stamp": self._stamp, "id": f"/movebase_client_py-{self._goals}-{self.now:.3f}"},
            "time": self._time,
        }

    def _result(self, place: Place) -> Event:
        return {
            "topic": "/move_base/result",
            "header": self._header("", self._goals),
            "status": {"status": 3, "text": "Goal reached."},
            "waypoint": place,
            "result": "success",
            "time": self._time,
        }

    def _radiation(self) -> Event:
        """Return a reading; the directed sensor sees a waypoint's radiation only while the rover
        inspects it.
        """
        levels = _CONTAMINATED if self.inspecting == self.last else _BACKGROUND
        moved = self.now - self._departure
        return {
            "pose": _pose(self._start[0] + moved * self._velocity[0], self._start[1] + moved * self._velocity[1]),
            "value": float(self.random.choice(levels)),
            "topic": "/radiation_sensor_plugin/sensor_0",
            "header": self._header("sim_sensor", self._readings),
            "time": self._time,
            "type": "",
        }

    def _header(self, frame: str, number: int) -> Event:
        return {"stamp": self._stamp, "frame_id": frame, "seq": number}

    @property
    def _stamp(self) -> Event:
        return {"secs": int(self.now), "nsecs": int(self.now % 1 * 1000) * 1_000_000}

    @property
    def _time(self) -> float:
        return round(self.now, 3)

    def _between(self, low: float, high: float) -> float:
        return low + (high - low) * self.random.random()


def _pose(x: float, y: float) -> Event:
    return {
        "position": {"x": x, "y": y, "z": 0.0},
        "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the messages of a mission as JSON Lines; return 2 on an error."""
    parser = ArgumentParser(prog="python -m papers.fmas2022.mission", description="a simulated remote inspection")
    parser.add_argument("--waypoints", type=int, default=5, metavar="N", help="how many, 2 or more (default 5)")
    parser.add_argument("--mode", type=Mode, default=Mode.NOMINAL, help=" or ".join(Mode))
    parser.add_argument("--seed", type=int, default=1, help="another one is another mission (default 1)")
    options = parser.parse_args(arguments)

    def write_messages() -> None:
        for event in Mission(options.waypoints, options.mode, options.seed).events():
            sys.stdout.write(f"{json.dumps(event)}\n")

    return ended("mission", write_messages)


if __name__ == "__main__":
    sys.exit(main())
