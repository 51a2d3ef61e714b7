"""Programs in the cache of native monitors that somebody else wrote, or that are damaged."""

import os
import shutil
import signal
import stat
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from backends.c.library import compiler
from backends.c.log import _functions
from rvaft import NotExpressible, Semantics, load, loads, translate
from tests.backends.c.programs import compile_strictly
from tests.cli.runs import COMMAND, SAND, TREES, UNBOUND, failed, run, written
from tests.tables import sampled

pytestmark = [
    pytest.mark.skipif(compiler() is None, reason="needs a C compiler"),
    pytest.mark.skipif(not hasattr(os, "geteuid"), reason="needs owners of files"),
]
ALONE = ("--format", "jsonl", "--semantics", "scattered", "--native")
"""A program of its own monitors the log."""
LOADED = ("--semantics", "scattered", "--native")
"""A library in this process monitors the log."""
JOINED = "event e(k, u) = { k: k, u: u }; top sand a b; a on e(1, U); b on e(2, U);"


@pytest.fixture(autouse=True)
def quick_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    if shutil.which("tcc"):
        monkeypatch.setenv("CC", "tcc")


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    _functions.cache_clear()
    return tmp_path / "rvaft" / "native"


@pytest.fixture
def call(tmp_path: Path) -> Callable[..., str]:
    tree = written(tmp_path / "tree.rvaft", JOINED)
    log = written(tmp_path / "log.jsonl", '{"k": 1, "u": 1}\n{"k": 2, "u": 1}\n')

    def made(*options: str) -> str:
        _functions.cache_clear()
        done = run("monitor", tree, log, *options)
        assert done.exit_code == 1, done.output
        assert "true" in done.stdout
        return done.stderr

    return made


def entries(cache: Path) -> list[Path]:
    return sorted(path for path in cache.iterdir() if not path.name.startswith("."))


@pytest.mark.parametrize("options", [ALONE, LOADED])
@pytest.mark.parametrize("damage", ["empty", "cut", "changed", "folder of another name"])
def test_a_damaged_program_is_built_anew(
    damage: str, options: tuple[str, ...], cache: Path, call: Callable[..., str]
) -> None:
    assert call(*options) == ""
    [entry] = entries(cache)
    whole = entry.read_bytes()
    assert stat.S_IMODE(entry.stat().st_mode) == 0o600
    before = entry.stat().st_mtime_ns
    assert call(*options) == ""
    assert entry.stat().st_mtime_ns == before
    match damage:
        case "empty":
            entry.write_bytes(b"")
        case "cut":
            entry.write_bytes(whole[: len(whole) // 2])
        case "changed":
            entry.write_bytes(whole[:-100] + bytes([whole[-100] ^ 1]) + whole[-99:])
        case _:
            entry.unlink()
            entry.symlink_to(written(cache.parent / "program", "#!/bin/sh\necho evil\n"))
    assert call(*options) == ""
    assert entry.read_bytes()[: len(whole) // 2] == whole[: len(whole) // 2]
    assert not entry.is_symlink()


@pytest.mark.parametrize("options", [ALONE, LOADED])
def test_a_program_that_others_may_write_is_built_anew(
    options: tuple[str, ...], cache: Path, call: Callable[..., str]
) -> None:
    call(*options)
    [entry] = entries(cache)
    before = entry.stat().st_mtime_ns
    entry.chmod(0o622)
    assert call(*options) == ""
    assert stat.S_IMODE(entry.stat().st_mode) == 0o600
    assert entry.stat().st_mtime_ns != before


@pytest.mark.parametrize("options", [ALONE, LOADED])
@pytest.mark.parametrize("wrong", ["others", "link", "file", "above", "owner"])
def test_a_folder_that_others_may_write_is_not_used(
    wrong: str, options: tuple[str, ...], cache: Path, call: Callable[..., str]
) -> None:
    cache.mkdir(parents=True, mode=0o700)
    match wrong:
        case "others":
            cache.chmod(0o777)
        case "above":
            cache.parent.chmod(0o775)
        case "link":
            cache.rename(cache.with_name("elsewhere"))
            cache.symlink_to("elsewhere")
        case "file":
            cache.rmdir()
            cache.touch()
        case _ if os.geteuid() != 0:
            pytest.skip("needs root")
        case _:
            os.chown(cache, 12345, 12345)
    warned = call(*options)
    assert warned.count("\n") == 1
    assert "native" in warned
    if cache.is_dir():
        assert list(cache.iterdir()) == []


def test_a_home_of_another_user_gets_no_cache(
    tmp_path: Path, call: Callable[..., str], monkeypatch: pytest.MonkeyPatch
) -> None:
    if os.geteuid() != 0:
        pytest.skip("needs root")
    (home := tmp_path / "home").mkdir()
    os.chown(home, 12345, 12345)
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setenv("HOME", str(home))
    assert "the folder belongs to another user" in call(*ALONE)
    assert list(home.iterdir()) == []


def test_a_compiler_of_another_version_builds_anew(
    cache: Path, call: Callable[..., str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cc = " ".join(compiler() or ())
    wrapper = written(tmp_path / "mycc", f'#!/bin/sh\nexec {cc} "$@"\n')
    wrapper.chmod(0o700)
    monkeypatch.setenv("CC", str(wrapper))
    call(*ALONE)
    written(wrapper, f'#!/bin/sh\n# 2\nexec {cc} "$@"\n')
    call(*ALONE)
    assert len(entries(cache)) == 2


def test_remains_of_killed_runs_are_removed(cache: Path, tmp_path: Path, call: Callable[..., str]) -> None:
    slow = written(tmp_path / "slowcc", "#!/bin/sh\nsleep 60\n")
    slow.chmod(0o700)
    tree, log = tmp_path / "tree.rvaft", tmp_path / "log.jsonl"
    words = [*COMMAND, "monitor", str(tree), str(log), *ALONE]
    with subprocess.Popen(words, env={**os.environ, "CC": str(slow)}, start_new_session=True) as running:
        until = time.monotonic() + 30
        while not list(cache.glob(".rvaft-*")) and time.monotonic() < until:
            time.sleep(0.05)
        assert list(cache.glob(".rvaft-*"))
        assert call(*ALONE) == ""  # while the other one runs, its folder stays
        assert list(cache.glob(".rvaft-*"))
        os.killpg(running.pid, signal.SIGKILL)
    assert list(cache.glob(".rvaft-*"))
    call(*ALONE)
    assert not list(cache.glob(".rvaft-*"))


def test_a_built_program_replaces_a_regular_file_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    tree = written(tmp_path / "tree.rvaft", SAND.read_text(encoding="utf-8"))
    (tmp_path / "link").symlink_to("program")
    (tmp_path / "null").symlink_to("/dev/null")
    (tmp_path / "same").symlink_to("tree.rvaft")
    (tmp_path / "folder").mkdir()
    os.mkfifo(tmp_path / "pipe")
    failed(run("build", tree, "-o", "-"), "-o")
    for name in ("tree.rvaft", "same", "null", "/dev/null", "pipe", "folder", "./tree.rvaft"):
        failed(run("build", tree, "-o", name), "cannot write")
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        *("folder", "link", "null", "pipe", "same", "tree.rvaft"),
    ]
    assert stat.S_ISCHR(Path("/dev/null").stat().st_mode)
    assert run("build", tree, "-o", "link").exit_code == 0
    assert (tmp_path / "link").is_symlink()
    program = tmp_path / "program"
    assert stat.S_IMODE(program.stat().st_mode) & 0o100
    done = subprocess.run([program, "/dev/null"], capture_output=True, check=False)
    assert done.returncode == 0


def test_a_build_that_fails_leaves_the_old_program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program = written(tmp_path / "program", "old")
    monkeypatch.setenv("CC", "false")
    failed(run("build", SAND, "-o", program), "the C compiler failed")
    assert program.read_text(encoding="utf-8") == "old"
    assert list(tmp_path.iterdir()) == [program]


STRANGE = r"""event "e*/ int x; /*"(n, u) = { "k*/\"\\??/": n, "é\u202e": u };
"top*/ \" \\ ??/ é \u001b" sand "a/*" "b??/";
"a/*" on "e*/ int x; /*"("v*/ \" \\ ??/\n é\u0000 \u202e ??' trigraph", U) label "*/ la\"b??/\\el";
"b??/" on "e*/ int x; /*"(V, U) when like(V, "*/ \"??/\\é*") or V != "x*/";"""
MACROS = ((), ("-DRVAFT_MAIN=1", "-DRVAFT_PLACES=1"), ("-DRVAFT_JSON=0",), ("-DRVAFT_PLACES=1",))
SHIPPED = sorted(path for path in TREES.rglob("*.rvaft") if path != UNBOUND)


@pytest.mark.parametrize("name", ["gcc", "clang"])
@pytest.mark.parametrize("macros", MACROS)
def test_strange_names_compile_without_warnings(name: str, macros: tuple[str, ...], tmp_path: Path) -> None:
    if shutil.which(name) is None:
        pytest.skip(f"needs {name}")
    for semantics in (Semantics.SCATTERED, Semantics.STRICT):
        text = translate(loads(STRANGE), "c", semantics=semantics).text
        compile_strictly(text, tmp_path, *macros, compiler=name)


@pytest.mark.parametrize("name", ["gcc", "clang"])
@pytest.mark.parametrize("semantics", Semantics)
@pytest.mark.parametrize("tree", sampled(((one,) for one in SHIPPED), 20, pytest.mark.slow))
def test_shipped_trees_compile_without_warnings(tree: Path, semantics: Semantics, name: str, tmp_path: Path) -> None:
    if shutil.which(name) is None:
        pytest.skip(f"needs {name}")
    try:
        text = translate(load(tree), "c", semantics=semantics).text
    except NotExpressible:
        return
    for macros in MACROS:
        compile_strictly(text, tmp_path, *macros, compiler=name)
