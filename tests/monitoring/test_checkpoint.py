"""Checkpoints: what they keep, what they refuse, and that being killed changes nothing."""

import gzip
import hashlib
import io
import json
import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any, BinaryIO, cast

import pytest
import zstandard
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import rvaft
from rvaft.analysis.pattern_index import TreeReads
from rvaft.api import narrowed
from rvaft.engine import Engine
from rvaft.errors import CheckpointError, OptionError, RvaftError, TraceError
from rvaft.model.nodes import Node
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitoring import checkpoint
from rvaft.monitoring.checkpoint import Checkpoint, CheckpointFile, LinesRead, TraceIdentity, digest, open_at
from rvaft.monitoring.hooks import Hooks
from rvaft.monitoring.reader import decode, read
from rvaft.monitoring.stream import Ordering
from tests.monitoring import killing

TREE = rvaft.loads("top or ab bc; ab sand a b fault; bc sand b c;")
COLUMNS = ("tree", "fault")
LINES = b'{"event": "a"}\n\n{"event": "x"}\r\n{"event": "b"}\n'


@pytest.fixture
def trace(tmp_path: Path) -> Path:
    path = tmp_path / "log.jsonl"
    path.write_bytes(LINES)
    return path


def sha(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def kept(path: Path, log: Path, **changes: Any) -> CheckpointFile:
    given: dict[str, Any] = {
        "tree": TREE,
        "semantics": Semantics.SCATTERED,
        "columns": COLUMNS,
        "trace": log,
        "settings": {"--key": "robot"},
    }
    return CheckpointFile(path, **{**given, **changes})


def place(offset: int, line: int = 1) -> LinesRead:
    return LinesRead(io.BytesIO(), offset=offset, line=line)


def save(path: Path, log: Path, state: object = None, *, events: int = 1, offset: int = 15, **changes: Any) -> None:
    """A checkpoint after the first event."""
    kept(path, log, **changes).save(state, events, place(offset))


def loaded(path: Path, log: Path, **changes: Any) -> Checkpoint | None:
    return kept(path, log, **changes).load()


def refused(path: Path, trace: Path, **changes: Any) -> str:
    """The message of the error, without the path before it."""
    with pytest.raises(CheckpointError) as caught:
        loaded(path, trace, **changes)
    error = caught.value
    assert isinstance(error, RvaftError)
    assert isinstance(error, ValueError)
    assert error.file == str(path)
    assert str(error) == f"{path}: {error.reason}"
    assert "\n" not in str(error)
    return error.reason


# -- what is kept -------------------------------------------------------------------------------------------------------


def test_all_is_kept(tmp_path: Path, trace: Path) -> None:
    path = tmp_path / "kept"
    assert loaded(path, trace) is None
    monitor = Engine(TREE, "scattered")
    monitor.step({"event": "a"})
    event = decode(
        b'{"event": "x", "time": 3, "n": {"k": 1, "k": 2}, "l": [null, true, 1e3, "\\u00e9"]}', reads=TreeReads(TREE)
    )
    ordering = Ordering("time", window=4)
    ordering.add(event)
    save(path, trace, (monitor.snapshot(), ordering), events=7)
    found = loaded(path, trace)
    assert found is not None
    assert found[:3] == (7, 15, 1)
    snapshot, held = found.state
    fresh = Engine(TREE, "scattered")
    fresh.restore(snapshot)
    assert fresh.step({"event": "b"}) is Verdict.TRUE
    assert list(held.rest()) == [event]


def test_what_was_told_is_remembered_until_the_next_checkpoint(tmp_path: Path, trace: Path) -> None:
    path = tmp_path / "kept"
    one = kept(path, trace)
    one.save(None, 1, place(15))
    one.note(3)
    again = kept(path, trace)
    again.load()
    assert again.noted == 3
    again.save(None, 4, place(16))
    one.note(9)  # of the checkpoint that is gone
    last = kept(path, trace)
    last.load()
    assert last.noted == 0


def test_writing_takes_no_longer_than_all_the_rest(
    tmp_path: Path, trace: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [0.0]
    monkeypatch.setattr(checkpoint, "monotonic", lambda: now[0])
    one = kept(tmp_path / "kept", trace, every=2)
    monkeypatch.setattr(checkpoint, "_replace", lambda *_: now.__setitem__(0, now[0] + 1))
    due = []
    for events in range(1, 40):
        now[0] += 0.1
        if one.is_due(events):
            due.append(events)
            one.save(None, events, place(15))
    assert due[:2] == [2, 4]
    assert 4 <= len(due) <= 7


def test_the_next_checkpoint_takes_the_place_of_the_last(tmp_path: Path, trace: Path) -> None:
    path = tmp_path / "kept"
    for events in range(3):
        save(path, trace, events=events)
        found = loaded(path, trace)
        assert found is not None
        assert found.events == events
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["kept", "log.jsonl"]
    assert path.stat().st_mode & 0o777 == 0o600


def test_a_link_stays_a_link(tmp_path: Path, trace: Path) -> None:
    (tmp_path / "kept").symlink_to(tmp_path / "elsewhere")
    save(tmp_path / "kept", trace)
    assert (tmp_path / "kept").is_symlink()
    assert loaded(tmp_path / "elsewhere", trace) is not None


def test_what_a_crash_left_is_no_hindrance(tmp_path: Path, trace: Path) -> None:
    (tmp_path / ".kept.new").write_bytes(b"half")
    save(tmp_path / "kept", trace)
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["kept", "log.jsonl"]


def test_it_is_on_the_disk_before_it_takes_its_place(
    tmp_path: Path, trace: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file is synced whole, then renamed, then the folder is synced."""
    done: list[str] = []
    sync, rename = os.fsync, Path.replace

    def synced(handle: int) -> None:
        name = Path(f"/proc/self/fd/{handle}").readlink().name
        done.append(f"sync {name} {os.fstat(handle).st_size if name.endswith('new') else ''}".strip())
        sync(handle)

    def renamed(self: Path, target: Path) -> Path:
        done.append(f"rename {self.name}")
        return rename(self, target)

    monkeypatch.setattr(os, "fsync", synced)
    monkeypatch.setattr(Path, "replace", renamed)
    save(tmp_path / "kept", trace)
    size = (tmp_path / "kept").stat().st_size
    assert done == [f"sync .kept.new {size}", "rename .kept.new", f"sync {tmp_path.name}"]


def test_a_failure_to_write_leaves_the_last_one(tmp_path: Path, trace: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "kept"
    save(path, trace)
    before = path.read_bytes()

    def full(_handle: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="cannot write: No space left on device") as caught:
        save(path, trace, events=2)
    assert caught.value.filename == str(path)
    assert path.read_bytes() == before
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["kept", "log.jsonl"]


class Own:
    """What no checkpoint holds."""


@pytest.mark.parametrize("monitors", [lambda: 0, Own(), [Own], Hooks("true"), sys.stdout, print])
def test_what_cannot_be_kept_is_refused_at_once(tmp_path: Path, trace: Path, monitors: object) -> None:
    with pytest.raises(CheckpointError, match="these monitors cannot be kept: ") as caught:
        save(tmp_path / "kept", trace, monitors)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "kept").exists()


# -- what is refused ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"tree": rvaft.loads("top or ab bc; ab sand b a fault; bc sand b c;")}, "a checkpoint of another tree"),
        ({"tree": narrowed(TREE, branch=1)}, "a checkpoint of another tree, or of another part of it"),
        ({"semantics": Semantics.STRICT}, "a run with --semantics scattered, not strict"),
        ({"columns": ("tree",)}, "of other monitors (tree, fault, not tree)"),
        ({"columns": ("fault", "tree")}, "of other monitors (tree, fault, not fault, tree)"),
        ({"settings": {}}, "of a run with --key robot, not without --key"),
        ({"settings": {"--key": "id"}}, "of a run with --key robot, not with --key id"),
        ({"settings": {"--key": "robot", "--order-by": "t"}}, "of a run without --order-by, not with --order-by t"),
    ],
)
def test_a_checkpoint_of_another_run_is_refused(
    tmp_path: Path, trace: Path, changes: dict[str, Any], reason: str
) -> None:
    save(tmp_path / "kept", trace)
    said = refused(tmp_path / "kept", trace, **changes)
    assert reason in said
    assert said.endswith("remove it to begin anew")


def test_each_part_of_a_tree_has_a_digest_of_its_own() -> None:
    parts = [TREE, narrowed(TREE, branch=1), narrowed(TREE, branch=2), narrowed(TREE, kind="fault")]
    assert len({digest(part) for part in parts}) == len(parts)
    assert digest(narrowed(TREE, branch=1)) == digest(narrowed(rvaft.loads(rvaft.dumps(TREE)), branch=1))


def test_a_checkpoint_of_another_version_is_refused(
    tmp_path: Path, trace: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "kept"
    with monkeypatch.context() as patched:
        patched.setattr(rvaft, "__version__", "0.0.9", raising=False)
        save(path, trace)
    assert f"a checkpoint of rvaft 0.0.9, this is {rvaft.__version__}" in refused(path, trace)
    path.write_bytes(path.read_bytes().replace(b"rvaft checkpoint 2", b"rvaft checkpoint 3", 1))
    assert "a checkpoint of another version of rvaft" in refused(path, trace)


@pytest.mark.parametrize("data", [b"", b"{}", LINES, b"\x80\x05.", b"rvaft check", b"\xff" * 100])
def test_a_file_that_is_no_checkpoint(tmp_path: Path, trace: Path, data: bytes) -> None:
    (tmp_path / "kept").write_bytes(data)
    assert "no checkpoint of rvaft" in refused(tmp_path / "kept", trace)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=150, deadline=None)
@given(data=st.data())
def test_a_damaged_file_is_refused(tmp_path: Path, trace: Path, data: st.DataObject) -> None:
    whole, path = tmp_path / "whole", tmp_path / "kept"
    if not whole.exists():
        save(whole, trace)
    good = whole.read_bytes()
    at = data.draw(st.integers(0, len(good) - 1))
    match data.draw(st.sampled_from(["cut", "flip", "more", "less"])):
        case "cut":
            path.write_bytes(good[:at])
        case "flip":
            path.write_bytes(good[:at] + bytes([good[at] ^ 1 << data.draw(st.integers(0, 7))]) + good[at + 1 :])
        case "more":
            path.write_bytes(good[:at] + data.draw(st.binary(min_size=1, max_size=3)) + good[at:])
        case "less":
            path.write_bytes(good[:at] + good[at + 1 :])
    if path.read_bytes() != good:
        refused(path, trace)


def forged(path: Path, payload: bytes, header: dict[str, Any] | None = None) -> None:
    """A file with the right digest, made by somebody who knows how."""
    good = path.read_bytes()
    line = good.split(b"\n", 3)[2] if header is None else json.dumps(header).encode()
    body = line + b"\n" + payload
    path.write_bytes(b"rvaft checkpoint 2\n" + sha(body).encode() + b"\n" + body)


class Calls:
    """Pickles as a call."""

    def __init__(self, function: Callable[..., object], *arguments: object) -> None:
        self.call = function, arguments

    def __reduce__(self) -> Any:
        return self.call


def text(data: str) -> bytes:
    return b"\x8c" + bytes([len(data)]) + data.encode()


def called(place: str, name: str, argument: str) -> bytes:
    """A pickle that calls what stands in a module at the end of a path of attributes, and holds the result."""
    return b"\x80\x05" + text(place) + text(name) + b"\x93" + text(argument) + b"\x85RNN\x87."


def patching(place: str, name: str, attribute: str, value: str) -> bytes:
    """A pickle that sets an attribute of a class, and holds nothing."""
    state = b"N}" + text(attribute) + text(value) + b"s\x86"
    return b"\x80\x05" + text(place) + text(name) + b"\x93" + state + b"b0NNN\x87."


def harmful(victim: str) -> dict[str, bytes]:
    """Pickles that make a folder when they are read."""
    return {
        "a call": pickle.dumps((Calls(os.mkdir, victim), None, None)),
        "the shell": pickle.dumps((Calls(os.system, f"mkdir {victim}"), None, None)),
        "code": pickle.dumps((Calls(eval, f"__import__('os').mkdir({victim!r})"), None, None)),
        "what a module of ours imports": called("rvaft.monitoring.hooks", "os.mkdir", victim),
        "what a module with data imports": called("rvaft.monitoring.run", "Path.mkdir", victim),
    }


def malicious(victim: str) -> dict[str, bytes]:
    """Pickles that reach for more than they should."""
    return {
        "getattr": pickle.dumps((Calls(getattr, Path, "mkdir"), None, None)),
        "a function": called("rvaft.monitoring.run", "_chunks", victim),
        "a class that a module imports": called("rvaft.monitoring.run", "Path", victim),
        "below a class": called("rvaft.model.nodes", "Node.__init__.__globals__", victim),
        "a value": called("rvaft.model.tree", "TYPE_CHECKING", victim),
        "a class with commands": patching("rvaft.monitoring.hooks", "Hooks", "always", "x"),
        "no module of ours": called("rvaft.engine_of_mine", "Engine", victim),
        "nothing that is a pickle": b"\x00",
        "nothing": b"",
    }


@pytest.mark.parametrize("how", harmful(""))
def test_a_pickle_that_does_harm_is_refused(tmp_path: Path, trace: Path, how: str) -> None:
    victim = tmp_path / "victim"
    payload = harmful(str(victim))[how]
    pickle.loads(payload)
    victim.rmdir()  # it was there
    save(tmp_path / "kept", trace)
    forged(tmp_path / "kept", payload)
    assert "the checkpoint cannot be read" in refused(tmp_path / "kept", trace)
    assert not victim.exists()


@pytest.mark.parametrize("how", malicious(""))
def test_a_pickle_that_reaches_for_more_is_refused(tmp_path: Path, trace: Path, how: str) -> None:
    save(tmp_path / "kept", trace)
    before = dict(vars(Hooks))
    forged(tmp_path / "kept", malicious(str(tmp_path))[how])
    assert "the checkpoint cannot be read" in refused(tmp_path / "kept", trace)
    assert dict(vars(Hooks)) == before


def test_a_forged_header_is_refused(tmp_path: Path, trace: Path) -> None:
    save(tmp_path / "kept", trace)
    headers: list[Any] = [{}, {"version": 1}, [], "x"]
    for header in headers:
        forged(tmp_path / "kept", b"", header)
        assert "the checkpoint cannot be read" in refused(tmp_path / "kept", trace)


# -- the trace ----------------------------------------------------------------------------------------------------------


def test_a_trace_may_grow_and_move(tmp_path: Path, trace: Path) -> None:
    save(tmp_path / "kept", trace)
    with trace.open("ab") as more:
        more.write(b'{"event": "c"}\n')
    moved = tmp_path / "other.jsonl"
    moved.write_bytes(trace.read_bytes())
    assert loaded(tmp_path / "kept", moved) is not None


def test_another_trace_is_refused(tmp_path: Path, trace: Path) -> None:
    lines = [b'{"event": "x", "n": %d}\n' % number for number in range(20_000)]
    whole = b"".join(lines)
    trace.write_bytes(whole)
    offset = len(b"".join(lines[:15_000]))
    save(tmp_path / "kept", trace, offset=offset)
    assert loaded(tmp_path / "kept", trace) is not None
    trace.write_bytes(whole[: offset - 1])
    assert f"of a longer trace ({offset} bytes were read, {trace} has {offset - 1})" in refused(
        tmp_path / "kept", trace
    )
    changed = {
        "the start": b"X" + whole[1:],
        "the first lines": whole.replace(b'"n": 100}', b'"n": 101}', 1),
        "the last byte before": whole[: offset - 1] + b" " + whole[offset:],
        "the last lines": whole.replace(b'"n": 14990}', b'"n": 14991}', 1),
        "a line that is gone": whole.replace(lines[7_000], b"", 1),
        "the rest of a rotated log": b"".join(lines[5_000:] + lines[:5_000]),
    }
    for data in changed.values():
        trace.write_bytes(data)
        assert f"of another trace: {trace} does not begin with what was read" in refused(tmp_path / "kept", trace)
    trace.write_bytes(whole[:offset] + b'{"something": "else"}')
    assert loaded(tmp_path / "kept", trace) is not None
    trace.unlink()
    with pytest.raises(FileNotFoundError):
        loaded(tmp_path / "kept", trace)


def test_what_has_no_identity(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path, tmp_path / "pipe"):
        with pytest.raises(OptionError, match="a checkpoint needs a trace in a regular file"):
            TraceIdentity.of(path, 0)
    with pytest.raises(FileNotFoundError):
        TraceIdentity.of(tmp_path / "none", 0)


PACKING: dict[str, Callable[[bytes], bytes]] = {".gz": gzip.compress, ".zst": zstandard.compress}


def packed(path: Path, data: bytes) -> Path:
    path.write_bytes(PACKING.get(path.suffix.lower(), bytes)(data))
    return path


@pytest.mark.parametrize("name", ["log", "log.gz", "log.zst", "LOG.GZ"])
def test_reading_goes_on_after_any_event(tmp_path: Path, name: str) -> None:
    lines = [b'{"n": %d}\n%s' % (number, b"\r\n" * (number % 3 == 0)) for number in range(60)]
    whole = b"".join(lines)
    path = packed(tmp_path / name, whole)
    with open_at(path) as stream:
        places = [(event["n"], stream.offset, stream.line) for event in read(cast("BinaryIO", stream), name=name)]
    for number, offset, line in places:
        with open_at(path, offset=offset, line=line) as stream:
            events = [event["n"] for event in read(cast("BinaryIO", stream), name=name)]
            assert events == list(range(number + 1, 60))
            assert (stream.offset, stream.line) == (len(whole), whole.count(b"\n"))


@pytest.mark.parametrize("name", ["log.gz", "log.zst"])
def test_a_compressed_trace_that_changed(tmp_path: Path, name: str) -> None:
    trace, path = packed(tmp_path / name, LINES), tmp_path / "kept"
    save(path, trace)
    whole = trace.read_bytes()
    assert loaded(path, trace) is not None
    trace.write_bytes(whole + whole)  # another member
    assert loaded(path, trace) is not None
    packed(trace, LINES.replace(b"x", b"y"))
    refused(path, trace)
    trace.write_bytes(whole[: len(whole) // 2])
    assert "of a longer trace" in refused(path, trace)
    with pytest.raises(TraceError, match=rf"{name}:4: cannot be read: "), open_at(trace, offset=len(LINES), line=3):
        pass
    trace.write_bytes(whole)
    with (
        pytest.raises(TraceError, match="it ends before the place of the checkpoint"),
        open_at(trace, offset=1000, line=3),
    ):
        pass


# -- being killed -------------------------------------------------------------------------------------------------------


def told(folder: Path) -> tuple[list[int], list[str]]:
    """After which events a run went on each time, and all that it told."""
    lines = (folder / "told").read_text().splitlines() if (folder / "told").exists() else []
    starts = [int(line.split()[1]) for line in lines if line.startswith("from")]
    return starts, [line for line in lines if not line.startswith("from")]


@pytest.mark.parametrize(("suffix", "semantics", "kills"), [("", "projected", 24), (".gz", "scattered", 12)])
def test_being_killed_changes_no_verdict(tmp_path: Path, suffix: str, semantics: str, kills: int) -> None:
    log = killing.events(Random(7), 300)
    trace = packed(tmp_path / f"log.jsonl{suffix}", b"".join(json.dumps(event).encode() + b"\n" for event in log))
    straight = tmp_path / "straight"
    straight.mkdir()
    killing.watch(straight, trace, Semantics(semantics), checkpoints=False)
    _, expected = told(straight)
    assert len(expected) == len(log) + 1
    assert sum(" true " in line for line in expected) > 5
    words = [sys.executable, "-m", "tests.monitoring.killing", str(tmp_path), str(trace), semantics, str(kills), "seed"]
    done = subprocess.run(words, capture_output=True, text=True, check=False, cwd=Path(__file__).parents[2])
    assert (done.returncode, done.stderr) == (0, "")
    runs = sorted((path for path in tmp_path.iterdir() if path.name.isdigit()), key=lambda path: int(path.name))
    killing.watch(runs[-1], trace, Semantics(semantics))  # another process brings the last one to its end
    middle = 0
    for run in runs:
        starts, lines = told(run)
        # Whatever is repeated, it says the same; nothing is missing; and the end is the same.
        assert set(lines) == set(expected)
        assert [line for line in lines if line.startswith(killing.END)][-1] == expected[-1]
        middle += sum(0 < start < len(log) for start in starts)
    assert middle >= kills // 2


def test_large_monitors_are_kept(tmp_path: Path, trace: Path) -> None:
    """A match that is deeper than Python can recurse, and values as deep as a trace may have them."""
    leaves = tuple(f"n{number}" for number in range(2000))
    tree = RVAFT("top", [Node("top", rvaft.Gate.AND, leaves), *map(Node, leaves)])
    monitor = Engine(tree)
    for name in leaves[:-1]:
        monitor.step({"event": name})
    deep: Any = 1
    for _ in range(490):
        deep = [deep]
    variable = Engine(rvaft.loads("event e(v) = { v: v }; event f(v) = { f: v }; top sand x y; x on e(V); y on f(V);"))
    variable.step({"v": deep})
    save(tmp_path / "kept", trace, [monitor.snapshot(), variable.snapshot()])
    found = loaded(tmp_path / "kept", trace)
    assert found is not None
    for one, event, snapshot in zip(
        (monitor, variable), ({"event": leaves[-1]}, {"f": deep}), found.state, strict=True
    ):
        fresh = Engine(one.tree)
        fresh.restore(snapshot)
        assert fresh.step(event) is Verdict.TRUE
