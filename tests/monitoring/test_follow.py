"""A file that grows, is truncated, is replaced."""

import os
import signal
import tempfile
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, BinaryIO, Self, cast

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rvaft.errors import OptionError
from rvaft.monitoring import follow
from rvaft.monitoring.follow import FollowedFile, stopping
from rvaft.monitoring.reader import read

POLL = 0.0003
LOOKS = 8
"""How often a follower asks whether to stop before the next thing happens: more than one look at the file takes."""


class Script:
    """Things that happen to a file while it is followed, one after the other; then the end."""

    def __init__(self, *steps: Callable[[], object]) -> None:
        self.steps = list(steps)
        self.asked = 0
        self.over = False

    def __call__(self) -> bool:
        self.asked += 1
        if self.asked % LOOKS == 0:
            if self.steps:
                self.steps.pop(0)()
            else:
                self.over = True
        return self.over


class Log:
    """A log as a program writes it."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / "log.jsonl"
        self.path.touch()
        self.writing = self.path.open("ab", buffering=0)
        self.renamed = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.writing.close()

    def write(self, data: bytes) -> Callable[[], object]:
        return lambda: self.writing.write(data)

    def rename(self) -> None:
        """Move the log away; the program goes on writing to it."""
        self.renamed += 1
        self.path.rename(self.path.with_suffix(f".{self.renamed}"))

    def reopen(self) -> None:
        """The program notices and begins a new log."""
        self.writing.close()
        self.writing = self.path.open("ab", buffering=0)

    def truncate(self) -> None:
        self.writing.truncate(0)

    def follow(self, *steps: Callable[[], object], **more: Any) -> tuple[FollowedFile, list[str]]:
        changes: list[str] = []
        return following(self.path, stop=Script(*steps), changed=changes.append, **more), changes

    def said(self, what: str = "was truncated or written anew", lost: str = "") -> str:
        return f"{self.path} {what} and is now read from its start{lost}"


def following(path: Path, **more: Any) -> FollowedFile:
    given: dict[str, Any] = {"stop": lambda: False, "changed": lambda _: None, "idle": lambda: None}
    return FollowedFile(path, **{**given, **more})


@pytest.fixture(autouse=True)
def _often(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(follow, "POLL", POLL)


@pytest.fixture
def log(tmp_path: Path) -> Iterator[Log]:
    with Log(tmp_path) as made:
        yield made


def lines(stream: FollowedFile) -> list[bytes]:
    with stream:
        return list(iter(stream.readline, b""))


def test_a_line_is_given_when_it_is_whole(log: Log) -> None:
    seen: list[list[bytes]] = []
    got: list[bytes] = []
    look: Callable[[], object] = lambda: seen.append(list(got))  # noqa: E731
    stream, _ = log.follow(log.write(b"1"), look, log.write(b"2"), look, log.write(b"3\n45"), look, log.write(b"6"))
    with stream:
        got.extend(iter(stream.readline, b""))
    assert got == [b"123\n"]  # the rest has no end yet
    assert seen == [[], [], [b"123\n"]]
    assert (stream.offset, stream.line) == (4, 1)


pieces = st.lists(st.binary(max_size=5) | st.sampled_from([b"\n", b"1\n2", b"\xef\xbb\xbf", b"\xef"]), max_size=12)


@settings(deadline=None, max_examples=30)
@given(pieces, st.sets(st.integers(0, 11)), st.booleans())
def test_nothing_is_lost_when_the_log_is_renamed(data: list[bytes], rotations: set[int], late: bool) -> None:
    """However the bytes come; the last line of a renamed log may lack its end."""
    with tempfile.TemporaryDirectory() as folder, Log(Path(folder)) as log:
        steps: list[Callable[[], object]] = []
        files: list[bytes] = [b""]
        for number, piece in enumerate(data):
            if number in rotations:
                steps.append(log.rename)
                if late:  # the program has not noticed yet
                    steps.append(log.write(b"last"))
                    files[-1] += b"last"
                steps.append(log.reopen)
                files.append(b"")
            steps.append(log.write(piece))
            files[-1] += piece
        stream, changes = log.follow(*steps)
        held = [
            files[0],
            *(file.removeprefix(b"\xef\xbb\xbf") for file in files[1:]),
        ]  # a byte order mark is no part of a line
        expected = [line + b"\n" for file in held[:-1] for line in split(file)]
        expected += [line + b"\n" for line in held[-1].split(b"\n")[:-1]]
        assert lines(stream) == expected
        assert changes == [log.said("was replaced")] * (len(files) - 1)


def split(file: bytes) -> Iterable[bytes]:
    parts = file.split(b"\n")
    return parts if parts[-1] else parts[:-1]


def test_what_is_written_in_the_moment_of_renaming_is_not_lost(log: Log) -> None:
    log.write(b"1\n")()

    def replace() -> None:
        log.write(b"2\n3")()
        log.rename()
        log.path.write_bytes(b"4\n")

    stream, changes = log.follow(replace)
    assert lines(stream) == [b"1\n", b"2\n", b"3\n", b"4\n"]
    assert changes == [log.said("was replaced")]
    assert (stream.offset, stream.line) == (2, 1)


@pytest.mark.parametrize("after", [b"3\n", b"1\n", b"31\n42\n53\n64\n"], ids=["shorter", "same start", "longer"])
def test_a_file_written_anew_is_read_from_its_start(log: Log, after: bytes) -> None:
    log.write(b"1\n2\n")()

    def anew() -> None:
        log.truncate()
        log.write(after)()

    stream, changes = log.follow(anew)
    assert lines(stream) == [b"1\n", b"2\n", *after.splitlines(keepends=True)]
    assert changes == [log.said()]


def test_an_unfinished_line_that_is_truncated_is_lost_and_told(log: Log) -> None:
    stream, changes = log.follow(log.write(b"1\n2"), log.truncate, log.write(b"3\n"))
    assert lines(stream) == [b"1\n", b"3\n"]
    assert changes == [log.said(lost="; an unfinished line of 1 bytes is lost")]


def test_a_path_where_nothing_stands_for_a_while(log: Log) -> None:
    log.write(b"1\n")()
    stream, changes = log.follow(log.path.unlink, lambda: None, log.reopen, log.write(b"2\n"))
    assert lines(stream) == [b"1\n", b"2\n"]
    assert changes == [log.said("was replaced")]


def test_a_byte_order_mark_at_the_start_of_the_next_file(log: Log) -> None:
    log.write(b'{"n": 1}\n')()
    stream, _ = log.follow(log.rename, log.reopen, log.write(b'\xef\xbb\xbf{"n": 2}\n'))
    with stream:
        assert list(read(cast("BinaryIO", stream))) == [{"n": 1}, {"n": 2}]
    assert stream.offset == 12


def test_it_goes_on_from_where_it_was(log: Log) -> None:
    whole = b"".join(b"%d\n" % number for number in range(200))
    log.write(whole)()
    first, _ = log.follow()
    with first:
        while first.readline():
            rest, changes = log.follow(log.write(b"new\n"), offset=first.offset, line=first.line)
            if first.line % 40 == 0:
                assert b"".join(lines(rest)) == whole[first.offset :] + b"new\n"
                assert (changes, rest.line) == ([], 201)
                log.writing.truncate(len(whole))
            rest.close()


def test_a_file_that_changed_before_the_place_to_go_on_from(log: Log) -> None:
    log.write(b"1\n2\n")()
    with pytest.raises(OptionError, match="fewer than 5 bytes"):
        log.follow(offset=5)
    stream, changes = log.follow(log.truncate, log.write(b"3\n4\n5\n"), offset=4)
    assert lines(stream) == [b"3\n", b"4\n", b"5\n"]
    assert changes == [log.said()]


def test_the_present_file_and_the_place_in_it_belong_together(log: Log) -> None:
    """At every line: what `file` holds before `offset` ends with the line that was given."""
    steps = [log.write(b"1\n2"), log.rename, log.reopen, log.write(b"3\n"), log.truncate, log.write(b"4\n5\n")]
    stream, _ = log.follow(*steps)
    places = []
    with stream:
        while line := stream.readline():
            stream.file.seek(0)
            places.append((line, stream.file.read(stream.offset)))
    assert places == [(b"1\n", b"1\n"), (b"2\n", b""), (b"3\n", b"3\n"), (b"4\n", b"4\n"), (b"5\n", b"4\n5\n")]


def test_an_endless_line_is_given_in_parts(log: Log) -> None:
    log.write(b"x" * 1_000_000)()
    stream, _ = log.follow()
    with stream:
        assert len(stream.readline(600_000)) == 600_000
        assert stream.readline(0) == b""
        assert stream.readline() == b""


def test_what_cannot_be_followed(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "log.gz").touch()
    for name, reason in (("", "regular file"), ("pipe", "regular file"), ("log.gz", "compressed")):
        with pytest.raises(OptionError, match=reason):
            following(tmp_path / name)
    with pytest.raises(FileNotFoundError):
        following(tmp_path / "none")


@pytest.mark.parametrize("asked", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_asks_for_the_end(asked: signal.Signals) -> None:
    before = signal.getsignal(asked)
    with stopping() as stop:
        assert not stop()
        signal.raise_signal(asked)
        assert stop()
        assert signal.getsignal(asked) is before  # the next one does what it always did
    assert signal.getsignal(asked) is before
    with stopping() as stop:
        assert not stop()
    assert signal.getsignal(asked) is before
