"""Events that come by themselves, watched for a tree."""

import asyncio
import pickle
from collections.abc import AsyncIterator, Iterable
from typing import Any

import pytest

import rvaft
from rvaft import Verdict

TREE = rvaft.loads("top sand a b;")
A, B, X = ({"event": name} for name in "abx")


async def slowly(events: Iterable[dict[str, str]]) -> AsyncIterator[dict[str, str]]:
    """The events one by one, other tasks in between."""
    for event in events:
        await asyncio.sleep(0)
        yield event


async def verdicts(tree: Any, events: Any, **options: Any) -> list[tuple[Any, Verdict]]:
    return [pair async for pair in rvaft.watch(tree, events, **options)]


@pytest.mark.parametrize("given", [list, iter, slowly])
def test_each_event_comes_with_its_verdict(given: Any) -> None:
    found = asyncio.run(verdicts(TREE, given([A, X, B, A])))
    assert found == [(A, "unknown"), (X, "unknown"), (B, "true"), (A, "true")]


def test_the_options_are_those_of_a_monitor() -> None:
    assert asyncio.run(verdicts(TREE, [A, X, B], semantics="strict"))[-1] == (B, "false")
    tree = rvaft.loads("top or a b; b attack;")
    assert [v for _, v in asyncio.run(verdicts(tree, [A, B], kind="attack"))] == ["false", "false"]
    assert [v for _, v in asyncio.run(verdicts(tree, [A, B], branch=1))] == ["true", "true"]


def test_nothing_is_read_ahead() -> None:
    read: list[str] = []

    def source() -> Iterable[dict[str, str]]:
        for event in (A, X, B):
            read.append(event["event"])
            yield event

    async def until_x() -> None:
        async for event, _ in rvaft.watch(TREE, source()):
            if event == X:
                break

    asyncio.run(until_x())
    assert read == ["a", "x"]


def test_a_monitor_goes_on_where_it_is() -> None:
    monitor = rvaft.monitor(TREE, semantics="strict")
    asyncio.run(verdicts(monitor, [A]))
    resumed = pickle.loads(pickle.dumps(monitor))
    assert asyncio.run(verdicts(resumed, slowly([B]))) == [(B, "true")]
    assert resumed.explanation.events == {"a": [1], "b": [2]}
    assert monitor.verdict is Verdict.UNKNOWN


def test_a_callback_is_called_once() -> None:
    told: list[rvaft.Explanation | None] = []
    step = rvaft.on_detection(TREE, told.append, semantics="scattered")
    assert [step(event) for event in (B, A)] == ["unknown", "unknown"]
    assert told == []
    assert [step(event) for event in (B, B)] == ["true", "true"]
    assert [explanation and explanation.events for explanation in told] == [{"a": [2], "b": [3]}]


def test_a_repetition_detects_and_calls_back_again() -> None:
    told: list[rvaft.Explanation | None] = []
    step = rvaft.on_detection(TREE, told.append, semantics="consecutive", repeat=True)
    found = asyncio.run(verdicts(TREE, [A, B, B, A, B, X], semantics="consecutive", repeat=True))
    assert [step(event) for event, _ in found] == [verdict for _, verdict in found]
    assert "".join(verdict.symbol for _, verdict in found) == "?⊤??⊤?"
    assert [explanation and explanation.events for explanation in told] == [{"a": [1], "b": [2]}, {"a": [4], "b": [5]}]
    one = rvaft.on_detection(rvaft.monitor(rvaft.loads("top or a b;"), repeat=True), told.append)
    assert [one(event) for event in (A, A, B)] == ["true"] * 3
    assert len(told) == 5


def test_a_failing_callback_is_not_hidden_and_the_verdict_stands() -> None:
    def fail(explanation: rvaft.Explanation | None) -> None:
        raise RuntimeError("no recovery")

    monitor = rvaft.monitor(TREE)
    step = rvaft.on_detection(monitor, fail)
    step(A)
    with pytest.raises(RuntimeError, match="no recovery"):
        step(B)
    assert monitor.verdict is Verdict.TRUE
    assert step(B) is Verdict.TRUE


def test_a_callback_that_would_have_to_be_awaited_is_refused() -> None:
    """At once where it can be seen, else on detection; the verdict stands."""

    async def stop(explanation: rvaft.Explanation | None) -> None:
        raise AssertionError(explanation)

    with pytest.raises(rvaft.WrongType, match=r"callback must be a synchronous function.*rvaft\.watch"):
        rvaft.on_detection(TREE, stop)

    class Stop:
        async def __call__(self, explanation: rvaft.Explanation | None) -> None:
            raise AssertionError(explanation)

    monitor = rvaft.monitor(TREE)
    step = rvaft.on_detection(monitor, Stop())
    step(A)
    with pytest.raises(rvaft.WrongType, match="synchronous function"):
        step(B)
    assert monitor.verdict is step(B) is Verdict.TRUE


@pytest.mark.parametrize(
    "verb", [lambda *a, **k: rvaft.watch(a[0], [], **k), lambda *a, **k: rvaft.on_detection(a[0], print, **k)]
)
def test_what_is_wrong_is_said_at_once(verb: Any) -> None:
    with pytest.raises(rvaft.WrongType, match="tree must be"):
        verb("trees/fire.rvaft")
    with pytest.raises(rvaft.OptionError, match="unknown semantics"):
        verb(TREE, semantics="weak")
    with pytest.raises(rvaft.TreeError, match="branch 7"):
        verb(TREE, branch=7)
    for option in ({"semantics": "strict"}, {"branch": 1}, {"kind": "fault"}, {"limit": 5}, {"repeat": True}):
        with pytest.raises(rvaft.OptionError, match="an existing monitor accepts none"):
            verb(rvaft.monitor(TREE), **option)


def test_wrong_events_and_callbacks() -> None:
    with pytest.raises(rvaft.WrongType, match="events must be an iterable, or an asynchronous one, not int"):
        rvaft.watch(TREE, 3)  # type: ignore[arg-type]
    with pytest.raises(rvaft.WrongType, match="callback must be a function of the explanation, not str"):
        rvaft.on_detection(TREE, "print")  # type: ignore[arg-type]
    with pytest.raises(rvaft.TraceError, match="2: an event is a JSON object"):
        asyncio.run(verdicts(TREE, slowly([A, "b"])))  # type: ignore[list-item]
