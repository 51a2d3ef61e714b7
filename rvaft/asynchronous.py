"""Monitoring of live events: as an asynchronous loop, or by a function that other code calls."""

from collections.abc import AsyncIterable, AsyncIterator, Callable, Coroutine, Iterable
from datetime import datetime
from inspect import iscoroutinefunction
from typing import Final, TypedDict, TypeVar, Unpack

from rvaft.api import monitor
from rvaft.errors import OptionError, WrongType, expect
from rvaft.model.nodes import Kind
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import Explanation, Monitor

Event = TypeVar("Event", bound=Json)

_AWAITED: Final = "a synchronous function (use rvaft.watch in asynchronous code)"


class MonitorOptions(TypedDict, total=False):
    """The options of `rvaft.monitor`."""

    semantics: Semantics | str | None
    branch: int | None
    kind: Kind | str | None
    limit: int
    repeat: bool
    repeat_by: str | None


def watch(
    tree: RVAFT | Monitor, events: AsyncIterable[Event] | Iterable[Event], **options: Unpack[MonitorOptions]
) -> AsyncIterator[tuple[Event, Verdict]]:
    """Yield each event with the verdict after it, for an `async for` loop.

    The options are those of `rvaft.monitor`. A monitor in place of a tree continues from its state.
    Each event is read only after the previous one was processed, and events continue after a final
    verdict. With a synchronous iterable, other tasks run only if the body of the loop awaits.

    Raises the errors of `rvaft.monitor`, and `WrongType`, at once; `TraceError` and `TooLarge`
    while events are read.

    >>> import asyncio, rvaft
    >>> async def verdicts(events):
    ...     return [verdict.symbol async for _, verdict in watch(rvaft.loads("top and a b;"), events)]
    >>> asyncio.run(verdicts([{"event": "b"}, {"event": "a"}]))
    ['?', '⊤']
    """
    watching = _watching(tree, options)
    expect("events", events, AsyncIterable | Iterable, "an iterable, or an asynchronous one")

    async def watched() -> AsyncIterator[tuple[Event, Verdict]]:
        if isinstance(events, AsyncIterable):
            async for event in events:
                yield event, watching.step(event)
        else:
            for event in events:
                yield event, watching.step(event)

    return watched()


def on_detection(
    tree: RVAFT | Monitor, callback: Callable[[Explanation | None], object], **options: Unpack[MonitorOptions]
) -> "Subscriber":
    """Return a function that reads an event, returns the verdict, and calls `callback` on a
    detection. Its method `pass_time` does so for a time that has come without an event.

    It suits code that delivers events by calls, such as a ROS subscriber. Options and errors are
    those of `watch`. Exceptions of the callback propagate to the caller. After a detection there is
    no further call, unless the monitor repeats. An `async def` callback is refused with
    `WrongType`: at once, or at a detection if only its result is a coroutine.

    >>> import rvaft
    >>> step = on_detection(rvaft.loads("top and a b;"), lambda explanation: print(explanation.events))
    >>> [step({"event": name}).symbol for name in "ba"]
    {'b': [1], 'a': [2]}
    ['?', '⊤']
    """
    watching = _watching(tree, options)
    if not callable(callback):
        raise WrongType("callback", callback, "a function of the explanation")
    if iscoroutinefunction(callback):
        raise WrongType("callback", callback, _AWAITED)

    return Subscriber(watching, callback)


class Subscriber:
    """A monitor that code calls with events, and that calls other code on a detection."""

    def __init__(self, watching: Monitor, callback: Callable[[Explanation | None], object]) -> None:
        self._watching, self._callback = watching, callback

    def __call__(self, event: Json) -> Verdict:
        """Read an event and return the verdict."""
        before = self._watching.detections
        return self._tell(before, self._watching.step(event))

    def pass_time(self, time: Json | datetime) -> Verdict:
        """Tell the monitor that a time has come, as `Monitor.pass_time` does, and return the verdict."""
        before = self._watching.detections
        return self._tell(before, self._watching.pass_time(time))

    def _tell(self, before: int, verdict: Verdict) -> Verdict:
        if self._watching.detections > before:
            result = self._callback(self._watching.explanation)
            if isinstance(result, Coroutine):
                result.close()  # avoids a later warning of Python
                raise WrongType("callback", self._callback, _AWAITED)
        return verdict


def _watching(tree: RVAFT | Monitor, options: MonitorOptions) -> Monitor:
    if not isinstance(tree, Monitor):
        return monitor(tree, **options)
    if options:
        raise OptionError("pass options to rvaft.monitor: an existing monitor accepts none")
    return tree
