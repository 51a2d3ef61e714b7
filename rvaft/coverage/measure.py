"""Coverage of the branches of a tree by several logs."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import islice
from typing import Final

from rvaft.analysis.branches import Branch, branch, branches
from rvaft.api import narrowed
from rvaft.coverage.reach import BranchFollower
from rvaft.engine.compiled_tree import CompiledTree, TreeLetters
from rvaft.engine.expectation import awaited
from rvaft.engine.explanation import chosen_part
from rvaft.engine.monitor import DEFAULT_LIMIT
from rvaft.errors import TooLarge, TreeError
from rvaft.model.nodes import Kind
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import Awaited
from rvaft.rules import require_valid

DEFAULT_BRANCHES: Final = 1_000
"""How many branches are monitored, one by one and all at once."""


@dataclass(frozen=True, slots=True)
class BranchCoverage:
    """One branch: it was reached `reached` of the `needed` events; `detected` logs detect it.

    `log` and `event` are where it was first detected or else came farthest first; `event` is the number of the last event
    matched there, from 1. Both are None where no event of the branch was matched. `awaited` is what could have come next.
    """

    number: int
    kinds: frozenset[Kind]
    needed: int
    reached: int
    detected: int = 0
    log: str | None = None
    event: int | None = None
    awaited: tuple[Awaited, ...] = ()


@dataclass(frozen=True, slots=True)
class CoverageReport:
    """What the logs covered.

    `infeasible` are the numbers of branches without a feasible scenario, which nothing can detect and which do not count. `nodes` is the number of nodes
    with a runtime event in the branches that do, `unseen` are those whose event no event of any log was.
    """

    semantics: Semantics
    logs: int
    branches: tuple[BranchCoverage, ...]
    infeasible: tuple[int, ...]
    nodes: int
    unseen: tuple[Awaited, ...]

    @property
    def exercised(self) -> int:
        """How many branches some log detects."""
        return sum(branch.detected > 0 for branch in self.branches)

    @property
    def seen(self) -> int:
        """To how many nodes some event fits."""
        return self.nodes - len(self.unseen)


@dataclass(slots=True)
class CoveredBranch:
    """A branch with the best that any log so far did, and the monitor that each log gets a copy of."""

    nodes: frozenset[int]
    """Its nodes by their numbers in the whole tree."""
    fresh: BranchFollower
    best: BranchCoverage


class Coverage:
    """Reads logs one by one and says what they covered.

    Raises `OptionError`, `TreeError` for a tree that breaks a rule, that has no such branch or kind, or of which no such branch is feasible, and
    `TooLarge` beyond `limit` branches; `configurations` bounds the partial matches that are followed in each.

    >>> import rvaft
    >>> coverage = Coverage(rvaft.loads("top or a x; x sand b c;"))
    >>> coverage.add("monday.jsonl", [{"event": "b"}])
    >>> [(branch.reached, branch.needed) for branch in coverage.report().branches]
    [(0, 1), (1, 2)]
    """

    def __init__(
        self,
        tree: RVAFT,
        semantics: Semantics | str = Semantics.PROJECTED,
        *,
        branch: int | None = None,
        kind: Kind | str | None = None,
        limit: int = DEFAULT_BRANCHES,
        configurations: int = DEFAULT_LIMIT,
    ) -> None:
        narrowed(tree, branch, kind)  # all that can be wrong with these is said here
        self.tree = tree
        self.semantics = Semantics(semantics)
        self._branches: list[CoveredBranch] = []
        self._infeasible: list[int] = []
        self._logs = 0
        self._seen: set[int] = set()
        self._compiled = CompiledTree(tree)
        self._letters = TreeLetters(tree, self._compiled)
        number = {name: node for node, name in enumerate(self._compiled.names)}
        for chosen in _chosen(tree, branch, kind, limit):
            part = chosen_part(tree, chosen.choices)
            try:
                require_valid(part)
            except TreeError as error:
                if error.rule != "no-scenario":
                    raise
                self._infeasible.append(chosen.number)
            else:
                fresh = BranchFollower(part, self.semantics, limit=configurations)
                start = fresh.fork().reach()
                none = BranchCoverage(chosen.number, chosen.kinds, start.lacking, 0, awaited=start.awaited)
                nodes = frozenset(number[name] for name in chosen.nodes)
                self._branches.append(CoveredBranch(nodes, fresh, none))

    def add(self, log: str, events: Iterable[Json]) -> None:
        """Read a whole log. Raises what reading its events raises, and `TooLarge`; a log that raises does not count."""
        followers = [(one, one.fresh.fork()) for one in self._branches]
        live, seen, number = list(followers), set[int](), 0
        try:
            for number, event in enumerate(events, 1):
                reading = self._letters.read(event)
                counts = reading.relevant or self.semantics is not Semantics.PROJECTED
                hit = {node for hit in reading.hits for node in hit.nodes} if counts else set[int]()
                seen |= hit
                if hit or self.semantics is Semantics.STRICT:
                    live = [one for one in live if not self._follow(*one, number, event, hit).final]
            reached = [follower.reach() for _, follower in followers]
        except TooLarge as error:
            remedy = "" if getattr(error, "__notes__", ()) else "; --max-configurations allows more"
            error.add_note(f"at event {number} of {log}{remedy}")
            raise
        self._logs += 1
        self._seen |= seen
        for (one, follower), reach in zip(followers, reached, strict=True):
            known = one.best
            detected = known.detected + (follower.verdict is Verdict.TRUE)
            came = known.needed - reach.lacking
            one.best = replace(known, detected=detected)
            if came > known.reached:
                one.best = replace(one.best, reached=came, log=log, event=reach.event, awaited=reach.awaited)

    def _follow(self, one: CoveredBranch, follower: BranchFollower, number: int, event: Json, hit: set[int]) -> Verdict:
        """The verdict of a branch after an event that counts and is the event of these nodes."""
        fits = not one.nodes.isdisjoint(hit)
        if not fits and self.semantics is Semantics.SCATTERED:
            return follower.verdict  # no partial match can use it, and none is ended by it
        return follower.follow(number, event, relevant=True, fits=fits)

    def report(self) -> CoverageReport:
        """What the logs so far covered."""
        kept = {node for one in self._branches for node in one.nodes if self._compiled.own[node]}
        return CoverageReport(
            self.semantics,
            self._logs,
            tuple(one.best for one in self._branches),
            tuple(self._infeasible),
            len(kept),
            awaited(self.tree, (self._compiled.names[node] for node in kept - self._seen)),
        )


def _chosen(tree: RVAFT, number: int | None, kind: Kind | str | None, limit: int) -> list[Branch]:
    """The branches to look at."""
    if number is not None:
        return [branch(tree, number)]
    found = list(islice(branches(tree), limit + 1))
    if len(found) > limit:
        error = TooLarge(f"a monitor for each branch of {tree.root}", limit=limit)
        error.add_note("--limit allows more; or choose one with --branch N, or prune the tree")
        raise error
    return [candidate for candidate in found if kind is None or Kind(kind) in candidate.kinds]
