"""Commands are entry points: packages add them, and one that is broken stops no other."""

import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from rvaft import all_backends, cli
from tests.cli.runs import failed, run
from tests.tables import sampled

PYPROJECT = Path(__file__).parents[2] / "pyproject.toml"
MODULE = '''
import click
from tests.tables import sampled

@click.command("greet")
@click.argument("name")
def greet(name: str) -> int:
    """Greet somebody by name."""
    click.echo(f"hello {name}")
    return 1

number = 3
'''
ENTRIES = """
[other.group]
nothing = nowhere:nothing

[rvaft.commands]
# a comment
zebra = no_such_module:command
greet = greeting:greet [extra]
number = greeting:number
check = greeting:greet
"""


@pytest.fixture
def _plugin(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A package of somebody else, before rvaft on the path of Python."""
    folder = tmp_path / "greeting-1.0.dist-info"
    folder.mkdir()
    (folder / "entry_points.txt").write_text(ENTRIES, encoding="utf-8")
    (tmp_path / "greeting.py").write_text(MODULE, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    cli.registered.cache_clear()
    yield
    cli.registered.cache_clear()


def listed() -> list[str]:
    """The names in the help text."""
    groups = run("--help").stdout.split("Model:\n")[1].split("  Exit status")[0].splitlines()
    return [line.split()[0] for line in groups if line.startswith("  ") and line[2] != " "]


def test_every_command_of_the_project_is_registered_and_has_its_place_in_the_help_text() -> None:
    project = tomllib.loads(PYPROJECT.read_text(encoding="utf-8"))["project"]
    assert cli.registered() == project["entry-points"][cli.GROUP]
    assert listed() == list(cli.registered())
    for name in cli.registered():
        assert cli.loaded(name).name == name


@pytest.mark.usefixtures("_plugin")
def test_commands_of_others_come_after_those_of_the_project() -> None:
    assert listed()[-4:] == ["compare", "greet", "number", "zebra"]
    text = run("--help").stdout
    assert "Other commands:\n  greet " in text
    assert "Greet somebody by name." in text
    assert text.count("(cannot be loaded)") == 2


@pytest.mark.usefixtures("_plugin")
def test_a_command_of_others_runs_and_gives_the_exit_status() -> None:
    done = run("greet", "you")
    assert (done.exit_code, done.stdout) == (1, "hello you\n")


@pytest.mark.usefixtures("_plugin")
def test_a_broken_command_is_an_error_that_gives_the_reason() -> None:
    failed(run("zebra"), "the command zebra failed: it cannot be loaded: ModuleNotFoundError")
    failed(run("number"), "the command number failed: greeting:number is not a click command")
    assert run("explain", "cycle").exit_code == 0


@pytest.mark.usefixtures("_plugin")
def test_nobody_replaces_a_command_of_the_project() -> None:
    assert cli.registered()["check"] == "rvaft.cli.check:check_command"


def test_a_command_of_the_project_that_is_not_installed_says_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cli, "registered", dict)
    failed(run("compare"), "the command compare is not installed: install rvaft again")
    assert "Model:" not in run("--help").stdout


@pytest.mark.parametrize(("command", "most"), [(("--version",), 260), (("check",), 300), (("monitor",), 340)])
def test_the_start_imports_what_it_uses(command: tuple[str, ...], most: int, tmp_path: Path) -> None:
    """A count of modules; neither the look-up of entry points nor that of resources belongs to the start."""
    (tree := tmp_path / "tree.rvaft").write_text("top sand a b;", encoding="utf-8")
    (log := tmp_path / "log.jsonl").write_text('{"event": "a"}\n', encoding="utf-8")
    files = {"check": (tree,), "monitor": (tree, log)}.get(command[0], ())
    call: list[str | Path] = [sys.executable, "-X", "importtime", "-m", "rvaft", *command, *files]
    done = subprocess.run(call, capture_output=True, text=True, check=True)
    lines = [line for line in done.stderr.splitlines() if line.startswith("import time:")]
    names = {line.rpartition("|")[2].strip() for line in lines}
    assert len(names) < most
    unused = {"importlib.metadata", "importlib.resources", "email.message", "zipfile", "xml.etree.ElementTree"}
    assert command == ("--version",) or not names & unused


NOT_FOR_TEXTS = ("engine", "stream", "readers", "reports", "integrations", "semantics")
"""Rooms that translations do not need."""
DRAWINGS = {f"rvaft.export.{name}" for name in ("layout", "dot", "svg", "tikz", "drawing")}
SIZES = {"c": 68, "sigma": 61, "sql": 66, "kql": 60, "stix": 62}


@pytest.mark.parametrize("language", sampled([(name,) for name in all_backends() if name != "rml-paper"], 4))
def test_a_translation_imports_what_it_uses(language: str, tmp_path: Path) -> None:
    """No engine, no reader of logs, no drawing; and for some a count of the modules and packages of the project."""
    (tree := tmp_path / "tree.rvaft").write_text("top sand a b;", encoding="utf-8")
    program = (
        "import sys; from rvaft.cli import main\n"
        "main(sys.argv[1:], standalone_mode=False)\n"
        "print(*sys.modules, file=sys.stderr)"
    )
    call = [sys.executable, "-c", program, "emit", str(tree), "--to", language, "--semantics", "scattered"]
    names = subprocess.run(call, capture_output=True, text=True, check=True).stderr.split()
    rooms = tuple(f"rvaft.{room}" for room in NOT_FOR_TEXTS)
    assert [name for name in names if name.startswith(rooms) or name in DRAWINGS] == []
    own = [name for name in names if name.partition(".")[0] in ("rvaft", "backends", "cross_check", "papers")]
    assert 20 < len(own) <= SIZES.get(language, len(own))
    if language in SIZES:
        assert "networkx" not in names
