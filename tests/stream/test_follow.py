"""A file that grows, is truncated, is replaced."""

import os
import signal
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rvaft.errors import OptionError
from rvaft.stream import follow
from rvaft.stream.follow import FollowedFile, stopping

LOOKS: Final = 8
"""How often a follower asks whether to stop before the next thing happens: more than one look at the file takes."""
BOM: Final = b"\xef\xbb\xbf"
Step = bytes | str | Callable[[], object] | tuple[Any, ...]
"""What happens to a log: bytes are written, a word is a method of it, a function is called, and of
several all happen in one moment.
"""


class Log:
    """A log as a program writes it."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / "log.jsonl"
        self.reopen()
        self.renamed = 0

    def rename(self) -> None:
        """Move the log away; the program goes on writing to it."""
        self.renamed += 1
        self.path.rename(self.path.with_suffix(f".{self.renamed}"))

    def reopen(self) -> None:
        """The program notices and begins a new log."""
        self.writing = os.open(self.path, os.O_WRONLY | os.O_APPEND | os.O_CREAT)

    def truncate(self) -> None:
        os.truncate(self.writing, 0)

    def remove(self) -> None:
        self.path.unlink()

    def wait(self) -> None:
        """Nothing happens."""

    def happen(self, step: Step) -> None:
        match step:
            case bytes():
                os.write(self.writing, step)
            case str():
                getattr(self, step)()
            case tuple():
                for each in step:
                    self.happen(each)
            case _:
                step()

    def follow(self, *steps: Step, **more: Any) -> tuple[FollowedFile, list[str]]:
        """Follow the log while these things happen to it one after the other, then the end; and
        what is told of changes.
        """
        left, asked, told, place = list(steps), 0, list[str](), -1

        def stop() -> bool:
            nonlocal asked, place
            if place != stream.offset:  # a line was read
                asked, place = 0, stream.offset
            asked += 1
            if asked % LOOKS == 0 and left:
                self.happen(left.pop(0))
                return False
            return asked % LOOKS == 0

        stream = following(self.path, stop=stop, changed=told.append, **more)
        return stream, told


def following(path: Path, **more: Any) -> FollowedFile:
    given: dict[str, Any] = {"stop": lambda: False, "changed": lambda _: None, "idle": lambda: None}
    return FollowedFile(path, **{**given, **more})


@pytest.fixture(autouse=True)
def _often(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(follow, "POLL", 0.0003)


@pytest.fixture
def log(tmp_path: Path) -> Iterator[Log]:
    made = Log(tmp_path)
    yield made
    os.close(made.writing)


def lines(stream: FollowedFile) -> list[bytes]:
    with stream:
        return list(iter(stream.readline, b""))


def said(log: Log, what: str, lost: str = "") -> str:
    return f"{log.path} was {what} and is now read from its start{lost}"


WRITTEN, REPLACED = "truncated or written anew", "replaced"


@pytest.mark.parametrize(
    ("start", "steps", "given", "changes"),
    [
        (b"1\n", [(b"2\n3", "rename", "reopen", b"4\n")], b"1\n2\n3\n4\n", [(REPLACED,)]),
        (b"1\n2\n", [("truncate", b"3\n")], b"1\n2\n3\n", [(WRITTEN,)]),
        (b"1\n2\n", [("truncate", b"1\n")], b"1\n2\n1\n", [(WRITTEN,)]),
        (b"1\n2\n", [("truncate", b"31\n42\n53\n64\n")], b"1\n2\n31\n42\n53\n64\n", [(WRITTEN,)]),
        (b"", [b"1\n2", "truncate", b"3\n"], b"1\n3\n", [(WRITTEN, "; an unfinished line of 1 bytes is lost")]),
        (b"1\n", ["remove", "wait", "reopen", b"2\n"], b"1\n2\n", [(REPLACED,)]),
        (b"1\n", ["rename", "reopen", BOM + b"2\n"], b"1\n2\n", [(REPLACED,)]),
        (BOM + b"1\n", [b"2\n"], BOM + b"1\n2\n", []),
    ],
)
def test_what_happens_to_a_log(
    log: Log, start: bytes, steps: list[Step], given: bytes, changes: list[tuple[str, ...]]
) -> None:
    log.happen(start)
    stream, told = log.follow(*steps)
    assert lines(stream) == given.splitlines(keepends=True)
    assert told == [said(log, *change) for change in changes]
    assert stream.offset == log.path.stat().st_size


def test_a_line_is_given_when_it_is_whole(log: Log) -> None:
    seen: list[list[bytes]] = []
    got: list[bytes] = []
    look: Callable[[], object] = lambda: seen.append(list(got))  # noqa: E731
    stream, _ = log.follow(b"1", look, b"2", look, b"3\n45", look, b"6")
    with stream:
        got.extend(iter(stream.readline, b""))
    assert got == [b"123\n"]  # the rest has no end yet
    assert seen == [[], [], [b"123\n"]]
    assert (stream.offset, stream.line) == (4, 1)


@pytest.mark.ci
@settings(max_examples=30)
@given(
    st.lists(st.binary(max_size=5) | st.sampled_from([b"\n", b"1\n2", BOM, BOM[:1]]), max_size=12),
    st.sets(st.integers(0, 11)),
    st.booleans(),
)
def test_nothing_is_lost_when_the_log_is_renamed(data: list[bytes], rotations: set[int], late: bool) -> None:
    """However the bytes come; the last line of a renamed log may lack its end."""
    with tempfile.TemporaryDirectory() as folder:
        log = Log(Path(folder))
        steps: list[Step] = []
        files = [b""]
        for number, piece in enumerate(data):
            if number in rotations:
                last = b"last" * late  # the program has not noticed yet
                steps += ["rename", last, "reopen"]
                files[-1] += last
                files.append(b"")
            steps.append(piece)
            files[-1] += piece
        stream, told = log.follow(*steps)
        *whole, last = files[0], *(file.removeprefix(BOM) for file in files[1:])  # a mark is no part of a line
        given = b"".join(file + b"\n" * (file[-1:] not in (b"", b"\n")) for file in whole) + last
        assert lines(stream) == [line + b"\n" for line in given.split(b"\n")[:-1]]
        assert told == [said(log, REPLACED)] * len(whole)
        os.close(log.writing)


def test_it_goes_on_from_where_it_was(log: Log) -> None:
    whole = b"".join(b"%d\n" % number for number in range(200))
    log.happen(whole)
    first, _ = log.follow()
    with first:
        while first.readline():
            if first.line % 40 == 0:
                rest, told = log.follow(b"new\n", offset=first.offset, line=first.line)
                assert b"".join(lines(rest)) == whole[first.offset :] + b"new\n"
                assert (told, rest.line) == ([], 201)
                os.truncate(log.path, len(whole))
    with pytest.raises(OptionError, match=f"fewer than {len(whole) + 1} bytes"):
        log.follow(offset=len(whole) + 1)
    stream, told = log.follow("truncate", b"3\n4\n5\n", offset=4)  # it changes before the place to go on from
    assert b"".join(lines(stream)).endswith(b"\n199\n3\n4\n5\n")
    assert told == [said(log, WRITTEN)]


def test_the_present_file_and_the_place_in_it_belong_together(log: Log) -> None:
    """At every line: what `file` holds before `offset` ends with the line that was given."""
    stream, _ = log.follow(b"1\n2", "rename", "reopen", b"3\n", "truncate", b"4\n5\n")
    places = []
    with stream:
        while line := stream.readline():
            stream.file.seek(0)
            places.append((line, stream.file.read(stream.offset)))
    assert places == [(b"1\n", b"1\n"), (b"2\n", b""), (b"3\n", b"3\n"), (b"4\n", b"4\n"), (b"5\n", b"4\n5\n")]


def test_an_endless_line_is_given_in_parts(log: Log) -> None:
    log.happen(b"x" * 1_000_000)
    stream, _ = log.follow()
    with stream:
        assert len(stream.readline(600_000)) == 600_000
        assert stream.readline(0) == stream.readline() == b""


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
    with stopping() as stop:
        assert not stop()
    assert signal.getsignal(asked) is before


def test_no_line_is_read_after_the_stop(log: Log) -> None:
    log.happen(b"1\n2\n3")
    asked = False
    with following(log.path, stop=lambda: asked) as stream:
        assert stream.readline() == b"1\n"
        asked = True
        assert stream.readline() == b""
        assert (stream.offset, stream.line, stream.goes_on, stream.unfinished) == (2, 1, True, 0)
