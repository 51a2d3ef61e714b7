"""Coverage of the branches of a tree by several logs."""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import islice
from typing import Final

from rvaft.analysis.branches import Branch, branch, branches
from rvaft.api import narrowed
from rvaft.coverage.reach import Follower, Reach, alone
from rvaft.engine.compiled_tree import plan_of
from rvaft.engine.event_index import Letters
from rvaft.engine.monitor import DEFAULT_LIMIT
from rvaft.errors import TooLarge, TreeError
from rvaft.model.expressions import name_text, on_text
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
class Unseen:
    """A node whose runtime event, `event` as text, no event of any log was."""

    node: str
    event: str


@dataclass(frozen=True, slots=True)
class Report:
    """What the logs covered.

    `infeasible` are the numbers of branches without a feasible scenario, which nothing can detect and which do not count. `nodes` is the number of nodes
    with a runtime event in the branches that do.
    """

    semantics: Semantics
    logs: int
    branches: tuple[BranchCoverage, ...]
    infeasible: tuple[int, ...]
    nodes: int
    unseen: tuple[Unseen, ...]

    @property
    def exercised(self) -> int:
        """How many branches some log detects."""
        return sum(branch.detected > 0 for branch in self.branches)

    @property
    def seen(self) -> int:
        """To how many nodes some event fits."""
        return self.nodes - len(self.unseen)


@dataclass(slots=True)
class _Row:
    """A branch and the best that any log so far did."""

    branch: Branch
    nodes: frozenset[int]
    """Its nodes by their numbers in the whole tree."""
    fresh: Follower
    """Has read nothing; each log gets a copy."""
    needed: int
    start: tuple[Awaited, ...]
    best: tuple[int, int, str, tuple[Awaited, ...]] | None = None
    """Events lacking, last event, log, what could have come next; None where nothing was matched."""
    detected: int = 0


class Coverage:
    """Reads logs one by one and says what they covered.

    Raises `OptionError`, `TreeError` for a tree that breaks a rule, that has no such branch or kind, or of which no such branch is feasible, and
    `TooLarge` beyond `limit` branches; `configurations` bounds the partial matches that are followed in each.
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
        self._rows: list[_Row] = []
        self._infeasible: list[int] = []
        self._logs = 0
        self._seen: set[int] = set()
        self._plan = plan_of(tree)
        self._letters = Letters(tree, self._plan)
        number = {name: node for node, name in enumerate(self._plan.names)}
        for chosen in _chosen(tree, branch, kind, limit):
            part = alone(chosen)
            try:
                require_valid(part)
            except TreeError as error:
                if error.rule != "no-scenario":
                    raise
                self._infeasible.append(chosen.number)
            else:
                fresh = Follower(part, self.semantics, limit=configurations)
                start = fresh.fork().reach()
                nodes = frozenset(number[name] for name in chosen.nodes)
                self._rows.append(_Row(chosen, nodes, fresh, start.lacking, start.awaited))

    def add(self, log: str, events: Iterable[Json]) -> None:
        """Read a whole log. Raises what reading its events raises, and `TooLarge`; a log that raises does not count."""
        followers = [row.fresh.fork() for row in self._rows]
        live, seen, number = list(zip(self._rows, followers, strict=True)), set[int](), 0
        try:
            for number, event in enumerate(events, 1):
                reading = self._letters.read(event)
                counts = reading.relevant or self.semantics is not Semantics.PROJECTED
                hit = {node for hit in reading.hits for node in hit.nodes} if counts else set[int]()
                seen |= hit
                if hit or self.semantics is Semantics.STRICT:
                    live = [one for one in live if not self._follow(*one, number, event, hit).final]
            reached = [follower.reach() for follower in followers]
        except TooLarge as error:
            remedy = "" if getattr(error, "__notes__", ()) else "; --max-configurations allows more"
            error.add_note(f"at event {number} of {log}{remedy}")
            raise
        self._logs += 1
        self._seen |= seen
        for row, follower, reach in zip(self._rows, followers, reached, strict=True):
            _merge(row, log, reach, detected=follower.verdict is Verdict.TRUE)

    def _follow(self, row: _Row, follower: Follower, number: int, event: Json, hit: set[int]) -> Verdict:
        """The verdict of a branch after an event that counts and is the event of these nodes."""
        fits = not row.nodes.isdisjoint(hit)
        if not fits and self.semantics is Semantics.SCATTERED:
            return follower.verdict  # no partial match can use it, and none is ended by it
        return follower.follow(number, event, relevant=True, fits=fits)

    def report(self) -> Report:
        """What the logs so far covered."""
        kept = {name for row in self._rows for name in row.branch.nodes}
        nodes = [node for node, name in enumerate(self._plan.names) if self._plan.own[node] and name in kept]
        unseen = (self.tree.nodes[self._plan.names[node]] for node in nodes if node not in self._seen)
        return Report(
            self.semantics,
            self._logs,
            tuple(map(_covered, self._rows)),
            tuple(self._infeasible),
            len(nodes),
            tuple(Unseen(n.name, name_text(n.name) if n.on is None else on_text(n.on)) for n in unseen),
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


def _merge(row: _Row, log: str, reach: Reach, *, detected: bool) -> None:
    """Take over what a log did, where it is better than what those before it did."""
    row.detected += detected
    if reach.lacking < (row.needed if row.best is None else row.best[0]):
        row.best = reach.lacking, reach.event, log, reach.awaited


def _covered(row: _Row) -> BranchCoverage:
    number, kinds = row.branch.number, row.branch.kinds
    if row.best is None:
        return BranchCoverage(number, kinds, row.needed, 0, awaited=row.start)
    lacking, event, log, awaited = row.best
    return BranchCoverage(number, kinds, row.needed, row.needed - lacking, row.detected, log, event, awaited)
