"""A second monitor for formulas: `ltlf2dfa` writes a MONA program, and MONA builds the automaton.

Spot's parser and the atoms are shared with the other monitor. `to_dfa` of ltlf2dfa is not used: it
writes all programs to one file in the installed package, which fails with parallel processes or a
read-only installation, and it ignores a missing MONA.
"""

import re
import resource
import shutil
import subprocess
import tempfile
from collections.abc import Hashable, Mapping
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Final

import networkx as nx

from backends.ltlf.formulas import JUNCTIONS, Connective, Formulas
from backends.ltlf.monitor import Atom, atoms_of
from backends.ltlf.reader import Header, formula_of
from rvaft.errors import NotExpressible, TooLarge, ToolFailed, ToolMissing, installed, unwritten
from rvaft.model.values import Json
from rvaft.model.verdict import Verdict
from rvaft.monitors import Monitor

ATOMS: Final = 8
"""Maximum number of atoms: there may be a transition per set of atoms."""
OPERATORS: Final = 2_000
"""Maximum number of operators after expanding shared subformulas: ltlf2dfa is recursive."""
SECONDS: Final = 20
MEMORY: Final = 1 << 30
"""Bytes, if the system can bound them; some small formulas exhaust the memory."""

_WRITTEN: Final = {
    Connective.TRUE: "true",
    Connective.FALSE: "false",
    Connective.NOT: "!({})",
    Connective.NEXT: "X({})",
    Connective.EVENTUALLY: "F({})",
    Connective.UNTIL: "(({}) U ({}))",
}
"""The syntax of ltlf2dfa, where `X` is the strong next."""
assert {*_WRITTEN, *JUNCTIONS, Connective.ATOM} == set(Connective)


def _program(formulas: Formulas, root: int, symbols: Mapping[str, str]) -> str:
    """Return the MONA program; `symbols` maps atoms to names that ltlf2dfa accepts."""
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
    remedy = "pip install '.[mona]' in a checkout of rvaft"
    base, parser = (installed(f"ltlf2dfa.{name}", "ltlf2dfa", remedy) for name in ("base", "parser.ltlf"))
    try:
        return str(base.MonaProgram(parser.LTLfParser()(texts[root])).mona_program())
    except RecursionError:
        raise TooLarge("the formula is nested too deep for ltlf2dfa", limit=OPERATORS) from None
    except Exception as error:
        raise ToolFailed("ltlf2dfa", reason=f"{type(error).__name__}: {error}".splitlines()[0]) from error


def _output(program: str) -> str:
    mona = shutil.which("mona")
    if mona is None:
        remedy = "install the program mona (Debian and Ubuntu: `apt install mona`), and see that it is on the PATH"
        raise ToolMissing("mona", remedy=remedy)
    with tempfile.TemporaryDirectory(prefix="rvaft-") as folder:
        file = Path(folder) / "formula.mona"
        file.write_text(program, encoding="utf-8")
        command = [mona, "-q", "-u", "-w", str(file)]
        with subprocess.Popen(  # noqa: S603
            command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, encoding="utf-8"
        ) as process:
            if hasattr(resource, "prlimit"):  # Linux
                with suppress(OSError):  # the process may have ended
                    resource.prlimit(process.pid, resource.RLIMIT_AS, (MEMORY, MEMORY))
            try:
                output, _ = process.communicate(timeout=SECONDS)
            except subprocess.TimeoutExpired:
                process.kill()
                raise TooLarge("mona needs more seconds for the formula", limit=SECONDS) from None
    if process.returncode:
        reason = next((line for line in output.splitlines() if line.strip()), f"exit status {process.returncode}")
        raise ToolFailed("mona", reason=reason)
    return output


_HEAD: Final = re.compile(
    r"^DFA for formula with free variables: *(.*)\nInitial state: (\d+)\nAccepting states: *([\d ]*)$", re.MULTILINE
)
_EDGE: Final = re.compile(r"^State (\d+): ([01X]*) -> state (\d+)$", re.MULTILINE)


class _MonaAutomaton:
    """A deterministic, complete automaton from the output of `mona -w`.

    A cube has `0`, `1` or `X` for each of `names`. The first step of MONA reads variables without a
    position; there are none here, so the automaton starts after it. Output:

            DFA for formula with free variables: P0 P1
            Initial state: 0
            Accepting states: 3
            ...
            State 0: XX -> state 1
    """

    def __init__(self, output: str) -> None:
        head = _HEAD.search(output)
        self.edges: dict[int, list[tuple[str, int]]] = {}
        for state, cube, target in _EDGE.findall(output):
            self.edges.setdefault(int(state), []).append((cube, int(target)))
        if head is None or len(first := self.edges.get(int(head[2]), [])) != 1:
            raise ToolFailed("mona", reason="it printed no automaton")
        self.names = head[1].split()
        self.start = first[0][1]
        accepts = frozenset(map(int, head[3].split()))
        graph = nx.DiGraph((state, target) for state, found in self.edges.items() for _, target in found)
        self.verdicts: dict[int, Verdict] = {}
        """Per state: ⊤ if it and all reachable states accept, ⊥ if none accepts."""
        for state in self.edges:
            ends = {reached in accepts for reached in (state, *nx.descendants(graph, state))}
            self.verdicts[state] = (
                Verdict.UNKNOWN if len(ends) == 2 else Verdict.TRUE if True in ends else Verdict.FALSE
            )


@lru_cache(maxsize=32)
def _made(text: str) -> tuple[_MonaAutomaton, Mapping[str, Atom], Header]:
    formulas = Formulas()
    header, root = formula_of(text, formulas)
    names = sorted(formulas.atoms(root))
    atoms = atoms_of(header, names, {})
    if variables := sorted(frozenset[str]().union(*(atom.mentions for atom in atoms.values()))):
        reason = f"its automata have no variables ({', '.join(variables)})"
        raise NotExpressible(unwritten(reason), backend="ltlf-mona", semantics="any semantics")
    if len(names) > ATOMS:
        raise TooLarge(f"a formula with {len(names)} atoms for mona", limit=ATOMS)
    symbols = {name: f"p{number}" for number, name in enumerate(names)}  # ltlf2dfa writes symbols in upper case
    made = _MonaAutomaton(_output(_program(formulas, root, symbols)))
    return made, {symbol.upper(): atoms[name] for name, symbol in symbols.items()}, header


class MonaMonitor(Monitor):
    """⊤ if the word and all its extensions are accepted, ⊥ if none is, else ?.

    Raises `LanguageError`, `NotExpressible` (variables), `TooLarge` (too many atoms, or a timeout of
    MONA), and `ToolMissing` without Spot, ltlf2dfa or MONA.
    """

    def __init__(self, text: str) -> None:
        super().__init__()
        self._automaton, self._atoms, self._header = _made(text)
        self._at = self._automaton.start

    @property
    def state(self) -> Hashable:
        """The automaton, its state and the verdict."""
        return self._automaton, self._at, self._verdict

    def _advance(self, event: Json) -> Verdict:
        event, nothing = self._header.stamped(event), dict[str, Json]()
        word = ["1" if self._atoms[name].holds(event, nothing, nothing) else "0" for name in self._automaton.names]
        for cube, to in self._automaton.edges[self._at]:
            if all(wanted in ("X", bit) for wanted, bit in zip(cube, word, strict=True)):
                self._at = to
                break
        return self._automaton.verdicts[self._at]
