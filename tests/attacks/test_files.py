"""Files that links, devices and pipes stand for: what is read under --confine-imports, and what is written."""

import json
import os
import shutil
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from rvaft import LanguageError, load
from tests.cli.runs import SAND, failed, run, written

SECRET = "root:$y$j9T$secret:19000:0:99999:7:::\nTOKEN = hunter2\n"
TREE = "top sand a b;\n"
EVENTS = '{"event": "a"}\n{"event": "b"}\n'


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current folder; beside it is a secret."""
    written(tmp_path / "secret", SECRET)
    (made := tmp_path / "folder").mkdir()
    monkeypatch.chdir(made)
    written(made / "tree.rvaft", TREE)
    written(made / "log.jsonl", EVENTS)
    return made


READERS = (
    *("check", "test", "show", "branches", "cross-check", "build -o made", "traces", "rosmonitoring -o made"),
    *("emit --to sql", "monitor --word a", "coverage", "compare --languages sql", "serve", "report", "view"),
)


@pytest.mark.parametrize("confined", [("--confine-imports",), ()])
@pytest.mark.parametrize("command", READERS)
def test_no_command_prints_lines_of_a_linked_file(command: str, confined: tuple[str, ...], folder: Path) -> None:
    (folder / "link.rvaft").symlink_to("../secret")
    (folder / "far").symlink_to("..")
    words = command.split()
    logs = ["log.jsonl"] if words[0] in {"coverage", "report", "view"} else []
    for name in ("link.rvaft", "far/secret"):
        done = run(words[0], name, *logs, *words[1:], *confined)
        assert done.exit_code == 2
        assert "root" not in done.output
        assert "hunter2" not in done.output
        if confined and name == "link.rvaft":
            assert "outside the folder" in done.stderr


@pytest.mark.parametrize("form", ["text", "json", "github", "sarif"])
def test_no_finding_quotes_a_linked_file(form: str, folder: Path) -> None:
    (folder / "link.rvaft").symlink_to("../secret")
    for options in ((), ("--confine-imports",)):
        done = run("check", "link.rvaft", "--format", form, *options)
        assert done.exit_code == 2
        assert "root" not in done.output


def test_a_named_tree_is_a_regular_file_in_its_folder(folder: Path) -> None:
    written(folder.parent / "other.rvaft", TREE)
    (folder / "out.rvaft").symlink_to("../other.rvaft")
    (folder / "in.rvaft").symlink_to("tree.rvaft")
    (folder / "sub").mkdir()
    (folder / "up").symlink_to("sub")
    written(folder / "sub" / "inner.rvaft", TREE)
    (folder / "deep.rvaft").symlink_to("up/inner.rvaft")
    os.mkfifo(folder / "pipe.rvaft")
    for name in ("tree.rvaft", "in.rvaft", "deep.rvaft", "up/inner.rvaft", folder / "tree.rvaft"):
        assert run("check", name, "--confine-imports").exit_code == 0, name
    for name in ("out.rvaft", "pipe.rvaft", "/dev/null", "sub"):
        failed(run("check", name, "--confine-imports"), "cannot read the file")
    assert run("check", "out.rvaft").exit_code == 0


def test_an_import_that_becomes_a_link_is_refused(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Between the check of a path and its opening, the file is replaced."""
    written(folder / "part.rvaft", "ignore e(2);")
    written(folder / "main.rvaft", 'import "part.rvaft"; top and a b;')
    real, done = os.path.realpath, list[str]()

    def swapping(path: str, **options: bool) -> str:
        found = real(path, **options)
        if str(path).endswith("part.rvaft") and len(done) < 2:
            done.append(str(path))
            (folder / "part.rvaft").unlink(missing_ok=True)
            (folder / "part.rvaft").symlink_to("../secret")
        return found

    monkeypatch.setattr("os.path.realpath", swapping)
    with pytest.raises(LanguageError, match=r"cannot import `part\.rvaft`") as raised:
        load("main.rvaft", confine_imports=True)
    assert done
    assert "secret:" not in str(raised.value)


@pytest.mark.parametrize("what", ["verdicts", "trace", "folder", "compressed"])
def test_files_beside_a_tested_tree_are_confined(what: str, folder: Path) -> None:
    (folder / "tree.traces").mkdir()
    written(folder / "tree.traces" / "one.jsonl", EVENTS)
    assert run("test", "tree.rvaft", "--update").exit_code == 0
    assert run("test", "tree.rvaft", "--confine-imports").exit_code == 0
    match what:
        case "verdicts":
            (folder / "tree.verdicts.json").rename(folder.parent / "verdicts.json")
            (folder / "tree.verdicts.json").symlink_to("../verdicts.json")
        case "folder":
            (folder / "tree.traces").rename(folder.parent / "elsewhere")
            (folder / "tree.traces").symlink_to("../elsewhere")
        case _:
            name = "two.jsonl" if what == "trace" else "two.csv"
            (folder / "tree.traces" / name).symlink_to("../../secret")
    done = run("test", "tree.rvaft", "--confine-imports")
    assert done.exit_code == 2
    assert "outside the folder" in done.stderr
    assert "root" not in done.output
    if what == "verdicts":
        before = (folder.parent / "verdicts.json").read_bytes()
        written(folder / "tree.traces" / "two.jsonl", EVENTS)
        failed(run("test", "tree.rvaft", "--update"), "a link has this name")
        assert (folder.parent / "verdicts.json").read_bytes() == before


def test_further_files_are_confined(folder: Path) -> None:
    for name, text in (("spec.sql", "select 1"), ("p.toml", 'input = "json"'), ("m.toml", "[a]"), ("t.txt", "{root}")):
        written(folder.parent / name, text)
        (folder / name).symlink_to(f"../{name}")
    for words in (
        "cross-check tree.rvaft --against spec.sql",
        "monitor tree.rvaft log.jsonl --profile p.toml",
        "emit tree.rvaft --to stix --mapping m.toml",
        "monitor tree.rvaft log.jsonl --template @t.txt",
    ):
        assert "outside the folder" not in run(*words.split()).stderr
        done = run(*words.split(), "--confine-imports")
        assert done.exit_code == 2
        assert "outside the folder" in done.stderr
    written(folder / "other.rvaft", 'import "../part.rvaft"; top and a b;')
    written(folder.parent / "part.rvaft", "ignore e(2);")
    assert (
        "--confine-imports" in run("cross-check", "tree.rvaft", "--against", "other.rvaft", "--confine-imports").stderr
    )


# What is written.

WRITERS = (
    *(
        "show IN -o OUT",
        "emit IN --to sql -o OUT",
        "emit IN --to mfotl --semantics scattered --signature OUT",
        "build IN -o OUT",
    ),
    *("infer log.jsonl -o OUT", "report IN log.jsonl -o OUT", "compare IN --languages sql --csv OUT"),
    *("compare IN --languages sql --latex OUT", "cross-check IN --backends sql --traces 1 --junit OUT"),
    *("cross-check IN --backends sql --traces 1 --csv OUT", "monitor IN log.jsonl --explain OUT"),
    *("monitor IN log.jsonl --checkpoint OUT", "monitor IN log.jsonl --foxglove OUT"),
)
SUFFIXES = {"--explain": ".txt", "--foxglove": ".mcap", "show": ".dot"}


@pytest.mark.parametrize("writer", WRITERS)
def test_outputs_are_regular_files_and_no_inputs(writer: str, folder: Path) -> None:
    if "foxglove" in writer:
        pytest.importorskip("foxglove", reason="needs foxglove-sdk")
    if "--latex" in writer:
        pytest.importorskip("pandas", reason="needs pandas")
    suffix = next((one for word, one in SUFFIXES.items() if word in writer), "")
    written(folder / "part", "event e(n) = { event: n };")
    tree = written(folder / f"in{suffix}", f'import "part"; {TREE}')
    (folder / f"link{suffix}").symlink_to(tree.name)
    (folder / f"null{suffix}").symlink_to("/dev/null")
    (folder / f"loop{suffix}").symlink_to(f"loop{suffix}")
    os.mkfifo(folder / f"pipe{suffix}")
    before = {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    devices = [f"null{suffix}", f"loop{suffix}"]
    if os.geteuid() == 0:
        os.mknod(folder / f"device{suffix}", 0o600 | stat.S_IFBLK, os.makedev(240, 77))
        devices.append(f"device{suffix}")
    if "--checkpoint" in writer or "build" in writer:
        devices.append("pipe")
    inputs = [tree.name, f"link{suffix}", f"./{tree.name}"]
    inputs += [] if suffix or "infer" in writer else ["part"]
    inputs += ["log.jsonl"] if "log.jsonl" in writer and not suffix else []
    for name in (*devices, *(inputs if "IN" in writer else ["log.jsonl"])):
        if "--explain" in writer and name == "log.jsonl":
            continue
        words = [{"IN": tree.name, "OUT": name}.get(word, word) for word in writer.split()]
        done = run(*words)
        assert done.exit_code == 2, (name, done.output)
        assert "cannot write" in done.stderr, (name, done.stderr)
    assert {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()} == before
    assert not [path for path in folder.iterdir() if path.name.startswith(".")]
    assert (folder / f"null{suffix}").is_symlink()


@pytest.mark.parametrize("writer", ["build t.rvaft -o", "monitor t.rvaft log.jsonl --checkpoint"])
def test_what_needs_a_regular_file_says_so_of_a_pipe(writer: str, folder: Path) -> None:
    if "build" in writer and not (shutil.which("gcc") or shutil.which("clang")):
        pytest.skip("needs a C compiler")
    written(folder / "t.rvaft", TREE)
    words = [sys.executable, "-m", "rvaft", *writer.split(), "/dev/stdout"]
    done = subprocess.run(words, capture_output=True, stdin=subprocess.DEVNULL, check=False, text=True)
    said = "rvaft: error: /dev/stdout: cannot write: a pipe is not a regular file; /dev/stdout links to it\n"
    assert (done.returncode, done.stdout, done.stderr) == (2, "", said)


@pytest.mark.parametrize("options", [(), ("--near-miss",)])
def test_traces_do_not_follow_links(options: tuple[str, ...], folder: Path) -> None:
    (folder / "traces").mkdir()
    name = "near-miss-1.jsonl" if options else "detect-1.jsonl"
    (folder / "traces" / name).symlink_to("../../secret")
    failed(run("traces", "tree.rvaft", "-n", 1, "-o", "traces", *options), name, "a link has this name")
    assert (folder.parent / "secret").read_text(encoding="utf-8") == SECRET


def test_a_generated_configuration_never_replaces_its_tree(folder: Path) -> None:
    (folder / "tree.rvaft").rename(folder / "monitors.yaml")
    done = run("rosmonitoring", "monitors.yaml", "-o", ".", "--force")
    assert done.exit_code == 2
    assert (folder / "monitors.yaml").read_text(encoding="utf-8") == TREE


def test_a_foxglove_file_is_not_written_through_a_link(folder: Path) -> None:
    pytest.importorskip("foxglove", reason="needs foxglove-sdk")
    (folder / ".run.mcap.new").symlink_to("../secret")
    assert run("monitor", "tree.rvaft", "log.jsonl", "--foxglove", "run.mcap").exit_code == 1
    assert (folder.parent / "secret").read_text(encoding="utf-8") == SECRET
    assert (folder / "run.mcap").stat().st_size > 0
    assert not (folder / ".run.mcap.new").exists()


def test_a_replaced_file_gains_no_rights(folder: Path) -> None:
    target = written(folder / "out.json", "old")
    target.chmod(0o4751)
    assert run("show", SAND, "-o", target).exit_code == 0
    assert stat.S_IMODE(target.stat().st_mode) == 0o751
    assert json.loads(target.read_text(encoding="utf-8"))["format"] == "rvaft"
