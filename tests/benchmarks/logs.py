"""Logs to time monitors on: the same bytes for the same arguments, written fast, and what a monitor has to find in them.

`python -m tests.benchmarks.logs DIR` writes them in full size, each with the tree that it is watched for.

The lines look as ROSMonitoring writes them (`json.dumps` of a message with `topic` and `time` added): fields in no
particular order, a blank after commas and colons, coordinates with all their digits.
"""

import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import cycle, islice
from pathlib import Path
from random import Random
from typing import Final

TREE: Final = Path(__file__).parents[2] / "trees" / "remote_inspection" / "pruned.rvaft"
BOUND: Final = 250
"""The reading from which on radiation is high in the tree."""
WAYPOINTS: Final = range(100, 110)
"""The waypoints of the rounds that come to nothing; the last five events have others."""
ENDING: Final = Counter(move=2, inspect=1, radiation=1, goal=1)
"""The relevant events of the attack at the end of every log."""

_IGNORING = f"""
ignore radiation(V, _) when V < {BOUND};
ignore move(W, _) when W >= {WAYPOINTS[0]};
ignore inspect(W) when W >= {WAYPOINTS[0]};
ignore result(W, _) when W >= {WAYPOINTS[0]};
ignore goal(W) when W >= {WAYPOINTS[0]};
"""


@dataclass(frozen=True, slots=True)
class Log:
    """A log, and what is known of it: how many events, how many of each type, how many that only just miss a type.

    The pruned tree is detected at the last event under `scattered`, and not before; under `projected` it is lost with the second
    event of one of its types, at `lost`.
    """

    file: Path
    events: int
    types: Counter[str]
    lost: int
    near_misses: int = 0


def ignoring_tree(folder: Path) -> Path:
    """A file with the pruned tree, and declarations that ignore all of an `inspections` log but its last five events."""
    file = folder / "ignoring.rvaft"
    file.write_text(f'import "{TREE}";\n{_IGNORING}', encoding="utf-8")
    return file


def telemetry(file: Path, events: int = 1_000_000, *, seed: int = 1) -> Log:
    """What a robot says all day, 100 to 400 bytes a line: one event in a thousand is of a type of the tree.

    As many only just miss one: a second sensor, which the tree does not know.
    """
    source = _Source(seed, step=0.005)
    messages = (
        source.odom,
        source.scan,
        source.tf,
        source.battery,
        source.joints,
        source.imu,
        source.velocity,
        source.rosout,
    )
    makers = [make for make, times in zip(messages, (6, 3, 6, 1, 4, 4, 4, 1), strict=True) for _ in range(times)]
    types: Counter[str] = Counter()
    near = lost = 0

    def lines() -> Iterator[str]:
        nonlocal near, lost
        rounds = cycle(source.visit(readings=4))
        relevant, missing = -1, -1
        for number in range(events - 5):
            if number % 1000 == 0:
                relevant, missing = number + source.random.randrange(500), number + 500 + source.random.randrange(500)
            if number == relevant:
                name = next(rounds)
                types[name] += 1
                lost = lost or (number + 1 if types.total() == 2 else 0)
                yield source.event(name)
            elif number == missing:
                near += 1
                yield source.radiation(sensor=1)
            else:
                yield source.random.choice(makers)()
        yield from source.attack()

    _write(file, lines())
    return Log(file, events, types + ENDING, lost, near)


def inspections(file: Path, events: int = 300_000, *, readings: int = 76, seed: int = 2) -> Log:
    """Rounds of a robot that inspects waypoints, nothing but events of the tree's types, as the published log has them.

    The published log has 95 readings in 100 events, which `readings` per visit say; with 1 all five types are equally frequent,
    and the lines shorter.
    """
    source = _Source(seed, step=1.0)
    types: Counter[str] = Counter()

    def lines() -> Iterator[str]:
        for name in islice(cycle(source.visit(readings)), events - 5):
            types[name] += 1
            yield source.event(name)
        yield from source.attack()

    _write(file, lines())
    return Log(file, events, types + ENDING, lost=2)


def _write(file: Path, lines: Iterator[str]) -> None:
    with file.open("w", encoding="utf-8", newline="\n") as stream:
        while block := "".join(islice(lines, 1000)):
            stream.write(block)


class _Source:
    """Messages with values at random, one after the other in time; `step` is the mean time between two, in seconds."""

    def __init__(self, seed: int, step: float) -> None:
        self.random = Random(seed)
        self.step = step
        self.time = 490.0
        self.count = 0
        self.waypoint = WAYPOINTS[0]
        # Numbers are drawn as runs from a pool: to make each anew would take longer than all that is timed.
        self._pool = [repr(self.random.uniform(-8, 8) if n % 3 else self.random.gauss(0, 1e-5)) for n in range(16_384)]

    def _some(self, count: int) -> list[str]:
        start = int(self.random.random() * 16_000)
        return self._pool[start : start + count]

    def _header(self, frame: str) -> str:
        """Time goes on by a little, and never stands still."""
        self.time += self.step * (0.5 + self.random.random())
        self.count += 1
        secs = int(self.time)
        nsecs = int((self.time - secs) * 1e6) * 1000
        return (
            f'"header": {{"stamp": {{"secs": {secs}, "nsecs": {nsecs}}}, "frame_id": "{frame}", "seq": {self.count}}}'
        )

    @property
    def _now(self) -> str:
        return f"{self.time:.6f}"

    # -- telemetry -------------------------------------------------------------------------------------------------

    def odom(self) -> str:
        header = self._header("odom")
        n = self._some(6)
        return (
            f'{{"pose": {{"position": {{"y": {n[0]}, "x": {n[1]}, "z": 0.0}}, "orientation": {{"y": 0.0, "x": 0.0, "z": '
            f'{n[2]}, "w": {n[3]}}}}}, "twist": {{"linear": {{"x": {n[4]}}}, "angular": {{"z": {n[5]}}}}}, "topic": "/odom", '
            f'{header}, "time": {self._now}}}\n'
        )

    def scan(self) -> str:
        header = self._header("laser")
        n = self._some(2)
        return (
            f'{{"topic": "/scan", {header}, "angle_min": -2.0944, "angle_max": 2.0944, "nearest": {n[0]}, "mean": {n[1]}, '
            f'"count": 682, "time": {self._now}}}\n'
        )

    def tf(self) -> str:
        header = self._header("map")
        n = self._some(4)
        return (
            f'{{"transforms": [{{{header}, "child_frame_id": "odom", "transform": {{"translation": {{"y": {n[0]}, "x": {n[1]}, '
            f'"z": 0.0}}, "rotation": {{"z": {n[2]}, "w": {n[3]}}}}}}}], "topic": "/tf", "time": {self._now}}}\n'
        )

    def battery(self) -> str:
        header = self._header("")
        n = self._some(1)
        return (
            f'{{"topic": "/battery_state", {header}, "voltage": 24.31, "current": {n[0]}, "capacity": null, "percentage": 0.87, '
            f'"present": true, "cell_voltage": [], "location": "bay 1", "time": {self._now}}}\n'
        )

    def joints(self) -> str:
        """A `name` that is a list, and no command."""
        header = self._header("")
        n = self._some(4)
        return (
            f'{{"name": ["left_wheel", "right_wheel"], "position": [{n[0]}, {n[1]}], "velocity": [{n[2]}, {n[3]}], "effort": '
            f'[0.0, 0.0], "topic": "/joint_states", {header}, "time": {self._now}}}\n'
        )

    def imu(self) -> str:
        header = self._header("imu_link")
        n = self._some(6)
        return (
            f'{{"angular_velocity": {{"y": {n[0]}, "x": {n[1]}, "z": {n[2]}}}, "linear_acceleration": {{"y": {n[3]}, "x": {n[4]}, '
            f'"z": {n[5]}}}, "topic": "/imu/data", {header}, "time": {self._now}}}\n'
        )

    def velocity(self) -> str:
        self._header("")
        n = self._some(2)
        return (
            f'{{"linear": {{"y": 0.0, "x": {n[0]}, "z": 0.0}}, "angular": {{"y": 0.0, "x": 0.0, "z": {n[1]}}}, "topic": '
            f'"/cmd_vel", "time": {self._now}}}\n'
        )

    def rosout(self) -> str:
        """Words of the tree, and escapes, inside of strings."""
        header = self._header("")
        n = self._some(1)
        return (
            f'{{"name": "/move_base", "level": 2, "msg": "Got new plan to \\"{self.waypoint}\\", cost {n[0]} \\u00b5", "file": '
            f'"planner_core.cpp", "line": 214, "topics": ["/rosout", "/command", "/move_base/goal"], "topic": "/rosout", '
            f'{header}, "time": {self._now}}}\n'
        )

    # -- the event types of the tree -------------------------------------------------------------------------------

    def visit(self, readings: int) -> tuple[str, ...]:
        """The event types of one visit to a waypoint, in order."""
        before = readings // 2
        return ("move", "goal", *["radiation"] * before, "result", "inspect", *["radiation"] * (readings - before))

    def event(self, name: str) -> str:
        """An event of a visit; each visit is to a waypoint at random."""
        match name:
            case "move":
                self.waypoint = self.random.choice(WAYPOINTS)
                return self.command("move", self.waypoint)
            case "inspect":
                return self.command("inspect", self.waypoint)
            case "goal":
                return self.goal(self.waypoint)
            case "result":
                return self.result(self.waypoint)
            case _:
                return self.radiation()

    def attack(self) -> Iterator[str]:
        """The five events by which the tree is detected, at the last of them and not before: they follow each other at once."""
        self.step = min(self.step, 1.0)
        yield self.command("move", 1)
        yield self.command("inspect", 1)
        yield self.radiation(value=300)
        yield self.command("move", 2)
        yield self.goal(3)

    def command(self, name: str, waypoint: int) -> str:
        self._header("")
        return (
            f'{{"name": "{name}", "topic": "/command", "verdict": false, "waypoint": {waypoint}, "time": {self._now}, '
            '"spec": "0"}\n'
        )

    def radiation(self, value: int | None = None, sensor: int = 0) -> str:
        header = self._header("sim_sensor")
        n = self._some(7)
        level = self.random.randrange(BOUND) if value is None else value
        return (
            f'{{"pose": {{"position": {{"y": {n[0]}, "x": {n[1]}, "z": {n[2]}}}, "orientation": {{"y": {n[3]}, "x": {n[4]}, '
            f'"z": {n[5]}, "w": {n[6]}}}}}, "value": {level}.0, "topic": "/radiation_sensor_plugin/sensor_{sensor}", {header}, '
            f'"verdict": false, "time": {self._now}, "type": "", "spec": "0"}}\n'
        )

    def result(self, waypoint: int) -> str:
        header = self._header("")
        return (
            f'{{"status": {{"status": 3, "text": "Goal reached.", "goal_id": "/movebase_client_py-{self.count}"}}, "topic": '
            f'"/move_base/result", {header}, "waypoint": {waypoint}, "result": "success", "verdict": false, "time": {self._now}, '
            '"spec": "0"}\n'
        )

    def goal(self, waypoint: int) -> str:
        header = self._header("map")
        x, y = self._some(2)
        return (
            f'{{"goal": {waypoint}, "target_pose": {{{header}, "pose": {{"position": {{"y": {y}, "x": {x}, "z": 0.0}}, '
            f'"orientation": {{"y": 0.0, "x": 0.0, "z": 0.0, "w": 1.0}}}}}}, "topic": "/move_base/goal", "goal_id": {{"id": '
            f'"/movebase_client_py-{self.count}"}}, "time": {self._now}, "verdict": false, "spec": "0"}}\n'
        )


def main(folder: Path) -> None:
    """Write all logs and their tree into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    ignoring_tree(folder)
    for log in (
        telemetry(folder / "telemetry.jsonl"),
        inspections(folder / "inspections.jsonl"),
        inspections(folder / "inspections_even.jsonl", readings=1),
    ):
        sys.stdout.write(f"{log.file}: {log.events} events\n")


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: python -m tests.benchmarks.logs DIR")
    main(Path(sys.argv[1]))
