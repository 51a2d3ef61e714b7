"""`rvaft show`, `branches`, `emit` and `backends`: what they print, and where to."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from rvaft import load, loads, translate
from rvaft.backend import all_backends, backend
from rvaft.errors import ToolMissing
from rvaft.export import Format, draw
from rvaft.model.verdict import Semantics
from tests.cli.runs import PRUNED, TREES, failed, run

SAND = TREES / "gates" / "sand.rvaft"
PICTURES = (Format.SVG, Format.PDF, Format.PNG)


def test_a_tree_is_drawn_for_the_terminal() -> None:
    result = run("show", SAND)
    assert (result.exit_code, result.stderr) == (0, "")
    assert result.stdout.splitlines()[1:] == ["├─ a", "├─ b", "└─ c"]


@pytest.mark.parametrize("form", [form for form in Format if form not in PICTURES])
def test_every_format_of_text(form: Format) -> None:
    result = run("show", PRUNED, "--format", form)
    assert result.exit_code == 0
    assert result.stdout_bytes == draw(load(PRUNED), form)


@pytest.mark.skipif(shutil.which("dot") is None, reason="needs Graphviz")
@pytest.mark.parametrize("form", PICTURES)
def test_every_format_of_pictures(form: Format, tmp_path: Path) -> None:
    target = tmp_path / f"tree.{form}"
    result = run("show", PRUNED, "-o", target)
    assert (result.exit_code, result.output) == (0, "")
    assert run("show", PRUNED, "--format", form).stdout_bytes[:4] == target.read_bytes()[:4]


def test_the_format_follows_the_suffix_unless_it_is_named(tmp_path: Path) -> None:
    assert run("show", SAND, "-o", tmp_path / "a.tex").exit_code == 0
    assert (tmp_path / "a.tex").read_text().startswith(r"\documentclass")
    assert run("show", SAND, "--format", "json", "-o", tmp_path / "b.tex").exit_code == 0
    assert json.loads((tmp_path / "b.tex").read_text())["root"] == load(SAND).root
    assert run("show", SAND, "-o", tmp_path / "c").exit_code == 0
    assert "├─ a" in (tmp_path / "c").read_text(encoding="utf-8")
    assert run("show", SAND, "-o", "-").stdout == run("show", SAND).stdout


def test_the_canonical_text_reads_back_as_the_same_tree() -> None:
    assert loads(run("show", PRUNED, "--format", "rvaft").stdout) == load(PRUNED)


def test_galileo_warns_of_what_it_cannot_say() -> None:
    result = run("show", PRUNED, "--format", "galileo")
    assert result.exit_code == 0
    assert result.stdout.startswith('toplevel "damaged";\n')
    warnings = result.stderr.splitlines()
    assert all(line.startswith("rvaft: warning: galileo: ") for line in warnings)
    assert any("pand" in line for line in warnings)


FULL = TREES / "remote_inspection" / "full.rvaft"
LOG = TREES / "remote_inspection" / "pruned.traces" / "table2_row3.jsonl"
CHOICES = ["--events", "--no-names", "--wrap", "20", "--depth", "4", "--collapse", "imagery", "--legend", "--stagger"]


def test_the_options_of_a_drawing_are_those_of_python() -> None:
    tree = load(FULL)
    expected = tree.to_dot(
        events=True, names=False, wrap=20, depth=4, collapse=["imagery"], branch=2, legend=True, stagger=True
    )
    assert run("show", FULL, "--format", "dot", *CHOICES, "--highlight", "branch:2").stdout == expected
    assert run("show", FULL, "--format", "dot").stdout == tree.to_dot()


def test_what_a_trace_detects_can_be_highlighted() -> None:
    text = run("show", PRUNED, "--highlight", LOG, "--collapse", "ev6").stdout
    assert "● │     ├─ ev4  on radiation(Value, T1)" in text
    assert "event 3, time 14.1" in text
    assert "(… 5 nodes)  event 4" in text
    assert "branch 3: attack" in text
    tikz = run("show", PRUNED, "--highlight", LOG, "--format", "tikz").stdout
    assert r"\textbf{event 3}" in tikz


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        (["--collapse", "imagry"], ["cannot collapse imagry", "did you mean imagery?"]),
        (["--highlight", "branch:7"], ["there is no branch 7"]),
        (["--highlight", "branch:x"], ["branch:N takes the number of a branch, not 'x'"]),
        (["--highlight", "missing.jsonl"], ["missing.jsonl: No such file"]),
        (
            ["--highlight", str(LOG), "--semantics", "strict"],
            ["table2_row3.jsonl: nothing is detected", "unknown after 5 events"],
        ),
        (["--depth", "-1"], ["--depth"]),
        (["--wrap", "2"], ["--wrap"]),
        (["--format", "json", "--depth", "1", "--legend"], ["--depth and --legend: not for the format json"]),
        (["--format", "tree", "--legend"], ["--legend: not for the format tree"]),
        (["--no-names", "--wrap", "9"], ["--no-names and --wrap: not for the format tree"]),
        (["--format", "json", "--no-events"], ["--no-events: not for the format json"]),
        (["--highlight", "branch:1", "--highlight", "branch:2"], ["one branch or one trace: give it once"]),
        (["--format", "tikz", "--stagger"], ["--stagger: not for the format tikz"]),
        (["-o", "/nowhere/tree.dot"], ["/nowhere/tree.dot: cannot write: No such file or directory"]),
        (["-o", "/dev/null/tree.gv"], ["/dev/null/tree.gv: cannot write"]),
    ],
)
def test_what_a_drawing_cannot_be_is_one_line(words: list[str], parts: list[str]) -> None:
    failed(run("show", FULL, *words), *parts)


def test_a_trace_that_detects_nothing_is_refused(tmp_path: Path) -> None:
    (tmp_path / "one.jsonl").write_text('{"event": "a"}\n')
    result = run("show", SAND, "--highlight", tmp_path / "one.jsonl")
    failed(result, "nothing is detected (the verdict is unknown after 1 event)")


def test_a_folder_that_cannot_be_written_stays_as_it_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Root may write everywhere, so the refusal is played."""

    def refused(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied", str(tmp_path))

    (tmp_path / "tree.dot").write_text("old")
    monkeypatch.setattr("rvaft.support.files.tempfile.mkstemp", refused)
    for words in (["show", SAND], ["emit", SAND, "--to", "dot"]):
        failed(run(*words, "-o", tmp_path / "tree.dot"), "tree.dot: cannot write: Permission denied")
    assert [path.name for path in tmp_path.iterdir()] == ["tree.dot"]
    assert (tmp_path / "tree.dot").read_text() == "old"


def test_an_automaton_is_drawn() -> None:
    result = run("emit", SAND, "--to", "dot", "--semantics", "strict")
    assert result.exit_code == 0
    assert result.stdout == backend("automaton").diagram(load(SAND), Semantics.STRICT)
    assert run("emit", PRUNED, "--to", "dot", "--branch", "1").stdout.count("doublecircle") == 1
    failed(run("emit", PRUNED, "--to", "dot", "--limit", "3"), "too many to draw (limit 3); raise it with --limit N")
    failed(run("emit", SAND, "--to", "dot", "-o", "a.jpg"), "no drawing of an automaton has the suffix .jpg")
    failed(run("emit", SAND, "--to", "dot", "--branch", "1", "--kind", "fault"), "exclude each other")


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        (["dto"], ["known: ", ", dot; did you mean dot?"]),
        (["pdf"], ["pdf is no language: --to dot -o FILE.pdf draws the automaton"]),
        (["automaton", "-o", "a.pdf"], ["automaton is written as text", "--to dot -o a.pdf draws the automaton"]),
        (["rml", "-o", "a.gv"], ["rml is written as text", "--to dot -o a.gv draws the automaton"]),
    ],
)
def test_who_takes_a_drawing_for_a_language_is_told(words: list[str], parts: list[str]) -> None:
    failed(run("emit", SAND, "--to", *words), *parts)


@pytest.mark.skipif(shutil.which("dot") is None, reason="needs Graphviz")
@pytest.mark.parametrize(
    ("suffix", "magic"), [("svg", b"<?xml"), ("pdf", b"%PDF"), ("png", b"\x89PNG"), ("gv", b"digraph")]
)
def test_the_suffix_says_how_an_automaton_is_drawn(suffix: str, magic: bytes, tmp_path: Path) -> None:
    target = tmp_path / f"a.{suffix}"
    assert run("emit", SAND, "--to", "dot", "-o", target).output == ""
    assert target.read_bytes().startswith(magic)


def test_without_graphviz_nothing_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    for words in (["show", SAND], ["emit", SAND, "--to", "dot"]):
        result = run(*words, "-o", tmp_path / "a.svg")
        failed(result, "dot is not installed: install Graphviz (apt-get install graphviz), or write a .dot file")
    assert list(tmp_path.iterdir()) == []


def test_the_branches_of_the_paper() -> None:
    result = run("branches", PRUNED)
    assert result.exit_code == 0
    rows = [line.split("\t") for line in result.stdout.splitlines()]
    assert [row[:2] for row in rows] == [["1", "fault"], ["2", "fault"], ["3", "attack"], ["4", "attack"]]
    assert rows[2][2].startswith("move(Waypoint, _) ")
    assert "goal(MBGoal)" in rows[3][2]
    assert run("branches", SAND).stdout.split("\t")[:2] == ["1", "-"]


def test_branches_come_one_by_one() -> None:
    """A tree of 2^60 branches: the first lines are there although the last never will be."""
    import itertools

    from rvaft.analysis.branches import branches

    text = "top and " + " ".join(f"o{n}" for n in range(60)) + ";"
    text += "".join(f"o{n} or a{n} b{n}; a{n}; b{n};" for n in range(60))
    assert [branch.number for branch in itertools.islice(branches(loads(text)), 3)] == [1, 2, 3]


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


def test_emit_says_what_a_language_cannot_express_and_what_is_too_large() -> None:
    result = run("emit", PRUNED, "--to", "rml-paper", "--semantics", "scattered")
    assert result.exit_code == 2
    assert result.stderr.startswith("rvaft: error: rml-paper cannot express this tree under scattered: ")
    result = run("emit", TREES / "gates" / "and.rvaft", "--to", "ltlf", "--limit", "1")
    assert result.exit_code == 2
    assert "(limit 1)" in result.stderr or "Spot is not installed" in result.stderr


def test_backends_are_listed_with_what_they_can_do_and_need() -> None:
    result = run("backends")
    assert (result.exit_code, result.stderr) == (0, "")
    rows = {line.split()[0]: line for line in result.stdout.splitlines()[1:]}
    assert set(rows) == set(all_backends())
    for name, row in rows.items():
        assert ("yes" if backend(name).faithful else "no") in row
        assert backend(name).suffix in row
    assert "scattered" not in rows["rml-paper"]


def test_a_missing_library_is_named_where_a_backend_needs_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(*_: object, **__: object) -> None:
        raise ToolMissing("spot", remedy="pip install spottl")

    monkeypatch.setattr(type(backend("ltlf")), "translate", missing)
    rows = {line.split()[0]: line for line in run("backends").stdout.splitlines()}
    assert rows["ltlf"].endswith("no: spot is not installed: pip install spottl")
    assert run("emit", SAND, "--to", "ltlf").stderr == "rvaft: error: spot is not installed: pip install spottl\n"


@pytest.mark.parametrize("command", ["show", "branches"])
def test_a_dash_is_standard_input(command: str) -> None:
    assert run(command, "-", data=SAND.read_bytes()).stdout == run(command, SAND).stdout
    assert run(command, "-", data=b"a or").stderr.startswith("rvaft: error: <stdin>:1:5: the text ends")


def test_a_branch_alone_is_a_hint() -> None:
    failed(run("show", SAND, "--highlight", "1"), "--highlight branch:1")


def test_branches_can_be_few() -> None:
    result = run("branches", PRUNED, "--limit", "2")
    assert (result.exit_code, result.stdout.count("\n")) == (0, 2)
    assert result.stderr == "rvaft: warning: the tree has more than 2 branches\n"
    assert run("branches", PRUNED, "--limit", "4").stderr == ""


def test_without_a_command_there_is_help() -> None:
    result = run()
    assert result.exit_code == 0
    assert "branches" in result.stdout
    module = subprocess.run([sys.executable, "-m", "rvaft"], capture_output=True, text=True, check=True)
    assert module.stdout.startswith("Usage: rvaft")
