"""Texts of strangers: they run nothing, they end in time, and they end in one line."""

import json
import os
import shutil
import signal
import socket
import subprocess
import threading
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from time import monotonic
from typing import Any

import pytest

from cross_check.confined_text import ConfinedText
from rvaft import ToolFailed, ToolTimeout, loads
from rvaft.backend import all_backends, backend
from rvaft.model.verdict import Semantics
from rvaft.support.confinement import Child, Limits, can_confine
from tests.cli.runs import children, failed, process, run, soon, started, written
from tests.tables import sampled

TREE = "top sand a b; a; b;"
NEEDS_CC = pytest.mark.skipif(not any(map(shutil.which, ("clang", "gcc"))), reason="needs gcc or clang")
CONFINED = pytest.mark.skipif(not can_confine(), reason="needs seccomp and Landlock on Linux (x86-64)")


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    return written(tmp_path / "tree.rvaft", TREE)


# Texts that are programs.


def c_text(addition: str) -> str:
    text = backend("c").translate(loads(TREE), Semantics.SCATTERED).text
    return f"{text}\n#include <stdio.h>\n#include <unistd.h>\n#include <stdlib.h>\n#include <signal.h>\n{addition}\n"


def hostile(mark: Path, kept: Path) -> str:
    """A text that, once loaded, writes and removes files, starts a program, and kills its parent."""
    body = f'FILE *f = fopen("{mark}", "w"); if (f) fclose(f); if (system("touch {mark}")) {{}} unlink("{kept}");'
    return c_text(f"__attribute__((constructor)) static void attack(void) {{ {body} kill(getppid(), SIGKILL); }}")


@NEEDS_CC
@pytest.mark.parametrize("how", ["against", "replay"])
def test_a_text_in_c_does_not_run_unless_asked(how: str, tree: Path, tmp_path: Path) -> None:
    mark, kept = tmp_path / "mark", written(tmp_path / "kept", "")
    text = hostile(mark, kept)
    if how == "against":
        failed(run("cross-check", tree, "--against", written(tmp_path / "x.c", text)), "C", "--run-c")
    else:
        case = tmp_path / "case"
        case.mkdir()
        written(case / "tree.rvaft", TREE)
        written(case / "trace.jsonl", '{"event": "a"}\n')
        written(case / "x.c", text)
        names = {"mine": {"language": "c", "file": "x.c"}}
        record = {"semantics": "scattered", "verdicts": {"mine": ["unknown"]}, "specifications": names}
        written(case / "case.json", json.dumps(record))
        result = run("cross-check", "--replay", case)
        assert result.exit_code == 2, result.output
        assert "--run-c" in result.output
    assert kept.exists()
    assert not mark.exists()


@NEEDS_CC
@CONFINED
@pytest.mark.parametrize("compiler", ["gcc", "clang"])
def test_a_text_in_c_runs_confined(compiler: str, tree: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if shutil.which(compiler) is None:
        pytest.skip(f"needs {compiler}")
    monkeypatch.setenv("CC", compiler)
    mark, kept = tmp_path / "mark", written(tmp_path / "kept", "")
    text = written(tmp_path / "x.c", hostile(mark, kept))
    options = ("--semantics", "scattered", "--traces", 20, "--jobs", 1)
    result = run("cross-check", tree, "--against", text, "--run-c", *options)
    assert result.exit_code == 0, result.output  # it cannot do what it tries, and monitors as it should
    assert kept.exists()
    assert not mark.exists()


@NEEDS_CC
@CONFINED
@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("for (;;);", "no answer within 2 s"),
        ("volatile char *p = 0; *p = 1;", "SIGSEGV"),
        ("exit(0);", "its process ended with status 0"),
        ("for (;;) { volatile char *p = malloc(1 << 20); if (!p) abort(); *p = 1; }", "SIG"),
    ],
)
def test_a_text_in_c_that_does_not_answer(line: str, reason: str, tree: Path, tmp_path: Path) -> None:
    body = "void rvaft_init(rvaft_monitor *m, uint64_t seed) {"
    text = c_text("").replace(body, f"{body} {line}")
    assert line in text
    text = text.replace("#include <stdint.h>", "#include <stdint.h>\n#include <stdlib.h>", 1)
    begun = monotonic()
    result = run("cross-check", tree, "--against", written(tmp_path / "x.c", text), "--run-c", "--timeout", 2)
    assert monotonic() - begun < 30
    failed(result, "x.c failed", reason)


@NEEDS_CC
@CONFINED
@pytest.mark.parametrize("options", ["-o {}", "-MD -MF {}", "-run"])
@pytest.mark.parametrize("compiler", ["tcc", ""])
def test_a_text_gives_no_options_to_its_compiler(
    options: str, compiler: str, tree: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CC", compiler)
    mark, kept = tmp_path / "mark", written(tmp_path / "kept", "")
    text = f'#pragma comment(option, "{options.format(mark)}")\n{hostile(mark, kept)}int main(void) {{ attack(); }}\n'
    result = run(
        "cross-check", tree, "--against", written(tmp_path / "x.c", text), "--run-c", "--traces", 5, "--jobs", 1
    )
    assert result.exit_code in (0, 2), result.output
    assert kept.exists()
    assert not mark.exists()


@NEEDS_CC
@CONFINED
def test_a_program_is_never_proved(tree: Path, tmp_path: Path) -> None:
    """What its comment says of the events that it tests could be a lie with the right digest."""
    text = written(tmp_path / "x.c", backend("c").translate(loads(TREE), Semantics.SCATTERED).text)
    result = run("cross-check", tree, "--against", text, "--run-c", "--semantics", "scattered", "--traces", 20)
    assert result.exit_code == 0, result.output
    assert "0 proofs" in result.output


@pytest.mark.parametrize(
    "data",
    [
        b"cposix\nsystem\n(S'touch mark'\ntR.",
        b"crvaft.backend\nEntryPoint\n.",
        b"crvaft.model.values\nExact.fromhex\n.",
        b"\x80\x04\x8c\x0crvaft.backend\x8c\x03sys\x93.",
    ],
)
def test_an_answer_is_data(data: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A child that was taken over cannot make its parent run anything."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("cross_check.confined_text.b64decode", lambda _: data)
    text = backend("ltlf").translate(loads(TREE), Semantics.SCATTERED).text
    with pytest.raises(ToolFailed, match="its patterns cannot be read"):
        ConfinedText("text", backend("ltlf"), text, Limits())
    assert not [*tmp_path.iterdir()]


@NEEDS_CC
@CONFINED
def test_the_compiler_quotes_no_other_file(tree: Path, tmp_path: Path) -> None:
    secret = written(tmp_path / "secret", "hunter2:x:0\n")
    text = written(tmp_path / "x.c", f'#include "{secret}"\n')
    result = run("cross-check", tree, "--against", text, "--run-c")
    failed(result, "not a monitor in C")
    assert "hunter2" not in result.output


# Texts that take too long, or too much.

_ENDLESS = (
    "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT 0 AS trace, count(*) AS detected FROM n"
)
_LARGE = (
    "WITH RECURSIVE n(i, s) AS (SELECT 1, hex(randomblob(100000)) UNION ALL SELECT i + 1, hex(randomblob(100000)) "
    "FROM n LIMIT 10000000) SELECT trace, max(length(s)) AS detected FROM events, n ORDER BY s"
)


def hoa(states: int, atoms: int) -> str:
    names = " ".join(f'"p{number}"' for number in range(atoms))
    head = f"HOA: v1\nStates: {states}\nStart: 0\nAP: {atoms} {names}\nacc-name: Buchi\nAcceptance: 1 Inf(0)\n"
    return f"{head}--BODY--\nState: 0 {{0}}\n[0] 0\n--END--\n"


TEXTS: dict[str, tuple[str, Callable[[], str]]] = {
    "an endless query": ("sql", lambda: _ENDLESS),
    "an endless query of DuckDB": ("sql-duckdb", lambda: _ENDLESS),
    "a query that needs all memory": ("sql", lambda: _LARGE),
    "an automaton with many atoms": ("automaton", lambda: hoa(1, 100_000)),
    "an automaton with many states": ("automaton", lambda: hoa(999_999_999, 1)),
    "a deep formula": ("ltlf", lambda: "(" * 100_000 + "a" + "!" * 100_000),
    "a deep expression of RML": ("rml", lambda: f"a matches {{'event':'a'}}; Main = {'(' * 50_000} a;"),
    "a deep formula of MTL": ("mtl", lambda: "(" * 100_000),
    "a deep rule of EQL": ("eql", lambda: f"sequence [any where {'not (' * 5_000} true]"),
}


@pytest.mark.parametrize("name", sampled([(name,) for name in TEXTS], 2))
def test_a_text_ends_in_one_line(name: str, tree: Path, tmp_path: Path) -> None:
    language, text = TEXTS[name]
    modules = [module for module in backend(language).modules if not find_spec(module)]
    if modules:
        pytest.skip(f"needs {modules[0]}")
    file = written(tmp_path / "text", text())
    begun = monotonic()
    result = process("cross-check", tree, "--against", f"{language}:{file}", "--timeout", 2, timeout=60)
    assert monotonic() - begun < 30
    assert result.returncode == 2, (result.stdout, result.stderr)
    assert "Traceback" not in result.stderr
    assert result.stderr.startswith("rvaft: error: ")
    assert len(result.stderr) < 2_000


def _command(number: str) -> bytes:
    try:
        return Path(f"/proc/{number}/cmdline").read_bytes()
    except OSError:
        return b""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_an_interrupt_ends_the_reading_of_a_text(number: signal.Signals, tree: Path, tmp_path: Path) -> None:
    text = written(tmp_path / "x.sql", _ENDLESS)
    with started("cross-check", tree, "--against", text) as running:
        if not Path("/proc/self/task").exists():
            pytest.skip("needs /proc")
        assert soon(lambda: bool(children(running)))
        (child,) = children(running)
        running.send_signal(number)
        begun = monotonic()
        running.wait(timeout=20)
        assert monotonic() - begun < 10
        assert soon(lambda: not _command(child))  # it does not outlive its parent
        if number == signal.SIGINT:
            assert running.returncode == 130
            assert "Traceback" not in running.stderr.read()


# The confinement itself.


def _tries() -> dict[str, Callable[[], object]]:
    def fork() -> None:
        if os.fork() == 0:
            os._exit(0)

    return {
        "a socket": socket.socket,
        "a local socket": lambda: socket.socket(socket.AF_UNIX),
        "a program": lambda: subprocess.run(["true"], check=True),
        "a process": fork,
        "a file to write": lambda: Path("file").write_text("x"),
        "a file to append": lambda: os.open("file", os.O_APPEND | os.O_WRONLY),
        "removal": lambda: Path("kept").unlink(),
        "renaming": lambda: Path("kept").rename("other"),
        "a folder": lambda: Path("folder").mkdir(),
        "a link": lambda: Path("link").symlink_to("kept"),
        "modes": lambda: Path("kept").chmod(0o777),
        "a signal": lambda: os.kill(os.getppid(), signal.SIGKILL),
        "memory": lambda: bytearray(1 << 30),
    }


def _attacker() -> Callable[[bytes], bytes]:
    def attack(name: bytes) -> bytes:
        try:
            _tries()[name.decode()]()
        except (OSError, MemoryError) as error:
            return type(error).__name__.encode()
        return b"done"

    return attack


@CONFINED
@pytest.mark.parametrize("name", [*_tries()])
def test_a_child_has_no_rights(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    written(tmp_path / "kept", "")
    child = Child("a child", _attacker, Limits(memory=256 << 20, seconds=10))
    assert child.ask(name.encode()) == (b"MemoryError" if name == "memory" else b"PermissionError")
    child.close()
    assert [one.name for one in tmp_path.iterdir()] == ["kept"]


@CONFINED
def test_a_child_can_read_and_start_threads(tmp_path: Path) -> None:
    file = written(tmp_path / "text", "read")

    def serve() -> Callable[[bytes], bytes]:
        def answer(_: bytes) -> bytes:
            found: list[str] = []
            thread = threading.Thread(target=lambda: found.append(file.read_text()))
            thread.start()
            thread.join()
            return found[0].encode()

        return answer

    assert Child("a child", serve, Limits()).ask(b"") == b"read"


@pytest.mark.parametrize(
    ("answer", "error", "reason"),
    [
        (lambda _: bytes(2 << 20), ToolFailed, "an answer of more than 1 MB"),
        (lambda _: os._exit(3), ToolFailed, "status 3"),
        (lambda _: 1 / 0, ToolFailed, "its process ended"),
        (lambda _: threading.Event().wait(), ToolTimeout, "no answer within 0.5 s"),
    ],
)
def test_a_child_that_fails_is_replaced(answer: Callable[[bytes], Any], error: type[Exception], reason: str) -> None:
    limits = Limits(reply=1 << 20, seconds=0.5)
    child = Child("a child", lambda: lambda asked: b"well" if asked == b"good" else answer(asked), limits)
    assert child.ask(b"good") == b"well"
    with pytest.raises(error, match=reason):
        child.ask(b"bad")
    assert child.ask(b"good") == b"well"
    assert child.number == 2
    big = bytes(3 << 20)  # more than a pipe holds
    with pytest.raises(error, match=reason):
        child.ask(big)
    child.close()


def test_all_languages_are_read_as_in_this_process(tmp_path: Path) -> None:
    """What a child answers is what the reader says; tests of the readers say whether that is right."""
    tree = loads("time t as s; top sand a o within 5 s; a; o or b c;")
    traces = [[{"event": name, "t": number} for number, name in enumerate(word)] for word in ("ab", "xac", "ba", "c")]
    seen = 0
    for name in all_backends():
        language = backend(name)
        if not language.readable or not language.faithful or not all(map(find_spec, language.modules)):
            continue
        if language.executes and not can_confine():
            continue
        try:
            text = language.translate(tree, Semantics.SCATTERED).text
        except Exception:  # noqa: BLE001 (this tree is not for every language)
            continue
        confined = ConfinedText("text", language, text, Limits())
        own = language.read(text)
        for trace in traces:
            assert [*confined.start().run(trace)] == [*own.fork().run(trace)], name
            stepped = confined.start()
            assert [stepped.step(event) for event in trace] == [*own.fork().run(trace)], name
        assert confined.observed == (None if language.executes else language.observed(text)), name
        seen += 1
    assert seen > 3


def test_the_number_of_a_dead_child_is_not_that_of_another(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody waits for a child before it is killed: a number that is free could be that of a bystander."""
    killed: list[bool] = []
    kill = os.killpg

    def noted(number: int, how: int) -> None:
        killed.append(Path(f"/proc/{number}").exists())
        kill(number, how)

    if not Path("/proc/self").exists():
        pytest.skip("needs /proc")
    monkeypatch.setattr(os, "killpg", noted)
    child = Child("a child", lambda: lambda _: os._exit(3), Limits(seconds=10))
    with pytest.raises(ToolFailed, match="status 3"):
        child.ask(b"")
    assert killed == [True]


@NEEDS_CC
@CONFINED
@pytest.mark.parametrize(
    "reply",
    [
        '{"value": 5}',
        '{"value": [1, ["true", "maybe"]]}',
        "{}",
        '{"value": ' + "[" * 2_000 + "]" * 2_000 + "}",
        "not JSON",
        '{"error": "x", "kind": "LanguageError", "fields": {"line": "abc"}}',
        '{"error": "x", "kind": "NotExpressible"}',
        '{"error": "x", "kind": "KeyboardInterrupt", "fields": []}',
    ],
)
def test_a_forged_answer_is_an_error_of_its_text(reply: str, tree: Path, tmp_path: Path) -> None:
    quoted = json.dumps(reply)
    attack = f"""__attribute__((constructor)) static void forge(void) {{
        static const char text[] = {quoted};
        uint64_t size = sizeof text - 1;
        for (int fd = 3; fd < 32; fd++) if (write(fd, &size, 8) == 8 && write(fd, text, sizeof text - 1) < 0) break;
    }}"""
    text = written(tmp_path / "x.c", c_text(attack))
    result = run("cross-check", tree, "--against", text, "--run-c", "--jobs", 1, "--semantics", "scattered")
    assert result.exit_code == 2, result.output
    assert "defect" not in result.output
    assert result.exception is None or isinstance(result.exception, SystemExit)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_workers_end_with_their_parent(number: signal.Signals) -> None:
    if not Path("/proc/self/task").exists():
        pytest.skip("needs /proc")
    with started("cross-check", "--random", 3_000, "--jobs", 2) as running:
        assert soon(lambda: len(children(running)) >= 2)
        workers = children(running)
        running.send_signal(number)
        running.wait(timeout=20)
        assert soon(lambda: not any(map(_command, workers)))
