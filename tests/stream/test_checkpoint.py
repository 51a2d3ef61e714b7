"""Checkpoints: what they keep, what they refuse, and that being killed changes nothing."""

import gzip
import hashlib
import io
import json
import multiprocessing
import os
import pickle
import sys
from collections.abc import Callable
from contextlib import redirect_stdout
from math import inf
from pathlib import Path
from random import Random
from time import monotonic
from typing import Any, BinaryIO, cast

import pytest
import zstandard
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import rvaft
from rvaft.cli import main
from rvaft.core.fields_to_read import TreeReads
from rvaft.engine import Engine
from rvaft.errors import CheckpointError, OptionError, TraceError
from rvaft.model.nodes import Node
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Verdict
from rvaft.readers.json_lines import LinesRead, decode, read
from rvaft.rules.validity import valid_part
from rvaft.stream import checkpoint
from rvaft.stream.checkpoint import Checkpoint, CheckpointFile, identity, open_at
from rvaft.stream.detection_commands import Hooks
from rvaft.stream.monitor_set import MonitorSet, columns
from rvaft.stream.order import Ordering
from rvaft.stream.verdict_change import MonitoredTrace
from tests.cli.runs import run, written
from tests.tables import sampled

TREE = rvaft.loads("top or ab bc; ab sand a b fault; bc sand b c;")
LINES = b'{"event": "a"}\n\n{"event": "x"}\r\n{"event": "b"}\n'


@pytest.fixture
def trace(tmp_path: Path) -> Path:
    path = tmp_path / "log.jsonl"
    path.write_bytes(LINES)
    return path


def kept(path: Path, log: Path, **changes: Any) -> CheckpointFile:
    return CheckpointFile(path, **{"trees": [TREE], "trace": log, "settings": {"--key": "robot"}, **changes})


def save(path: Path, log: Path, state: object = None, *, events: int = 1, offset: int = 15, **changes: Any) -> None:
    """A checkpoint after the first event."""
    kept(path, log, **changes).save(lambda: state, events, LinesRead(io.BytesIO(), offset=offset, line=1))


def loaded(path: Path, log: Path, **changes: Any) -> tuple[Checkpoint, Any]:
    found = kept(path, log, **changes).load()
    assert found is not None
    return found[0], found[2]


def refused(path: Path, trace: Path, **changes: Any) -> str:
    """The message of the error, which is one line."""
    with pytest.raises(CheckpointError) as caught:
        loaded(path, trace, **changes)
    assert str(caught.value) == f"{path}: {caught.value.reason}"
    assert "\n" not in str(caught.value)
    return caught.value.reason


# -- what is kept
# -------------------------------------------------------------------------------------------------------


def test_all_is_kept(tmp_path: Path, trace: Path) -> None:
    path = tmp_path / "kept"
    assert kept(path, trace).load() is None
    monitor = Engine(TREE, "scattered")
    monitor.step({"event": "a"})
    event = decode(
        b'{"event": "x", "time": 3, "n": {"k": 1, "k": 2}, "l": [null, true, 1e3, "\\u00e9"]}', reads=TreeReads(TREE)
    )
    ordering: Ordering[Any] = Ordering("time", window=4)
    ordering.add(event)
    save(path, trace, (monitor.snapshot(), ordering), events=7)
    found, (snapshot, held) = loaded(path, trace)
    assert (found.events, found.offset, found.line) == (7, 15, 1)
    fresh = Engine(TREE, "scattered")
    fresh.restore(snapshot)
    assert fresh.step({"event": "b"}) is Verdict.TRUE
    assert list(held.rest()) == [event]


def test_what_was_told_is_remembered_until_the_next_checkpoint(tmp_path: Path, trace: Path) -> None:
    path, place = tmp_path / "kept", LinesRead(io.BytesIO(), offset=15, line=1)
    one, again, last = (kept(path, trace) for _ in range(3))
    one.save(lambda: None, 1, place)
    one.note(3)
    again.load()
    assert again.noted == 3
    again.save(lambda: None, 4, place)
    one.note(9)  # of the checkpoint that is gone
    last.load()
    assert last.noted == 0


def test_writing_takes_no_longer_than_all_the_rest(
    tmp_path: Path, trace: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [0.0]
    monkeypatch.setattr(checkpoint, "monotonic", lambda: now[0])
    one = kept(tmp_path / "kept", trace, every=2)
    monkeypatch.setattr(checkpoint, "write_whole", lambda *_, **__: now.__setitem__(0, now[0] + 1))
    due = []

    def state() -> None:
        now[0] += 1  # to build it counts, too

    for events in range(1, 200):
        now[0] += 0.1
        if one.is_due(events):
            due.append(events)
            one.save(state, events, LinesRead(io.BytesIO(), offset=15, line=1))
            assert len(due) == 1 or 2 * 2 * len(due) <= now[0] + 0.5
    assert due[0] == 2
    assert 4 <= len(due) <= 10


def test_what_would_take_too_long_is_put_off(tmp_path: Path, trace: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A large state is packed in parts, of which each takes no longer than the work before it."""
    now = [0.0]
    monkeypatch.setattr(checkpoint, "monotonic", lambda: now[0])
    pack = checkpoint.packed

    def packed_slowly(state: object, deadline: float = inf) -> bytes:
        now[0] += 1.0 * isinstance(state, list)
        return pack(state, deadline)

    monkeypatch.setattr(checkpoint, "packed", packed_slowly)
    monitors = MonitorSet(columns(TREE), Engine, rvaft.Semantics.PROJECTED)
    traces = [MonitoredTrace("log", monitors.fork(), (number,), events=1) for number in range(5_000)]
    one, path = kept(tmp_path / "kept", trace, every=1), tmp_path / "kept"
    begun = tries = 0
    while not path.exists():
        begun += 1
        now[0] += 0.5
        if one.is_due(begun):
            tries += 1
            place = LinesRead(io.BytesIO(), offset=15, line=1)
            one.save(lambda: None, begun, place, traces=traces, bounded=True)
            assert now[0] <= 2 * 0.5 * begun + 2
    assert tries > 2
    found = kept(path, trace).load()
    assert found is not None
    assert [key for key, _, _ in found[1]] == [(number,) for number in range(5_000)]


def test_the_next_checkpoint_takes_the_place_of_the_last(tmp_path: Path, trace: Path) -> None:
    """Also where a crash left half of one; a link stays a link."""
    path, link = tmp_path / "kept", tmp_path / "link"
    link.symlink_to(path)
    for events in range(3):
        (tmp_path / ".kept.new").write_bytes(b"half")
        save(link, trace, events=events)
        assert loaded(path, trace)[0].events == events
    assert link.is_symlink()
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["kept", "link", "log.jsonl"]
    assert path.stat().st_mode & 0o777 == 0o600


def test_it_is_on_the_disk_before_it_takes_its_place(
    tmp_path: Path, trace: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file is synced whole, then renamed, then the folder is synced; where that fails the last one is left."""
    done: list[str] = []
    path, sync, rename = tmp_path / "kept", os.fsync, Path.replace

    def synced(handle: int) -> None:
        name = Path(f"/proc/self/fd/{handle}").readlink().name
        done.append(f"sync {name} {os.fstat(handle).st_size if name.endswith('new') else ''}".strip())
        sync(handle)

    def renamed(self: Path, target: Path) -> Path:
        done.append(f"rename {self.name}")
        return rename(self, target)

    def full(_handle: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", synced)
    monkeypatch.setattr(Path, "replace", renamed)
    save(path, trace)
    before = path.read_bytes()
    assert done == [f"sync .kept.new {len(before)}", "rename .kept.new", f"sync {tmp_path.name}"]
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


# -- what is refused
# ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"trees": [rvaft.loads("top or ab bc; ab sand b a fault; bc sand b c;")]}, "a checkpoint of another tree"),
        ({"trees": [valid_part(TREE, branch=1)]}, "a checkpoint of another tree, or of another part of it"),
        ({"trees": [valid_part(TREE, kind="fault")]}, "a checkpoint of another tree, or of another part of it"),
        ({"settings": {}}, "of a run with --key robot, not without --key"),
        ({"settings": {"--key": "id"}}, "of a run with --key robot, not with --key id"),
        ({"settings": {"--key": "robot", "--order-by": "t"}}, "of a run without --order-by, not with --order-by t"),
        ({"settings": {"--key": "robot", "--repeat": ""}}, "of a run without --repeat, not with --repeat:"),
    ],
)
def test_a_checkpoint_of_another_run_is_refused(
    tmp_path: Path, trace: Path, changes: dict[str, Any], reason: str
) -> None:
    save(tmp_path / "kept", trace)
    said = refused(tmp_path / "kept", trace, **changes)
    assert reason in said
    assert said.endswith("remove it to begin anew")
    save(tmp_path / "kept", trace, **changes)
    loaded(tmp_path / "kept", trace, **changes)
    refused(tmp_path / "kept", trace)


def test_a_checkpoint_of_another_version_is_refused(
    tmp_path: Path, trace: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "kept"
    with monkeypatch.context() as patched:
        patched.setattr("rvaft.stream.checkpoint.version", lambda: "0.0.9")
        save(path, trace)
    assert f"a checkpoint of rvaft 0.0.9, this is {rvaft.__version__}" in refused(path, trace)
    path.write_bytes(path.read_bytes().replace(b"rvaft checkpoint 9", b"rvaft checkpoint 8", 1))
    assert "a checkpoint of another version of rvaft" in refused(path, trace)
    for data in (b"", b"{}", LINES, b"\x80\x05.", b"rvaft check", b"\xff" * 100):
        path.write_bytes(data)
        assert "no checkpoint of rvaft" in refused(path, trace)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=100)
@given(st.floats(0, 0.999), st.integers(0, 1), st.binary(max_size=3))
def test_a_damaged_file_is_refused(tmp_path: Path, trace: Path, where: float, gone: int, more: bytes) -> None:
    whole, path = tmp_path / "whole", tmp_path / "kept"
    if not whole.exists():
        save(whole, trace)
    good = whole.read_bytes()
    at = int(where * len(good))
    path.write_bytes(good[:at] + more + good[at + gone :])
    if path.read_bytes() != good:
        refused(path, trace)
    path.write_bytes(good[:at])
    refused(path, trace)


def forged(path: Path, payload: bytes, header: bytes | None = None) -> None:
    """A file with the right digest, made by somebody who knows how."""
    line = path.read_bytes().split(b"\n", 3)[2] if header is None else header
    body = line + b"\n" + payload
    path.write_bytes(b"rvaft checkpoint 9\n" + hashlib.sha256(body).hexdigest().encode() + b"\n" + body)


def text(data: str) -> bytes:
    return b"\x8c" + bytes([len(data)]) + data.encode()


def called(place: str, name: str, argument: str) -> bytes:
    """A pickle that calls what stands in a module at the end of a path of attributes, and holds the result."""
    return b"\x80\x05" + text(place) + text(name) + b"\x93" + text(argument) + b"\x85RNN\x87."


CALLS = [
    ("os", "mkdir", "{}"),
    ("os", "system", "mkdir {}"),
    ("builtins", "eval", "__import__('os').mkdir('{}')"),
    ("rvaft.stream.detection_commands", "os.mkdir", "{}"),  # what a module of ours imports
    ("rvaft.stream.event_buffer", "Path.mkdir", "{}"),
    (
        "rvaft.stream.event_buffer",
        "Path",
        "{}",
    ),  # from here on nothing is made at once, but more is reached than should be
    ("builtins", "getattr", "{}"),
    ("rvaft.model.nodes", "Node.__init__.__globals__", "{}"),
    ("rvaft.model.tree", "TYPE_CHECKING", "{}"),
    ("rvaft.engine_of_mine", "Engine", "{}"),
]
SETS_COMMANDS = (
    text("rvaft.stream.detection_commands")
    + text("Hooks")
    + b"\x93N}"
    + text("always")
    + text("x")
    + b"s\x86b0NNN\x87."
)


def test_a_forged_file_is_refused(tmp_path: Path, trace: Path) -> None:
    path, victim, before = tmp_path / "kept", tmp_path / "victim", dict(vars(Hooks))
    save(path, trace)
    calls = [called(place, name, argument.format(victim)) for place, name, argument in CALLS]
    for payload in calls[:5]:
        pickle.loads(payload)
        victim.rmdir()  # it was there
    for payload in (*calls, b"\x80\x05" + SETS_COMMANDS, b"\x00", b""):
        forged(path, payload)
        assert "the checkpoint cannot be read" in refused(path, trace)
        assert not victim.exists()
    assert dict(vars(Hooks)) == before
    for header in (b"{}", b'{"version": 1}', b"[]", b'"x"'):
        forged(path, b"", header)
        assert "the checkpoint cannot be read" in refused(path, trace)


# -- the trace
# ----------------------------------------------------------------------------------------------------------


def test_another_trace_is_refused(tmp_path: Path, trace: Path) -> None:
    lines = [b'{"event": "x", "n": %d}\n' % number for number in range(20_000)]
    whole = b"".join(lines)
    trace.write_bytes(whole)
    offset = len(b"".join(lines[:15_000]))
    save(tmp_path / "kept", trace, offset=offset)
    moved = tmp_path / "other.jsonl"
    for data in (whole, whole[:offset], whole[:offset] + b'{"something": "else"}'):
        moved.write_bytes(data)
        loaded(tmp_path / "kept", moved)
    trace.write_bytes(whole[: offset - 1])
    shorter = f"of a longer trace ({offset} bytes were read, {trace} has {offset - 1})"
    assert shorter in refused(tmp_path / "kept", trace)
    for data in (
        b"X" + whole[1:],
        whole.replace(b'"n": 100}', b'"n": 101}', 1),
        whole[: offset - 1] + b" " + whole[offset:],
        whole.replace(b'"n": 14990}', b'"n": 14991}', 1),
        whole.replace(lines[7_000], b"", 1),
        b"".join(lines[5_000:] + lines[:5_000]),
    ):
        trace.write_bytes(data)
        assert f"of another trace: {trace} does not begin with what was read" in refused(tmp_path / "kept", trace)
    trace.unlink()
    with pytest.raises(FileNotFoundError):
        loaded(tmp_path / "kept", trace)
    os.mkfifo(trace)
    for path in (tmp_path, trace):
        with pytest.raises(OptionError, match="a checkpoint needs a trace in a regular file"):
            identity(path, 0)


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
    for data in (whole, whole + whole):  # another member
        trace.write_bytes(data)
        loaded(path, trace)
    packed(trace, LINES.replace(b"x", b"y"))
    refused(path, trace)
    trace.write_bytes(whole[: len(whole) // 2])
    assert "of a longer trace" in refused(path, trace)
    for offset, reason in ((len(LINES), rf"{name}:4: cannot be read: "), (1000, "before the place of the checkpoint")):
        with pytest.raises(TraceError, match=reason), open_at(trace, offset=offset, line=3):
            pass
        trace.write_bytes(whole)


# -- being killed
# -------------------------------------------------------------------------------------------------------


SEVERAL = """
event go(v) = { name: "go", v: v };
event back(v) = { name: "back", v: v };
top or pair all;
pair sand x y attack; x on go(V); y on back(W) when W == V + 1;
all 2of3 a b both fault; both and a c; c sand d e;
"""


def events(random: Random, count: int) -> list[dict[str, Any]]:
    """Events of several robots in one stream, not quite in order."""
    made: list[dict[str, Any]] = []
    for number in range(count):
        event: dict[str, Any] = {"robot": random.randrange(count // 15), "time": number + random.randrange(6)}
        name = random.choice(["go", "back", "a", "b", "c", "d", "e", "other", "other"])
        event |= {"name": name, "v": random.randrange(4)} if name in ("go", "back") else {"event": name}
        made.append(event)
    return made


def go_on(told: Path, words: list[str]) -> None:
    """The command, in a process that may be killed."""
    with told.open("w") as out, redirect_stdout(out):
        main(words, standalone_mode=False)


@pytest.mark.parametrize(
    ("suffix", "semantics", "rounds"),
    sampled([("", "projected", 1), ("", "projected", 4), (".gz", "scattered", 2)], 3),
)
def test_being_killed_changes_no_verdict(tmp_path: Path, suffix: str, semantics: str, rounds: int) -> None:
    """Whatever is told again says the same, nothing is missing, and the end is the same."""
    random, state, told = Random(7), tmp_path / "state", tmp_path / "told"
    tree = written(tmp_path / "tree.rvaft", SEVERAL)
    log = packed(tmp_path / f"log{suffix}", b"".join(json.dumps(one).encode() + b"\n" for one in events(random, 300)))
    words = ["monitor", str(tree), str(log), "--semantics", semantics, "--key", "robot"]
    words += ["--order-by", "time", "--window", "5"]
    keeping = [*words, "--checkpoint", str(state), "--checkpoint-every", "7"]
    whole, summary = run(*words, "--format", "jsonl").stdout.splitlines(), run(*words).stdout.splitlines()[-20:]
    assert (len(whole), sum('"verdict": "true"' in line for line in whole) > 5) == (300, True)
    begun, middle = monotonic(), 0
    run(*keeping)
    takes = monotonic() - begun
    for _ in range(rounds):
        state.unlink()
        said: list[str] = []
        for moment in (*(random.uniform(0, takes) for _ in range(3)), 60):
            told.write_text("")
            child = multiprocessing.get_context("fork").Process(
                target=go_on, args=(told, [*keeping, "--format", "jsonl"])
            )
            child.start()
            child.join(moment)
            child.kill()
            child.join()
            assert child.exitcode in (0, -9)
            new = told.read_text().replace(', "again": true', "").split("\n")[:-1]
            middle += new[:1] not in ([], whole[:1])
            said += new
        assert set(said) == set(whole)
        assert said[-1] == whole[-1]
        assert run(*keeping).stdout.splitlines()[-20:] == summary
    assert middle > 0


@pytest.mark.ci
@pytest.mark.parametrize("options", [["--key", "robot", "--per", "kind"], ["--order-by", "time", "--cooldown", "9 s"]])
def test_being_killed_tells_no_detection_twice_without_a_mark(tmp_path: Path, options: list[str]) -> None:
    """Monitors that repeat: each detection is there, with the number that it has in a run that
    never stopped, once unmarked or only marked.
    """
    random, state, told = Random(3), tmp_path / "state", tmp_path / "told"
    tree = written(tmp_path / "tree.rvaft", f"time time as s; {SEVERAL}")
    log = written(tmp_path / "log", "".join(json.dumps(one) + "\n" for one in events(random, 400)))
    words = ["monitor", str(tree), str(log), "--semantics", "scattered", "--repeat", *options]
    words += ["--format", "jsonl", "--detections"]
    whole = run(*words)
    assert len(whole.stdout.splitlines()) > 10
    keeping = [*words, "--checkpoint", str(state), "--checkpoint-every", "150"]
    begun, marked = monotonic(), 0
    run(*keeping)
    takes = monotonic() - begun
    for number in range(20):
        if number >= 3 and marked:  # it was stopped between a detection and a checkpoint
            break
        state.unlink()
        said: list[str] = []
        for moment in (*(random.uniform(0.2, 0.9) * takes for _ in range(4)), 60):
            told.write_text("")
            child = multiprocessing.get_context("fork").Process(target=go_on, args=(told, keeping))
            child.start()
            child.join(moment)
            child.kill()
            child.join()
            said += told.read_text().split("\n")[:-1]
        unmarked = [line for line in said if '"again": true' not in line]
        assert len(set(unmarked)) == len(unmarked)
        again = {line.replace(', "again": true', "") for line in said}
        assert again == set(whole.stdout.splitlines())
        marked += len(said) - len(unmarked)
        assert run(*keeping).stderr == whole.stderr
    assert marked


@pytest.mark.ci
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
    _, state = loaded(tmp_path / "kept", trace)
    for one, event, snapshot in zip((monitor, variable), ({"event": leaves[-1]}, {"f": deep}), state, strict=True):
        fresh = Engine(one.tree)
        fresh.restore(snapshot)
        assert fresh.step(event) is Verdict.TRUE
