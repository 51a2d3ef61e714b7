"""Commands that are run on detection."""

import json
import os
import shlex
import subprocess
import sys
import time
from pathlib import Path

import pytest

import rvaft
from rvaft.errors import OptionError
from rvaft.model.nodes import Kind
from rvaft.model.tree import RVAFT
from rvaft.monitoring import hooks
from rvaft.monitoring.hooks import CommandFailure, Hooks, detection
from rvaft.monitoring.run import Detection

TREE = rvaft.loads(
    "event e(v) = { v: v }; top or x y; x sand a b; a fault on e(V); b on e(W) when W > V; y attack on e(_);"
)
DETECTED = detection(Detection(None, {}), TREE, name="t.rvaft", trace="log", event=1)


def detected(tree: RVAFT = TREE, kinds: str = "fault", **more: object) -> dict[str, object]:
    monitor = rvaft.monitor(tree, semantics="scattered", kind=kinds)
    events = {number: {"v": number, "time": number / 2} for number in (1, 2)}
    for event in events.values():
        monitor.step(event)
    found = Detection(monitor.explanation, events)
    return detection(found, tree, name="t.rvaft", trace="log", event=2, **more)  # type: ignore[arg-type]


def test_the_command_is_told_the_detection(tmp_path: Path) -> None:
    said = tmp_path / "said"
    assert Hooks(f"cat > {said}").run(detected(key=("robot",))) == ()
    text = said.read_text(encoding="utf-8")
    assert text.endswith("}\n")
    assert text.count("\n") == 1
    assert json.loads(text) == {
        "tree": "t.rvaft",
        "trace": "log",
        "key": "robot",
        "event": 2,
        "branch": 1,
        "kinds": ["fault"],
        "matched": [{"node": "a", "event": 1, "time": 0.5}, {"node": "b", "event": 2, "time": 1.0}],
        "variables": {"V": 1, "W": 2},
        "events": {"1": {"v": 1, "time": 0.5}, "2": {"v": 2, "time": 1.0}},
    }
    assert "key" not in detected()
    assert detected(key=(None,))["key"] is None


def test_a_monitor_that_does_not_explain() -> None:
    assert DETECTED == {
        "tree": "t.rvaft",
        "trace": "log",
        "event": 1,
        "branch": None,
        "kinds": [],
        "matched": [],
        "variables": {},
        "events": {},
    }


@pytest.mark.parametrize(
    ("kinds", "ran"), [([], "any"), (["fault"], "any fault"), (["attack", "fault"], "any fault attack")]
)
def test_each_kind_has_its_command(tmp_path: Path, kinds: list[str], ran: str) -> None:
    said = tmp_path / "said"
    commands = Hooks(f"echo any >> {said}", {kind: f"echo {kind} >> {said}" for kind in reversed(Kind)})
    assert commands.run({**DETECTED, "kinds": kinds}) == ()
    assert said.read_text().split() == ran.split()
    assert Hooks(on={Kind.ATTACK: "false"}).run({**DETECTED, "kinds": ["fault"]}) == ()


@pytest.mark.parametrize(
    ("command", "reason"),
    [
        ("exit 3", "ended with status 3"),
        ("no-such-command-anywhere 2>/dev/null", "ended with status 127 (command not found)"),
        (f"{shlex.quote(os.fspath(Path(__file__)))} 2>/dev/null", "ended with status 126 (cannot be executed)"),
        ("kill -9 $$", "was killed by SIGKILL"),
        ("a\0b", "cannot be run: embedded null byte"),
        ("true " + "x" * 5_000_000, "cannot be run: Argument list too long"),
    ],
)
def test_a_failure_is_told(command: str, reason: str) -> None:
    (failure,) = Hooks(command).run(DETECTED)
    assert failure == CommandFailure(command, reason)
    assert len(str(failure)) < 200
    assert "\n" not in str(failure)


def test_input_that_is_not_read_does_no_harm() -> None:
    large = {**DETECTED, "events": {"1": {"text": "x" * 5_000_000}}}
    assert Hooks("exec 0<&-; sleep 0.05; true").run(large) == ()
    assert Hooks("head -c 10 > /dev/null").run(large) == ()
    assert Hooks("cat > /dev/null").run(large) == ()


def test_output_goes_to_standard_error(capfd: pytest.CaptureFixture[str]) -> None:
    assert Hooks("echo out; echo err >&2").run(DETECTED) == ()
    said = capfd.readouterr()
    assert said.out == ""
    assert sorted(said.err.split()) == ["err", "out"]


SILENT = "from rvaft.monitoring.hooks import Hooks; import os; os._exit(len(Hooks('echo out').run({'kinds': []})))"


def test_a_monitor_without_standard_error() -> None:
    words = shlex.join([sys.executable, "-c", SILENT])
    done = subprocess.run(["/bin/sh", "-c", f"{words} 2>&-"], capture_output=True, check=False)
    assert (done.returncode, done.stdout) == (0, b"")


def gone(pid: int) -> bool:
    """Whether a process has ended, give or take the moment until it is buried."""
    for _ in range(100):
        try:
            state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
        except FileNotFoundError:
            return True
        if state == "Z":
            return True
        time.sleep(0.02)
    return False


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs /proc")
@pytest.mark.parametrize("stubborn", [False, True])
def test_a_command_that_does_not_end_is_ended_with_all_it_started(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stubborn: bool
) -> None:
    monkeypatch.setattr(hooks, "_GRACE", 0.2)
    pids = tmp_path / "pids"
    ignore = "trap '' TERM; " if stubborn else ""
    command = f"{ignore}sleep 60 & echo $! $$ > {pids}; wait; sleep 60"
    begun = time.monotonic()
    (failure,) = Hooks(command, timeout=0.3).run({**DETECTED, "events": {"1": "x" * 1_000_000}})
    assert time.monotonic() - begun < 10
    assert failure.reason == "did not end within 0.3 s and was killed"
    assert all(gone(int(pid)) for pid in pids.read_text().split())


def test_a_command_may_leave_something_running(tmp_path: Path) -> None:
    go, said = tmp_path / "go", tmp_path / "said"
    assert Hooks(f"(until test -e {go}; do sleep 0.02; done; touch {said}) &", timeout=20).run(DETECTED) == ()
    assert not said.exists()
    go.touch()
    begun = time.monotonic()
    while not said.exists():
        assert time.monotonic() - begun < 20
        time.sleep(0.02)


def test_an_interrupt_ends_the_command_and_comes_through(tmp_path: Path) -> None:
    pids = tmp_path / "pids"
    program = (
        "import sys\nfrom rvaft.monitoring.hooks import Hooks\n"
        "try:\n    Hooks(sys.argv[1]).run({'kinds': []})\nexcept KeyboardInterrupt:\n    print('interrupted')\n"
    )
    words = [sys.executable, "-c", program, f"sleep 1; echo $$ > {pids}.new; mv {pids}.new {pids}; exec sleep 60"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as running:
        for _ in range(1000):
            if pids.exists():
                break
            time.sleep(0.02)
        running.send_signal(2)
        assert running.communicate(timeout=20)[0] == "interrupted\n"
    assert gone(int(pids.read_text()))


@pytest.mark.parametrize("timeout", [0, -1, float("nan")])
def test_a_timeout_is_positive(timeout: float) -> None:
    with pytest.raises(OptionError, match="timeout"):
        Hooks("true", timeout=timeout)
