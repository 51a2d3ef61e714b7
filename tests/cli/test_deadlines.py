"""What did not happen, in logs that end, that fall silent, and that many entities write."""

import json
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from tests.cli.runs import jsonl, lines, run, started, written

BEAT = "semantics scattered; event beat(r) = {{ beat: r }}; time t as {form}; {lost}"
LOST = "lost on beat(Robot) without beat(Robot) for 2 s after;"
LOW = """semantics scattered; time t as s; event battery(u, p) = { u: u, p: p };
low on battery(U, P) when P < 20 without battery(U, Q) when Q >= 20 for 5 s after;"""


def tree(tmp_path: Path, text: str) -> Path:
    (file := tmp_path / "tree.rvaft").write_text(text, encoding="utf-8")
    return file


def log(tmp_path: Path, events: list[dict[str, Any]]) -> Path:
    (file := tmp_path / "log.jsonl").write_text(lines(events), encoding="utf-8")
    return file


def beats(*pairs: tuple[int | None, float]) -> list[dict[str, Any]]:
    return [{"t": time} | ({} if robot is None else {"beat": robot}) for robot, time in pairs]


@pytest.mark.parametrize(
    ("options", "detected"),
    [
        ([], []),
        (["--complete"], [(3, "end of the log")]),
        (["--repeat", "--complete"], [(3, "end of the log")]),
    ],
)
def test_the_end_of_a_log_decides_if_it_is_complete(
    tmp_path: Path, options: list[str], detected: list[tuple[int, str]]
) -> None:
    files = tree(tmp_path, BEAT.format(form="s", lost=LOST)), log(tmp_path, beats((1, 0), (1, 1), (1, 2)))
    found = jsonl(*files, "--detections", *options)
    assert [(one["event"], one["passed"]) for one in found] == detected


def test_a_later_time_of_any_event_decides(tmp_path: Path) -> None:
    files = tree(tmp_path, BEAT.format(form="s", lost=LOST)), log(tmp_path, beats((1, 0), (None, 2), (None, 2.5)))
    (found,) = jsonl(*files, "--detections")
    assert found["event"] == 3
    assert found["absent"] == [
        {"node": "lost", "event": "beat(Robot)", "side": "after", "duration": 2 * 10**9, "after": 1, "before": 3}
    ]
    text = run("monitor", *files).stdout
    assert "no beat(Robot) for 2 s after event 1, as event 3 shows (lost)" in text


@pytest.mark.parametrize("options", [[], ["--repeat"], ["--key", "beat", "--repeat"]])
def test_what_did_not_happen_is_kept_in_a_checkpoint(tmp_path: Path, options: list[str]) -> None:
    """A run that goes on from it, before and after a detection, says what a run over all events says."""
    events = beats((1, 0), (1, 1), (None, 4), (1, 5), (1, 6), (None, 9), (None, 10))
    file = tree(tmp_path, BEAT.format(form="s", lost=LOST))
    expected = jsonl(file, log(tmp_path, events), *options, "--detections")
    whole, kept = (tmp_path / "log.jsonl").read_text().splitlines(keepends=True), tmp_path / "kept"
    told: list[Any] = []
    for count in range(1, len(events) + 1):
        (tmp_path / "log.jsonl").write_text("".join(whole[:count]))
        told += jsonl(file, tmp_path / "log.jsonl", *options, "--detections", "--checkpoint", kept)
    assert told == expected
    assert expected[0]["absent"][0]["after"] in (1, 2)


def test_an_entity_that_sends_nothing_is_found_by_the_times_of_others(tmp_path: Path) -> None:
    events = beats((1, 0), (2, 0), (2, 1), (2, 2), (2, 3), (2, 4))
    files = tree(tmp_path, BEAT.format(form="s", lost=LOST)), log(tmp_path, events)
    found = jsonl(*files, "--key", "beat", "--detections")
    assert [(one["key"], one["event"], one["passed"]) for one in found] == [(1, 5, "event of another key")]


def test_a_reading_of_the_same_unit_ends_what_lasts(tmp_path: Path) -> None:
    readings = [(1, 10, 0), (2, 10, 0), (1, 15, 3), (2, 30, 3), (1, 12, 5), (3, 99, 6)]
    files = tree(tmp_path, LOW), log(tmp_path, [{"u": u, "p": p, "t": t} for u, p, t in readings])
    (found,) = jsonl(*files, "--detections")
    assert (found["event"], found["variables"]) == (6, {"U": 1, "P": 10})


def test_a_silent_log_is_decided_by_the_clock(tmp_path: Path) -> None:
    file = tree(tmp_path, BEAT.format(form="iso8601", lost=LOST.replace("2 s", "100 ms")))
    (path := tmp_path / "log.jsonl").touch()
    with started(
        "monitor", file, path, "--follow", "--clock", "100 ms", "--format", "jsonl", "--detections"
    ) as running:
        with path.open("a", encoding="utf-8") as stream:
            stream.write(json.dumps({"beat": 1, "t": datetime.now(tz=UTC).isoformat()}) + "\n")
        found = json.loads(running.stdout.readline())
    assert (found["event"], found["verdict"], found["variables"]) == (1, "true", {"Robot": 1})
    assert found["passed"].startswith("time ")


def test_a_log_with_another_clock_is_told(tmp_path: Path) -> None:
    file = tree(tmp_path, BEAT.format(form="s", lost=LOST))
    path = written(tmp_path / "log.jsonl", '{"beat": 1, "t": 5}\n')
    with started("monitor", file, path, "--follow", "--clock", "100 ms") as running:
        told = running.stderr.readline()
    assert "days before this machine's time: if t is of another clock, --clock ends every wait at once" in told


ATTACK = """semantics scattered; event failed(u) = { failed: u }; event entered(u) = { entered: u };
top sand f e; f on failed(U) times 2; e on entered(U);"""


def test_each_value_is_repeated_for_itself(tmp_path: Path) -> None:
    names = [("failed", 1), ("failed", 2), ("failed", 1), ("failed", 2), ("entered", 1), ("entered", 2), ("entered", 1)]
    files = tree(tmp_path, ATTACK), log(tmp_path, [{name: user} for name, user in names])
    found = {
        option: [(one["event"], one["variables"]["U"]) for one in jsonl(*files, *option.split(), "--detections")]
        for option in ("--repeat", "--repeat-by U")
    }
    assert found == {"--repeat": [(5, 1)], "--repeat-by U": [(5, 1), (6, 2)]}
    said = tree(tmp_path, f"repeat by U; {ATTACK}")
    assert [one["event"] for one in jsonl(said, files[1], "--repeat", "--detections")] == [5, 6]


@pytest.mark.parametrize(
    ("options", "why"),
    [
        (["--clock", "1s"], "--clock needs events that arrive"),
        (["--repeat-by", "V"], "matches cannot be repeated by V"),
        (["--repeat-by", "U", "--semantics", "projected"], "needs the semantics scattered"),
        (["--complete", "--backend", "ltlf"], "--complete is for monitors of the engine"),
    ],
)
def test_what_does_not_go_together_is_refused(tmp_path: Path, options: list[str], why: str) -> None:
    done = run("monitor", tree(tmp_path, ATTACK), log(tmp_path, [{"failed": 1}]), *options)
    assert done.exit_code == 2
    assert why in done.stderr
    assert "Traceback" not in done.output
