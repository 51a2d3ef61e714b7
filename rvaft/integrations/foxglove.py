"""Detections and verdicts for Foxglove, in an MCAP file or from a WebSocket server.

Messages are JSON with a schema: detections (as for commands) on `/rvaft/detections`, changes of
verdicts on `/rvaft/verdicts`. Their log time is the event time, or the current time if the tree
declares no time. Needs `foxglove-sdk`.
"""

import os
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, TypeVar, Unpack

import rvaft
from rvaft.asynchronous import MonitorOptions
from rvaft.errors import OptionError, installed
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Verdict
from rvaft.monitors import Explanation
from rvaft.stream.detection import detection, matched_events
from rvaft.stream.event_buffer import EventBuffer
from rvaft.stream.publishers import Publisher
from rvaft.stream.verdict_change import MonitoredTrace, VerdictChange
from rvaft.support.files import error_context, target_of, temporary_beside

Given = TypeVar("Given")
DETECTIONS: Final = "/rvaft/detections"
VERDICTS: Final = "/rvaft/verdicts"
HOST: Final = "127.0.0.1"
_TEXT: Final = {"type": "string"}
_WHOLE: Final = {"type": "integer"}
_ABOUT: Final = {"tree": _TEXT, "trace": _TEXT, "key": {}, "event": _WHOLE, "again": {"type": "boolean"}}
_MATCHED: Final = {
    "type": "object",
    "properties": {"node": _TEXT, "occurrence": _WHOLE, "event": _WHOLE, "time": {}, "topic": _TEXT},
}
_SCHEMAS: Final[Mapping[str, tuple[str, Mapping[str, Any]]]] = {
    DETECTIONS: (
        "rvaft.Detection",
        {
            **_ABOUT,
            "detection": _WHOLE,
            "suppressed": _WHOLE,
            "branch": {"type": ["integer", "null"]},
            "kinds": {"type": "array", "items": _TEXT},
            "matched": {"type": "array", "items": _MATCHED},
            "variables": {"type": "object"},
            "events": {"type": "object"},
        },
    ),
    VERDICTS: ("rvaft.Verdict", {**_ABOUT, "verdict": _TEXT, "verdicts": {"type": "object"}}),
}


class FoxgloveSink(Publisher):
    """Publishes to a `.mcap` file, complete once closed, or on a port (a number or `HOST:PORT`).

    A failure to write is reported to `warn` at once; `close` raises it as `OSError`. Raises
    `OptionError` for an invalid target or an unavailable port, `OSError` and `ToolMissing`.

    >>> import rvaft, tempfile
    >>> from pathlib import Path
    >>> tree = rvaft.loads("time t as s; top sand a b;")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     with FoxgloveSink(tree, f"{folder}/run.mcap") as sink:
    ...         step = sink.on_detection(semantics="scattered")
    ...         print([step({"event": name, "t": 7}).symbol for name in "ab"])
    ...     print([path.name for path in Path(folder).iterdir()])
    ['?', '⊤']
    ['run.mcap']
    """

    whole = True

    def __init__(
        self,
        tree: RVAFT,
        target: int | str | os.PathLike[str],
        *,
        name: str = "tree",
        key: Callable[[MonitoredTrace], Mapping[str, Json]] = lambda _: {},
        warn: Callable[[str], object] = lambda _: None,
    ) -> None:
        self._tree, self._name, self._key, self._warn = tree, name, key, warn
        self._failure: OSError | None = None
        found = port_of(target)
        remedy = "pip install '.[foxglove]' in a checkout of rvaft"
        sdk = installed("foxglove", "foxglove-sdk", remedy)
        context = self._context = sdk.Context()  # unreferenced contexts close their channels
        self._channels = {
            topic: sdk.Channel(topic, schema={"type": "object", "title": title, "properties": has}, context=context)
            for topic, (title, has) in _SCHEMAS.items()
        }
        self._file: _File | None = None
        if found is None:
            self._file = _File(Path(str(target)))
            self._open: Any = sdk.open_mcap(self._file, context=context)
            return
        host, port = found
        try:
            self._open = sdk.start_server(name=f"rvaft {name}", host=host, port=port, context=context)
        except (RuntimeError, ValueError) as error:
            reason = str(error).removeprefix("FoxgloveError: ")
            raise OptionError(f"no server for Foxglove at {host}:{port}: {reason}") from error
        self.url = f"ws://{host}:{self._open.port}"

    @classmethod
    def serves(cls, target: int | str | os.PathLike[str]) -> bool:
        """Whether the target is a port, not an MCAP file; raises `OptionError`."""
        return port_of(target) is not None

    def close(self) -> None:
        """Stop the server or finish the file; raises `OSError`."""
        if self._file is None:
            self._open.stop()
        elif not self._file.closed:
            with suppress(RuntimeError):
                self._open.close()
            self._file.finish()

    def on_detection(self, **options: Unpack[MonitorOptions]) -> Callable[[Json], Verdict]:
        """Return a function that reads one event and publishes detections.

        The options are those of `rvaft.on_detection`.
        """
        monitor, buffer = rvaft.monitor(self._tree, **options), EventBuffer()
        number, about = 0, {"tree": self._name}
        event: Json = {}

        def detected(explanation: Explanation | None) -> None:
            events = buffer.events(matched_events([explanation] if explanation else []))
            self._log(DETECTIONS, detection({**about, "event": number}, explanation, events, self._tree), event)

        inner = rvaft.on_detection(monitor, detected)

        def step(new: Json) -> Verdict:
            nonlocal number, event
            number, event, before = number + 1, new, monitor.verdict
            buffer.remember(number, new)
            verdict = inner(new)
            if verdict is not before and not (options.get("repeat") and verdict is Verdict.UNKNOWN):
                self._log(VERDICTS, {**about, "event": number, "verdict": verdict.value}, new)
            return verdict

        return step

    def change(self, change: VerdictChange) -> None:
        """Publish changed verdicts and detections."""
        watch, labels = change.watch, [column.label for column in change.watch.monitors.columns]
        again = {"again": True} if change.number <= self.reported_before else {}
        about = {"tree": self._name, "trace": watch.trace, **self._key(watch), "event": change.number, **again}
        each = {label: verdict.value for label, verdict in zip(labels, change.verdicts, strict=True)}
        verdicts = {"verdicts": each} if len(labels) > 1 else {}
        self._log(VERDICTS, {**about, "verdict": change.verdicts[0].value, **verdicts}, change.event)
        for explanation, _, count in change.detections:
            counted = {} if count is None else count.fields
            record = detection({**about, **counted}, explanation, change.events, self._tree)
            self._log(DETECTIONS, record, change.event)

    def _log(self, topic: str, message: Mapping[str, Json], event: Json) -> None:
        if self._failure is not None:
            return
        time = None if self._tree.time is None else self._tree.time.read(event)
        self._channels[topic].log(dict(message), log_time=time if time is not None and 0 <= time < 1 << 64 else None)
        if self._file is not None and (failure := self._file.failure) is not None:
            self._failure = failure
            self._warn(f"{self._file.path}: cannot be written: {failure.strerror}")


def port_of(target: int | str | os.PathLike[str]) -> tuple[str, int] | None:
    """Return host and port, or None for an MCAP file; raises `OptionError`.

    >>> port_of(8765), port_of("0.0.0.0:8765"), port_of("run.mcap")
    (('127.0.0.1', 8765), ('0.0.0.0', 8765), None)
    """
    text = str(target)
    host, _, port = text.rpartition(":")
    if Path(text).suffix.lower() == ".mcap":
        return None
    if not (port.isascii() and port.isdigit() and int(port) < 1 << 16):
        raise OptionError(f"{text!r} is neither a port (8765 or HOST:8765) nor a file named .mcap")
    return host or HOST, int(port)


class _File:
    def __init__(self, path: Path) -> None:
        self.path = path
        self.failure: OSError | None = None
        with error_context("cannot write", path):
            self._target = target_of(path)
            self._new, self._stream = temporary_beside(self._target)

    @property
    def closed(self) -> bool:
        return self._stream.closed

    def write(self, data: bytes) -> int:
        return self._unless_failed(lambda: self._stream.write(data), len(data))

    def flush(self) -> None:
        self._unless_failed(self._stream.flush, None)

    def seek(self, offset: int, whence: int = 0) -> int:
        return self._unless_failed(lambda: self._stream.seek(offset, whence), offset)

    def _unless_failed(self, do: Callable[[], Given], otherwise: Given) -> Given:
        """Call a function, or keep its failure, which the library would report repeatedly."""
        if self.failure is None:
            try:
                return do()
            except OSError as error:
                self.failure = error
        return otherwise

    def finish(self) -> None:
        """Move the file into place; on a failure remove it and raise `OSError`."""
        with error_context("cannot write", self.path):
            try:
                self.flush()
                with suppress(OSError):
                    self._stream.close()
                if self.failure is not None:
                    raise self.failure
                self._new.replace(self._target)
            except OSError:
                self._new.unlink(missing_ok=True)
                raise
