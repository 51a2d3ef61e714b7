"""Commands that are run on detection: the way from a monitor to a recovery mechanism.

A command is a line for the shell, run as `sh -c COMMAND`. It gets the detection as one JSON object on its standard input, and what
it prints goes to the standard error of the monitor, whose standard output stays what it is. The monitor waits for it: end
the line with `&` for what shall go on by itself. Whatever a command does, the monitor goes on; a failure is returned.
"""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Collection, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Final

from rvaft.errors import OptionError
from rvaft.model.nodes import Kind
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.monitoring.explanation_json import explained, matched_events, told_fields
from rvaft.monitoring.run import Detection

DEFAULT_TIMEOUT: Final = 30.0
"""How long a command may take unless told otherwise, in seconds."""
_UNEXPLAINED: Final[Mapping[str, Json]] = {"branch": None, "kinds": [], "matched": [], "variables": {}}
_GRACE: Final = 1.0
"""Seconds between asking a command to end and killing it."""
_SHELL: Final = "/bin/sh"
_SHELL_SAYS: Final = {126: "cannot be executed", 127: "command not found"}
_SHOWN: Final = 80
"""Characters of a command in a message."""


@dataclass(frozen=True, slots=True)
class CommandFailure:
    """A command that did not do its work, and why; as text one line."""

    command: str
    reason: str

    def __str__(self) -> str:
        line = " ".join(self.command.split())
        short = line if len(line) <= _SHOWN else f"{line[:_SHOWN]}…"
        return f"the command {short!r} {self.reason}"


@dataclass(frozen=True, slots=True)
class Hooks:
    """The commands: `always` for every detection, `on` for those whose explanation has the kind. `timeout` is in seconds.

    Raises `OptionError` for a timeout that is not positive.
    """

    always: str | None = None
    on: Mapping[Kind, str] = field(default_factory=dict)
    timeout: float = DEFAULT_TIMEOUT

    def __post_init__(self) -> None:
        if not self.timeout > 0:
            raise OptionError(f"a timeout of {self.timeout:g} s: it must be positive")

    def __bool__(self) -> bool:
        return self.always is not None or bool(self.on)

    def run(self, detected: Mapping[str, Json], also: Collection[Kind] = ()) -> tuple[CommandFailure, ...]:
        """Run the commands for a `detection`, one after the other (that for all, then for faults, then for attacks), and say which failed.

        `also` are kinds that were detected beside those of the match: a branch of a kind may be matched without a node of that kind.
        """
        text = f"{json.dumps(detected)}\n".encode()
        chosen = [self.on.get(kind) for kind in Kind if kind in also or kind.value in detected["kinds"]]
        failures = [_run(command, text, self.timeout) for command in (self.always, *chosen) if command is not None]
        return tuple(failure for failure in failures if failure is not None)


def detection(
    found: Detection,
    tree: RVAFT,
    *,
    name: str,
    trace: str,
    event: int,
    key: tuple[Json] | None = None,
    again: bool = False,
) -> dict[str, Json]:
    """What a command is told: one JSON object.

    `tree` and `trace` are their names, `event` is the number of the event that detected; `key` says what the monitor is for, in a tuple
    since it may be null, and is only there where there is one for each. From the explanation come `branch`, `kinds`, `matched` (nodes with the numbers of
    their events) and `variables`; without one, as from a backend that does not explain, they are null or empty. `events`
    are those that were matched, by their numbers as text, as far as they are known. With `again` an earlier run has told this already.
    """
    told = _UNEXPLAINED
    numbers: list[int] = []
    if found.explanation is not None:
        told = explained(found.explanation, tree, found.events, told_fields(tree))
        numbers = sorted(matched_events([found.explanation]))
    return {
        "tree": name,
        "trace": trace,
        **({} if key is None else {"key": key[0]}),
        "event": event,
        **({"again": True} if again else {}),
        **told,
        "events": {str(number): found.events[number] for number in numbers if number in found.events},
    }


def _run(command: str, text: bytes, timeout: float) -> CommandFailure | None:
    """Run one command; in a process group of its own, so that all of it can be ended."""
    output = subprocess.DEVNULL if sys.__stderr__ is None else sys.__stderr__.fileno()
    try:
        running = subprocess.Popen(  # noqa: S603 (the user's own command)
            [_SHELL, "-c", command], stdin=subprocess.PIPE, stdout=output, start_new_session=True
        )
    except (OSError, ValueError) as error:
        return CommandFailure(command, f"cannot be run: {getattr(error, 'strerror', None) or error}")
    try:
        running.communicate(text, timeout=timeout)  # a command that does not read its input is none the worse for it
    except subprocess.TimeoutExpired:
        _end(running)
        return CommandFailure(command, f"did not end within {timeout:g} s and was killed")
    except BaseException:
        _end(running)
        raise
    status = running.returncode
    if status == 0:
        return None
    if status > 0:
        said = _SHELL_SAYS.get(status)
        return CommandFailure(command, f"ended with status {status}{f' ({said})' if said else ''}")
    known = -status in set(signal.Signals)
    return CommandFailure(command, f"was killed by {signal.Signals(-status).name if known else f'signal {-status}'}")


def _end(running: "subprocess.Popen[bytes]") -> None:
    """End a command and all that it started: by asking, then by force."""
    with suppress(ProcessLookupError):
        os.killpg(running.pid, signal.SIGTERM)
    with suppress(subprocess.TimeoutExpired):
        running.wait(_GRACE)
    with suppress(ProcessLookupError):
        os.killpg(running.pid, signal.SIGKILL)
    if running.stdin is not None:
        with suppress(OSError):
            running.stdin.close()
    running.wait()
