"""Trees, and programs that monitor them."""

import subprocess
from functools import cache
from pathlib import Path

from backends.c import CBackend
from backends.c.library import build_program, compile_c
from rvaft import Semantics, loads

SANITIZERS = ("-O0", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
"""Without optimisation, which removes some of what is undefined and doubles the time of the compiler."""
WARNINGS = ("-Wall", "-Wextra", "-Wconversion", "-pedantic", "-Werror")
BACKEND, SCATTERED = CBackend(), Semantics.SCATTERED
TIED = "event e(k, u) = { k: k, u: u }; top sand x y; x on e(1, U); y on e(2, U);"
READING = 'event x(v) = { a: v }; event y(v) = { topic: "t", value: v }; top or a b c; a on x(_); b on y(_);'
WINDOW = f"time ts as s late 0 s; {TIED.replace('x y;', 'x y within 10 s;')}"


@cache
def program(text: str, folder: Path, semantics: Semantics = SCATTERED, capacity: int = 64) -> Path:
    file = folder / f"monitor-{abs(hash((text, semantics, capacity)))}"
    build_program(BACKEND.translate(loads(text), semantics).text, file, capacity)
    return file


def compile_strictly(text: str, folder: Path, *options: str, compiler: str = "") -> None:
    """Compile a text, of which a warning is an error; those of clang do not depend on the code that it makes."""
    made = "-fsyntax-only" if compiler == "clang" else "-c"
    compile_c(text, folder / "monitor.o", (*WARNINGS, *options, made), command=[compiler] if compiler else ())


def status(file: Path, data: bytes, *options: str) -> tuple[int, str, str]:
    done = subprocess.run([file, *options], input=data, capture_output=True, check=False, timeout=60)
    return done.returncode, done.stdout.decode(), done.stderr.decode()
