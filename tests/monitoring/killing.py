"""A run that keeps checkpoints and is killed again and again.

As a program of its own it may fork: `python -m tests.monitoring.killing FOLDER TRACE SEMANTICS KILLS SEED`. Each fork watches the trace from
the last checkpoint and is killed a random moment after a random event; a run that comes to its end before is followed by a new one.
"""

import json
import os
import signal
import sys
from collections.abc import Mapping
from pathlib import Path
from random import Random
from typing import Any, BinaryIO, cast

import rvaft
from rvaft.model.verdict import Semantics
from rvaft.monitoring.checkpoint import Checkpoint, digest, identity, load, reading, save
from rvaft.monitoring.near_misses import Statistics
from rvaft.monitoring.reader import read
from rvaft.monitoring.stream import Ordering
from rvaft.monitors import Monitor

TEXT = """
event go(v) = { name: "go", v: v };
event back(v) = { name: "back", v: v };
top or pair all;
pair sand x y attack; x on go(V); y on back(W) when W == V + 1;
all 2of3 a b both fault; both and a c; c sand d e;
"""
COLUMNS = ("tree",)
EVERY = 7
END = "end"


def events(random: Random, count: int) -> list[dict[str, Any]]:
    """Events of several robots in one stream, not quite in order."""
    made: list[dict[str, Any]] = []
    for number in range(count):
        event: dict[str, Any] = {"robot": random.randrange(count // 15), "time": number + random.randrange(6)}
        name = random.choice(["go", "back", "a", "b", "c", "d", "e", "other", "other"])
        event |= {"name": name, "v": random.randrange(4)} if name in ("go", "back") else {"event": name}
        made.append(event)
    return made


def explained(robots: Mapping[int, Monitor]) -> list[Any]:
    """Why each robot's monitor fired."""
    found = [(robot, monitor.explanation) for robot, monitor in sorted(robots.items())]
    return [
        [robot, why.branch, sorted(why.kinds), dict(why.matched), dict(why.variables)]
        for robot, why in found
        if why is not None
    ]


def watch(
    folder: Path, trace: Path, semantics: Semantics, *, checkpoints: bool = True, deadly: int = 0, delay: float = 0.0
) -> None:
    """Watch the trace, from the last checkpoint on, and tell every verdict and at the end what there is to tell.

    It is killed so many seconds after it has read that many events.
    """
    tree = rvaft.loads(TEXT)
    kept = folder / "kept"
    found = None
    if checkpoints:
        found = load(kept, tree=tree, semantics=semantics, columns=COLUMNS, trace=trace)
    robots: dict[int, Monitor] = {}
    statistics, ordering, number, offset, line = Statistics(tree), Ordering("time", window=5), 0, 0, 0
    if found is not None:
        robots, statistics, ordering = found.monitors, found.statistics, found.held
        number, offset, line = found.events, found.offset, found.line

    def step(place: int, event: dict[str, Any]) -> None:
        monitor = robots.get(event["robot"])
        if monitor is None:
            monitor = robots[event["robot"]] = rvaft.monitor(tree, semantics=semantics)
        verdict = monitor.step(event)
        statistics.add(event, place)
        said = "" if monitor.explanation is None else json.dumps(dict(monitor.explanation.matched))
        out.write(f"{place} {verdict} {said}\n")
        out.flush()

    with (folder / "told").open("a") as out, reading(trace, offset=offset, line=line) as stream:
        out.write(f"from {number}\n")
        for event in read(cast("BinaryIO", stream), name=str(trace)):
            number += 1
            deadly -= 1
            if deadly == 0:
                signal.setitimer(signal.ITIMER_REAL, delay)  # nobody handles its signal
            given = ordering.add(number, event)
            if given is not None:
                step(*given)
            if checkpoints and number % EVERY == 0:
                place = identity(trace, stream.offset)
                state = robots, statistics, ordering
                here = stream.offset, stream.line, number
                save(kept, Checkpoint(digest(tree), semantics, COLUMNS, place, *here, *state))
        for given in ordering.rest():
            step(*given)
        told = [explained(robots), statistics.events, dict(statistics.relevant), statistics.never_seen, stream.line]
        out.write(f"{END} {json.dumps(told)}\n")


def main(folder: Path, trace: Path, semantics: Semantics, kills: int, random: Random) -> None:
    """Kill that often; then the last run is left as it is."""
    rvaft.monitor(rvaft.loads(TEXT), semantics=semantics)  # what is imported now is there in every fork
    for run in range(kills):
        (folder / str(run)).mkdir()
        while True:
            deadly, delay = random.randrange(1, 60), random.uniform(1e-6, 0.01)
            child = os.fork()
            if child == 0:
                watch(folder / str(run), trace, semantics, deadly=deadly, delay=delay)
                os._exit(0)
            _, status = os.waitpid(child, 0)
            if not os.WIFSIGNALED(status):
                if status:
                    sys.exit(f"the run ended with status {status}")
                break  # it was faster
            kills -= 1
            if kills == 0:
                return


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), Semantics(sys.argv[3]), int(sys.argv[4]), Random(sys.argv[5]))
