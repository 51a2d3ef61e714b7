"""What every monitor does, whichever way it was made."""

from typing import Any

import pytest

from rvaft import Monitor, Semantics, ToolMissing, TraceError, Verdict, all_backends, loads
from rvaft.backend import backend
from rvaft.engine import Engine
from rvaft.semantics import Reference

TREE = loads("top sand a b;")


def monitor(name: str) -> Monitor:
    if name == "engine":
        return Engine(TREE, Semantics.STRICT)
    if name == "reference":
        return Reference(TREE, Semantics.STRICT)
    try:
        return backend(name).translate(TREE, Semantics.STRICT).monitor()
    except ToolMissing as missing:
        pytest.skip(str(missing))


ALL_VERDICTS = [name for name in all_backends() if Verdict.FALSE in backend(name).verdicts]


@pytest.mark.parametrize("name", ["engine", "reference", *ALL_VERDICTS])
class TestAnyMonitor:
    @pytest.mark.parametrize("event", ['{"event": "a"}', b"{}", [], 5, None, [{"event": "a"}]])
    def test_only_objects_are_events(self, name: str, event: Any) -> None:
        watching = monitor(name)
        with pytest.raises(TraceError, match="decode the line first"):
            watching.step(event)
        assert watching.verdict is Verdict.UNKNOWN
        assert watching.step({"event": "a"}) is Verdict.UNKNOWN
        assert watching.step({"event": "b"}) is Verdict.TRUE

    def test_a_final_verdict_stays(self, name: str) -> None:
        watching = monitor(name)
        assert list(watching.run([{"event": "b"}, {"event": "a"}, {"event": "b"}])) == [Verdict.FALSE] * 3

    def test_equal_states_after_equal_traces(self, name: str) -> None:
        one, other = monitor(name), monitor(name)
        assert one.state == other.state
        one.step({"event": "a"})
        assert one.state != other.state
        other.step({"event": "a", "more": 1})
        assert one.state == other.state
        assert hash(one.state) == hash(other.state)
