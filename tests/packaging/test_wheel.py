"""The wheel, installed into a fresh environment outside the checkout, does its work there."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[2]


def run(*command: str | Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(list(map(str, command)), cwd=cwd, capture_output=True, text=True, timeout=600, check=False)


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    built = run(sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", folder, ROOT, cwd=folder)
    assert built.returncode == 0, built.stderr
    (wheel,) = folder.glob("*.whl")
    assert run(sys.executable, "-m", "venv", folder / "venv", cwd=folder).returncode == 0
    done = run(folder / "venv/bin/python", "-m", "pip", "install", "--quiet", "--no-compile", wheel, cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder


def test_check_emit_monitor_work_there(installed: Path) -> None:
    tree = installed / "vot.rvaft"
    tree.write_text("top 2of3 a b c;\na; b; c;\n", encoding="utf-8")
    rvaft = installed / "venv/bin/rvaft"
    assert run(rvaft, "check", tree, cwd=installed).returncode == 0
    where = "import rvaft, backends, cross_check; print(rvaft.__file__)"
    done = run(installed / "venv/bin/python", "-c", where, cwd=installed)
    assert (done.returncode, str(ROOT) in done.stdout) == (0, False), done.stderr
    for language in ("rml", "automaton"):
        emitted = run(rvaft, "emit", tree, "--to", language, cwd=installed)
        assert emitted.returncode == 0, emitted.stderr
        assert emitted.stdout
        found = run(rvaft, "monitor", tree, "--word", "c a", "--backend", language, cwd=installed)
        assert found.returncode == 1, found.stderr
    found = run(rvaft, "monitor", tree, "--word", "c a", cwd=installed)
    assert found.returncode == 1
    assert "event 2: true" in found.stdout


def test_the_gates_are_compared_there(installed: Path) -> None:
    """The trees of the run without arguments come with the package."""
    done = run(installed / "venv/bin/rvaft", "cross-check", "--backends", "rml", "--semantics", "strict", cwd=installed)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "no disagreement" in done.stdout


def test_the_action_installs_the_package(installed: Path) -> None:
    """The command of `action.yml`, in an environment that has the dependencies already."""
    steps = yaml.safe_load((ROOT / "action.yml").read_text(encoding="utf-8"))["runs"]["steps"]
    (install,) = [step["run"] for step in steps if step.get("name") == "Install rvaft"]
    venv = installed / "venv" / "bin"
    assert run(venv / "python", "-m", "pip", "uninstall", "--yes", "--quiet", "rvaft", cwd=installed).returncode == 0
    done = subprocess.run(
        ["bash", "-eo", "pipefail", "-c", install],
        env={**os.environ, "PATH": f"{venv}{os.pathsep}{os.environ['PATH']}", "RVAFT_SOURCE": str(ROOT)},
        cwd=installed,
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert run(venv / "rvaft", "--version", cwd=installed).returncode == 0
