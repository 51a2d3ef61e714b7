"""Reading traces: what is one JSON object per line by RFC 8259, and what is not, whatever the fault."""

import gzip
import io
import json
import re
import sys
from collections.abc import Callable
from contextlib import nullcontext
from math import inf
from pathlib import Path
from typing import Any

import pytest
import zstandard
from hypothesis import given
from hypothesis import strategies as st

from rvaft import RVAFT, EventType, Ignore, Node, On, ToolMissing, TraceError, loads
from rvaft.core.fields_to_read import Reads, Scope, TreeReads
from rvaft.model.patterns import Anything, ObjectPattern, Variable
from rvaft.model.values import finite
from rvaft.readers import json_lines
from rvaft.readers.json_lines import MAX_DEPTH, decode, read
from rvaft.readers.log import MAX_LINE
from tests.cli.runs import TREES, failed, run
from tests.tables import rows, spelled


def events(data: bytes, reads: Scope | None = None, *, strict: bool = False) -> list[dict[str, Any]]:
    return list(read(io.BytesIO(data), name="log.jsonl", reads=reads, strict=strict))


def nested(levels: int) -> bytes:
    return b'{"a":' * levels + b"1" + b"}" * levels


LINES = rows(__file__, "lines.txt")
GOOD, BAD, STRICT = (
    {name: spelled(text) for one, name, text in LINES if one == kind} for kind in ("good", "bad", "strict")
)


@pytest.mark.parametrize("case", GOOD)
def test_what_is_a_trace(case: str) -> None:
    lines = GOOD[case].decode("utf-8-sig").split("\n")
    assert events(GOOD[case]) == [json.loads(line) for line in lines if line.strip()]


@pytest.mark.parametrize("case", [*BAD, *STRICT])
@pytest.mark.parametrize("ends", [b"", b"\n", b"\r\n"])
def test_what_is_malformed(case: str, ends: bytes) -> None:
    stream = io.BytesIO(b'{"a":1}\n\n' + (BAD | STRICT)[case].split(b"\n")[0] + ends)
    given = read(stream, name="log.jsonl", strict=case in STRICT)
    assert next(given) == {"a": 1}
    with pytest.raises(TraceError) as caught:
        next(given)
    assert (caught.value.file, caught.value.line) == ("log.jsonl", 3)
    assert re.fullmatch(r"log\.jsonl:3: .{1,180}", str(caught.value))
    assert isinstance(caught.value, ValueError)


@pytest.mark.parametrize("row", rows(__file__, "repeated_keys.txt"), ids=lambda row: row[1])
def test_a_key_is_not_repeated_where_the_tree_reads(row: list[str]) -> None:
    tree = loads('event e(v) = { topic: "t", pose: { x: _ }, value: v, list: [{ y: 1 }] }; toplevel a; a on e(V);')
    said, text = row[0], row[1].encode()
    with pytest.raises(TraceError, match="repeated"):
        events(text)
    with pytest.raises(TraceError, match="repeated") if said == "refused" else nullcontext():
        assert len(events(text, TreeReads(tree))) == 1


@pytest.mark.parametrize(
    ("text", "expected", "field"),
    [
        (b'{"topic":"t","value":1e999}', {"topic": "t", "value": inf}, "value"),
        (b'{"topic":"t","value":[{"deep":-1e999}]}', {"topic": "t", "value": [{"deep": -inf}]}, "value.0.deep"),
        (b'{"topic":-Infinity,"x":NaN}', {"topic": -inf, "x": None}, "topic"),
        (b'{"topic":"t","other":1e999}', {"topic": "t", "other": None}, None),
        (
            b'{"topic":"another","value":-1E+0999,"x":[Infinity]}',
            {"topic": "another", "value": None, "x": [None]},
            None,
        ),
        (b'{"x":[1,{"y":%b.5}]}' % (b"1" * 400), {"x": [1, {"y": None}]}, None),
        (b'{"x":[1e308,1e-999,"1e999","NaN"]}', {"x": [1e308, 0.0, "1e999", "NaN"]}, None),
    ],
)
def test_a_number_that_is_not_finite_is_undefined_where_the_tree_reads(
    text: bytes, expected: object, field: str | None
) -> None:
    reads = TreeReads(loads('event e(v) = { topic: "t", value: v }; toplevel a; a on e(V);'))
    [event] = events(text, reads)
    assert (event, getattr(event, "field", None)) == (expected, field)
    passed = decode(text, reads=reads, passed_on=True)
    assert (finite(passed), getattr(passed, "field", None)) == (finite(event), field)
    words, huge = (
        any(one in text for one in some) for some in ((b":NaN", b"Infinity"), (b":1e999", b"-1", b"1" * 400))
    )
    with pytest.raises(TraceError) if words or field else nullcontext():
        assert events(text, reads, strict=True) == [expected]
    with pytest.raises(ValueError, match=r"not a JSON number|range of a double") if words or huge else nullcontext():
        decode(text, reads=reads, strict=True, passed_on=True)


def test_a_default_event_and_an_ignore_are_read_too() -> None:
    noise = EventType("noise", ("v",), ObjectPattern((("noise", Variable("v")),)))
    tree = RVAFT("a", [Node("a")], [noise], ignores=[Ignore(On("noise", (Anything(),)))])
    assert TreeReads(tree).of({}) == Reads(fields={"event": Reads(), "noise": Reads()})
    assert events(b'{"noise":{"x":1,"x":2}}', TreeReads(tree)) == [{"noise": {"x": 2}}]
    with pytest.raises(TraceError):
        events(b'{"noise":1,"noise":2}', TreeReads(tree))


def test_an_endless_line_is_refused_before_it_fills_the_memory() -> None:
    taken = 0

    class Endless(io.RawIOBase):
        def readable(self) -> bool:
            return True

        def readinto(self, buffer: Any) -> int:
            nonlocal taken
            taken += len(buffer)
            buffer[:] = b"x" * len(buffer)
            return len(buffer)

    with pytest.raises(TraceError, match=r"log:1: the line is longer than 64 MiB"):
        next(read(io.BufferedReader(Endless()), name="log"))
    assert taken <= 2 * MAX_LINE


@pytest.mark.parametrize("garbage", [b"[", b'"', b'\\"', b'[\\"', b'{"a":', b'{"a":"\\ud83d', b"\xff"])
def test_a_long_line_of_garbage_is_refused_in_linear_time(garbage: bytes) -> None:
    line = garbage * (2_000_000 // len(garbage))
    with pytest.raises(ValueError, match=r"^.{1,150}$"):
        decode(line)


def test_events_come_as_their_lines_do() -> None:
    class Stream(io.BytesIO):
        read_lines = 0

        def readline(self, size: int | None = -1, /) -> bytes:
            self.read_lines += 1
            return super().readline(size)

    stream = Stream(b'{"a":1}\n{"a":2}\nnonsense\n')
    for number, event in zip((1, 2), read(stream), strict=False):
        assert (event, stream.read_lines) == ({"a": number}, number)


def test_a_path_is_opened_and_named_in_errors(tmp_path: Path) -> None:
    log = tmp_path / "a.jsonl"
    log.write_bytes(b'{"a":1}\n{')
    given = read(log)
    assert next(given) == {"a": 1}
    with pytest.raises(TraceError, match=r"a\.jsonl:2: "):
        next(given)
    with pytest.raises(FileNotFoundError):
        next(read(tmp_path / "missing"))


def test_no_recursion_error_leaks_from_a_full_stack() -> None:
    def deeply(levels: int) -> object:
        return decode(nested(MAX_DEPTH)) if levels == 0 else deeply(levels - 1)

    with pytest.raises(ValueError, match="nested too deeply"):
        deeply(sys.getrecursionlimit() - 350)


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=10,
)


@given(st.dictionaries(st.text(max_size=5), JSON, max_size=4), st.booleans())
def test_every_object_is_read_back(value: dict[str, Any], ascii_only: bool) -> None:
    assert decode(json.dumps(value, ensure_ascii=ascii_only).encode()) == value


@given(st.dictionaries(st.text(max_size=3), JSON, max_size=3), st.integers(0), st.binary(min_size=1, max_size=2))
def test_damage_is_refused_or_still_json(value: dict[str, Any], where: int, damage: bytes) -> None:
    text = json.dumps(value).encode()
    where %= len(text) + 1
    line = (text[:where] + damage + text[where:]).replace(b"\n", b" ")
    try:
        event = decode(line)
    except ValueError:
        return
    assert json.loads(line) == event
    json.dumps(event, allow_nan=False, ensure_ascii=False).encode()


# -- compressed files
# ---------------------------------------------------------------------------------------------------

PACKED = b"".join(b'{"event": "%c"}\n' % letter for letter in b"cab") * 500
AND = TREES / "gates" / "and.rvaft"
PACK: dict[str, Callable[[bytes], bytes]] = {".gz": gzip.compress, ".zst": zstandard.compress, ".GZ": gzip.compress}


def written(folder: Path, name: str, data: bytes) -> Path:
    (folder / name).write_bytes(data)
    return folder / name


@pytest.mark.parametrize("suffix", PACK)
def test_compressed_files(tmp_path: Path, suffix: str) -> None:
    """The events are those of the plain file, of several members too; damage is an error with file and line."""
    good = PACK[suffix](PACKED)
    plain, packed = written(tmp_path, "log.jsonl", PACKED), written(tmp_path, f"log.jsonl{suffix}", good)
    assert list(read(packed)) == list(read(plain))
    result = run("monitor", AND, packed, "--semantics", "strict")
    assert (result.exit_code, result.stdout) == (1, run("monitor", AND, plain, "--semantics", "strict").stdout)
    assert len(list(read(written(tmp_path, f"two{suffix}", good + good)))) == 3000
    for data in (good[: len(good) // 2], PACKED, good[:20] + b"\x00\xff" + good[22:]):
        file = written(tmp_path, f"bad{suffix}", data)
        with pytest.raises(TraceError, match=rf"bad{suffix}:\d+: "):
            list(read(file))
        failed(run("monitor", AND, file), f"bad{suffix}:")
    for length in range(1, len(good) - 8, 7):
        with pytest.raises(TraceError):
            list(read(written(tmp_path, f"cut{suffix}", good[:length])))


def test_a_line_is_bounded_after_decompression(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(json_lines, "MAX_LINE", 1 << 20)
    with pytest.raises(TraceError, match="longer than 1 MiB"):
        list(read(written(tmp_path, "bomb.gz", gzip.compress(b"x" * ((1 << 20) + 2), 1))))


def test_without_the_package_zst_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "zstandard", None)
    with pytest.raises(ToolMissing, match=r"\.\[zstd\]"):
        list(read(written(tmp_path, "log.zst", zstandard.compress(PACKED))))
    assert list(read(written(tmp_path, "log.gz", gzip.compress(PACKED))))
