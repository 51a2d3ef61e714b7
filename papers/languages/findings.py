"""What is seen in the sizes, each as a formula that every measured cell is held against."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from math import comb
from typing import Final

from cross_check.benchmark.measurement import Measurement, Outcome
from rvaft.model.nodes import Gate
from rvaft.model.verdict import Semantics

STRICT: Final = Semantics.STRICT
PROJECTED: Final = Semantics.PROJECTED
SCATTERED: Final = Semantics.SCATTERED


@dataclass(frozen=True, slots=True)
class Finding:
    """A sentence, and what it says of every cell that it is about; `concerns` picks those."""

    title: str
    concerns: Callable[[Measurement], bool]
    holds: Callable[[Measurement], bool]

    def cells(self, rows: Iterable[Measurement]) -> list[Measurement]:
        """The rows that it is about."""
        return [row for row in rows if self.concerns(row)]


def counted_subsets(row: Measurement) -> int:
    """How many sets of fewer than k of the n children there are: what has happened before a VOT k/n is detected."""
    return sum(comb(_n(row), size) for size in range(_k(row)))


def unrolled(row: Measurement) -> int:
    """The symbols of the paper's VOT k/n: for each set of fewer than k children an equation with an option for each child that is left."""
    n, k = _n(row), _k(row)
    inner = sum(comb(n, size) * (5 * (n - size) + 2) for size in range(k - 1))
    last = comb(n, k - 1) * (4 * (n - k + 1) + 2)
    return inner + last + 5 + _filter(row)


def _filter(row: Measurement) -> int:
    """The symbols of `relevant >> (…)`, which RML has around the whole under `projected`."""
    return 4 if row.semantics is PROJECTED else 0


def _n(row: Measurement) -> int:
    return row.children or 0


def _k(row: Measurement) -> int:
    return row.threshold or 0


def _between(row: Measurement) -> bool:
    return 1 < _k(row) < _n(row)


def _of(
    language: str, *gates: Gate, semantics: Sequence[Semantics] = tuple(Semantics)
) -> Callable[[Measurement], bool]:
    def concerns(row: Measurement) -> bool:
        named = row.language == language and row.gate in gates and row.semantics in semantics
        return named and row.result is Outcome.OK

    return concerns


def _all(row: Measurement) -> bool:
    return row.gate is not None


FINDINGS: Final = (
    Finding(
        "Every text that could be run gave the verdicts that the tree demands on all traces, the paper's unrolled VOT too: over "
        "leaves, with nothing behind the gate, it is right.",
        lambda row: _all(row) and row.run is Outcome.OK,
        lambda row: row.differing == 0,
    ),
    Finding(
        "The paper does not say how to write a tree under `scattered`; that is the only thing that some language cannot express.",
        _all,
        lambda row: (
            (row.result is Outcome.NOT_EXPRESSIBLE) == (row.language == "rml-paper" and row.semantics is SCATTERED)
        ),
    ),
    Finding(
        "An automaton for AND over n ≥ 2 children has 2ⁿ + 2 states under `strict` and `projected`.",
        lambda row: _of("automaton", Gate.AND, semantics=(STRICT, PROJECTED))(row) and _n(row) > 1,
        lambda row: row.states == 2 ** _n(row) + 2,
    ),
    Finding(
        "Under `scattered` it has 2ⁿ + 1: nothing can go wrong, so no state for that.",
        lambda row: _of("automaton", Gate.AND, semantics=(SCATTERED,))(row) and _n(row) > 1,
        lambda row: row.states == 2 ** _n(row) + 1,
    ),
    Finding(
        "An automaton for VOT k/n under `scattered` has a state for each set of fewer than k children, and two more.",
        _of("automaton", Gate.VOT, semantics=(SCATTERED,)),
        lambda row: row.states == counted_subsets(row) + 2,
    ),
    Finding(
        "An automaton for SAND under `scattered` has n + 2 states, in either direction.",
        _of("automaton", Gate.SAND, Gate.SAND_RL, semantics=(SCATTERED,)),
        lambda row: row.states == _n(row) + 2,
    ),
    Finding(
        "LTLf says AND under `scattered` with 3n - 1 symbols and 2n + 1 distinct subformulas (n ≥ 2): one conjunct for each child.",
        lambda row: _of("ltlf", Gate.AND, semantics=(SCATTERED,))(row) and _n(row) > 1,
        lambda row: (row.symbols, row.subformulas) == (3 * _n(row) - 1, 2 * _n(row) + 1),
    ),
    Finding(
        "LTLf says VOT k/n, k < n, under `scattered` with k(2(n - k) + 3) distinct subformulas: at most quadratic in n, where automata have a sum of binomials.",
        lambda row: _of("ltlf", Gate.VOT, semantics=(SCATTERED,))(row) and _k(row) < _n(row),
        lambda row: row.subformulas == _k(row) * (2 * (_n(row) - _k(row)) + 3),
    ),
    Finding(
        "RML says AND under `strict` with 2n + 5 symbols (n ≥ 2): `|` is a shuffle, and disjoint events cannot be confused.",
        lambda row: _of("rml", Gate.AND, semantics=(STRICT,))(row) and _n(row) > 1,
        lambda row: row.symbols == 2 * _n(row) + 5,
    ),
    Finding(
        "For VOT k/n, 1 < k < n, under `scattered` RML has one equation for each set of fewer than k children, and `Main`: one less than the automaton has states.",
        lambda row: _of("rml", Gate.VOT, semantics=(SCATTERED,))(row) and _between(row),
        lambda row: row.states == counted_subsets(row) + 1,
    ),
    Finding(
        "The paper's unrolled VOT has one equation for each set of fewer than k children, and `Main`, under `strict` and `projected`: its symbols follow a sum of binomials.",
        _of("rml-paper", Gate.VOT, semantics=(STRICT, PROJECTED)),
        lambda row: (row.symbols, row.states) == (unrolled(row), counted_subsets(row) + 1),
    ),
    Finding(
        "RML needs no unrolling there: its VOT never has more symbols than the unrolled one. (Small ones are written as alternatives all the same: then the published monitors say `true` at the very event, not one later.)",
        _of("rml", Gate.VOT, semantics=(STRICT, PROJECTED)),
        lambda row: (row.symbols or 0) <= unrolled(row),
    ),
    Finding(
        "From eight children up, for 1 < k < n, it is one equation of 3n + k + 10 symbols (`projected`: 4 more).",
        lambda row: _of("rml", Gate.VOT, semantics=(STRICT, PROJECTED))(row) and _between(row) and _n(row) >= 8,
        lambda row: (row.symbols, row.states) == (3 * _n(row) + _k(row) + 10 + _filter(row), 1),
    ),
)


def missed(rows: Sequence[Measurement]) -> list[str]:
    """The titles of findings that some cell contradicts, or that no cell is about."""
    return [
        finding.title
        for finding in FINDINGS
        if not (cells := finding.cells(rows)) or not all(finding.holds(row) for row in cells)
    ]
