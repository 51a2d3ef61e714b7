"""Compiling C, and running the functions of a compiled text in this process."""

import ctypes
import json
import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Hashable, Sequence
from functools import lru_cache, partial
from importlib.util import find_spec
from pathlib import Path
from sys import executable
from typing import Final, Self

from rvaft.errors import LanguageError, NoVerdict, ToolFailed, ToolMissing
from rvaft.model.values import Json
from rvaft.model.verdict import Verdict
from rvaft.monitors import Monitor
from rvaft.support.files import require_target, write_whole
from rvaft.support.processes import end_with_parent

CAPACITY: Final = 1 << 18
"""The default number of partial matches of a program."""
STANDARD: Final = ("-std=c99",)
_SECONDS: Final = 300
_STRANGERS: Final = 60
"""Seconds of processor time for the compiler of a stranger's text."""
_FUNCTIONS: Final = ("rvaft_init", "rvaft_line", "rvaft_size", "rvaft_reader_size", "rvaft_state", "rvaft_again")
_VERDICTS: Final = {0: Verdict.UNKNOWN, 1: Verdict.TRUE, 2: Verdict.FALSE}
_ERRORS: Final = {
    -1: "an array is full: compile with a larger RVAFT_CAPACITY",
    -2: "a number or a time needs more than 64 bits",
    -3: "the event is not JSON",
}
_STATE: Final = 1 << 16


def compiler() -> list[str] | None:
    """Return the command of the C compiler: `$CC`, `cc`, or the one of the package `ziglang`."""
    named = os.environ.get("CC", "").split()
    if named and shutil.which(named[0]):
        return named
    if shutil.which("cc"):
        return ["cc"]
    return [executable, "-m", "ziglang", "cc"] if find_spec("ziglang") else None


def require_compiler() -> list[str]:
    """Return the command of the C compiler; raises `ToolMissing`."""
    found = compiler()
    if found is None:
        raise ToolMissing("a C compiler", remedy="install gcc or clang, or pip install 'rvaft[native]'")
    return found


def fast_compiler() -> list[str]:
    """Return the command of a compiler for texts that run once: compiling takes longer than running."""
    named = next((name for name in ("tcc", "clang") if shutil.which(name)), None)
    return require_compiler() if named is None or os.environ.get("CC") else [named]


def compiles_at_once() -> bool:
    """Return whether `fast_compiler` takes milliseconds for a text, as TinyCC does; others optimise little, but take
    tenths of a second.
    """
    return Path(fast_compiler()[0]).name == "tcc"


def strict_compiler() -> list[str]:
    """Return the command of a compiler for texts of strangers; raises `ToolMissing`.

    A text can give options to TinyCC, such as a file to write, or to run what it compiles.
    """
    named = os.environ.get("CC", "").split()
    if named and Path(named[0]).name.startswith(("gcc", "clang")) and shutil.which(named[0]):
        return named
    found = next((name for name in ("clang", "gcc") if shutil.which(name)), None)
    if found is None:
        raise ToolMissing("gcc or clang, which compile texts of strangers,", remedy="install one of them")
    return [found]


class CompilerError(ToolFailed):
    """An error that the compiler reports at a line of the text."""

    def __init__(self, message: str, *, line: int) -> None:
        self.line = line
        super().__init__("the C compiler", reason=f"line {line}: {message}")


def _limit_compiler() -> None:
    import resource  # noqa: PLC0415 -- a browser has no such module, and translates all the same

    resource.setrlimit(resource.RLIMIT_CPU, (_STRANGERS, _STRANGERS))
    end_with_parent()


def compile_c(
    text: str, to: Path, options: Sequence[str], *, command: Sequence[str] = (), limited: bool = False
) -> None:
    """Compile a text to a program or a library; raises `ToolMissing` and `ToolFailed`.

    A `limited` compiler has a minute of processor time, and ends with this process.
    """
    source = to.with_suffix(".c")
    source.write_text(text, encoding="utf-8")
    every = [*(command or require_compiler()), *STANDARD, *options, os.fspath(source), "-o", os.fspath(to)]
    try:
        done = subprocess.run(  # noqa: S603
            every,
            capture_output=True,
            timeout=_SECONDS,
            check=False,
            preexec_fn=_limit_compiler if limited else None,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise ToolFailed("the C compiler", reason=str(error)) from None
    if done.returncode:
        lines = done.stderr.decode(errors="replace").splitlines()
        # An error in another file may quote that file, which the text includes.
        own = (
            re.fullmatch(rf"{re.escape(os.fspath(source))}:([0-9]+):(?:[0-9]+:)? (.*error.*)", line) for line in lines
        )
        found = next(filter(None, own), None)
        if found is None:
            reason = f"exit status {done.returncode}; it reports no error in the text itself"
            raise ToolFailed("the C compiler", reason=reason)
        raise CompilerError(found[2], line=int(found[1]))


def build_program(text: str, to: Path, capacity: int, *, places: bool = False) -> None:
    """Compile a text to a program for JSON Lines, which replaces the regular file `to` at the end.

    With `places` its detections have the places of their events. Raises `ToolMissing`, `ToolFailed`
    and `OSError`.
    """
    options = ("-DRVAFT_MAIN=1", f"-DRVAFT_CAPACITY={capacity}", f"-DRVAFT_PLACES={int(places)}")
    require_target(to, regular=True)
    with tempfile.TemporaryDirectory(prefix="rvaft-") as folder:
        compile_monitor(text, made := Path(folder) / "monitor", options)
        write_whole(to, made.read_bytes(), executable=True)


def compile_monitor(text: str, to: Path, options: Sequence[str]) -> None:
    """Compile a text with optimisation; raises `ToolMissing` and `ToolFailed`."""
    compile_c(text, to, ("-O3", *options))


@lru_cache(maxsize=64)
def _library(text: str, confine: Callable[[], object] | None) -> ctypes.CDLL:
    with tempfile.TemporaryDirectory(prefix="rvaft-", ignore_cleanup_errors=True) as folder:
        path = Path(folder) / "monitor.so"
        try:
            command = fast_compiler() if confine is None else strict_compiler()
            compile_c(text, path, ("-O0", "-shared", "-fPIC"), command=command, limited=confine is not None)
            if confine is not None:  # a confined process cannot remove the folder
                made = os.open(path, os.O_RDONLY)
                shutil.rmtree(folder)
                confine()
                path = Path(f"/proc/self/fd/{made}")
            found = ctypes.CDLL(os.fspath(path))
            for name in _FUNCTIONS:
                getattr(found, name)
        except CompilerError as error:
            raise LanguageError(f"not a monitor in C: {error}", line=error.line) from None
        except AttributeError as error:
            raise LanguageError(f"not a monitor in C: {str(error).rpartition(': ')[2]}") from None
        except (ToolFailed, OSError) as error:
            raise LanguageError(f"not a monitor in C: {error}") from None
    found.rvaft_size.restype = found.rvaft_reader_size.restype = found.rvaft_state.restype = ctypes.c_size_t
    found.rvaft_init.restype = found.rvaft_again.restype = None
    found.rvaft_init.argtypes = [ctypes.c_void_p, ctypes.c_uint64]
    found.rvaft_line.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_char_p, ctypes.c_size_t]
    found.rvaft_state.argtypes = [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_size_t]
    return found


class CMonitor(Monitor):
    """Runs the functions of a compiled text.

    `confine` (on Linux) is called before the compiled text runs. Raises `NoVerdict` where an array is full or a
    number has too many bits.
    """

    def __init__(self, text: str, confine: Callable[[], object] | None = None) -> None:
        super().__init__()
        self._functions = _library(text, confine)
        self._state = ctypes.create_string_buffer(self._functions.rvaft_size())
        self._reader = ctypes.create_string_buffer(self._functions.rvaft_reader_size())
        self._functions.rvaft_init(self._state, 1)
        self.left_open = partial(_left_open, text, confine)  # no cycle, which would keep the memory

    def fork(self) -> Self:
        """Return an independent monitor in the same state."""
        twin = super().fork()
        vars(twin)["_state"] = ctypes.create_string_buffer(len(self._state))
        ctypes.memmove(vars(twin)["_state"], self._state, len(self._state))
        return twin

    def _advance(self, event: Json) -> Verdict:
        return self.read_line(json.dumps(event, default=dict, ensure_ascii=False).encode("utf-8", "surrogatepass"))

    @property
    def size(self) -> int:
        """The size of the monitor in bytes."""
        return len(self._state)

    def read_line(self, line: bytes) -> Verdict:
        """Read a line of JSON and return the verdict after it; raises `NoVerdict`."""
        code = self._functions.rvaft_line(self._state, self._reader, line + bytes(16), len(line))
        if code not in _VERDICTS:
            raise NoVerdict(_ERRORS.get(code, str(code)), event=self._read)
        return _VERDICTS[code]

    @property
    def state(self) -> Hashable:
        """The verdict and the partial matches; before the first event, only the verdict."""
        if self._verdict.final:
            return self._verdict
        size = _STATE
        while True:
            buffer = ctypes.create_string_buffer(size)
            used = self._functions.rvaft_state(self._state, buffer, size)
            if used <= size:
                break
            size = used
        records, at, data = set[bytes](), 0, buffer.raw
        while at < used:
            length = int.from_bytes(data[at : at + 4], "little")
            records.add(data[at + 4 : at + 4 + length])
            at += 4 + length
        return self._verdict, frozenset(records)


def _left_open(text: str, confine: Callable[[], object] | None, trace: Sequence[Json]) -> str:
    try:
        list(CMonitor(text, confine).run(trace))
    except NoVerdict as error:
        return error.reason
    return ""
