"""What people would check a log with, each as one function: from a log to the seconds it took, its answer compared with what is known.

Imports and the start of other programs are left out of all figures.
"""

import gc
import importlib
import json
import os
import shutil
import subprocess
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, Final

import orjson

from rvaft.api import load
from rvaft.backend import backend
from rvaft.errors import NotExpressible
from rvaft.model.verdict import Semantics
from tests.benchmarks.logs import BOUND, Log


class NotRun(Exception):
    """A peer that could not run, and why."""


@dataclass(frozen=True, slots=True)
class Timing:
    """Seconds for so many events."""

    events: int
    seconds: float


def timed(call: Callable[[], object]) -> float:
    """Seconds of a call, with nothing left over from what ran before."""
    gc.collect()
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


# -- decoding alone ----------------------------------------------------------------------------------------------------


def decoding(loads: Callable[[bytes], object]) -> Callable[[Log], Timing]:
    """All lines of a log through a decoder, and no more than that."""

    def run(log: Log) -> Timing:
        def read() -> None:
            with log.file.open("rb") as stream:
                for line in stream:
                    loads(line)

        return Timing(log.events, timed(read))

    return run


# -- Reelay ------------------------------------------------------------------------------------------------------------

ATTACK: Final = f"""
{{topic: "/move_base/goal"}} and pre(once(
{{topic: "/command", name: "move"}} and pre(once(
{{topic: "/radiation_sensor_plugin/sensor_0", value >= {BOUND}}} and pre(once(
{{topic: "/command", name: "inspect"}} and pre(once(
{{topic: "/command", name: "move"}} or {{topic: "/move_base/result", result: "success"}}
))))))))
"""
"""The attack branches of the pruned tree under `scattered`, without what ties their variables together.

The same: the events, `result` "success", the bound of the reading, and that each comes strictly after the one before (`pre`
of `once`). Left out: the fault branches, whose guard compares two times (Reelay has no arithmetic over data; its own time is counted
in events); that both waypoints are equal; that the waypoint of the goal is another one than that of the move (data
references have to be strings); that it is not "entrance", which no event has in these logs. A field that an event lacks keeps its
value in Reelay; no atom sees that here, for an event with its topic has all its fields. So the formula demands less than the
tree, and first holds with the last event of the logs, as the tree is detected there.
"""


def reelay(log: Log) -> Timing:
    """Reelay's monitor in Python (discrete time, a verdict for each event) on what `orjson` decodes."""
    try:
        module: Any = importlib.import_module("reelay")
    except ImportError as error:
        raise NotRun("the package reelay is not installed") from error
    monitor = module.discrete_timed_monitor(pattern=ATTACK, semantics="boolean", condense=False, y_name="holds")
    first = 0

    def run() -> None:
        nonlocal first
        with log.file.open("rb") as stream:
            for number, line in enumerate(stream, 1):
                event = orjson.loads(line)
                # Reelay cannot read a list where an atom names the field; such events are left out, in its favour.
                if event.get("name").__class__ is list:
                    continue
                if monitor.update(event)["holds"] and not first:
                    first = number

    seconds = timed(run)
    assert first == log.events
    return Timing(log.events, seconds)


# -- the published RML monitor ----------------------------------------------------------------------------------------


def rml(log: Log, tree: Path, semantics: Semantics, *, events: int) -> Timing:
    """The published RML monitor as it comes (its own `monitor.pl`, silent) with the RML text of a tree, on the first events of a log.

    Of a log in which the tree is lost early, events of other types: the monitor stops with the event that loses it. The
    time to start it and to load the specification is measured, and taken off.
    """
    checkout = Path(os.environ.get("RML_MONITOR", ""))
    if not (checkout / "monitor.pl").is_file():
        raise NotRun("RML_MONITOR names no checkout of the monitor")
    swipl = shutil.which("swipl")
    if swipl is None:
        raise NotRun("swipl is not on the path")
    loaded = load(tree)
    try:
        text = backend("rml-prolog").translate(loaded, semantics).text
    except NotExpressible as error:
        raise NotRun(f"RML cannot express the tree under {semantics}") from error
    specification = log.file.with_suffix(".pl")
    specification.write_text(text, encoding="utf-8")
    prefix = log.file.with_suffix(".prefix")
    topics = tuple(f'"topic": "{_topic(relevant.pattern)}"'.encode() for relevant in loaded.alphabet)
    with log.file.open("rb") as stream:
        kept = stream if loaded.ignores else (line for line in stream if not any(topic in line for topic in topics))
        lines = list(islice(kept, events))
    ending = _last_lines(log.file, 5) if loaded.ignores else []
    command = [swipl, "-O", "-f", "none", "-p", f"monitor={checkout}", str(checkout / "monitor.pl"), "--"]
    command += [str(specification), str(prefix), "--silent"]

    def seconds(given: Iterable[bytes]) -> float:
        prefix.write_bytes(b"".join(given))
        start = time.perf_counter()
        done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)
        taken = time.perf_counter() - start
        said = "Execution terminated correctly" if ending else "Unmatched end of trace"
        assert said in done.stdout, done
        return taken

    return Timing(len(lines), seconds([*lines, *ending]) - seconds(ending))


def _topic(pattern: Any) -> str:
    """The topic of a pattern of the pruned tree."""
    return str(dict(pattern.fields)["topic"].value)


def _last_lines(file: Path, count: int) -> list[bytes]:
    with file.open("rb") as stream:
        stream.seek(-min(file.stat().st_size, 8192), os.SEEK_END)
        return stream.read().splitlines(keepends=True)[-count:]


JSON: Final = decoding(json.loads)
ORJSON: Final = decoding(orjson.loads)
