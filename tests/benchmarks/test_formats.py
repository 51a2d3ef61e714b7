"""What it costs to monitor a log that is no JSON Lines, beside what it costs to read it with the library alone."""

import contextlib
import csv
import io
import json
from collections import deque
from collections.abc import Callable
from pathlib import Path
from time import process_time

import pytest

from rvaft.cli import main
from tests.benchmarks.logs import TREE, telemetry
from tests.readers.samples import write_telemetry

pytestmark = pytest.mark.benchmark

MESSAGES = 20_000


def shortest(call: Callable[[], object], rounds: int) -> float:
    """Seconds of the processor, which others do not take part in."""

    def taken() -> float:
        start = process_time()
        call()
        return process_time() - start

    return min(taken() for _ in range(rounds))


def monitoring(log: Path) -> Callable[[], None]:
    def run() -> None:
        with contextlib.redirect_stdout(io.StringIO()) as said:
            main(["monitor", str(TREE), str(log)], standalone_mode=False)
        assert f"events read: {MESSAGES}" in said.getvalue()

    return run


def test_a_recording_is_monitored_as_fast_as_it_is_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """At least 0.8 times as fast as `rosbags` alone decodes all its messages."""
    highlevel = pytest.importorskip("rosbags.highlevel")
    write_telemetry(tmp_path / "bag", MESSAGES)

    def alone() -> None:
        with highlevel.AnyReader([tmp_path / "bag"]) as bag:
            deque((bag.deserialize(data, one.msgtype) for one, _, data in bag.messages()), maxlen=0)

    monitored, read = shortest(monitoring(tmp_path / "bag"), 5), shortest(alone, 5)
    with capsys.disabled():
        print(
            f"\n{MESSAGES:,} messages: {read:.3f} s read alone, {monitored:.3f} s monitored: {read / monitored:.2f} x"
        )
    assert read / monitored > 0.8


def test_other_formats(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The events of one log as lines, as a document, as a table and as a table in Parquet; asserted
    is the order of magnitude.
    """
    pa, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    lines = telemetry(tmp_path / "log.jsonl", MESSAGES).file
    events = [json.loads(line) for line in lines.read_bytes().splitlines()]
    names = list(dict.fromkeys(name for event in events for name in event))
    (tmp_path / "log.json").write_text(json.dumps(events), encoding="utf-8")
    with (tmp_path / "log.csv").open("w", newline="", encoding="utf-8") as stream:
        table = csv.DictWriter(stream, names)
        table.writeheader()
        table.writerows(events)
    texts = [{name: str(event[name]) for name in ("topic", "name") if name in event} for event in events]
    parquet.write_table(pa.Table.from_pylist(texts), tmp_path / "log.parquet")
    taken = {form: shortest(monitoring(tmp_path / f"log.{form}"), 3) for form in ("jsonl", "json", "csv", "parquet")}
    with capsys.disabled():
        print(f"\n{MESSAGES:,} events:", ", ".join(f"{form} {seconds:.3f} s" for form, seconds in taken.items()))
    assert max(taken.values()) < 40 * taken["jsonl"]
