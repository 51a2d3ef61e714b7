"""Events that come by themselves, watched for a tree: as an asynchronous loop, or by a function
that other code calls.
"""

from collections.abc import AsyncIterable, AsyncIterator, Callable, Coroutine, Iterable
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

_AWAITED: Final = "a plain function, since nothing here awaits it (rvaft.watch is for asynchronous code)"


class MonitorOptions(TypedDict, total=False):
    """The options of `rvaft.monitor`."""

    semantics: Semantics | str | None
    branch: int | None
    kind: Kind | str | None
    limit: int
    repeat: bool


def watch(
    tree: RVAFT | Monitor, events: AsyncIterable[Event] | Iterable[Event], **options: Unpack[MonitorOptions]
) -> AsyncIterator[tuple[Event, Verdict]]:
    """The events as they come, each with the verdict after it: for `async for event, verdict in …`.

    The options are those of `rvaft.monitor`; in place of a tree a monitor may stand, which then
    goes on from where it is, and can be asked for its explanation afterwards. An event is not read
    before the one before it has been dealt with, and events go on after a final verdict. Iterating
    over what is not asynchronous never waits, so other tasks run only where the loop's body lets
    them.

    Raises what `rvaft.monitor` raises, and `WrongType` for events that cannot be iterated over, at
    once; while events are read, `TraceError` for what is no JSON object, and `TooLarge`.

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
) -> Callable[[Json], Verdict]:
    """A function to be called with each event, which gives the verdict and calls back on detection,
    with the explanation.

    Made for code that delivers events by calling, such as a subscriber to a topic. The options and
    errors are those of `watch`; what the callback raises comes out of the call with the detecting
    event, and the verdict stands. A monitor that has detected already does not call back again,
    unless it repeats. Nothing here could await a callback, so an `async def` is refused with
    `WrongType`: at once, or on detection where only what it returns shows it.

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

    def step(event: Json) -> Verdict:
        before = watching.detections
        verdict = watching.step(event)
        if watching.detections > before:
            told = callback(watching.explanation)
            if isinstance(told, Coroutine):
                told.close()  # else Python warns of it, later and elsewhere
                raise WrongType("callback", callback, _AWAITED)
        return verdict

    return step


def _watching(tree: RVAFT | Monitor, options: MonitorOptions) -> Monitor:
    """The monitor given, or a fresh one."""
    if not isinstance(tree, Monitor):
        return monitor(tree, **options)
    if options:
        raise OptionError("a monitor has its options already: give them to rvaft.monitor")
    return tree
