"""Bytes made for the places where reading quickly takes something for granted."""

import gzip
import io
import json
from io import BufferedIOBase
from pathlib import Path
from typing import Any, BinaryIO, cast

import pytest

from rvaft import loads
from rvaft.analysis.pattern_index import LONGEST, PatternIndex, TreeReads
from rvaft.errors import TraceError
from rvaft.monitoring import fast_reader, reader
from rvaft.monitoring.fast_reader import FastReader, LogBlock, Skeletons
from rvaft.monitoring.near_misses import EventTypeIndex, Statistics
from rvaft.monitoring.reader import MAX_DIGITS, read
from rvaft.support.files import opened
from tests.monitoring.test_fast_reader import GOOD, TREES, same


@pytest.mark.parametrize(
    ("known", "odd"),
    [
        (b'{"topic":"t","value":1,"x":2}', b'{"topic":"t","value":1,"x":' + b"9" * (MAX_DIGITS + 1) + b"}"),
        ('{"topic":"t","value":1,"x":"é"}'.encode(), b'{"topic":"t","value":1,"x":"\xc31\xa9"}'),
        (b'{"topic":"t","value":1,"x":"\\n"}', b'{"topic":"t","value":1,"x":"\\1n"}'),
        (b'{"topic":"t","value":1,"x":"\\\\"}', b'{"topic":"t","value":1,"x":"\\1\\"}'),
        (b'{"topic":"t","value":1,"x":true}', b'{"topic":"t","value":1,"x":tru}'),
        (b'{"topic":"t","value":1,"x":[1,2]}', b'{"topic":"t","value":1,"x":[1,]}'),
        (b'{"topic":"t","value":1}', b'{"topic":"t","value":1}5'),
        (b'{"topic":"t","value":1}', b'{"topic":"t","value":1e999}'),
    ],
)
def test_the_skeleton_of_a_good_line(known: bytes, odd: bytes) -> None:
    held = same(TREES["one"], b"\n".join([*[known] * 40, odd, known]), size=200)
    assert len(held.events) == 40
    assert str(held.error).startswith("log:41: ")


@pytest.mark.parametrize(
    "text",
    [
        b'{"topic":"t","value":1}{"x":1}\n{"topic":"t",\n"value":1}\n',
        b'{"topic":"t",\n"value":1}\n{"topic":"t","value":1}{"x":1}\n',
        b'{"x":1}{"x":1}\n\n',
    ],
)
def test_as_many_values_as_lines_but_not_one_on_each(text: bytes) -> None:
    held = same(TREES["one"], text)
    assert (held.events, str(held.error)[:7]) == ([], "log:1: ")


class _Failing(io.RawIOBase):
    """A file that can be read so far and no further."""

    def __init__(self, data: bytes) -> None:
        self._data = data

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        if not self._data:
            raise OSError(5, "Input/output error")
        taken, self._data = self._data[:100], self._data[100:]
        buffer[: len(taken)] = taken
        return len(taken)


@pytest.mark.parametrize("end", [b"", b"\n", b'\n{"topic":'])
@pytest.mark.parametrize("dense", [False, True])
def test_a_file_that_fails_midway(end: bytes, *, dense: bool) -> None:
    data = b"\n".join([GOOD, b"", *[GOOD] * 50]) + end
    with pytest.raises(TraceError) as slow:
        list(read(cast("BinaryIO", io.BufferedReader(cast("io.FileIO", _Failing(data)), 128)), name="log"))
    batches = FastReader.of(TreeReads(TREES["one"]))
    assert batches is not None
    batches._dense = dense
    counts: list[int] = []
    found = batches.read(io.BufferedReader(cast("io.FileIO", _Failing(data)), 128), "log")
    with pytest.raises(TraceError) as quick:
        counts.extend(batch.count for batch in found)
    lines = data.count(b"\n")
    assert str(quick.value) == str(slow.value) == f"log:{lines + 1}: cannot be read: Input/output error"
    assert sum(counts) == lines - 1


def test_skeletons_without_end_are_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fast_reader, "MEMORY", 20)
    monkeypatch.setattr(Skeletons, "FEW", 0)
    known = Skeletons([b'"topic"'])
    for number in range(30):
        lines = [json.dumps({chr(97 + number % 26) * (number + 1): place, "x" * place: 1}) for place in range(10)]
        assert known.count(LogBlock("\n".join(lines).encode())) == 10
        assert len(known._known) <= 20


def test_values_without_end_are_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rvaft.monitoring.fast_reader.MEMORY", 20)
    batches = FastReader.of(TreeReads(TREES["one"]))
    assert batches is not None
    text = b"\n".join(b'{"topic":"t%d"}' % (number % 70) for number in range(500))
    count = sum(batch.count for batch in batches.read(io.BytesIO(text), "log"))
    assert (count, len(batches._known) <= 20) == (500, True)


def test_the_longest_line(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (reader, fast_reader):
        monkeypatch.setattr(module, "MAX_LINE", 3000)
    for length, number in ((2999, None), (3000, None), (3001, 2), (9000, 2)):
        start = b'{"topic":"t","value":1,"x":"'
        line = start + b"a" * (length - len(start) - 2) + b'"}'
        held = same(TREES["one"], b"\n".join([GOOD, line, GOOD]), size=500)
        assert (held.error is None) == (number is None)
        assert len(held.events) == (3 if number is None else 1)


def test_a_line_of_blanks_can_be_too_long_too(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in ("rvaft.monitoring.reader", "rvaft.monitoring.fast_reader"):
        monkeypatch.setattr(f"{module}.MAX_LINE", 1000)
    good = b'{"topic":"t","value":1}\n'
    for blank in (b" " * 1001, b"\t" * 70_000, b" " * 200_000):
        held = same(TREES["one"], good + blank + b"\n" + good)
        assert held.error == "log:2: the line is longer than 0 MiB"
        assert len(held.events) == 1
    assert len(same(TREES["one"], good + b" " * 1000 + b"\n" + good).events) == 2
    assert len(same(TREES["one"], b"\xef\xbb\xbf" + good[:-1] + b" " * (1001 - len(good)) + b"\n" + good).events) == 2


@pytest.mark.parametrize("place", range(300, 3000, 100))
def test_damaged_data_is_read_up_to_the_damage(place: int, tmp_path: Path) -> None:
    log = tmp_path / "log.gz"
    lines = b"".join(b'{"topic":"t","value":%d,"x":"%x"}\n' % (n, n * 2654435761 % 2**32) for n in range(2000))
    data = bytearray(gzip.compress(lines))
    data[place] ^= 16
    log.write_bytes(data)
    outcomes = []
    for quick in (False, True):
        count, error = 0, ""
        try:
            with opened(log) as stream:
                if quick:
                    batches = FastReader.of(TreeReads(TREES["one"]))
                    assert batches is not None
                    for batch in batches.read(cast("BufferedIOBase", stream), str(log)):
                        count += batch.count
                else:
                    for _ in read(stream, name=str(log), reads=TreeReads(TREES["one"])):
                        count += 1
        except TraceError as failure:
            error = str(failure)
        outcomes.append((count, error))
    assert outcomes[0] == outcomes[1]
    assert outcomes[0][1]


def test_long_strings_are_not_remembered() -> None:
    tree = loads('event a() = { topic: "t", data: "stop" }; toplevel r; r and x y; x on a(); y;')
    shapes = PatternIndex([tree.pattern("x")], lambda decided: decided)  # type: ignore[list-item]
    statistics, reads = Statistics(EventTypeIndex(tree)), TreeReads(tree)
    batches = FastReader.of(reads)
    assert batches is not None
    for number in range(50):
        event = {"topic": f"{number}" + "x" * LONGEST, "data": f"{number}" + "x" * LONGEST}
        assert shapes.of(event) == ((), ())
        statistics.add(event, number)
        list(batches.read(io.BytesIO(json.dumps(event).encode()), "log"))
    assert not shapes._memory
    assert not batches._known
    assert not statistics._looked_at
