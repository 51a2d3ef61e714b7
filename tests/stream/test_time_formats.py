"""Every format of times on the whole path: files read in blocks, checkpoints, the year as an option."""

import json
from pathlib import Path
from random import Random

import pytest

import rvaft
from cross_check.generate.times import FORMATS, TODAY, written
from rvaft.model.event_time import EventTime, TextFormat, TimeFormat
from rvaft.readers.json_lines import decode
from rvaft.semantics.events import time_of
from tests.cli.runs import jsonl, run

STATED = [*FORMATS, TextFormat("%A, %B %d %Y %H:%M"), TextFormat("%H%M%S %m/%d", 2024, "America/New_York")]


@pytest.mark.parametrize("form", STATED, ids=str)
def test_a_log_is_monitored_as_the_reference_reads_it(form: TimeFormat | TextFormat, tmp_path: Path) -> None:
    random, time = Random(str(form)), EventTime(("t",), form)
    tree = f"time t as {form}; semantics scattered; top sand a b within 90 s;"
    steps = [random.randrange(1, 4 * 10**10) for _ in range(400)]
    events = [
        {"event": random.choice("abc"), "t": written(random, form, TODAY + sum(steps[:end]), plain=False)}
        for end in range(len(steps))
    ]
    assert [time.read(event) for event in events] == [time_of(time, event) for event in events]
    (tmp_path / "tree.rvaft").write_text(tree)
    log = tmp_path / "log.jsonl"
    log.write_text("".join(f"{json.dumps(event)}\n" for event in events))
    whole = _detected(tmp_path / "tree.rvaft", log)
    monitor = rvaft.monitor(rvaft.loads(tree))
    assert whole[0] == next(number for number, event in enumerate(events, 1) if monitor.step(event).symbol == "⊤")
    begun, state = tmp_path / "begun.jsonl", tmp_path / "state.ckpt"
    lines, parts = log.read_text().splitlines(keepends=True), list[int]()
    for end in (150, len(lines)):
        begun.write_text("".join(lines[:end]))
        parts += _detected(tmp_path / "tree.rvaft", begun, "--checkpoint", state)
    assert parts == whole


@pytest.mark.parametrize(
    ("form", "text", "iso"),
    [
        (TextFormat("%Y-%m-%d %H:%M", zone="+02:00"), "0001-01-01 00:30", "0001-01-01T00:30+02:00"),
        (TextFormat("%Y-%m-%d %H:%M", zone="-05:30"), "9999-12-31 23:30", "9999-12-31T23:30-05:30"),
        (TextFormat("%Y-%m-%d %H:%M", zone="Asia/Tokyo"), "0001-01-01 00:30", None),
        (TextFormat("%Y-%m-%d %H:%M", zone="America/New_York"), "9999-12-31 23:30", "9999-12-31T23:30-05:00"),
        (TextFormat("%Y-%m-%d %H:%M %z"), "0001-01-01 00:30 +0200", "0001-01-01T00:30+02:00"),
        (TextFormat("%Y-%m-%d %H:%M %z"), "2026-01-01 00:30 z", "2026-01-01T00:30z"),
        (TextFormat("%d.%m.%y %H:%M"), "31.12.68 23:30", "2068-12-31T23:30"),
        (TextFormat("%d.%m.%y %H:%M"), "01.01.69 00:30", "1969-01-01T00:30"),
        (TextFormat("%y%m%d%H%M"), "2603020800", "2026-03-02T08:00"),
        (TextFormat("%Y-%m-%d %H:%M%z"), "2026-01-01 00:30Z", "2026-01-01T00:30Z"),
        (TextFormat("%Y-%m-%d %H:%M", zone="Europe/Berlin"), "2026-03-29 02:30", "undefined"),
        (TextFormat("%Y-%m-%d %H:%M", zone="Europe/Berlin"), "2026-10-25 02:30", "2026-10-25T02:30+02:00"),
    ],
)
def test_a_strptime_format_reads_what_iso8601_does(form: TextFormat, text: str, iso: str | None) -> None:
    time = EventTime(("t",), form)
    found = time.read({"t": text})
    assert found == time_of(time, {"t": text})
    if iso is not None:
        assert found == EventTime(("t",), TimeFormat.ISO8601).read({"t": iso})
    assert (found is None) is (iso == "undefined")


@pytest.mark.parametrize("zeros", [0, 990, 5_000, 10_000])
@pytest.mark.parametrize(("number", "less", "more"), [("2.0000000005", 2 * 10**9, 1), ("1.0000000015", 10**9 + 2, 0)])
def test_a_number_is_rounded_once(number: str, less: int, more: int, zeros: int) -> None:
    """Half to even, and up where a digit follows, however far behind it is."""
    time = EventTime(("t",), TimeFormat.SECONDS)

    def nanoseconds(text: str) -> int | None:
        return time.read(decode(f'{{"t": {text}}}'.encode()))

    assert nanoseconds(number + "0" * zeros) == less
    assert nanoseconds(f"{number}{'0' * zeros}1") == less + more
    assert nanoseconds(f"-{number}{'0' * zeros}1") == -less - more


def _detected(*args: object) -> list[int]:
    return [one["event"] for one in jsonl(*args, "--repeat") if one["verdict"] == "true" and "event" in one]


def test_the_year_is_an_option(tmp_path: Path) -> None:
    tree, log = tmp_path / "tree.rvaft", tmp_path / "log.jsonl"
    tree.write_text('time t as "%b %d %H:%M:%S"; semantics scattered; top sand a b within 1 d;')
    log.write_text('{"event": "a", "t": "Feb 28 23:00:00"}\n{"event": "b", "t": "Feb 29 01:00:00"}\n')
    refused = run("monitor", tree, log)
    assert refused.exit_code == 2
    assert "`year 2026`" in refused.stderr
    assert "--year" in refused.stderr
    assert run("monitor", tree, log, "--year", "2024").exit_code == 1
    assert run("monitor", tree, log, "--year", "2026").exit_code == 0
    assert "Feb 29" in run("monitor", tree, log, "--year", "2026").stdout, "the time cannot be read"
    emitted = run("emit", tree, "--to", "sql", "--year", "2024")
    assert '-- time ["t"] as "%b %d %H:%M:%S" year 2024' in emitted.stdout
    assert rvaft.load(tree, year=2024).time == rvaft.loads(tree.read_text(), year=2024).time
    with pytest.raises(TypeError):
        rvaft.load(tree, yaer=2024)  # type: ignore[call-arg]


def test_text_formats_are_inferred(tmp_path: Path) -> None:
    log = tmp_path / "log.jsonl"
    log.write_text('{"event": "a", "ts": "Mar  1 10:00:00"}\n{"event": "a", "ts": "Mar 12 10:00:00"}\n')
    assert "no candidate" in run("fields", log).stdout
    assert 'time ts as "%b %d %H:%M:%S" year 2026' in run("fields", log, "--year", "2026").stdout
    log.write_text('{"event": "a", "ts": 134169120000000000}\n')
    assert "time ts as filetime" in run("fields", log).stdout
