"""Commands that are run on detection."""

import json
import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

import rvaft
from rvaft.model.nodes import Kind
from rvaft.stream import detection_commands as module
from rvaft.stream.detection import detection
from rvaft.stream.detection_commands import Hooks
from tests.cli.runs import soon

TREE = rvaft.loads(
    "event e(v) = { v: v }; top or x y; x sand a b; a fault on e(V); b on e(W) when W > V; y attack on e(_);"
)
DETECTED = detection({"event": 1}, None, {}, TREE)


def detected() -> dict[str, object]:
    monitor = rvaft.monitor(TREE, semantics="scattered", kind="fault")
    events = {number: {"v": number, "time": number / 2} for number in (1, 2)}
    for event in events.values():
        monitor.step(event)
    return detection({"tree": "t.rvaft", "key": "robot"}, monitor.explanation, events, TREE)


def test_the_command_is_told_the_detection(tmp_path: Path) -> None:
    said, events = tmp_path / "said", {"1": {"v": 1, "time": 0.5}, "2": {"v": 2, "time": 1.0}}
    assert Hooks(f"cat > {said}").run(detected()) == []
    text = said.read_text(encoding="utf-8")
    assert (text[-2:], text.count("\n")) == ("}\n", 1)
    matched = [
        {"node": "a", "occurrence": 1, "event": 1, "time": 0.5},
        {"node": "b", "occurrence": 1, "event": 2, "time": 1.0},
    ]
    found = {"branch": 1, "kinds": ["fault"], "matched": matched, "variables": {"V": 1, "W": 2}, "events": events}
    assert json.loads(text) == {"tree": "t.rvaft", "key": "robot", **found}
    # a backend does not explain
    assert DETECTED == {"event": 1, "branch": None, "kinds": [], "matched": [], "variables": {}, "events": {}}


@pytest.mark.parametrize(
    ("kinds", "also", "ran"),
    [([], [], "any"), (["fault"], [], "any fault"), (["attack"], [Kind.FAULT], "any fault attack")],
)
def test_each_kind_has_its_command(tmp_path: Path, kinds: list[str], also: list[Kind], ran: str) -> None:
    said = tmp_path / "said"
    commands = Hooks(f"echo any >> {said}", {kind: f"echo {kind} >> {said}" for kind in reversed(Kind)})
    assert commands.run({**DETECTED, "kinds": kinds}, also) == []
    assert said.read_text().split() == ran.split()


@pytest.mark.parametrize(
    ("command", "reason"),
    [
        ("exit 3", "ended with status 3"),
        ("no-such-command-anywhere 2>/dev/null", "ended with status 127 (command not found)"),
        (f"{shlex.quote(os.fspath(Path(__file__)))} 2>/dev/null", "ended with status 126 (cannot be executed)"),
        ("kill -9 $$", "was killed by SIGKILL"),
        ("a\0b", "cannot be run: embedded null byte"),
        ("true " + "x\n" * 2_500_000, "cannot be run: Argument list too long"),
    ],
)
def test_a_failure_is_told_in_a_line(command: str, reason: str) -> None:
    (failure,) = Hooks(command).run(DETECTED)
    assert failure.endswith(f"' {reason}")
    assert failure.startswith(f"the command {command[:4]!r}"[:-1])
    assert len(failure) < 200
    assert "\n" not in failure


@pytest.mark.parametrize(
    "command", ["exec 0<&-; sleep 0.05; true", "head -c 10 > /dev/null", "cat > /dev/null", "echo out; echo err >&2"]
)
def test_input_need_not_be_read_and_output_goes_to_standard_error(
    command: str, capfd: pytest.CaptureFixture[str]
) -> None:
    assert Hooks(command).run({**DETECTED, "events": {"1": {"text": "x" * 5_000_000}}}) == []
    said = capfd.readouterr()
    assert said.out == ""
    assert sorted(said.err.split()) == (["err", "out"] if "err" in command else [])


def test_a_monitor_without_standard_error() -> None:
    program = (
        "from rvaft.stream.detection_commands import Hooks\n"
        "import os; os._exit(len(Hooks('echo x').run({'kinds': []})))"
    )
    words = shlex.join([sys.executable, "-c", program])
    done = subprocess.run(["/bin/sh", "-c", f"{words} 2>&-"], capture_output=True, check=False)
    assert (done.returncode, done.stdout) == (0, b"")


def gone(pid: str) -> bool:
    """Whether a process has ended, give or take the moment until it is buried."""
    state = Path(f"/proc/{pid}/stat")
    return soon(lambda: not state.exists() or state.read_text().rpartition(")")[2].split()[0] == "Z")


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs /proc")
@pytest.mark.parametrize("stubborn", [False, True])
def test_a_command_that_does_not_end_is_ended_with_all_it_started(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stubborn: bool
) -> None:
    monkeypatch.setattr(module, "_GRACE", 0.2)
    monkeypatch.setattr(module, "TIMEOUT", 0.3)
    pids = tmp_path / "pids"
    ignore = "trap '' TERM; " if stubborn else ""
    command = f"{ignore}sleep 60 & echo $! $$ > {pids}; wait; sleep 60"
    (failure,) = Hooks(command).run({**DETECTED, "events": {"1": "x" * 1_000_000}})
    assert failure.endswith("did not end within 0.3 s and was killed")
    assert all(map(gone, pids.read_text().split()))


def test_a_command_may_leave_something_running(tmp_path: Path) -> None:
    go, said = tmp_path / "go", tmp_path / "said"
    assert Hooks(f"(until test -e {go}; do sleep 0.02; done; touch {said}) &").run(DETECTED) == []
    assert not said.exists()
    go.touch()
    assert soon(said.exists)


def test_an_interrupt_ends_the_command_and_comes_through(tmp_path: Path) -> None:
    pids = tmp_path / "pids"
    program = (
        "import sys\nfrom rvaft.stream.detection_commands import Hooks\n"
        "try:\n    Hooks(sys.argv[1]).run({'kinds': []})\nexcept KeyboardInterrupt:\n    print('interrupted')\n"
    )
    words = [sys.executable, "-c", program, f"sleep 0.3; echo $$ > {pids}.new; mv {pids}.new {pids}; exec sleep 60"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as running:
        assert soon(pids.exists)
        running.send_signal(2)
        assert running.communicate(timeout=20)[0] == "interrupted\n"
    assert gone(pids.read_text().strip())
