"""Control and bidirectional characters, and commands of GitHub Actions, in names, labels and logs."""

import json
import os
import re
from pathlib import Path
from typing import Final

import pytest

from backends.c.library import compiler
from rvaft import NotExpressible, Semantics, ToolMissing, load, loads
from rvaft.backend import all_backends, backend
from rvaft.model.values import Json
from rvaft.support.terminal import is_hidden
from tests.cli.runs import process, run, written

BAD: Final = "\x1b]0;x\x07\x9b31m\u202ea\u2066\x85\u200b\u2028é"
QUOTED: Final = json.dumps(BAD)
TREES: Final = {
    "names": f'"top{QUOTED[1:]} sand "a{QUOTED[1:]} b;',
    "labels": f"top sand a b; a label {QUOTED};",
    "texts": f"event e(u) = {{ k: {QUOTED}, u: u }}; top sand a b; a on e(1); b on e(2);",
    "fields": f"event e(u) = {{ {QUOTED}: u, k: 1 }}; top sand a b; a on e(1); b on e(2);",
    "guards": f"event e(n, u) = {{ k: n, u: u }}; top sand a b; a on e(1, U); b on e(2, V) when V == {QUOTED};",
}
TRACES: Final[dict[str, list[dict[str, Json]]]] = {
    "names": [{"event": f"a{BAD}"}, {"event": "b"}],
    "labels": [{"event": "a"}, {"event": "b"}],
    "texts": [{"k": BAD, "u": 1}, {"k": BAD, "u": 2}],
    "fields": [{BAD: 1, "k": 1}, {BAD: 2, "k": 1}],
    "guards": [{"k": 1, "u": "x"}, {"k": 2, "u": BAD}],
}
UNESCAPED: Final = {"rml", "rml-paper", "stix"}
"""Languages without an escape for such characters."""
COMMENT: Final = re.compile(r"(?m)^\s*(?://|--|#|/\*|\(\*|%).*$")


def hidden(text: str) -> set[str]:
    return {one for one in set(text) - set("\n\t") if is_hidden(one)}


@pytest.mark.parametrize("semantics", [Semantics.SCATTERED, Semantics.PROJECTED])
@pytest.mark.parametrize("name", all_backends())
def test_emitted_texts_escape_what_their_language_can(name: str, semantics: Semantics) -> None:
    language = backend(name)
    for what, text in TREES.items():
        try:
            specification = language.translate(loads(text), semantics)
        except NotExpressible:
            continue
        assert not hidden("".join(COMMENT.findall(specification.text))), what
        if name not in UNESCAPED and (name, what) != ("eql", "fields"):
            assert not hidden(specification.text), what
        if language.readable:
            try:
                verdicts = list(specification.monitor().run(TRACES[what]))
            except ToolMissing:
                continue
            assert verdicts[-1].symbol == "⊤", what


@pytest.mark.parametrize("what", TREES)
def test_printed_trees_are_read_back(what: str, tmp_path: Path) -> None:
    tree = written(tmp_path / "tree.rvaft", TREES[what])
    for form in ("rvaft", "json", "galileo", "dot", "tree", "tikz"):
        done = run("show", tree, "--format", form)
        assert done.exit_code == 0 or (form, done.exit_code) == ("galileo", 2)
        assert not hidden(done.output), form
        if form == "rvaft":
            assert load(written(tmp_path / "again.rvaft", done.stdout)) == load(tree)
    for form in ("text", "unicode", "latex"):
        done = run("branches", tree, "--format", form)
        assert not hidden(done.output), form


@pytest.mark.parametrize("what", TREES)
def test_commands_print_no_raw_characters(what: str, tmp_path: Path) -> None:
    tree = written(tmp_path / "tree.rvaft", TREES[what])
    log = tmp_path / f"log{BAD}.jsonl".replace("\x85", "")
    written(log, "".join(f"{json.dumps(event, ensure_ascii=False)}\n" for event in TRACES[what]))
    by = ("--by", "k") if "k" in TRACES[what][0] else ()
    for words in (
        *(("check", tree, "--format", form) for form in ("text", "json", "github", "sarif")),
        *(("fields", log, "--format", form, *by) for form in ("text", "json")),
        *(("traces", tree, option) for option in ("--detect", "--random")),
        *(("traces", tree, "--format", form, "--semantics", "scattered") for form in ("stix", "sigma", "eql")),
        *(("monitor", tree, log, log, "--format", form) for form in ("text", "jsonl", "ecs", "ocsf", "sigma")),
        ("monitor", tree, log, "--explain"),
        ("monitor", tree, log, "--template", "{matched} {tree} {trace}"),
        ("coverage", tree, log),
        ("coverage", tree, log, "--format", "json"),
    ):
        done = run(*words)
        assert not hidden(done.output), words
    done = run("infer", log, *by)
    assert done.exit_code in {0, 2}
    assert not hidden(done.output)
    if done.exit_code == 0:
        assert run("monitor", written(tmp_path / "inferred.rvaft", done.stdout), log).exit_code == 1


@pytest.mark.skipif(compiler() is None, reason="needs a C compiler")
def test_a_native_monitor_escapes_the_names_of_logs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    tree = written(tmp_path / "tree.rvaft", "top sand a b;")
    names = [f'x{BAD}😀\\"'.replace("\x85", ""), "plain"]
    logs = [written(tmp_path / f"{name}.jsonl", '{"event": "a"}\n{"event": "b"}\n') for name in names]
    call = ("monitor", tree, *logs, "--format", "jsonl", "--semantics", "scattered")
    found = run(*call, "--native")
    assert found.stdout.isascii()
    assert json.loads(found.stdout.splitlines()[0])["trace"] == str(logs[0])
    assert run(*call).stdout == found.stdout
    odd = written(tmp_path / os.fsdecode(b"\xff\xed\xa0\x80\xe2\x82.jsonl"), '{"event": "a"}\n{"event": "b"}\n')
    call = (*call, odd)
    found = run(*call, "--native")
    assert found.exit_code == 1
    assert run(*call).stdout == found.stdout


def test_a_terminal_gets_no_raw_text(tmp_path: Path) -> None:
    pty = pytest.importorskip("pty")
    tree = written(tmp_path / "tree.rvaft", TREES["texts"])
    words = ("emit", tree, "--to", "stix", "--semantics", "scattered")
    ours, theirs = pty.openpty()
    done = process(*words, stdout=theirs)
    os.close(theirs)
    shown = b""
    while b"FOLLOWEDBY" not in shown or b"\n" not in shown:
        shown += os.read(ours, 10_000)
    os.close(ours)
    assert done.returncode == 0
    assert "-o FILE" in done.stderr
    assert not hidden(shown.decode().replace("\r", ""))
    assert r"\x1b]0;x\x07\x9b31m\u202ea" in shown.decode()
    assert run(*words, "-o", tmp_path / "raw.stix").exit_code == 0
    assert BAD in (tmp_path / "raw.stix").read_text(encoding="utf-8")
    assert process(*words).stderr == ""


# Commands of GitHub Actions.

MASK: Final = "::add-mask::e"
OLD: Final = "x##[add-mask]e"


def commands(text: str) -> list[str]:
    """The lines that a runner takes for commands: it strips blanks, and finds ##[ anywhere."""
    return [line for line in text.splitlines() if line.strip().startswith("::") or "##[" in line]


@pytest.mark.parametrize("name", [MASK, OLD])
@pytest.mark.parametrize(
    "text", ["top and a b;", "top and a\n::add-mask::x", "top and a b\n  ##[add-mask]x y;", 'top and a b; "::x" fault;']
)
def test_no_line_is_a_command_of_a_runner(
    name: str, text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    tree = written(Path(f"{name}.rvaft"), text)
    Path(f"{name}.traces").mkdir()
    written(Path(f"{name}.traces/{MASK}.jsonl"), '{"event": "a"}\n')
    shown = ""
    for words in (
        ("check", tree),
        ("check", tree, "--format", "json"),
        ("test", tree, "--update"),
        (
            "cross-check",
            tree,
            "--backends",
            "sql",
            "--traces",
            1,
            "--states",
            0,
            "--semantics",
            "scattered",
            "--jobs",
            1,
        ),
    ):
        shown += run(*words).output
    verdicts = Path(f"{name}.verdicts.json")
    if verdicts.exists():
        written(verdicts, verdicts.read_text(encoding="utf-8").replace("?", "⊤"))
        wrong = run("test", tree)
        assert wrong.exit_code == 1
        shown += wrong.output
    assert not commands(shown)


def test_annotations_name_the_file_within_their_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    tree = written(Path("::add-mask::%0A,é:\n\x1b.rvaft"), "top and a a;")
    done = run("check", tree, "--format", "github")
    lines = done.stdout.splitlines()
    assert lines
    for line in lines:
        found = re.fullmatch(r"::(?:error|warning|notice) file=([^,:]*),line=\d+,col=\d+,title=rvaft [a-z-]+::.*", line)
        assert found is not None, line
        assert found[1].startswith("%3A%3Aadd-mask%3A%3A%250A%2Cé%3A")
        assert not hidden(line)
