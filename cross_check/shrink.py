"""Shrinking: a tree and a trace on which somebody disagrees, made as small as they get together.

Greedy, to a fixpoint: of the candidates that the reductions offer, in a fixed order, the first that still disagrees is taken, and
the reductions are asked again, until none of their candidates disagrees. Only a smaller pair is ever taken, by a measure of
natural numbers compared from the left (`cross_check.reductions.sizes`), so this ends, and the same input gives the same result.
The idea is delta debugging: A. Zeller, R. Hildebrandt, Simplifying and Isolating Failure-Inducing Input, IEEE TSE 28(2), 2002.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from itertools import islice
from typing import Final, TypeAlias

from cross_check.reductions import REDUCTIONS, Pair, Reduction
from rvaft.errors import OptionError, RvaftError, TreeError
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.rules import require_valid

Disagrees: TypeAlias = Callable[[RVAFT, list[Json]], bool]

DEFAULT_STEPS: Final = 2_000
"""How often a tree and a trace are tried."""


class NotReproduced(RvaftError, ValueError):
    """There is nothing to shrink: the tree and the trace that were given do not show a disagreement."""


def shrink(
    tree: RVAFT, trace: Iterable[Json], disagrees: Disagrees, *, steps: int = DEFAULT_STEPS
) -> tuple[RVAFT, list[Json]]:
    """A smallest tree and trace on which `disagrees` is still true, no single reduction of which is left to make.

    `disagrees` is asked at most `steps` times, the first time about the input, and only about trees that keep the rules; where it raises
    an `RvaftError`, that is no disagreement. When the steps are used up, the smallest pair so far is the result.

    Raises `NotReproduced` where the input itself does not disagree, `TreeError` where it breaks a rule, and `OptionError` for
    a restricted tree (shrink the whole, and restrict it in `disagrees`) or fewer than one step.
    """
    if steps < 1:
        raise OptionError(f"shrinking takes one step at least, not {steps}")
    if tree.restricted:
        raise OptionError("a part of a tree cannot be shrunk: shrink the whole tree, and take the part in each step")
    require_valid(tree)
    search = _Search(Pair.of(tree, trace), disagrees, steps)
    if not search.holds(search.pair):
        raise NotReproduced("there is no disagreement on this tree and trace, so there is nothing to shrink")
    search.run()
    return search.pair.tree, list(search.pair.trace)


class _OutOfSteps(Exception):
    """`disagrees` was asked as often as it may be."""


@dataclass(slots=True)
class _Search:
    """The smallest pair so far, and what has been tried."""

    pair: Pair
    disagrees: Disagrees
    steps: int
    failed: set[bytes] = field(default_factory=set)

    def run(self) -> None:
        """Reduce to a fixpoint, or until the steps are used up."""
        before = None
        try:
            while before is not self.pair:
                before = self.pair
                for reduction in REDUCTIONS:
                    self._exhaust(reduction)
        except _OutOfSteps:
            pass

    def _exhaust(self, reduction: Reduction) -> None:
        """Take what one reduction offers. After a success go on where it was: what failed before will mostly fail again."""
        tried = 0
        candidates = reduction(self.pair)
        while (candidate := next(candidates, None)) is not None:
            if self._takes(candidate):
                candidates = islice(reduction(self.pair), tried, None)
            else:
                tried += 1

    def _takes(self, candidate: Pair) -> bool:
        if candidate.measure >= self.pair.measure or candidate.key in self.failed:
            return False
        if _valid(candidate) and self.holds(candidate):
            self.pair = candidate
            return True
        self.failed.add(candidate.key)
        return False

    def holds(self, candidate: Pair) -> bool:
        """Whether the pair disagrees."""
        if self.steps == 0:
            raise _OutOfSteps
        self.steps -= 1
        try:
            return self.disagrees(candidate.tree, list(candidate.trace))
        except RvaftError:
            return False


def _valid(candidate: Pair) -> bool:
    try:
        require_valid(candidate.tree)
    except TreeError:
        return False
    return True
