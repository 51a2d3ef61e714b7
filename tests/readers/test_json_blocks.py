"""Reading many lines at a time gives what reading them one by one gives, whatever the bytes."""

import gzip
import io
import json
import math
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from io import BufferedIOBase
from pathlib import Path
from typing import Any, BinaryIO, cast

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from rvaft import RVAFT, TraceError, loads
from rvaft.core.fields_to_read import TreeReads
from rvaft.core.pattern_index import LONGEST_TEXT, PatternIndex
from rvaft.model.patterns import ObjectPattern, match
from rvaft.readers import json_blocks, json_lines
from rvaft.readers.json_blocks import JsonBlockReader, plain_fields
from rvaft.readers.json_lines import read
from rvaft.readers.log import Batch
from rvaft.stream.statistics import EventTypeIndex, Statistics
from rvaft.support.files import opened
from tests.tables import rows, spelled

TREES = {
    "one": loads(
        'event a(v) = { topic: "t", value: v }; event b(v, w) = { topic: "u", value: v, other: w };'
        "toplevel r; r and x y; x on a(V); y on b(V, W);"
    ),
    "two": loads(
        'event a(v) = { topic: "t", value: v }; event e(v) = { kind: "k", name: "n", value: v };'
        "toplevel r; r and x y z; x on a(V); y on e(V); z;"
    ),
    "nested": loads(
        'event a(v) = { topic: "t", value: { deep: v } }; event c(v) = { topic: "t", name: 1, items: [v, _] };'
        "toplevel r; r and x y; x on a(V); y on c(V); ignore a(V) when V > 1;"
    ),
}
Event = dict[str, Any]


def fast(tree: RVAFT, *, dense: bool = False, strict: bool = False) -> JsonBlockReader:
    reads = TreeReads(tree)
    found = JsonBlockReader(reads, EventTypeIndex(tree).possible, plain_fields(reads), strict=strict)
    found._dense = dense
    return found


def one_by_one(batches: Iterable[Batch]) -> Iterator[Event | None]:
    for batch in batches:
        given = dict(batch.events)
        assert len(given) == len(batch.events)
        yield from map(given.get, range(batch.total))


def held(tree: RVAFT, events: Iterable[Event | None]) -> tuple[list[Event | None], str | None]:
    """What a log holds for a tree: for each event what it has in the tree's fields if it fits a
    pattern, and the error at its end.
    """
    patterns = TreeReads(tree).patterns
    fields = sorted({field for one in patterns if isinstance(one, ObjectPattern) for field, _ in one.fields})
    found: list[Event | None] = []
    try:
        for event in events:
            if event is None or all(match(pattern, event, {}) is None for pattern in patterns):
                found.append(None)
            else:
                found.append({field: event[field] for field in fields if field in event})
    except TraceError as error:
        return found, str(error)
    return found, None


def both(
    tree: RVAFT, stream: Callable[[], BufferedIOBase], name: str = "log", *, strict: bool = False
) -> tuple[list[Event | None], str | None]:
    """What a stream holds, which is the same however it is read."""
    expected = held(tree, read(cast("BinaryIO", stream()), name=name, reads=TreeReads(tree), strict=strict))
    for dense in (False, True):
        reader = fast(tree, dense=dense, strict=strict)
        assert repr(held(tree, one_by_one(reader.read(stream(), name)))) == repr(expected)
    return expected


@contextmanager
def small(size: int) -> Iterator[None]:
    """Blocks of that many bytes; and skeletons are looked at whatever is new."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(json_blocks, "SIZE", size)
        patch.setattr(json_blocks, "FEW", 0)
        yield


def same(
    tree: RVAFT, data: bytes, *, size: int = 1 << 16, strict: bool = False
) -> tuple[list[Event | None], str | None]:
    with small(size):
        return both(tree, lambda: io.BytesIO(data), strict=strict)


values = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-3, 3),
    st.sampled_from([1.0, -0.0, 0.5, 1e300, 10**400, 2**53 + 1, 2**64, 1e-320, math.nan, -math.inf]),
    st.sampled_from(["t", "u", "k", "n", "", "x\u00e9", "\U0001f600", '"topic"', "a\nb", "\\"]),
)
fields = st.sampled_from(
    ["topic", "value", "other", "kind", "name", "items", "deep", "event", "x", "z", "topics", "tópic"]
)
deep = st.recursive(
    values, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(fields, inner, max_size=3), max_leaves=6
)
objects = st.one_of(
    st.dictionaries(fields, deep, max_size=5),
    st.builds(
        lambda topic, rest: {"topic": topic, **rest},
        st.sampled_from(["t", "u", "w", "T", "/t/ ", "u" + " " * LONGEST_TEXT]),
        st.dictionaries(fields.filter(lambda name: name != "topic"), deep, max_size=4),
    ),
    st.builds(lambda value: {"topic": "t", "value": value, "x": 1}, st.integers(0, 50)),
)


PIECES = st.sampled_from(b'|\xff|\xed\xa0\x80|\\|"|{|}|1|e|,|\n|\x00|\\ud800| '.split(b"|"))


@st.composite
def lines(draw: st.DrawFn) -> bytes:
    """An object as somebody writes it, or nearly so."""
    made = draw(objects)
    separators = draw(st.sampled_from([(", ", ": "), (",", ":"), (" , ", " : ")]))
    text = json.dumps(made, ensure_ascii=draw(st.booleans()), separators=separators)
    if made and draw(st.integers(0, 9)) == 0:  # a key twice
        key = draw(st.sampled_from(sorted(made)))
        text = text[:-1] + separators[0] + json.dumps(key) + separators[1] + json.dumps(draw(values)) + "}"
    if draw(st.integers(0, 9)) == 0:
        text = text.replace('"topic"', '"\\u0074opic"', 1)
    data = bytearray(text.encode())
    for _ in range(draw(st.sampled_from([0, 0, 0, 0, 1, 2]))):
        place = draw(st.integers(0, max(len(data) - 1, 0)))
        piece = draw(PIECES)
        data[place : place + draw(st.integers(0, 1))] = piece
    return bytes(data) + draw(st.sampled_from([b"", b"", b"", b"\r", b" "]))


logs = st.builds(
    lambda mark, some, end: mark + b"\n".join(some) + end,
    st.sampled_from([b"", b"", b"\xef\xbb\xbf"]),
    st.lists(st.one_of(lines(), lines(), st.sampled_from([b"", b"  ", b'{"topic":"t","value":1}'])), max_size=12),
    st.sampled_from([b"", b"\n", b"\n\n"]),
)


@given(st.sampled_from(sorted(TREES)), logs, st.sampled_from([1, 40, 200, 1 << 16]))
@example("one", b'{"topic":"t","value":1}{"topic":"t","value":1}\n{"topic":"t",\n"value":1}\n', 1 << 16)
@example("one", b'{"topic":"t","value":1} 5\n\n{"topic":"t","value":1}\n', 1 << 16)
@example("one", b'{"topic":"t","value":"\\\\"}\n{"topic":"t","value":"\\1"}\n', 1 << 16)
@example("one", b'{"topic":"t","topic":null}\n{"\\u0074opic":"t","value":0}\n', 1 << 16)
@settings(max_examples=100)
def test_any_bytes(name: str, data: bytes, size: int) -> None:
    same(TREES[name], data, size=size)


GOOD = b'{"topic":"t","value":1,"x":2}'


@pytest.mark.parametrize("row", rows(__file__, "lines.txt"), ids=lambda row: row[1])
def test_one_line_among_many(row: list[Any]) -> None:
    kind, name, line = row[0], row[1], spelled(row[2])
    lines = len([one for one in line.removeprefix(b"\xef\xbb\xbf").split(b"\n") if one.strip(b" \t\r")])
    marked = line.startswith(b"\xef\xbb\xbf")  # which is for the start of a file
    for before in (0, 1, 90) if not marked else (0,) if kind == "good" else (1, 90):
        text = b"\n".join([GOOD] * before + [line] + [GOOD] * 90)
        if kind == "strict":
            assert same(TREES["one"], text, size=1024)[1] is None
        events, error = same(TREES["one"], text, size=1024, strict=True)
        if kind not in ("bad", "strict"):
            assert (error, len(events)) == (None, before + 90 + lines)
        elif error is None:
            assert name.startswith("beyond")  # a number where the tree does not read
        else:
            assert f"log:{before + 1}: " in error
            assert len(events) == before


@given(st.sampled_from(sorted(TREES)), st.lists(objects, max_size=40))
def test_statistics_are_the_same(name: str, some: list[dict[str, Any]]) -> None:
    tree = TREES[name]
    data = b"".join(json.dumps(event).encode() + b"\n" for event in some)
    parsed = list(read(io.BytesIO(data), reads=TreeReads(tree)))
    types = EventTypeIndex(tree)
    slow, quick = Statistics(types), Statistics(types)
    for number, event in enumerate(parsed, 1):
        slow.add(event, number)
    reader = fast(tree)
    with small(100):
        number = 0
        for batch in reader.read(io.BytesIO(data), "log"):
            for place, decoded in batch.events:
                quick.add(decoded, number + place + 1)
            quick.events += batch.total - len(batch.events)
            number += batch.total
    assert (slow.events, slow.relevant, slow.never_seen) == (quick.events, quick.relevant, quick.never_seen)
    assert slow.near_misses == quick.near_misses


def test_trees_that_are_left_to_the_other_way() -> None:
    for field in ("", '"a/b": "t", ', 'topic: "t", "ö": 1, ', 'topic: "t", "a\\"b": 1, '):
        tree = loads(f"event e(v) = {{ {field}value: v }}; toplevel a; a on e(V);")
        assert not plain_fields(TreeReads(tree))


# -- where reading quickly takes something for granted
# ------------------------------------------------------------------


@pytest.mark.parametrize("row", rows(__file__, "skeletons.txt"))
def test_the_skeleton_of_a_good_line(row: list[Any]) -> None:
    known, odd = map(spelled, row)
    events, error = same(TREES["one"], b"\n".join([*[known] * 40, odd, known]), size=200, strict=True)
    assert len(events) == 40
    assert str(error).startswith("log:41: ")


def test_as_many_values_as_lines_but_not_one_on_each() -> None:
    for text in (
        b'{"topic":"t","value":1}{"x":1}\n{"topic":"t",\n"value":1}\n',
        b'{"topic":"t",\n"value":1}\n{"topic":"t","value":1}{"x":1}\n',
        b'{"x":1}{"x":1}\n\n',
    ):
        events, error = same(TREES["one"], text)
        assert (events, str(error)[:7]) == ([], "log:1: ")


class _Failing(io.BytesIO):
    """A file that can be read so far and no further."""

    def _given(self, data: bytes) -> bytes:
        if not data:
            raise OSError(5, "Input/output error")
        return data

    def read1(self, size: int | None = -1, /) -> bytes:
        return self._given(super().read1(min(size or 100, 100)))

    def readline(self, size: int | None = -1, /) -> bytes:
        line = super().readline(size)
        return line if line.endswith(b"\n") else self._given(b"")


@pytest.mark.parametrize("end", [b"", b"\n", b'\n{"topic":'])
def test_a_file_that_fails_midway(end: bytes) -> None:
    data = b"\n".join([GOOD, b"", *[GOOD] * 50]) + end
    lines = data.count(b"\n")
    events, error = both(TREES["one"], lambda: _Failing(data))
    assert (len(events), error) == (lines - 1, f"log:{lines + 1}: cannot be read: Input/output error")


def test_what_has_no_end_is_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(json_blocks, "MEMORY", 20)
    batches = fast(TREES["one"], dense=True)
    for number in range(30):
        lines = [json.dumps({"topic": "t", "x" * (number + 1): "y" * place, "value": 1}) for place in range(10)]
        with small(1 << 16):
            batches._dense = True
            [batch] = batches.read(io.BytesIO("\n".join(lines).encode()), "log")
        assert batch.total == len(batch.events) == 10
        assert 0 < len(batches._skeletons) <= 20
    text = b"\n".join(b'{"topic":"t%d"}' % (number % 70) for number in range(500))
    assert sum(batch.total for batch in batches.read(io.BytesIO(text), "log")) == 500
    assert len(batches._known) <= 20


def test_long_strings_are_not_remembered() -> None:
    tree = loads('event a() = { topic: "t", data: "stop" }; toplevel r; r and x y; x on a(); y;')
    shapes = PatternIndex([tree.pattern("x")], lambda decided: decided)  # type: ignore[list-item]
    statistics, batches = Statistics(EventTypeIndex(tree)), fast(tree)
    for number in range(50):
        event = {"topic": f"{number}" + "x" * LONGEST_TEXT, "data": f"{number}" + "x" * LONGEST_TEXT}
        assert shapes.of(event) == ((), ())
        statistics.add(event, number)
        list(batches.read(io.BytesIO(json.dumps(event).encode()), "log"))
    assert not any([shapes._memory, batches._known, statistics._looked_at])


@pytest.mark.parametrize("blank", [False, True])
@pytest.mark.parametrize("length", [2999, 3000, 3001, 9000])
def test_the_longest_line(length: int, blank: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (json_lines, json_blocks):
        monkeypatch.setattr(module, "MAX_LINE", 3000)
    line = b" " * length if blank else b'{"topic":"t","value":1,"x":"'.ljust(length - 2, b"a") + b'"}'
    events, error = same(TREES["one"], b"\n".join([GOOD, line, GOOD]), size=500)
    assert error == (None if length <= 3000 else "log:2: the line is longer than 0 MiB")
    assert len(events) == (1 if length > 3000 else 2 if blank else 3)
    first = b"\xef\xbb\xbf" + GOOD + b" " * (3000 - len(GOOD))
    assert len(same(TREES["one"], first + b"\n" + GOOD)[0]) == 2


@pytest.mark.parametrize("place", range(300, 3000, 300))
def test_damaged_data_is_read_up_to_the_damage(place: int, tmp_path: Path) -> None:
    log = tmp_path / "log.gz"
    lines = b"".join(b'{"topic":"t","value":%d,"x":"%x"}\n' % (n, n * 2654435761 % 2**32) for n in range(2000))
    data = bytearray(gzip.compress(lines))
    data[place] ^= 16
    log.write_bytes(data)
    with ExitStack() as streams:
        _, error = both(TREES["one"], lambda: cast("BufferedIOBase", streams.enter_context(opened(log))), str(log))
    assert error
