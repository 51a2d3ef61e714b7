"""Detections as JSON, and the commands that run on them.

A command is run as `sh -c COMMAND`, with the detection as one JSON object on standard input. Its
standard output goes to the standard error of the monitor. The monitor waits for it, except for a
command that ends with `&`. A failure is reported, and the monitor continues. A command that still
runs a second after the monitor was stopped is killed.
"""

import json
import os
import signal
import sys
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import lru_cache
from tempfile import TemporaryFile
from typing import Final

from rvaft.core.fields_to_read import TreeReads
from rvaft.model.nodes import Kind
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json, finite, is_finite
from rvaft.monitors import Explanation, Pending
from rvaft.support.output import STOP, waits
from rvaft.support.terminal import cut

PLACES: Final = ("time", "topic")
TIMEOUT: Final = 30.0
"""Maximum duration of a command in seconds."""
UNSTARTED: Final = "the command was not started, because the monitor was stopped"
_GRACE: Final = 0.5
"""Seconds between SIGTERM and SIGKILL."""
_SHELL_STATUS: Final = {126: " (cannot be executed)", 127: " (command not found)"}
_FINITE: Final = frozenset({str, int, bool})
"""Types of which all values are finite."""
_UNEXPLAINED: Final[Mapping[str, Json]] = {"branch": None, "kinds": [], "matched": [], "variables": {}}


def counted(count: int, what: str = "event") -> str:
    """Return a count with its noun.

    >>> counted(2), counted(1, "detection")
    ('2 events', '1 detection')
    """
    return f"{count} {what}{'' if count == 1 else 's'}"


def matched_events(explanations: Collection[Explanation]) -> set[int]:
    """Return the numbers of the events in explanations."""
    return {one.event for explanation in explanations for one in explanation.matched}


def identifying_fields(tree: RVAFT) -> tuple[str, ...]:
    """Return time, topic, and discriminating fields, which identify an event in output.

    >>> import rvaft
    >>> identifying_fields(rvaft.loads('event e(x) = { kind: "k", x: x }; top and a; a on e(1);'))
    ('time', 'topic', 'kind')
    """
    return tuple(dict.fromkeys((*PLACES, *_time_field(tree), *TreeReads(tree).discriminators.fields)))


def _time_field(tree: RVAFT) -> tuple[str, ...]:
    return () if tree.time is None else tree.time.field[:1]


def places(event: Json, tree: RVAFT) -> dict[str, Json]:
    """Return the time of an event, as written in the time field of the tree, and its topic.

    >>> import rvaft
    >>> places({"t": 7, "topic": "/x"}, rvaft.loads("time t as s; top and a b;"))
    {'time': 7, 'topic': '/x'}
    """
    written = None if tree.time is None else tree.time.written(event)
    if written is None:
        return kept(event, PLACES)
    return {**kept({"time": written}, PLACES[:1]), **kept(event, PLACES[1:])}


def kept(event: Json, fields: Sequence[str]) -> dict[str, Json]:
    """Return the values of an event in these fields, without numbers that are not finite."""
    if type(event) is not dict and not isinstance(event, Mapping):
        return {}
    found = [(name, event[name]) for name in fields if name in event]
    return {name: value for name, value in found if type(value) in _FINITE or is_finite(value)}


def other_fields(node: str, event: Json, tree: RVAFT, fields: Sequence[str]) -> dict[str, Json]:
    """Return the identifying fields besides time and topic; none for a default event."""
    others = _others(tuple(fields), _time_field(tree))
    if not others or (node in tree.nodes and tree.nodes[node].on is None):
        return {}
    found = kept(event, others)
    return {name: value for name, value in found.items() if not isinstance(value, (Mapping, list))} if found else found


@lru_cache(maxsize=16)
def _others(fields: tuple[str, ...], of_time: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(name for name in fields if name not in (*PLACES, *of_time))


def explained(
    explanation: Explanation,
    tree: RVAFT,
    events: Mapping[int, Json],
    fields: Sequence[str],
    lines: Mapping[int, int | None] | None = None,
) -> dict[str, Json]:
    """Return an explanation as JSON; `events` and `lines` have the known events."""
    matched = []
    for node, occurrence, number in explanation.matched:
        event = events.get(number)
        others = other_fields(node, event, tree, fields)
        record = {"node": node, "occurrence": occurrence, "event": number}
        if lines is not None:
            record["line"] = lines.get(number)
        record.update(places(event, tree))
        if others:
            record["fields"] = others
        matched.append(record)
    return {
        "branch": explanation.branch,
        "kinds": sorted(kind.value for kind in explanation.kinds),
        "matched": matched,
        **({"absent": [one._asdict() for one in explanation.absences]} if explanation.absences else {}),
        "variables": finite(explanation.bound(tree)),
    }


def expected(pending: Sequence[Pending]) -> list[Json]:
    """Return the missing events, one record per branch and binding."""
    return [
        {
            "branch": record.branch,
            "awaited": [{"node": awaited.node, "event": awaited.event} for awaited in record.awaited],
            **({"absent": [{"node": a.node, "event": a.event} for a in record.absent]} if record.absent else {}),
            "variables": finite(dict(record.variables)),
        }
        for record in pending
    ]


def unlike(explanations: Mapping[int, Explanation]) -> Collection[tuple[list[int], Explanation]]:
    """Return distinct explanations, each with its columns."""
    known: dict[object, tuple[list[int], Explanation]] = {}
    for column, one in explanations.items():
        known.setdefault((one.branch, one.kinds, one.matched), ([], one))[0].append(column)
    return known.values()


def detection(
    about: Mapping[str, Json],
    explanation: Explanation | None,
    events: Mapping[int, Json],
    tree: RVAFT,
    lines: Mapping[int, int | None] | None = None,
) -> dict[str, Json]:
    """Return the JSON object for a command: `about`, the explanation, and the known events by
    number as text.

    Without an explanation, `branch`, `kinds`, `matched` and `variables` are null or empty.
    """
    found, numbers = _UNEXPLAINED, set[int]()
    if explanation is not None:
        found = explained(explanation, tree, events, identifying_fields(tree), lines)
        numbers = matched_events([explanation])
    known = {str(number): finite(events[number]) for number in sorted(numbers) if number in events}
    return {**about, **found, "events": known}


@dataclass(frozen=True, slots=True)
class Hooks:
    """Commands: `always` runs on every detection, `on` for detections of a kind."""

    always: str | None = None
    on: Mapping[Kind, str | None] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return any(command is not None for command in (self.always, *self.on.values()))

    def run(self, detected: Mapping[str, Json], also: Collection[Kind] = ()) -> list[str]:
        """Run the commands in turn (always, faults, attacks); return the failures as messages.

        After a stop was requested no command is started: it is `UNSTARTED`. `also` has further
        detected kinds: a branch of a kind may match without a node of that kind.
        """
        text = f"{json.dumps(detected)}\n".encode()
        wanted = (self.always, *(self.on.get(k) for k in Kind if k in also or k.value in detected["kinds"]))
        failures = list[str]()
        for command in wanted:
            if command is not None and STOP.passed():
                failures.append(UNSTARTED)
            elif command is not None and (reason := _run(command, text)):
                failures.append(f"the command {cut(' '.join(command.split()), 80)!r} {reason}")
        return failures


def _run(command: str, text: bytes) -> str | None:
    """Run a command in a process group to kill; return the failure, if any."""
    import subprocess  # noqa: PLC0415

    def wait(seconds: float) -> None:
        try:
            running.wait(seconds)
        except subprocess.TimeoutExpired as error:
            raise TimeoutError from error

    output = subprocess.DEVNULL if sys.__stderr__ is None else sys.__stderr__.fileno()
    try:
        with TemporaryFile() as given:  # a command may ignore its input, so no pipe
            given.write(text)
            given.seek(0)
            running = subprocess.Popen(  # noqa: S603 (the user's own command)
                ["/bin/sh", "-c", command], stdin=given, stdout=output, start_new_session=True
            )
    except (OSError, ValueError) as error:
        return f"cannot be run: {getattr(error, 'strerror', None) or error}"
    try:
        waits(wait, TIMEOUT)
    except BaseException as error:
        for number in (signal.SIGTERM, signal.SIGKILL):
            with suppress(ProcessLookupError):
                os.killpg(running.pid, number)
            with suppress(subprocess.TimeoutExpired):
                running.wait(_GRACE)
        if isinstance(error, TimeoutError):
            if STOP.passed():
                return "was killed, because it did not end when the monitor was stopped"
            return f"did not end within {TIMEOUT:g} s and was killed"
        raise
    status = running.returncode
    if status >= 0:
        return f"ended with status {status}{_SHELL_STATUS.get(status, '')}" if status else None
    known = -status in set(signal.Signals)
    return f"was killed by {signal.Signals(-status).name if known else f'signal {-status}'}"
