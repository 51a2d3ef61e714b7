"""Bytes made for the places where reading quickly takes something for granted."""

import io
import json
from typing import Any, BinaryIO, cast

import pytest

from rvaft.errors import TraceError
from rvaft.fast import skeletons
from rvaft.fast.batches import Batches
from rvaft.fast.blocks import Block
from rvaft.fast.skeletons import Skeletons
from rvaft.reads import TreeReads
from rvaft.traces import BOM, MAX_DIGITS, read
from tests.fast.test_batches import GOOD, TREES, Held, same


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


def test_a_mark_in_front_of_a_later_block() -> None:
    for size in (1, len(GOOD) + 1, 1000):
        held = same(TREES["one"], GOOD + b"\n" + BOM + GOOD + b"\n", size=size)
        assert (len(held.events), str(held.error)[:7]) == (1, "log:2: ")


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
    batches = Batches.of(TreeReads(TREES["one"]))
    assert batches is not None
    batches._dense = dense
    counts: list[int] = []
    found = batches.read(io.BufferedReader(cast("io.FileIO", _Failing(data)), 128), "log", lambda _: 0)
    with pytest.raises(TraceError) as quick:
        counts.extend(batch.count for batch in found)
    lines = data.count(b"\n")
    assert str(quick.value) == str(slow.value) == f"log:{lines + 1}: cannot be read: Input/output error"
    assert sum(counts) == lines - 1


def test_skeletons_without_end_are_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(skeletons, "MEMORY", 20)
    monkeypatch.setattr(skeletons, "_FEW", 0)
    known = Skeletons([b'"topic"'], lambda line: isinstance(json.loads(line), dict))
    for number in range(30):
        lines = [json.dumps({chr(97 + number % 26) * (number + 1): place, "x" * place: 1}) for place in range(10)]
        assert known.count(Block("\n".join(lines).encode())) == 10
        assert len(known._known) <= 20


def test_values_without_end_are_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rvaft.fast.batches.MEMORY", 20)
    batches = Batches.of(TreeReads(TREES["one"]))
    assert batches is not None
    text = b"\n".join(b'{"topic":"t%d"}' % (number % 70) for number in range(500))
    count = sum(batch.count for batch in batches.read(io.BytesIO(text), "log", lambda _: 0))
    assert (count, len(batches._known) <= 20) == (500, True)


def test_nothing_at_all() -> None:
    assert same(TREES["one"], b"") == same(TREES["one"], BOM) == same(TREES["one"], b"\n \r\n") == Held([], None)
