"""`rvaft show`, `branches`, `emit` and `backends`: what they print, and where to."""

import itertools
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from rvaft import Semantics, ToolMissing, all_backends, load, loads, to_dot, translate
from rvaft.backend import backend
from rvaft.core.branches import branches
from rvaft.export import Format
from rvaft.export.drawing import draw
from rvaft.export.property_text import align_latex
from tests.cli.runs import FULL, PRUNED, SAND, TREES, run
from tests.tex import unsound

PICTURES = {Format.SVG: b"<?xml", Format.PDF: b"%PDF", Format.PNG: b"\x89PNG"}
CHOICES = ["--events", "--no-names", "--wrap", "20", "--depth", "4", "--collapse", "imagery", "--legend", "--stagger"]
needs_graphviz = pytest.mark.skipif(shutil.which("dot") is None, reason="needs Graphviz")


@pytest.mark.parametrize("form", [form for form in Format if form not in PICTURES])
def test_every_format_of_text(form: Format) -> None:
    tree = TREES / "gates" / "and.rvaft" if form is Format.OPEN_PSA else PRUNED
    result = run("show", tree, "--format", form)
    assert (result.exit_code, result.stdout_bytes) == (0, draw(load(tree), form))


@pytest.mark.parametrize(("form", "magic"), PICTURES.items())
def test_every_format_of_pictures(form: Format, magic: bytes, tmp_path: Path) -> None:
    """Without Graphviz."""
    if form is not Format.SVG:
        pytest.importorskip("cairosvg")
    target, boxes = tmp_path / f"tree.{form}", tmp_path / f"boxes.{form}"
    assert run("show", PRUNED, "-o", target, env={"PATH": ""}).output == ""
    assert run("show", PRUNED, "-o", boxes, "--boxes", env={"PATH": ""}).output == ""
    assert target.read_bytes().startswith(magic)
    assert boxes.read_bytes().startswith(magic)
    assert boxes.read_bytes() != target.read_bytes()
    assert run("show", PRUNED, "--format", form).stdout_bytes == target.read_bytes()


@needs_graphviz
@pytest.mark.parametrize(("form", "magic"), PICTURES.items())
def test_an_automaton_as_a_picture(form: Format, magic: bytes, tmp_path: Path) -> None:
    assert run("emit", SAND, "--to", "dot", "-o", tmp_path / f"a.{form}").output == ""
    assert (tmp_path / f"a.{form}").read_bytes().startswith(magic)


def test_the_format_follows_the_suffix_unless_it_is_named(tmp_path: Path) -> None:
    shown = run("show", SAND)
    assert (shown.exit_code, shown.stderr, shown.stdout.splitlines()[1:]) == (0, "", ["├─ a", "├─ b", "└─ c"])
    for name, options, start in (
        ("a.tex", [], r"\documentclass"),
        ("b.tex", ["--format", "json"], '{\n  "format": "rvaft"'),
        ("c", [], shown.stdout),
        ("x.jpg", ["--format", "dot"], "digraph"),
    ):
        assert run("show", SAND, *options, "-o", tmp_path / name).exit_code == 0
        assert (tmp_path / name).read_text(encoding="utf-8").startswith(start)
    assert run("show", SAND, "-o", "-").stdout == shown.stdout
    assert loads(run("show", PRUNED, "--format", "rvaft").stdout) == load(PRUNED)


def test_the_options_of_a_drawing_are_those_of_python() -> None:
    tree = load(FULL)
    expected = to_dot(
        tree, events=True, names=False, wrap=20, depth=4, collapse=["imagery"], branch=2, legend=True, stagger=True
    )
    assert run("show", FULL, "--format", "dot", *CHOICES, "--highlight", "branch:2").stdout == expected
    assert run("show", FULL, "--format", "dot").stdout == to_dot(tree)


def test_branches_in_latex() -> None:
    """Text and Unicode stand in the documentation."""
    tex = run("branches", PRUNED, "--format", "latex").stdout
    assert tex.splitlines() == "\n".join(align_latex(branches(load(PRUNED)))).splitlines()
    assert unsound(tex, allowed="&") is None
    assert tex.count(" &= ") == 4
    assert all(line.strip() for line in tex.splitlines()), "an empty line ends an align*"
    widths = (10_000, 100, 40, 1)
    breaks = [run("branches", PRUNED, "--format", "latex", "--width", n).stdout.count("\\\\") for n in widths]
    assert breaks[0] == 3
    assert breaks == sorted(set(breaks))


def test_branches_come_one_by_one_and_can_be_few() -> None:
    """A tree of 2^60 branches: the first lines are there although the last never will be."""
    text = f"top and {' '.join(f'o{n}' for n in range(60))};" + "".join(f"o{n} or a{n} b{n};" for n in range(60))
    assert [branch.number for branch in itertools.islice(branches(loads(text)), 3)] == [1, 2, 3]
    assert run("branches", PRUNED, "--limit", "2").stdout.count("\n") == 2


@pytest.mark.parametrize("options", [{}, {"semantics": "strict"}, {"branch": 2}, {"kind": "fault"}])
def test_emit_writes_the_text_of_the_specification(options: dict[str, object], tmp_path: Path) -> None:
    spec = translate(load(PRUNED), "rml", **options)  # type: ignore[arg-type]
    words = [word for name, value in options.items() for word in (f"--{name}", value)]
    result = run("emit", PRUNED, "--to", "rml", *words)
    assert (result.exit_code, result.stderr) == (0, "")
    assert result.stdout.rstrip("\n") == spec.text.rstrip("\n")
    target = tmp_path / "spec.rml"
    assert run("emit", PRUNED, "--to", "rml", *words, "-o", target).output == ""
    assert target.read_text(encoding="utf-8") == result.stdout


def test_an_automaton_is_drawn(tmp_path: Path) -> None:
    result = run("emit", SAND, "--to", "dot", "--semantics", "strict", "-o", tmp_path / "a.gv")
    assert (result.exit_code, result.output) == (0, "")
    assert (tmp_path / "a.gv").read_text() == backend("automaton").diagram(load(SAND), Semantics.STRICT)
    assert run("emit", PRUNED, "--to", "dot", "--branch", "1").stdout.count("doublecircle") == 1


def test_backends_are_listed_with_what_they_can_do_and_need(monkeypatch: pytest.MonkeyPatch) -> None:
    result = run("backends")
    assert (result.exit_code, result.stderr) == (0, "")
    rows = {line.split()[0]: line for line in result.stdout.splitlines()[1:]}
    assert set(rows) == set(all_backends())
    for name, row in rows.items():
        assert ("yes" if backend(name).faithful else "no") in row
        assert backend(name).suffix in row
    assert "scattered" not in rows["rml-paper"]

    def missing(*_: object, **__: object) -> None:
        raise ToolMissing("spot", remedy="pip install spottl")

    monkeypatch.setattr(type(backend("ltlf")), "translate", missing)
    rows = {line.split()[0]: line for line in run("backends").stdout.splitlines()}
    assert rows["ltlf"].endswith("no: spot is not installed: pip install spottl")
    assert run("emit", SAND, "--to", "ltlf").stderr == "rvaft: error: spot is not installed: pip install spottl\n"


def test_without_a_command_there_is_help() -> None:
    result = run()
    assert result.exit_code == 0
    assert "branches" in result.stdout
    module = subprocess.run([sys.executable, "-m", "rvaft"], capture_output=True, text=True, check=True)
    assert module.stdout.startswith("Usage: rvaft")
