"""A run that keeps checkpoints and is killed again and again.

As a program of its own it may fork: `python -m tests.monitoring.killing FOLDER TRACE SEMANTICS KILLS SEED`. Each fork watches the trace from
the last checkpoint and is killed a random moment after a random event; a run that comes to its end before is followed by a new one.
"""

import json
import os
import signal
import sys
from pathlib import Path
from random import Random
from typing import Any, BinaryIO, TextIO, cast

import rvaft
from rvaft.analysis.pattern_index import TreeReads
from rvaft.model.verdict import Semantics
from rvaft.monitoring.checkpoint import CheckpointFile, open_at
from rvaft.monitoring.monitor_set import MonitorSet, columns
from rvaft.monitoring.near_misses import Statistics
from rvaft.monitoring.run import EventBuffer, Key, Listener, MonitoredTrace, MonitoringPlan, TraceRun, VerdictChange

TEXT = """
event go(v) = { name: "go", v: v };
event back(v) = { name: "back", v: v };
top or pair all;
pair sand x y attack; x on go(V); y on back(W) when W == V + 1;
all 2of3 a b both fault; both and a c; c sand d e;
"""
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


class Told(Listener):
    """Writes every verdict, and how it came about, and flushes it."""

    every = True

    def __init__(self, out: TextIO) -> None:
        self.out = out

    def event(self, watch: MonitoredTrace, number: int, event: Any) -> None:
        self.out.write(f"{number} {watch.monitors.verdicts[0]} {event['robot']}\n")
        self.out.flush()

    def change(self, change: VerdictChange) -> None:
        why = change.explanations.get(0)
        said = "" if why is None else json.dumps([why.branch, dict(why.matched), dict(why.variables)])
        self.out.write(f"{change.number} {change.verdicts[0]} {change.event['robot']} {said}\n")
        self.out.flush()


def watch(
    folder: Path, trace: Path, semantics: Semantics, *, checkpoints: bool = True, deadly: int = 0, delay: float = 0.0
) -> None:
    """Watch the trace, from the last checkpoint on, and tell every verdict and at the end what there is to tell.

    It is killed so many seconds after it has read that many events.
    """
    tree = rvaft.loads(TEXT)
    monitors = MonitorSet(columns(tree), lambda part: rvaft.monitor(part, semantics=semantics), semantics)
    plan = MonitoringPlan(monitors, TreeReads(tree), Key.parse(["robot"]), order_by="time", window=5)
    kept = CheckpointFile(folder / "kept", tree=tree, semantics=semantics, columns=["tree"], trace=trace, every=EVERY)
    with (folder / "told").open("a") as out:
        run = TraceRun(plan, "log", [Told(out)], buffer=EventBuffer(), statistics=Statistics(monitors.types))
        found = kept.load() if checkpoints else None
        offset = line = 0
        if found is not None:
            run.restore(found[1], found[0].events)
            offset, line = found[0].offset, found[0].line
        out.write(f"from {run.number}\n")
        with open_at(trace, offset=offset, line=line) as stream:
            going_on = True
            for going_on_ in run.read(cast("BinaryIO", stream), str(trace), line=line + 1):
                deadly -= 1
                if deadly == 0:
                    signal.setitimer(signal.ITIMER_REAL, delay)  # nobody handles its signal
                if checkpoints and going_on and (kept.is_due(run.number) or not going_on_):
                    kept.save(run.state, run.number, stream)
                going_on = going_on and going_on_
        assert run.statistics is not None
        counted = run.statistics.events, dict(run.statistics.relevant), run.statistics.never_seen, stream.line
        out.write(f"{END} {json.dumps([*counted, *run.warnings])}\n")


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
