"""Running MONA, and the automaton that it prints.

MONA's first step reads the variables that stand for no position, of which there are none here: the automaton of the words starts
behind it. Output, for `-w`:

    DFA for formula with free variables: P0 P1
    Initial state: 0
    Accepting states: 3
    ...
    State 0: XX -> state 1
"""

import re
import resource
import shutil
import subprocess
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rvaft.errors import TooLarge, ToolFailed, ToolMissing
from rvaft.verdict import Verdict

SECONDS: Final = 20
MEMORY: Final = 1 << 30
"""Bytes, where the system can bound them: some small formulas take all there are."""

REMEDY: Final = "install the program mona (Debian and Ubuntu: `apt install mona`), and see that it is on the PATH"
_NAMES: Final = re.compile(r"^DFA for formula with free variables: *(.*)$", re.MULTILINE)
_INITIAL: Final = re.compile(r"^Initial state: (\d+)$", re.MULTILINE)
_ACCEPTING: Final = re.compile(r"^Accepting states: *([\d ]*)$", re.MULTILINE)
_EDGE: Final = re.compile(r"^State (\d+): ([01X]*) -> state (\d+)$", re.MULTILINE)


@dataclass(frozen=True, slots=True, eq=False)
class Automaton:
    """Deterministic and complete; a cube has `0`, `1` or `X` for each of `names`."""

    names: tuple[str, ...]
    start: int
    accepting: frozenset[int]
    edges: Mapping[int, tuple[tuple[str, int], ...]]
    verdicts: Mapping[int, Verdict]
    """Of each state, once something was read: ⊤ where it and all that it leads to accept, ⊥ where none does."""

    def step(self, state: int, letter: frozenset[str]) -> int:
        """The state after a letter, which is the set of names that are true."""
        word = ["1" if name in letter else "0" for name in self.names]
        fitting = (to for cube, to in self.edges[state] if all(c in ("X", w) for c, w in zip(cube, word, strict=True)))
        return next(fitting)


def automaton(program: str) -> Automaton:
    """The automaton of a program; raises `ToolMissing`, `ToolFailed`, and `TooLarge` where MONA comes to no end in time."""
    return _read(_output(program))


def _output(program: str) -> str:
    mona = shutil.which("mona")
    if mona is None:
        raise ToolMissing("mona", remedy=REMEDY)
    with tempfile.TemporaryDirectory(prefix="rvaft-") as folder:
        file = Path(folder) / "formula.mona"
        file.write_text(program, encoding="utf-8")
        command = [mona, "-q", "-u", "-w", str(file)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, encoding="utf-8") as process:  # noqa: S603
            _bounded(process.pid)
            try:
                output, _ = process.communicate(timeout=SECONDS)
            except subprocess.TimeoutExpired:
                process.kill()
                raise TooLarge("mona needs more seconds for the formula", limit=SECONDS) from None
    if process.returncode:
        reason = next((line for line in output.splitlines() if line.strip()), f"exit status {process.returncode}")
        raise ToolFailed("mona", reason=reason)
    return output


def _bounded(process: int) -> None:
    if hasattr(resource, "prlimit"):  # Linux
        with suppress(OSError):  # it may have come to its end already
            resource.prlimit(process, resource.RLIMIT_AS, (MEMORY, MEMORY))


def _read(output: str) -> Automaton:
    names, initial, accepting = (found.search(output) for found in (_NAMES, _INITIAL, _ACCEPTING))
    edges: dict[int, list[tuple[str, int]]] = {}
    for state, cube, target in _EDGE.findall(output):
        edges.setdefault(int(state), []).append((cube, int(target)))
    if names is None or initial is None or accepting is None or len(first := edges.get(int(initial[1]), [])) != 1:
        raise ToolFailed("mona", reason="it printed no automaton")
    accepts = frozenset(map(int, accepting[1].split()))
    table = {state: tuple(found) for state, found in edges.items()}
    verdicts = {state: _verdict(state, table, accepts) for state in table}
    return Automaton(tuple(names[1].split()), first[0][1], accepts, table, verdicts)


def _verdict(state: int, edges: Mapping[int, tuple[tuple[str, int], ...]], accepting: frozenset[int]) -> Verdict:
    found = {reached in accepting for reached in _reached(state, edges)}
    return Verdict.UNKNOWN if len(found) == 2 else Verdict.TRUE if found == {True} else Verdict.FALSE


def _reached(state: int, edges: Mapping[int, tuple[tuple[str, int], ...]]) -> Iterator[int]:
    """The state itself and all that it leads to."""
    seen, todo = {state}, [state]
    while todo:
        yield (current := todo.pop())
        fresh = {target for _, target in edges[current]} - seen
        seen |= fresh
        todo.extend(fresh)
