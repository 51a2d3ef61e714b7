"""The package, installed into a fresh environment outside the checkout, does its work there."""

import os
import subprocess
import sys
from collections.abc import Iterator
from importlib.metadata import Distribution, distribution
from pathlib import Path

import pytest
from packaging.requirements import Requirement

pytestmark = pytest.mark.ci
ROOT = Path(__file__).parents[2]


def run(*command: str | Path, cwd: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    env = {**os.environ, **environment}
    return subprocess.run(command, cwd=cwd, env=env, capture_output=True, text=True, timeout=600, check=False)


def dependencies(of: Distribution) -> Iterator[Distribution]:
    """What a distribution says it needs, and what that needs, as it is installed here."""
    for requirement in map(Requirement, of.requires or ()):
        if requirement.marker is None or requirement.marker.evaluate({"extra": ""}):
            found = distribution(requirement.name)
            assert found.version in requirement.specifier
            yield found
            yield from dependencies(found)


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder whose environment has the wheel that pip makes of the checkout, and of what is here
    only what that depends on.
    """
    folder = tmp_path_factory.mktemp("wheel")
    made = run(sys.executable, "-m", "venv", "--without-pip", "venv", cwd=folder)
    assert made.returncode == 0, made.stderr
    wheel = ("-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation", "--wheel-dir", "made", ROOT)
    built = run(sys.executable, *wheel, cwd=folder)
    assert built.returncode == 0, built.stderr
    (source,) = (folder / "made").iterdir()
    install = ("-m", "pip", "install", "--quiet", "--no-deps", source)
    done = run(sys.executable, *install, cwd=folder, PIP_PYTHON=str(folder / "venv/bin/python"), PIP_NO_COMPILE="1")
    assert done.returncode == 0, done.stderr
    (metadata,) = (folder / "venv").glob("lib/python*/site-packages/rvaft-*.dist-info")
    for needed in dependencies(Distribution.at(metadata)):
        for name in {file.parts[0] for file in needed.files or ()} - {"..", "__pycache__"}:
            if not (link := metadata.with_name(name)).exists():
                link.symlink_to(str(needed.locate_file(name)))
    return folder


def test_check_emit_monitor_work_there(installed: Path) -> None:
    tree = installed / "vot.rvaft"
    tree.write_text("top 2of3 a b c;\na; b; c;\n", encoding="utf-8")
    rvaft = installed / "venv/bin/rvaft"
    where = "import rvaft, backends, cross_check; print(rvaft.__file__)"
    done = run(installed / "venv/bin/python", "-c", where, cwd=installed)
    assert (done.returncode, str(ROOT) in done.stdout) == (0, False), done.stderr
    emitted = run(rvaft, "emit", tree, "--to", "rml", cwd=installed)
    assert (emitted.returncode, bool(emitted.stdout)) == (0, True), emitted.stderr
    for options in ([], ["--backend", "automaton"]):
        found = run(rvaft, "monitor", tree, "--word", "c a", *options, cwd=installed)
        assert (found.returncode, "event 2: true" in found.stdout) == (1, True), found.stderr
    log = installed / "log.jsonl"
    log.write_text('{"event": "a"}\n', encoding="utf-8")
    page = run(rvaft, "report", tree, log, cwd=installed)
    assert (page.returncode, page.stdout.startswith("<!DOCTYPE html>")) == (0, True), page.stderr


def test_languages_are_compared_there(installed: Path) -> None:
    asked = ("--gates", "and", "--max-arity", "2", "--languages", "rml")
    done = run(installed / "venv/bin/rvaft", "compare", *asked, cwd=installed)
    assert (done.returncode, "rml" in done.stdout) == (0, True), done.stdout + done.stderr


def test_the_gates_are_compared_there(installed: Path) -> None:
    """The trees of the run without arguments come with the package."""
    done = run(installed / "venv/bin/rvaft", "cross-check", "--backends", "rml", "--semantics", "strict", cwd=installed)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "no disagreement" in done.stdout
