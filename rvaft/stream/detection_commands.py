"""The commands that run on detections.

A command is run as `sh -c COMMAND`, with the detection as one JSON object on standard input. Its
standard output goes to the standard error of the monitor. The monitor waits for it, except for a
command that ends with `&`. A failure is reported, and the monitor continues. A command that still
runs a second after the monitor was stopped is killed.
"""

import json
import os
import signal
import sys
from collections.abc import Collection, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from tempfile import TemporaryFile
from typing import Final

from rvaft.model.nodes import Kind
from rvaft.model.values import Json
from rvaft.support.output import STOP, waits
from rvaft.support.terminal import cut

TIMEOUT: Final = 30.0
"""Maximum duration of a command in seconds."""
UNSTARTED: Final = "the command was not started, because the monitor was stopped"
_GRACE: Final = 0.5
"""Seconds between SIGTERM and SIGKILL."""
_SHELL_STATUS: Final = {126: " (cannot be executed)", 127: " (command not found)"}


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
