"""What is told of a detection: as JSON on standard output and by a server, and to the commands that are run on it.

A command is a line for the shell, run as `sh -c COMMAND`: the way from a monitor to a recovery
mechanism. It gets the detection as one JSON object on its standard input, and what it prints goes
to the standard error of the monitor, whose standard output stays what it is. The monitor waits for
it: end the line with `&` for what shall go on by itself. Whatever a command does, the monitor goes
on; a failure is told.
"""

import json
import os
import signal
import sys
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Final

from rvaft.core.classifier import TreeReads
from rvaft.model.nodes import Kind
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json, finite, is_finite
from rvaft.monitors import Explanation, Pending
from rvaft.support.terminal import cut

PLACES: Final = ("time", "topic")
"""The fields of an event that say where it is from, in the logs of ROS."""
TIMEOUT: Final = 30.0
"""Seconds that a command may take."""
_GRACE: Final = 1.0
"""Seconds between asking a command to end and killing it."""
_SHELL_SAYS: Final = {126: " (cannot be executed)", 127: " (command not found)"}
_UNEXPLAINED: Final[Mapping[str, Json]] = {"branch": None, "kinds": [], "matched": [], "variables": {}}


def counted(count: int, what: str = "event") -> str:
    """So many events, or others, in words.

    >>> counted(2), counted(1, "detection")
    ('2 events', '1 detection')
    """
    return f"{count} {what}{'' if count == 1 else 's'}"


def matched_events(explanations: Collection[Explanation]) -> set[int]:
    """The numbers of the events that explanations name."""
    return {one.event for explanation in explanations for one in explanation.matched}


def told_fields(tree: RVAFT) -> tuple[str, ...]:
    """The fields that tell an event of a tree from others: time and topic, and those where its
    event types have different texts.

    >>> import rvaft
    >>> told_fields(rvaft.loads('event e(x) = { kind: "k", x: x }; top and a; a on e(1);'))
    ('time', 'topic', 'kind')
    """
    return tuple(dict.fromkeys((*PLACES, *_time_field(tree), *TreeReads(tree).discriminators.fields)))


def _time_field(tree: RVAFT) -> tuple[str, ...]:
    return () if tree.time is None else tree.time.field[:1]


def places(event: Json, tree: RVAFT) -> dict[str, Json]:
    """The time of an event, as it stands where the tree says that times stand, and its topic.

    >>> import rvaft
    >>> places({"t": 7, "topic": "/x"}, rvaft.loads("time t as s; top and a b;"))
    {'time': 7, 'topic': '/x'}
    """
    written = None if tree.time is None else tree.time.written(event)
    return {**kept({"time": written} if written is not None else event, PLACES[:1]), **kept(event, PLACES[1:])}


def kept(event: Json, fields: Sequence[str]) -> dict[str, Json]:
    """What an event has in some fields. A number that is none in JSON, as infinity, says nothing."""
    found = {name: event[name] for name in fields if name in event} if isinstance(event, Mapping) else {}
    return {name: value for name, value in found.items() if is_finite(value)}


def other_fields(node: str, event: Json, tree: RVAFT, fields: Sequence[str]) -> dict[str, Json]:
    """What tells the event of a node from others beside time and topic; a default event is named by its node alone."""
    if node in tree.nodes and tree.nodes[node].on is None:
        return {}
    found = kept(event, [name for name in fields if name not in (*PLACES, *_time_field(tree))])
    return {name: value for name, value in found.items() if not isinstance(value, (Mapping, list))}


def explained(
    explanation: Explanation, tree: RVAFT, events: Mapping[int, Json], fields: Sequence[str]
) -> dict[str, Json]:
    """Branch, kinds, which event was which node, and the variables; `events` are those that are
    known, by their numbers.
    """
    matched = []
    for node, occurrence, number in explanation.matched:
        event = events.get(number)
        others = other_fields(node, event, tree, fields)
        told = {"node": node, "occurrence": occurrence, "event": number}
        matched.append({**told, **places(event, tree), **({"fields": others} if others else {})})
    return {
        "branch": explanation.branch,
        "kinds": sorted(kind.value for kind in explanation.kinds),
        "matched": matched,
        "variables": finite(explanation.bound(tree)),
    }


def expected(pending: Sequence[Pending]) -> list[Json]:
    """What was waited for, a record for each branch and each way to bind its variables."""
    return [
        {
            "branch": record.branch,
            "awaited": [{"node": awaited.node, "event": awaited.event} for awaited in record.awaited],
            "variables": finite(dict(record.variables)),
        }
        for record in pending
    ]


def unlike(explanations: Mapping[int, Explanation]) -> Collection[tuple[list[int], Explanation]]:
    """The explanations that differ in branch or events, each with the columns that have it."""
    known: dict[object, tuple[list[int], Explanation]] = {}
    for column, one in explanations.items():
        known.setdefault((one.branch, one.kinds, one.matched), ([], one))[0].append(column)
    return known.values()


def detection(
    about: Mapping[str, Json], explanation: Explanation | None, events: Mapping[int, Json], tree: RVAFT
) -> dict[str, Json]:
    """What a command is told: one JSON object, which begins with what it is `about`.

    From the explanation come `branch`, `kinds`, `matched` (nodes with the numbers of their events)
    and `variables`; without one, as from a backend that does not explain, they are null or empty.
    `events` are those that were matched, by their numbers as text, as far as they are known.
    """
    told, numbers = _UNEXPLAINED, set[int]()
    if explanation is not None:
        told, numbers = explained(explanation, tree, events, told_fields(tree)), matched_events([explanation])
    known = {str(number): finite(events[number]) for number in sorted(numbers) if number in events}
    return {**about, **told, "events": known}


@dataclass(frozen=True, slots=True)
class Hooks:
    """The commands: `always` for every detection, `on` for those whose explanation has the kind."""

    always: str | None = None
    on: Mapping[Kind, str | None] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return any(command is not None for command in (self.always, *self.on.values()))

    def run(self, detected: Mapping[str, Json], also: Collection[Kind] = ()) -> list[str]:
        """Run the commands for a `detection`, one after the other (that for all, then for faults,
        then for attacks), and say what failed.

        `also` are kinds that were detected beside those of the match: a branch of a kind may be
        matched without a node of that kind.
        """
        text = f"{json.dumps(detected)}\n".encode()
        wanted = (self.always, *(self.on.get(k) for k in Kind if k in also or k.value in detected["kinds"]))
        return [
            f"the command {cut(' '.join(command.split()), 80)!r} {reason}"
            for command in wanted
            if command is not None and (reason := _run(command, text))
        ]


def _run(command: str, text: bytes) -> str | None:
    """Run one command, in a process group of its own so that all of it can be ended; why it failed, if it did."""
    import subprocess  # noqa: PLC0415 -- imported on use

    output = subprocess.DEVNULL if sys.__stderr__ is None else sys.__stderr__.fileno()
    try:
        running = subprocess.Popen(  # noqa: S603 (the user's own command)
            ["/bin/sh", "-c", command], stdin=subprocess.PIPE, stdout=output, start_new_session=True
        )
    except (OSError, ValueError) as error:
        return f"cannot be run: {getattr(error, 'strerror', None) or error}"
    try:
        running.communicate(text, timeout=TIMEOUT)  # a command that does not read its input is none the worse for it
    except BaseException as error:
        for number in (signal.SIGTERM, signal.SIGKILL):
            with suppress(ProcessLookupError):
                os.killpg(running.pid, number)
            with suppress(subprocess.TimeoutExpired):
                running.wait(_GRACE)
        if running.stdin is not None:
            with suppress(OSError):
                running.stdin.close()
        if isinstance(error, subprocess.TimeoutExpired):
            return f"did not end within {TIMEOUT:g} s and was killed"
        raise
    status = running.returncode
    if status >= 0:
        return f"ended with status {status}{_SHELL_SAYS.get(status, '')}" if status else None
    known = -status in set(signal.Signals)
    return f"was killed by {signal.Signals(-status).name if known else f'signal {-status}'}"
