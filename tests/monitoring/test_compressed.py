"""Traces in compressed files."""

import gzip
from pathlib import Path

import pytest
import zstandard

from rvaft.errors import ToolMissing, TraceError
from rvaft.monitoring.reader import MAX_LINE, read
from tests.cli.runs import TREES, failed, run

LINES = b"".join(b'{"event": "%c"}\n' % letter for letter in b"cab") * 500
AND = TREES / "gates" / "and.rvaft"


def gz(data: bytes) -> bytes:
    return gzip.compress(data)


def zst(data: bytes) -> bytes:
    return zstandard.ZstdCompressor().compress(data)


def written(folder: Path, name: str, data: bytes) -> Path:
    (folder / name).write_bytes(data)
    return folder / name


@pytest.mark.parametrize(("suffix", "pack"), [(".gz", gz), (".zst", zst), (".GZ", gz)])
def test_the_events_are_those_of_the_plain_file(tmp_path: Path, suffix: str, pack: object) -> None:
    packed = written(tmp_path, f"log.jsonl{suffix}", pack(LINES))  # type: ignore[operator]
    plain = written(tmp_path, "log.jsonl", LINES)
    assert list(read(packed)) == list(read(plain))
    result = run("monitor", AND, packed, "--semantics", "strict")
    assert result.exit_code == 1
    assert result.stdout == run("monitor", AND, plain, "--semantics", "strict").stdout


def test_several_members_are_one_file(tmp_path: Path) -> None:
    for pack in (gz, zst):
        name = f"two.{pack.__name__}"
        assert len(list(read(written(tmp_path, name, pack(LINES) + pack(LINES))))) == 3000


@pytest.mark.parametrize(("suffix", "pack"), [(".gz", gz), (".zst", zst)])
def test_damaged_files_are_errors_with_file_and_line(tmp_path: Path, suffix: str, pack: object) -> None:
    good: bytes = pack(LINES)  # type: ignore[operator]
    for name, data in {
        "cut": good[: len(good) // 2],
        "plain": LINES,
        "flipped": good[:20] + b"\x00\xff" + good[22:],
    }.items():
        file = written(tmp_path, f"{name}{suffix}", data)
        with pytest.raises(TraceError, match=rf"{name}{suffix}:\d+: "):
            list(read(file))
        failed(run("monitor", AND, file), f"{name}{suffix}:")


def test_a_truncated_zst_is_an_error(tmp_path: Path) -> None:
    whole = zst(LINES)
    for length in range(1, len(whole), 7):
        with pytest.raises(TraceError):
            list(read(written(tmp_path, "cut.zst", whole[:length])))


def test_a_line_is_bounded_after_decompression(tmp_path: Path) -> None:
    bomb = written(tmp_path, "bomb.gz", gzip.compress(b"x" * (MAX_LINE + 2), 1))
    with pytest.raises(TraceError, match="longer than"):
        list(read(bomb))


def test_without_the_package_zst_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "zstandard", None)
    with pytest.raises(ToolMissing, match=r"\.\[zstd\]"):
        list(read(written(tmp_path, "log.zst", zst(LINES))))
    assert list(read(written(tmp_path, "log.gz", gz(LINES))))
