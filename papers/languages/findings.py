"""Statements on sizes, each a formula that is checked against every measured cell."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import comb, perm
from pathlib import Path
from typing import Final

from papers.languages.measurement import Measurement, Outcome
from rvaft.errors import Cause
from rvaft.model.nodes import Gate
from rvaft.model.verdict import Semantics

STRICT, PROJECTED, CONSECUTIVE, SCATTERED = Semantics
SEQUENCES: Final = (Gate.SAND, Gate.SAND_RL, Gate.PAND)
COUNTS: Final = (Gate.OR, Gate.AND, Gate.VOT)
SCATTERED_ALONE: Final = ("eql", "sigma", "stix")
"""Languages in which rvaft writes `scattered` alone."""

_OVER_SEVERAL: Final = ("tied", "tied_some", "compared", "product", "window", "inner_window", "apart")

Formula = Callable[[int, int], int]
"""A size of a gate over n children that needs k; OR has k = 1, gates except VOT k = n."""


@dataclass(frozen=True, slots=True)
class Finding:
    """A sentence, and its check on the cells that `concerns` selects."""

    title: str
    concerns: Callable[[Measurement], bool]
    holds: Callable[[Measurement], bool]

    def cells(self, rows: Iterable[Measurement]) -> list[Measurement]:
        """Return the rows that the finding concerns."""
        return [row for row in rows if self.concerns(row)]


@dataclass(frozen=True, slots=True)
class Claim:
    """The sizes of gates in a language, under some semantics and for n and k with `where`."""

    language: str
    gates: Sequence[Gate]
    semantics: Sequence[Semantics]
    sizes: Mapping[str, Formula]
    where: Callable[[int, int], bool] = lambda _n, _k: True
    at_most: bool = False
    """Whether the sizes are bounds."""

    def concerns(self, row: Measurement) -> bool:
        """Return whether the claim concerns a cell."""
        named = row.language == self.language and row.gate in self.gates and row.semantics in self.semantics
        return named and row.result is Outcome.OK and self.where(*_gate(row))

    def holds(self, row: Measurement) -> bool:
        """Return whether the cell satisfies the claim."""
        pairs = [(getattr(row, name), formula(*_gate(row))) for name, formula in self.sizes.items()]
        return all(found <= wanted if self.at_most else found == wanted for found, wanted in pairs)


def sized(title: str, *claims: Claim) -> Finding:
    """Return the finding that all of these claims hold."""
    return Finding(
        title,
        lambda row: any(claim.concerns(row) for claim in claims),
        lambda row: all(claim.holds(row) for claim in claims if claim.concerns(row)),
    )


def filtered(claim: Claim) -> tuple[Claim, Claim]:
    """Return the claim under `strict` and `projected`, which adds 4 symbols: `relevant >> (…)`."""
    symbols = claim.sizes["symbols"]
    more: Formula = lambda n, k: symbols(n, k) + 4  # noqa: E731
    return claim, replace(claim, semantics=(PROJECTED,), sizes={**claim.sizes, "symbols": more})


def _gate(row: Measurement) -> tuple[int, int]:
    n = row.children or 0
    return n, row.threshold or (1 if row.gate is Gate.OR else n)


def subsets(n: int, k: int) -> int:
    """Return the number of sets of fewer than k of n children: the states before the detection."""
    return sum(comb(n, size) for size in range(k))


def sequences(n: int, k: int) -> int:
    """Return the number of sequences of fewer than k different children."""
    return sum(perm(n, length) for length in range(k))


def larger(n: int, k: int, size: Callable[[int], int]) -> int:
    """Return the total size of all sets of at least k children."""
    return sum(comb(n, j) * size(j) for j in range(k, n + 1))


def unrolled(n: int, k: int) -> int:
    """Return the symbols of the paper's VOT k/n.

    It has an equation per set of fewer than k children, with an option per remaining child.
    """
    inner = sum(comb(n, size) * (5 * (n - size) + 2) for size in range(k - 1))
    return inner + comb(n, k - 1) * (4 * (n - k + 1) + 2) + 5


def chains(n: int, k: int, chain: Callable[[int], int], *, other: int, more: int = 0, joint: int = 0) -> int:
    """Return the symbols of a chain per order of k - 1 children, with a choice of the others first.

    `other` counts per alternative, `more` per choice, `joint` between chains.
    """
    each = chain(k) + other * (n - k) + more * (k < n)
    return perm(n, k - 1) * each + (perm(n, k - 1) - 1) * joint


def several(n: int, _k: int) -> bool:
    """Return whether there are at least two children."""
    return n > 1


def between(n: int, k: int) -> bool:
    """Return whether k is neither 1 nor n."""
    return 1 < k < n


def votes(language: str, formula: Formula, semantics: Sequence[Semantics] = (SCATTERED,)) -> Claim:
    """Return a claim on the symbols of AND, and of VOT with k > 1."""
    return Claim(language, (Gate.AND, Gate.VOT), semantics, {"symbols": formula}, lambda _, k: k > 1)


def in_a_row(language: str, semantics: Semantics, formula: Callable[[int], int], least: int = 2) -> Claim:
    """Return a claim on the symbols of SAND, in either direction, and PAND."""
    return Claim(language, SEQUENCES, (semantics,), {"symbols": lambda n, _: formula(n)}, lambda n, _: n >= least)


SECTIONS: Final[Mapping[str, Sequence[Finding]]] = {
    "Expressiveness": (
        Finding(
            "No gate over leaves is beyond a language, and none needs an extension of rvaft.",
            lambda row: row.gate is not None,
            lambda row: row.cause is not Cause.LANGUAGE and not row.extension,
        ),
        Finding(
            "LTLf and automata have variables over several events and windows by extensions of rvaft alone.",
            lambda row: row.language in ("automaton", "ltlf") and Path(row.tree).stem in _OVER_SEVERAL,
            lambda row: bool(row.extension),
        ),
    ),
    "Verdicts": (
        Finding(
            "Every text with a reader gives the verdicts of the tree on all traces (detections-only "
            "languages: the same first detections). This includes the paper's unrolled VOT over leaves "
            "with nothing behind the gate.",
            lambda row: bool(row.walks),
            lambda row: row.differing == 0,
        ),
        Finding(
            "SQL expresses every tree of the first table under each semantics; of these languages, rvaft drops late "
            "events only in SQL.",
            lambda row: row.gate is None and (row.language == "sql" or "late" in row.tree),
            lambda row: (row.result is Outcome.OK) == (row.language == "sql"),
        ),
        Finding(
            "The paper does not define PAND, `consecutive` and `scattered`; in EQL, Sigma and STIX rvaft writes only "
            "`scattered`. Every other gate over leaves has a text in every language, within the limits.",
            lambda row: row.gate is not None,
            lambda row: (
                (row.result is Outcome.NOT_EXPRESSIBLE)
                == (
                    (row.language in SCATTERED_ALONE and row.semantics is not SCATTERED)
                    or (
                        row.language == "rml-paper"
                        and (row.gate is Gate.PAND or row.semantics in (CONSECUTIVE, SCATTERED))
                    )
                )
            ),
        ),
    ),
    "Automata": (
        sized(
            "An automaton for AND over n ≥ 2 children has 2ⁿ + 2 states under `strict` and `projected`.",
            Claim("automaton", (Gate.AND,), (STRICT, PROJECTED), {"states": lambda n, _: 2**n + 2}, several),
        ),
        sized(
            "Under `scattered` it has 2ⁿ + 1: there is no rejecting state.",
            Claim("automaton", (Gate.AND,), (SCATTERED,), {"states": lambda n, _: 2**n + 1}, several),
        ),
        sized(
            "An automaton for VOT k/n under `scattered` has a state per set of fewer than k children, and two more.",
            Claim("automaton", (Gate.VOT,), (SCATTERED,), {"states": lambda n, k: subsets(n, k) + 2}),
        ),
        sized(
            "An automaton for VOT k/n under `consecutive` has a state per sequence of fewer than k "
            "different children, and two more; OR has k = 1, AND k = n. The order matters: after a "
            "repeated child, a match may begin at a later event.",
            Claim("automaton", COUNTS, (CONSECUTIVE,), {"states": lambda n, k: sequences(n, k) + 2}),
        ),
        sized(
            "An automaton for SAND, in either direction, or PAND has n + 2 states under `consecutive` and `scattered`.",
            Claim("automaton", SEQUENCES, (CONSECUTIVE, SCATTERED), {"states": lambda n, _: n + 2}),
        ),
        sized(
            "Under `strict` and `projected` it has one more (n ≥ 2), the rejecting state.",
            Claim("automaton", SEQUENCES, (STRICT, PROJECTED), {"states": lambda n, _: n + 3}, several),
        ),
    ),
    "LTLf": (
        sized(
            "VOT k/n, k ≥ 3, and AND (k = n) under `projected` and `consecutive` have 9k² - 10k + 2 + (n "
            "- k)(9k - 13) distinct subformulas: quadratic.",
            Claim(
                "ltlf",
                (Gate.AND, Gate.VOT),
                (PROJECTED, CONSECUTIVE),
                {"subformulas": lambda n, k: 9 * k**2 - 10 * k + 2 + (n - k) * (9 * k - 13)},
                lambda _, k: k > 2,
            ),
        ),
        sized(
            "AND under `scattered` has 3n - 1 symbols and 2n + 1 distinct subformulas (n ≥ 2): one conjunct per child.",
            Claim(
                "ltlf",
                (Gate.AND,),
                (SCATTERED,),
                {"symbols": lambda n, _: 3 * n - 1, "subformulas": lambda n, _: 2 * n + 1},
                several,
            ),
        ),
        sized(
            "VOT k/n, k < n, under `scattered` has k(2(n - k) + 3) distinct subformulas: at most "
            "quadratic in n, while automata have a sum of binomials.",
            Claim(
                "ltlf",
                (Gate.VOT,),
                (SCATTERED,),
                {"subformulas": lambda n, k: k * (2 * (n - k) + 3)},
                lambda n, k: k < n,
            ),
        ),
        sized(
            "Over n ≥ 2 leaves, PAND equals SAND: 5n - 6 symbols under `strict`, 12n - 4 under "
            "`projected`, 12n - 6 under `consecutive`, 6n - 4 under `scattered`.",
            in_a_row("ltlf", STRICT, lambda n: 5 * n - 6),
            in_a_row("ltlf", PROJECTED, lambda n: 12 * n - 4),
            in_a_row("ltlf", CONSECUTIVE, lambda n: 12 * n - 6),
            in_a_row("ltlf", SCATTERED, lambda n: 6 * n - 4),
        ),
    ),
    "RML": (
        sized(
            "SAND, in either direction, and PAND over n ≥ 2 leaves have n + 4 symbols under `strict`, n + "
            "8 under `projected`, 17n + 1 under `consecutive`, 3n + 4 under `scattered`.",
            in_a_row("rml", STRICT, lambda n: n + 4),
            in_a_row("rml", PROJECTED, lambda n: n + 8),
            in_a_row("rml", CONSECUTIVE, lambda n: 17 * n + 1),
            in_a_row("rml", SCATTERED, lambda n: 3 * n + 4),
        ),
        sized(
            "AND under `strict` has 2n + 5 symbols (n ≥ 2): `|` is a shuffle, and the events are disjoint.",
            Claim("rml", (Gate.AND,), (STRICT,), {"symbols": lambda n, _: 2 * n + 5}, several),
        ),
        sized(
            "VOT k/n, 1 < k < n, under `scattered` has an equation per set of fewer than k children, and "
            "`Main`: one less than the automaton has states.",
            Claim("rml", (Gate.VOT,), (SCATTERED,), {"states": lambda n, k: subsets(n, k) + 1}, between),
        ),
        sized(
            "Under `consecutive` it has one per sequence of fewer than k different children, and `Main`; "
            "OR has k = 1, AND k = n.",
            Claim("rml", COUNTS, (CONSECUTIVE,), {"states": lambda n, k: sequences(n, k) + 1}),
        ),
        sized(
            "The paper's unrolled VOT has an equation per set of fewer than k children, and `Main`, under"
            " `strict` and `projected`: its symbols grow as a sum of binomials.",
            *filtered(
                Claim(
                    "rml-paper",
                    (Gate.VOT,),
                    (STRICT,),
                    {"symbols": unrolled, "states": lambda n, k: subsets(n, k) + 1},
                )
            ),
        ),
        sized(
            "The VOT of `rml` is not unrolled, and never has more symbols. (Small ones are alternatives, "
            "so that the published monitors report `true` at the detecting event, not one later.)",
            *filtered(Claim("rml", (Gate.VOT,), (STRICT,), {"symbols": unrolled}, at_most=True)),
        ),
        sized(
            "From eight children, for 1 < k < n, it is one equation of 3n + k + 10 symbols (`projected`: 4 more).",
            *filtered(
                Claim(
                    "rml",
                    (Gate.VOT,),
                    (STRICT,),
                    {"symbols": lambda n, k: 3 * n + k + 10, "states": lambda _n, _k: 1},
                    lambda n, k: between(n, k) and n >= 8,
                )
            ),
        ),
    ),
    "SQL and row patterns": (
        sized(
            "An SQL query for SAND, in either direction, or PAND joins n tables in 40n + 45 symbols under"
            " `strict`, 48n + 47 under `projected`, 64n + 47 under `consecutive`, 62n + 4 under "
            "`scattered`.",
            in_a_row("sql", STRICT, lambda n: 40 * n + 45),
            in_a_row("sql", PROJECTED, lambda n: 48 * n + 47),
            in_a_row("sql", CONSECUTIVE, lambda n: 64 * n + 47),
            in_a_row("sql", SCATTERED, lambda n: 62 * n + 4),
        ),
        sized(
            "For VOT k/n, k ≥ 2, and AND (k = n) under `scattered` it has a join of k tables per set of k"
            " children, without an order: 40n + C(n,k)(14k + 17) - 2 symbols. Languages of sequences list"
            " the orders.",
            votes("sql", lambda n, k: 40 * n + comb(n, k) * (14 * k + 17) - 2),
        ),
        sized(
            "Under the other semantics it has a join per set of at least k children.",
            votes("sql", lambda n, k: 24 * n + 29 + larger(n, k, lambda j: 20 * j + 17), (STRICT,)),
            votes("sql", lambda n, k: 32 * n + 31 + larger(n, k, lambda j: 20 * j + 17), (PROJECTED,)),
            votes("sql", lambda n, k: 44 * n + 35 + larger(n, k, lambda j: 24 * j + 13), (CONSECUTIVE,)),
        ),
        sized(
            "MATCH_RECOGNIZE has a query of 10k + 43 symbols per order of k children under `scattered`: "
            "n! for AND. (The standard's PERMUTE needs one; Flink lacks it.)",
            Claim(
                "match-recognize",
                COUNTS,
                (SCATTERED,),
                {
                    "symbols": lambda n, k: perm(n, k) * (10 * k + 45) - 2,
                    "subformulas": lambda n, k: k * perm(n, k),
                },
            ),
            in_a_row("match-recognize", SCATTERED, lambda n: 10 * n + 43, 1),
        ),
        sized(
            "Under the other semantics it has, for AND and VOT, one per order of at least k children.",
            Claim(
                "match-recognize",
                (Gate.AND, Gate.VOT),
                (STRICT, PROJECTED, CONSECUTIVE),
                {"subformulas": lambda n, k: sum(j * perm(n, j) for j in range(k, n + 1))},
            ),
        ),
    ),
    "Security languages": (
        sized(
            "STIX writes OR, AND, SAND and PAND with n observations in 6n - 1 symbols: each gate is an "
            "operator, and observations are distinct.",
            Claim("stix", (Gate.OR, Gate.AND, *SEQUENCES), (SCATTERED,), {"symbols": lambda n, _: 6 * n - 1}),
        ),
        sized(
            "It cannot count distinct observations: VOT k/n, 1 < k < n, is an alternative of 6k + 1 "
            "symbols per set of k children, C(n,k)(6k + 2) - 1.",
            Claim("stix", (Gate.VOT,), (SCATTERED,), {"symbols": lambda n, k: comb(n, k) * (6 * k + 2) - 1}, between),
        ),
        sized(
            "Sigma has a rule per event and one correlation: 28n + 13 symbols for AND, SAND and PAND (n ≥ 2), and"
            " 28n + 18 for VOT k/n, 1 < k < n. It counts (`gte: k`), so VOT is linear. OR is one rule of"
            " 7n + 16 (n ≥ 2).",
            Claim("sigma", (Gate.AND, *SEQUENCES), (SCATTERED,), {"symbols": lambda n, _: 28 * n + 13}, several),
            Claim("sigma", (Gate.VOT,), (SCATTERED,), {"symbols": lambda n, _: 28 * n + 18}, between),
            Claim("sigma", (Gate.OR,), (SCATTERED,), {"symbols": lambda n, _: 7 * n + 16}, several),
        ),
        sized(
            "EQL writes SAND and PAND as one sequence of 8n + 1 symbols (n ≥ 2), and OR as one event of 5n + 1.",
            in_a_row("eql", SCATTERED, lambda n: 8 * n + 1),
            Claim("eql", (Gate.OR,), (SCATTERED,), {"symbols": lambda n, _: 5 * n + 1}),
        ),
        sized(
            "For AND it has n! sequences, and for VOT k/n, k ≥ 2, one per order of k - 1 children, "
            "preceded by a choice of the others: n!/(n - k + 1)! sequences of 8k + 1 + 5(n - k) symbols.",
            votes("eql", lambda n, k: chains(n, k, lambda k: 8 * k + 1, other=5)),
        ),
    ),
    "Past-time logics": (
        sized(
            "MFOTL writes AND with n atoms in 12n - 2 symbols, and SAND and PAND with n atoms and n - 1 "
            "comparisons of positions in 20n - 10: positions are values, so orders are not listed.",
            Claim(
                "mfotl",
                (Gate.AND,),
                (SCATTERED,),
                {"symbols": lambda n, _: 12 * n - 2, "subformulas": lambda n, _: n},
            ),
            Claim(
                "mfotl",
                SEQUENCES,
                (SCATTERED,),
                {"symbols": lambda n, _: 20 * n - 10, "subformulas": lambda n, _: 2 * n - 1},
            ),
        ),
        sized(
            "For OR and VOT k/n, k < n, it has an existential formula per set of k children: kC(n,k) "
            "atoms in C(n,k)(12k + 1) - 1 symbols.",
            Claim(
                "mfotl",
                (Gate.OR, Gate.VOT),
                (SCATTERED,),
                {
                    "symbols": lambda n, k: comb(n, k) * (12 * k + 1) - 1,
                    "subformulas": lambda n, k: k * comb(n, k),
                },
                lambda n, k: k < n,
            ),
        ),
        sized(
            "Past MTL has no positions: SAND and PAND are one chain of 12n - 4 symbols for Reelay, 14n - "
            "13 for R2U2. AND and VOT k/n have a chain per order of k - 1 children, with a choice of the "
            "others: n! for AND, as in EQL.",
            in_a_row("mtl", SCATTERED, lambda n: 12 * n - 4),
            in_a_row("mtl-r2u2", SCATTERED, lambda n: 14 * n - 13),
            Claim(
                "mtl",
                COUNTS,
                (SCATTERED,),
                {"symbols": lambda n, k: chains(n, k, lambda k: 12 * k - 4, other=6, more=2, joint=1)},
            ),
            Claim(
                "mtl-r2u2",
                COUNTS,
                (SCATTERED,),
                {"symbols": lambda n, k: chains(n, k, lambda k: 14 * k - 13, other=3, more=2, joint=2)},
            ),
        ),
        sized(
            "Under the other semantics, too, SAND and PAND are one chain (n ≥ 2): for Reelay 9n + 18 symbols under "
            "`strict`, 20n + 1 under `projected`, 20n - 12 under `consecutive`; for R2U2 14n + 8, 26n - 10, 26n - 25; "
            "in MFOTL 20n - 2, 27n + 2, 27n - 17.",
            in_a_row("mtl", STRICT, lambda n: 9 * n + 18),
            in_a_row("mtl", PROJECTED, lambda n: 20 * n + 1),
            in_a_row("mtl", CONSECUTIVE, lambda n: 20 * n - 12),
            in_a_row("mtl-r2u2", STRICT, lambda n: 14 * n + 8),
            in_a_row("mtl-r2u2", PROJECTED, lambda n: 26 * n - 10),
            in_a_row("mtl-r2u2", CONSECUTIVE, lambda n: 26 * n - 25),
            in_a_row("mfotl", STRICT, lambda n: 20 * n - 2),
            in_a_row("mfotl", PROJECTED, lambda n: 27 * n + 2),
            in_a_row("mfotl", CONSECUTIVE, lambda n: 27 * n - 17),
        ),
        sized(
            "For AND and VOT, MFOTL has under `projected` and `consecutive` a chain per order of at least k children, "
            "and under `strict` still a formula per set of them.",
            Claim(
                "mfotl",
                (Gate.AND, Gate.VOT),
                (PROJECTED, CONSECUTIVE),
                {"subformulas": lambda n, k: sum(j * perm(n, j) for j in range(k, n + 1))},
            ),
            Claim(
                "mfotl",
                (Gate.AND, Gate.VOT),
                (STRICT,),
                {"subformulas": lambda n, k: larger(n, k, lambda j: 2 * j)},
            ),
        ),
    ),
}
FINDINGS: Final = tuple(finding for some in SECTIONS.values() for finding in some)


def missed(rows: Sequence[Measurement]) -> list[str]:
    """Return the titles of findings that a cell contradicts, or that concern no cell."""
    return [
        finding.title
        for finding in FINDINGS
        if not (cells := finding.cells(rows)) or not all(finding.holds(row) for row in cells)
    ]
