"""A remote inspection mission, simulated: what the rover's topics carry while it goes from waypoint to waypoint.

The messages have the fields that the published log of the case study has
(rafaelcaue/rvaft-remote-inspection), with the two that the tree speaks of named as in the paper's
Tables 2 and 3: a command has a `waypoint`, and `goal` is the waypoint that the planner is sent to,
its pose being in `target_pose`. The planner's results, to which the tree listens too, are added.

The simulation goes from event to event; nothing waits for a clock. The last waypoint is
contaminated, and what happens there is the mode. The mission ends when the rover arrives where it
was sent from there: a `scattered` monitor puts events together across any distance, so that it
would hold the next departure, after decontamination, against the rover as well.

Run as `python -m papers.fmas2022.mission --mode attack | rvaft monitor
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
"""Where the rover starts and is decontaminated; the tree knows it by this name."""
SPEED: Final = 0.5
"""Metres per second, about what the rover of the published log makes."""
PERIOD: Final = 1.0
"""Seconds between two readings of the radiation sensor."""
_LATENCY: Final = 0.002
"""Seconds from a reading to its message."""
_SIDE: Final = 20.0
"""Metres of the square hall; the entrance is in the middle of its southern wall."""
_BACKGROUND: Final = range(4, 11)
_CONTAMINATED: Final = range(257, 400)
"""Units of radiation, as the sensor of the case study counts them; from 250 on the tree calls them high."""


class Mode(StrEnum):
    """What happens at the contaminated waypoint.

    `nominal`: the first high reading sends the rover to the entrance. `fault`: the inspection
    hangs, and the rover is sent on only after more than 10 s. `attack`: an attacker keeps the alarm
    from the agent, which sends the rover on in time, and alters the goal on its way to the planner.
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
    """A mission of two waypoints or more (`OptionError`): equal missions have equal events."""

    waypoints: int
    mode: Mode = Mode.NOMINAL
    seed: int = 1

    def __post_init__(self) -> None:
        if self.waypoints < 2:
            raise OptionError(
                f"a mission has 2 waypoints or more, not {self.waypoints}: an altered goal is another one"
            )

    def events(self) -> Iterator[Event]:
        """The messages in the order of their times."""
        return _Simulation(self).run()


class _Simulation:
    """The rover, its agent, the planner and the attacker at one moment of a mission; `now` is in seconds."""

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

    # -- what the rover does -----------------------------------------------------------------------------------------

    def _travel(self, target: Place, altered: Place | None = None) -> Iterator[Event]:
        """The agent's command, the goal as the planner gets it, the way there, and the planner's result."""
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
        """An inspection of that length."""
        self.inspecting = number
        yield self._command("inspect", number)
        yield from self._wait(seconds)
        self.inspecting = None
        yield {"topic": "inspected", "location": number, "time": self._time, "data": True}
        yield from self._wait(self._between(0.5, 1.0))

    def _alarmed(self, number: int) -> Iterator[Event]:
        """An inspection that the first high reading breaks off."""
        self.inspecting = number
        yield self._command("inspect", number)
        yield from self._wait(PERIOD)
        self.inspecting = None

    def _wait(self, seconds: float) -> Iterator[Event]:
        """Let time pass; the sensor goes on reading."""
        end = self.now + seconds
        while (due := self._readings * PERIOD + _LATENCY) <= end:
            self.now = due
            self._readings += 1
            yield self._radiation()
        self.now = end

    # -- what it says ------------------------------------------------------------------------------------------------

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
        """A reading.

        The sensor is directed: what a waypoint radiates it counts only where the rover inspects
        that waypoint.
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
    """Write the messages of a mission as JSON Lines; 2 where there is no such mission."""
    parser = ArgumentParser(prog="python -m papers.fmas2022.mission", description="a simulated remote inspection")
    parser.add_argument("--waypoints", type=int, default=5, metavar="N", help="how many, 2 or more (default 5)")
    parser.add_argument("--mode", type=Mode, default=Mode.NOMINAL, help=" or ".join(Mode))
    parser.add_argument("--seed", type=int, default=1, help="another one is another mission (default 1)")
    options = parser.parse_args(arguments)

    def told() -> None:
        for event in Mission(options.waypoints, options.mode, options.seed).events():
            sys.stdout.write(f"{json.dumps(event)}\n")

    return ended("mission", told)


if __name__ == "__main__":
    sys.exit(main())
