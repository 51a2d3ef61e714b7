"""Formulas run by others: the package `ltlf2dfa` writes them as programs for MONA, and MONA makes an automaton.

Of ltlf2dfa only its parser and its translation are used. Its `to_dfa` writes every program to one file inside the installed
package, where two processes meet and where a read-only installation keeps an old program without a word, and it makes an
automaton even of the output of a missing MONA.
"""

import re
import resource
import shutil
import subprocess
import tempfile
from collections.abc import Hashable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import networkx as nx

from backends.ltlf.formulas import JUNCTIONS, Connective, Formulas
from backends.ltlf.monitor import Atom, atoms_of
from backends.ltlf.reader import formula_of
from rvaft.errors import NotExpressible, TooLarge, ToolFailed, ToolMissing
from rvaft.model.patterns import Pattern
from rvaft.model.values import Json
from rvaft.model.verdict import Verdict
from rvaft.monitors import Monitor

# A formula of the core as a program for MONA, by the package `ltlf2dfa`.

_WRITTEN: Final = {
    Connective.TRUE: "true",
    Connective.FALSE: "false",
    Connective.NOT: "!({})",
    Connective.NEXT: "X({})",
    Connective.EVENTUALLY: "F({})",
    Connective.UNTIL: "(({}) U ({}))",
}
assert {*_WRITTEN, *JUNCTIONS, Connective.ATOM} == set(Connective)

OPERATORS: Final = 2_000
"""The most operators, shared subformulas written out wherever they occur: ltlf2dfa knows no sharing, and works by recursion."""


def program(formulas: Formulas, root: int, symbols: Mapping[str, str]) -> str:
    """The program; `symbols` names each atom in a way that ltlf2dfa takes. Raises `ToolMissing`, `ToolFailed`, `TooLarge`.

    In the syntax of ltlf2dfa `X` is the strong next; every operand stands in parentheses.
    """
    sizes: dict[int, int] = {}
    texts: dict[int, str] = {}
    for number in formulas.reachable(root):
        row = formulas.rows[number]
        sizes[number] = 1 + sum(sizes[operand] for operand in row.operands)
        if sizes[number] > OPERATORS:
            raise TooLarge("the formula, written out for ltlf2dfa, has more operators", limit=OPERATORS)
        operands = [texts[operand] for operand in row.operands]
        if row.op in JUNCTIONS:
            texts[number] = f"({f' {row.op.value} '.join(operands)})"
        else:
            texts[number] = symbols[row.name] if row.op is Connective.ATOM else _WRITTEN[row.op].format(*operands)
    try:
        from ltlf2dfa.base import MonaProgram  # noqa: PLC0415 -- not there on every machine
        from ltlf2dfa.parser.ltlf import LTLfParser  # noqa: PLC0415 -- not there on every machine
    except ImportError as error:
        raise ToolMissing("ltlf2dfa", remedy="run `pip install 'rvaft[mona]'`") from error
    try:
        made: Any = MonaProgram(LTLfParser()(texts[root])).mona_program()
    except RecursionError:
        raise TooLarge("the formula is nested too deep for ltlf2dfa", limit=OPERATORS) from None
    except Exception as error:
        raise ToolFailed("ltlf2dfa", reason=f"{type(error).__name__}: {error}".splitlines()[0]) from error
    return str(made)


# Running MONA, and the automaton that it prints.
#
# MONA's first step reads the variables that stand for no position, of which there are none here: the automaton of the words starts
# behind it. Output, for `-w`:
#
#     DFA for formula with free variables: P0 P1
#     Initial state: 0
#     Accepting states: 3
#     ...
#     State 0: XX -> state 1

SECONDS: Final = 20
MEMORY: Final = 1 << 30
"""Bytes, where the system can bound them: some small formulas take all there are."""

REMEDY: Final = "install the program mona (Debian and Ubuntu: `apt install mona`), and see that it is on the PATH"
_NAMES: Final = re.compile(r"^DFA for formula with free variables: *(.*)$", re.MULTILINE)
_INITIAL: Final = re.compile(r"^Initial state: (\d+)$", re.MULTILINE)
_ACCEPTING: Final = re.compile(r"^Accepting states: *([\d ]*)$", re.MULTILINE)
_EDGE: Final = re.compile(r"^State (\d+): ([01X]*) -> state (\d+)$", re.MULTILINE)


@dataclass(frozen=True, slots=True, eq=False)
class MonaAutomaton:
    """Deterministic and complete; a cube has `0`, `1` or `X` for each of `names`."""

    names: tuple[str, ...]
    start: int
    edges: Mapping[int, tuple[tuple[str, int], ...]]
    verdicts: Mapping[int, Verdict]
    """Of each state, once something was read: ⊤ where it and all that it leads to accept, ⊥ where none does."""


def _output(program: str) -> str:
    """What MONA prints of a program; raises `ToolMissing`, `ToolFailed`, and `TooLarge` where it comes to no end in time."""
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


def _read(output: str) -> MonaAutomaton:
    names, initial, accepting = (found.search(output) for found in (_NAMES, _INITIAL, _ACCEPTING))
    edges: dict[int, list[tuple[str, int]]] = {}
    for state, cube, target in _EDGE.findall(output):
        edges.setdefault(int(state), []).append((cube, int(target)))
    if names is None or initial is None or accepting is None or len(first := edges.get(int(initial[1]), [])) != 1:
        raise ToolFailed("mona", reason="it printed no automaton")
    accepts = frozenset(map(int, accepting[1].split()))
    table = {state: tuple(found) for state, found in edges.items()}
    graph = nx.DiGraph((state, target) for state, found in table.items() for _, target in found)
    verdicts: dict[int, Verdict] = {}
    for state in table:
        ends = {reached in accepts for reached in (state, *nx.descendants(graph, state))}
        verdicts[state] = Verdict.UNKNOWN if len(ends) == 2 else Verdict.TRUE if True in ends else Verdict.FALSE
    return MonaAutomaton(tuple(names[1].split()), first[0][1], table, verdicts)


# A text of LTLf run by MONA's automaton instead of this project's own reading of formulas.
#
# Both use Spot's parser and the meaning of atoms at an event; what a formula demands of a word, they find out in different ways.

ATOMS: Final = 8
"""The most atoms: the automaton has a transition for every set of them in the worst case."""


def read(text: str, given: Mapping[str, Pattern]) -> Monitor:
    """A monitor of the text; raises as `Backend.read_with` says."""
    return MonaMonitor(*_made(text, tuple(sorted(given.items(), key=lambda item: item[0]))))


@lru_cache(maxsize=32)
def _made(text: str, given: tuple[tuple[str, Pattern], ...]) -> tuple[MonaAutomaton, Mapping[str, Atom]]:
    """The automaton, and the atoms by their names in it."""
    formulas = Formulas()
    header, root = formula_of(text, formulas)
    rows = (formulas.rows[number] for number in formulas.reachable(root))
    names = sorted(row.name for row in rows if row.op is Connective.ATOM)
    atoms = atoms_of(header, names, dict(given))
    if variables := sorted(frozenset[str]().union(*(atom.mentions for atom in atoms.values()))):
        reason = f"its automata have no variables ({', '.join(variables)})"
        raise NotExpressible(reason, backend="ltlf-mona", semantics="any semantics")
    if len(names) > ATOMS:
        raise TooLarge(f"a formula with {len(names)} atoms for mona", limit=ATOMS)
    symbols = {name: f"p{number}" for number, name in enumerate(names)}  # ltlf2dfa writes symbols in upper case
    made = _read(_output(program(formulas, root, symbols)))
    return made, {symbol.upper(): atoms[name] for name, symbol in symbols.items()}


class MonaMonitor(Monitor):
    """⊤ where the word and all its extensions are accepted, ⊥ where none of them is, else ?; ? before any event."""

    def __init__(self, automaton: MonaAutomaton, atoms: Mapping[str, Atom]) -> None:
        super().__init__()
        self._automaton = automaton
        self._atoms = atoms
        self._at = automaton.start

    @property
    def state(self) -> Hashable:
        """The automaton, its state, the verdict."""
        return self._automaton, self._at, self._verdict

    def _advance(self, event: Json) -> Verdict:
        word = ["1" if self._atoms[name].holds(event, {}) else "0" for name in self._automaton.names]
        for cube, to in self._automaton.edges[self._at]:
            if all(asked in ("X", bit) for asked, bit in zip(cube, word, strict=True)):
                self._at = to
                break
        return self._automaton.verdicts[self._at]
