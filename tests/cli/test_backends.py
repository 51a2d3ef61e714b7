"""`rvaft monitor --backend` on finished logs: the verdicts of the engine, with few evaluations of the log."""

import json
import random
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from rvaft.errors import TraceError
from rvaft.monitors import AHEAD, DetectionMonitor, Repetition
from tests.cli.runs import jsonl, run

TREE = """
event x(u) = { event: "x", u: u }; event y(u) = { event: "y", u: u };
semantics scattered; time t as s; top sand a b within 3 s; a on x(U); b on y(U);
"""
WORD = "ab" * AHEAD + "d" + "abc" * AHEAD


class Asked:
    """The first `d`, and an error after an `!`; it counts the traces."""

    def __init__(self) -> None:
        self.events: list[int] = []

    def __call__(self, traces: Sequence[Sequence[Any]]) -> list[int | None]:
        found: list[int | None] = []
        for trace in traces:
            self.events.append(len(trace))
            names = "".join(event["event"] for event in trace)
            if "!" in names:
                raise TraceError("an event that the language does not know")
            found.append(names.find("d") + 1 or None)
        return found


def events(word: str) -> list[dict[str, str]]:
    return [{"event": name} for name in word]


def test_announced_events_are_evaluated_a_few_times() -> None:
    asked = Asked()
    verdicts = [verdict.symbol for verdict in DetectionMonitor(asked).run(events(WORD))]
    place = WORD.index("d")
    assert verdicts == ["?"] * place + ["⊤"] * (len(WORD) - place)
    assert sum(asked.events) < 4 * place + AHEAD


@pytest.mark.parametrize(
    "word", ["", "a", "d", "ada", WORD, f"{WORD}!", f"{'a' * 700}!d", f"{'a' * 300}d!", "!", "aa!"]
)
def test_announced_events_have_the_verdicts_of_other_events(word: str) -> None:
    def verdicts(*, announced: bool) -> list[str]:
        monitor, found = DetectionMonitor(Asked()), list[str]()
        if announced:
            monitor.expect(events(word)[: len(word) - 3])  # further events may come
        try:
            found.extend(monitor.step(event).symbol for event in events(word))
        except TraceError as error:
            found.append(str(error))
        return found

    assert verdicts(announced=True) == verdicts(announced=False)


def test_repetitions_go_on_with_the_announced_events() -> None:
    asked, word = Asked(), ("a" * 500 + "d") * 5
    repeated = Repetition(DetectionMonitor(asked))
    repeated.expect(events(word))
    assert "".join(repeated.step(event).symbol for event in events(word)) == ("?" * 500 + "⊤") * 5
    assert sum(asked.events) < 4 * len(word)


@pytest.mark.parametrize("options", [[], ["--repeat"], ["--key", "u"], ["--key", "u", "--repeat"], ["--order-by", "t"]])
@pytest.mark.parametrize("backend", ["sql", "eql"])
def test_backends_have_the_verdicts_of_the_engine(backend: str, options: list[str], tmp_path: Path) -> None:
    if backend == "eql":
        pytest.importorskip("eql", reason="eql is not installed")
    tree, log, draw = tmp_path / "tree.rvaft", tmp_path / "log.jsonl", random.Random(1)
    tree.write_text(TREE)
    shuffle = "--order-by" in options
    times = [number + draw.choice([0, 3]) * shuffle for number in range(2 * AHEAD)]
    lines = [{"event": draw.choice("xyzz"), "u": draw.randrange(40), "t": time} for time in times]
    log.write_text("".join(f"{json.dumps(line)}\n" for line in lines))
    found = jsonl(tree, log, "--backend", backend, *options)
    told = [(line["event"], line.get("key"), line["verdict"]) for line in jsonl(tree, log, *options)]
    assert [(line["event"], line.get("key"), line["verdict"]) for line in found] == told
    assert any(verdict == "true" for _, _, verdict in told)


def test_an_error_follows_the_events_before_it(tmp_path: Path) -> None:
    tree, log = tmp_path / "tree.rvaft", tmp_path / "log.jsonl"
    tree.write_text(TREE)
    log.write_text('{"event": "x", "u": 1, "t": 1}\n{"event": "y", "u": 1, "t": 2}\nno JSON\n')
    done = run("monitor", tree, log, "--backend", "sql")
    assert done.exit_code == 2
    assert "event 2: true" in done.stdout
    assert "log.jsonl:3: not JSON" in done.stderr


@pytest.mark.parametrize(("backend", "warned"), [("sql", True), ("automaton", False)])
def test_events_that_come_one_by_one_are_evaluated_up_to_a_limit(
    backend: str, warned: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rvaft.monitors.LIVE", 2)
    (tree := tmp_path / "tree.rvaft").write_text("top sand x y z;")
    events = "".join(f'{{"event": "{name}"}}\n' for name in "xyz")
    done = run("monitor", tree, "-", "--backend", backend, "--semantics", "scattered", data=events)
    assert ("the backend evaluates all events of <stdin> after each event" in done.stderr) is warned
    assert ("which are all evaluated after each event (limit 2)" in done.stderr) is warned
    assert done.exit_code == (2 if warned else 1)
    file = tmp_path / "log.jsonl"
    file.write_text(events)
    for trace in ([file], ["--word", "x y z"]):
        whole = run("monitor", tree, *trace, "--backend", backend, "--semantics", "scattered")
        assert "warning: the backend" not in whole.stderr
        assert whole.exit_code == 1
