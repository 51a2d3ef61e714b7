"""The GitHub Action and the hooks for pre-commit: the very commands they contain, run on a repository of trees."""

import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any, Final
from xml.etree import ElementTree as ET

import pytest
import yaml

from tests.cli.runs import run

ROOT: Final = Path(__file__).parents[2]
ACTION: Final = yaml.safe_load((ROOT / "action.yml").read_text())
HOOKS: Final = {hook["id"]: hook for hook in yaml.safe_load((ROOT / ".pre-commit-hooks.yaml").read_text())}
EXPRESSION: Final = re.compile(r"\$\{\{ (inputs|github)\.([a-z_-]+) \}\}")

GOOD: Final = "toplevel r; r and a s; s sand b c; a; b; c;\n"
BAD: Final = "toplevel r; r and a b; b and r;\n"


def steps() -> dict[str, dict[str, Any]]:
    return {step["name"]: step for step in ACTION["runs"]["steps"] if "run" in step}


def reports(folder: Path) -> Path:
    """Where the reports go: beside the checkout."""
    temporary = folder.with_name(f"{folder.name}-temp")
    temporary.mkdir(exist_ok=True)
    return temporary / "rvaft-reports"


def run_step(name: str, folder: Path, **inputs: str) -> subprocess.CompletedProcess[str]:
    """Run a step as a runner does: the inputs come by its environment, and the shell stops at the first error."""
    step = steps()[name]
    given = {key: str(value.get("default", "")) for key, value in ACTION["inputs"].items()} | inputs

    def value(found: re.Match[str]) -> str:
        return given[found[2]] if found[1] == "inputs" else str(ROOT)

    environment = {key: EXPRESSION.sub(value, text) for key, text in step.get("env", {}).items()}
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    return subprocess.run(
        ["bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", step["run"]],
        cwd=folder,
        env={
            **{key: text for key, text in os.environ.items() if key != "PYTHONPATH"},
            **environment,
            "PATH": path,
            "RUNNER_TEMP": str(reports(folder).parent),
            "GITHUB_STEP_SUMMARY": str(folder / "summary"),
        },
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    (tmp_path / "models" / "deep").mkdir(parents=True)
    (tmp_path / "models" / "deep" / "good tree.rvaft").write_text(GOOD)
    (tmp_path / "top.rvaft").write_text(GOOD)
    return tmp_path


def test_nothing_is_interpolated_into_a_script() -> None:
    """What a user gives reaches the shell by the environment only, so that it cannot be a command."""
    assert steps().keys() == {"Install rvaft", "Check the trees", "Test the trees", "Cross-check the trees"}
    assert not any("${{" in step["run"] for step in steps().values())


@pytest.mark.ci
def test_good_trees_pass_and_leave_reports(repository: Path) -> None:
    pytest.importorskip("spot")
    checked = run_step("Check the trees", repository)
    assert (checked.returncode, checked.stdout) == (0, ""), checked.stderr
    compared = run_step("Cross-check the trees", repository, semantics="strict,scattered")
    assert compared.returncode == 0, compared.stdout + compared.stderr
    junit = ET.parse(reports(repository) / "junit.xml").getroot()
    trees = ("models/deep/good tree.rvaft", "top.rvaft")
    assert {suite.get("name") for suite in junit} == {
        f"{one} ({how})" for one in trees for how in ("strict", "scattered")
    }
    assert "no disagreement" in (repository / "summary").read_text()
    assert (reports(repository) / "results.csv").read_text().count("proved") >= 4


@pytest.mark.ci
def test_what_is_found_is_an_annotation_and_a_report(repository: Path) -> None:
    """What cannot be compared fails the run, too, and still leaves reports."""
    (repository / "bad.rvaft").write_text(BAD)
    (repository / "events.rvaft").write_text("event e(x) = { a: x };\n")
    done = run_step("Check the trees", repository)
    assert (done.returncode, "[cycle]" in done.stdout) == (1, True)
    assert done.stdout.startswith("::error file=bad.rvaft,line=1,col=")
    report = json.loads((reports(repository) / "check.sarif").read_text())
    assert report["runs"][0]["results"][0]["ruleId"] == "cycle"
    assert run_step("Cross-check the trees", repository, semantics="strict", trees="*.rvaft").returncode == 2
    assert "top.rvaft" in (reports(repository) / "results.csv").read_text()


def test_the_traces_of_the_trees_are_run(repository: Path) -> None:
    assert run_step("Test the trees", repository).stdout == "", "no tree has traces"
    (repository / "top.traces").mkdir()
    (repository / "top.traces" / "x.jsonl").write_text('{"event": "a"}\n')
    (repository / "top.verdicts.json").write_text('{"x": {"strict": {"tree": "⊤"}}}', encoding="utf-8")
    done = run_step("Test the trees", repository)
    assert done.returncode == 1
    assert "expected ⊤, got ?" in done.stdout


@pytest.mark.parametrize(
    "name", ["Check the trees", "Test the trees", pytest.param("Cross-check the trees", marks=pytest.mark.ci)]
)
def test_a_hostile_repository(name: str, repository: Path) -> None:
    """Names are no options and no commands, and nothing of the checkout runs."""
    mark, elsewhere = repository / "mark", repository.with_name(f"{repository.name}-elsewhere")
    elsewhere.mkdir()
    for module in ("secrets.py", "pip.py", "rvaft.py", "click.py", "site.py"):
        (repository / module).write_text(f"open({str(mark)!r}, 'w')")
    (repository / "rvaft-reports").symlink_to(elsewhere)
    for tree in (
        "--help.rvaft",
        "--semantics=strict.rvaft",
        "::add-mask::e.rvaft",
        "##[add-mask]e.rvaft",
        "%0A::x.rvaft",
    ):
        (repository / tree).write_text(GOOD)
        (repository / f"{tree.removesuffix('.rvaft')}.verdicts.json").write_text("{}", encoding="utf-8")
        (repository / f"::error::{tree.strip('-:#')}").write_text(BAD)
    done = run_step(name, repository, semantics="strict", timeout="20")
    assert done.returncode in (1, 2), done.stderr
    assert not mark.exists()
    assert not [*elsewhere.iterdir()]
    commands = [
        line for line in (done.stdout + done.stderr).splitlines() if line.lstrip().startswith("::") or "##[" in line
    ]
    if name == "Check the trees":
        assert commands
        assert all(re.match("::(error|warning|notice) file=", line) for line in commands), commands
    else:
        start, end = commands
        assert start == f"::stop-commands::{end.strip(':')}"


def test_no_tree_at_all_is_an_error(tmp_path: Path) -> None:
    done = run_step("Check the trees", tmp_path)
    assert done.returncode == 2
    assert "no tree matches" in done.stdout


@pytest.mark.parametrize(
    ("name", "status"), [("rvaft-check", 1), pytest.param("rvaft-cross-check", 2, marks=pytest.mark.ci)]
)
def test_hooks(name: str, status: int, repository: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run as pre-commit does: the entry, with the changed files that the hook wants behind it."""
    pytest.importorskip("spot")
    monkeypatch.chdir(repository)
    (repository / "bad.rvaft").write_text(BAD)
    program, *words = shlex.split(HOOKS[name]["entry"])
    wanted = [file for file in ("top.rvaft", "README.md", "bad.rvaft") if re.search(HOOKS[name]["files"], file)]
    assert (program, wanted) == ("rvaft", ["top.rvaft", "bad.rvaft"])
    assert run(*words, "top.rvaft").exit_code == 0
    assert run(*words, *wanted).exit_code == status
