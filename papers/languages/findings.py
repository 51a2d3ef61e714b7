"""What is seen in the sizes, each as a formula that every measured cell is held against."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from math import comb, perm
from typing import Final

from cross_check.benchmark.measurement import Measurement, Outcome
from rvaft.model.nodes import Gate
from rvaft.model.verdict import Semantics

STRICT: Final = Semantics.STRICT
PROJECTED: Final = Semantics.PROJECTED
CONSECUTIVE: Final = Semantics.CONSECUTIVE
SCATTERED: Final = Semantics.SCATTERED
SEQUENCES: Final = (Gate.SAND, Gate.SAND_RL, Gate.PAND)
COUNTS: Final = (Gate.OR, Gate.AND, Gate.VOT)


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


def counted_sequences(row: Measurement) -> int:
    """How many sequences of fewer than k different children there are; OR has k = 1, AND k = n."""
    return sum(perm(_n(row), length) for length in range(_k(row)))


def in_a_row(row: Measurement) -> int:
    """The symbols of a gate whose children follow each other."""
    n = _n(row)
    symbols = {
        "rml": {STRICT: n + 4, PROJECTED: n + 8, CONSECUTIVE: 17 * n + 1, SCATTERED: 3 * n + 4},
        "ltlf": {STRICT: 5 * n - 6, PROJECTED: 12 * n - 4, CONSECUTIVE: 12 * n - 6, SCATTERED: 6 * n - 4},
    }
    return symbols[row.language][row.semantics]


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
    return row.threshold or (1 if row.gate is Gate.OR else _n(row))


def _between(row: Measurement) -> bool:
    return 1 < _k(row) < _n(row)


def _in_print(row: Measurement) -> bool:
    return row.gate is not Gate.PAND and row.semantics in (STRICT, PROJECTED)


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
        "The paper does not say how to write PAND, nor a tree under `consecutive` or `scattered`; that is the only thing that some language cannot express.",
        _all,
        lambda row: (row.result is Outcome.NOT_EXPRESSIBLE) == (row.language == "rml-paper" and not _in_print(row)),
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
        "An automaton for VOT k/n under `consecutive` has a state for each sequence of fewer than k different children, and two more; OR has k = 1, "
        "AND k = n. The order counts: if a child comes again, what has come since may begin a match.",
        _of("automaton", *COUNTS, semantics=(CONSECUTIVE,)),
        lambda row: row.states == counted_sequences(row) + 2,
    ),
    Finding(
        "RML has one equation for each of these sequences there, and `Main`.",
        _of("rml", *COUNTS, semantics=(CONSECUTIVE,)),
        lambda row: row.states == counted_sequences(row) + 1,
    ),
    Finding(
        "LTLf says VOT k/n, k ≥ 3, and AND (k = n) under `projected` and `consecutive` with 9k² - 10k + 2 + (n - k)(9k - 13) distinct subformulas: "
        "quadratic, and no more where a match may begin anywhere.",
        lambda row: _of("ltlf", Gate.AND, Gate.VOT, semantics=(PROJECTED, CONSECUTIVE))(row) and _k(row) > 2,
        lambda row: row.subformulas == 9 * _k(row) ** 2 - 10 * _k(row) + 2 + (_n(row) - _k(row)) * (9 * _k(row) - 13),
    ),
    Finding(
        "An automaton for SAND, in either direction, or PAND has n + 2 states under `consecutive` and `scattered`.",
        _of("automaton", *SEQUENCES, semantics=(CONSECUTIVE, SCATTERED)),
        lambda row: row.states == _n(row) + 2,
    ),
    Finding(
        "Under `strict` and `projected` it has one more (n ≥ 2), for what can go wrong.",
        lambda row: _of("automaton", *SEQUENCES, semantics=(STRICT, PROJECTED))(row) and _n(row) > 1,
        lambda row: row.states == _n(row) + 3,
    ),
    Finding(
        "Over n ≥ 2 leaves PAND is SAND, in as many symbols: RML has n + 4 under `strict`, n + 8 under `projected`, 17n + 1 under `consecutive`, "
        "3n + 4 under `scattered`; LTLf has 5n - 6, 12n - 4, 12n - 6, 6n - 4.",
        lambda row: any(_of(language, *SEQUENCES)(row) for language in ("rml", "ltlf")) and _n(row) > 1,
        lambda row: row.symbols == in_a_row(row),
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
