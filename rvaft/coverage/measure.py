"""Coverage of the branches of a tree by several logs."""

from collections.abc import Callable, Collection, Hashable, Iterable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import partial
from io import BufferedIOBase, IOBase
from itertools import combinations, islice
from math import inf
from typing import BinaryIO, Final, NamedTuple, Self, TypeAlias, cast

from rvaft.core.branches import branch as numbered
from rvaft.core.branches import branches
from rvaft.core.build import build
from rvaft.core.engine_form import followed
from rvaft.core.fields_to_read import TreeReads
from rvaft.core.letters import Letter, reader
from rvaft.core.precedence import transitive
from rvaft.core.property import (
    All,
    EndInOrder,
    Event,
    One,
    Part,
    PartKind,
    Property,
    Source,
    Times,
    kept_ways,
    with_parts,
)
from rvaft.core.restriction import of_branch
from rvaft.core.scenarios import is_empty
from rvaft.engine.compiled_tree import CompiledTree, Reading, TreeLetters
from rvaft.engine.explanation import awaited
from rvaft.engine.selection import measured_strategy
from rvaft.engine.strategy import Progress
from rvaft.errors import TooLarge, TreeError
from rvaft.model.nodes import Kind
from rvaft.model.tree import RVAFT, resolve_semantics
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import DEFAULT_LIMIT, Awaited
from rvaft.readers.json_lines import read
from rvaft.rules.validity import valid_part
from rvaft.stream import sources
from rvaft.stream.data_warnings import DataWarning, DataWarnings
from rvaft.stream.statistics import EventKind, EventTypeIndex
from rvaft.support.bits import bits

DEFAULT_BRANCHES: Final = 1_000
"""All branches are monitored at once."""
_WAYS: Final = 20_000
"""The maximum number of ways to keep children of gates above shared nodes."""


Kept: TypeAlias = Mapping[int, tuple[int, ...]]
"""The nodes of a scenario, each with its kept children."""


class Way(NamedTuple):
    """A way to keep the children below a node, with the number of missing events."""

    lacking: int
    node: int
    below: tuple["Way", ...]

    def kept(self) -> Kept:
        """Return the kept children of each node."""
        found: dict[int, tuple[int, ...]] = {}
        agenda = [self]
        while agenda:
            _, node, below = agenda.pop()
            found[node] = tuple(one.node for one in below)
            agenda += below
        return found


class Ways(NamedTuple):
    """The cheapest way, and the cheapest with a missing event."""

    least: Way | None
    more: Way | None

    @classmethod
    def of(cls, ways: Iterable[Way]) -> "Ways":
        """Return the cheapest of these ways, the first of several."""
        found = list(ways)
        missing = (one for one in found if one.lacking)
        return cls(min(found, key=_lacking, default=None), min(missing, key=_lacking, default=None))


def _lacking(way: Way) -> int:
    return way.lacking


class LackingEvents:
    """The minimum number of missing events of a partial match, over the feasible scenarios of a
    branch.

    In a branch only KofN gates still choose. The cheapest children are optimal, except at gates
    above shared nodes (the *core*), whose choices are enumerated.
    """

    def __init__(self, compiled: CompiledTree) -> None:
        self._compiled = compiled
        self._occurrences = frozenset(node for node, own in enumerate(compiled.own) if own)

    def fewest(self, progress: Progress) -> tuple[int, Collection[int]]:
        """Return the minimum number of missing events, and the nodes of such a scenario.

        If the progress is `exact`, the scenario contains all nodes taken, and must exist. Raises
        `TooLarge`.
        """
        compiled, taken, exact = self._compiled, progress.taken, progress.exact
        if not compiled.chooses:
            return len(self._occurrences) - len(taken), range(len(compiled.names))
        below = [node for node in reversed(range(len(compiled.names))) if node not in compiled.members]
        forced: set[int] = set()
        for node in below:
            if exact and (node in taken or not forced.isdisjoint(compiled.children[node])):
                forced.add(node)
        ways = self._cheapest(below, progress, forced)
        best: tuple[int, Collection[int]] | None = None
        for kept in self._resolutions(ways, forced, progress):
            lacking = len(self._occurrences & kept.keys() - taken.keys())
            fits = (best is None or lacking < best[0]) and (not exact or taken.keys() <= kept.keys())
            if fits and (not compiled.core or self._keeps_order(kept, taken)):
                best = lacking, kept
        assert best is not None, "a partial match is part of a feasible scenario"
        return best

    def _cheapest(self, nodes: Iterable[int], progress: Progress, forced: Collection[int]) -> dict[int, Ways]:
        """Return the cheapest ways of each possible node, children first."""
        found: dict[int, Ways] = {}
        for node in nodes:
            if node in progress.dead:
                continue
            own = int(node in self._occurrences and node not in progress.taken)
            kept = self._kept_ways(node, found, forced)
            ways = Ways.of(Way(own + sum(map(_lacking, below)), node, below) for below in kept)
            if node in progress.unfit:
                ways = Ways(ways.more, ways.more)
            if node in progress.ended:
                ways = Ways(None if ways.least is None or ways.least.lacking else ways.least, None)
            if ways.least is not None:
                found[node] = ways
        return found

    def _kept_ways(self, node: int, found: Mapping[int, Ways], forced: Collection[int]) -> Iterator[tuple[Way, ...]]:
        """Iterate over ways to keep children, with the cheapest and the cheapest with a missing event."""
        children, need = self._compiled.children[node], self._compiled.need[node]
        least = {child: found[child].least for child in children if child in found}
        able = {child: way for child, way in least.items() if way is not None}
        must = [child for child in children if child in forced]
        if len(able) < need or not able.keys() >= {*must}:
            return
        if self._compiled.ends >> node & 1:
            yield from self._ended_ways([found[child] for child in children], [child in must for child in children])
            return
        rest = sorted((child for child in able if child not in must), key=lambda child: able[child].lacking)
        count = max(need - len(must), 0)
        chosen = {*must, *rest[:count]}

        def made(changed: Mapping[int, Way], without: Collection[int] = ()) -> tuple[Way, ...]:
            ways = {**{child: able[child] for child in chosen if child not in without}, **changed}
            return tuple(ways[child] for child in children if child in ways)

        least_way = made({})
        yield least_way
        if any(map(_lacking, least_way)):
            return
        # no chosen child lacks an event: one with a missing event takes its place, or is added
        more = {child: way for child in able if (way := found[child].more) is not None}
        for some in ([child for child in more if child in chosen], [child for child in more if child not in chosen]):
            child = min(some, key=lambda child: more[child].lacking, default=None)
            if child is None:
                continue
            if child in chosen or self._compiled.ops[node] is not PartKind.ONE:
                yield made({child: more[child]})
            if child not in chosen and count:
                yield made({child: more[child]}, without=[rest[count - 1]])

    def _ended_ways(self, ways: Sequence[Ways], touched: Sequence[bool]) -> Iterator[tuple[Way, ...]]:
        """Iterate over ways of children that end in order: once an event is missing, the later ones lack some too."""
        for place in range(len(ways) + 1):
            before = [one.least for one in ways[:place] if one.least is not None and not one.least.lacking]
            later = zip(ways[place:], touched[place:], strict=True)
            after = [way for one, has in later if (way := one.more if has else one.least) is not None]
            if len(before) + len(after) == len(ways):
                yield (*before, *after)

    def _resolutions(self, ways: Mapping[int, Ways], forced: Collection[int], progress: Progress) -> Iterator[Kept]:
        """Iterate over scenarios: every choice in the core, the cheapest below it."""
        compiled = self._compiled
        agenda: list[tuple[dict[int, tuple[int, ...]], tuple[int, ...]]] = [({}, (compiled.root,))]
        tried = 0
        while agenda:
            kept, reached = agenda.pop()
            waiting = next((node for node in reached if node in compiled.members and node not in kept), None)
            if waiting is not None and waiting in progress.dead:
                continue
            if waiting is not None:
                children = compiled.children[waiting]
                able = [child for child in children if child in compiled.members or child in ways]
                some = kept_ways(able, compiled.need[waiting], len(able))
                possible = (way for way in some if all(child in way for child in children if child in forced))
                agenda.extend(({**kept, waiting: way}, (*reached, *way)) for way in possible)
                continue
            tried += 1
            if tried > _WAYS:
                gates = (compiled.names[node] for node in compiled.core if compiled.chooses >> node & 1)
                what = f"ways to keep children of {', '.join([*gates][:10])}, which share nodes"
                remedy = "choose a branch without them with --branch N, or prune the tree"
                raise TooLarge(what, limit=_WAYS, remedy=remedy)
            parts = [node for node in dict.fromkeys(reached) if node not in compiled.members]
            if all(node in ways for node in parts):
                yield from self._completed(kept, parts, ways, progress)

    def _completed(
        self, kept: Kept, parts: Sequence[int], ways: Mapping[int, Ways], progress: Progress
    ) -> Iterator[Kept]:
        """Iterate over the ways of the parts of a resolution in which broken windows lack an event."""
        below: dict[int, set[int]] = {}
        for node in sorted(kept, reverse=True):
            below[node] = {node, *kept[node]}.union(*(below[child] for child in kept[node] if child in below))
        broken = {
            window: below[window]
            for window, one, other in progress.broken
            if window in kept and {one, other} <= below[window]
        }
        core = [node for node in kept if node in self._occurrences and node not in progress.taken]
        for count in range(len(broken) + 1):
            for some in combinations([node for node in parts if ways[node].more is not None], count):
                chosen = [ways[node].more if node in some else ways[node].least for node in parts]
                made = [way for way in chosen if way is not None]
                lacking = {*core, *(way.node for way in made if way.lacking)}
                if all(not lacking.isdisjoint(inside) for inside in broken.values()):
                    yield {**kept, **{node: children for way in made for node, children in way.kept().items()}}

    def _keeps_order(self, kept: Kept, taken: Mapping[int, int]) -> bool:
        """Whether a scenario is feasible and orders `taken` before all missing events."""
        compiled = self._compiled
        inside: dict[int, int] = {}
        before = [0] * len(compiled.names)
        for node in sorted(kept, reverse=True):
            inside[node] = 0
            for child in kept[node]:
                if compiled.ops[node] is PartKind.SEQUENCE:
                    for event in bits(inside[child]):
                        before[event] |= inside[node]
                inside[node] |= inside[child]
            if compiled.own[node]:
                for event in bits(inside[node]) if compiled.top_down else ():
                    before[event] |= 1 << node
                before[node] |= 0 if compiled.top_down else inside[node]
                inside[node] |= 1 << node
        closed = transitive(before)
        if closed is None:
            return False
        return all(taken.get(event, inf) < taken[node] for node in taken for event in bits(closed[node]))


class Reach(NamedTuple):
    """The best result of a log: the missing events, the last event matched (0: none), the awaited
    ones.
    """

    lacking: int
    event: int
    awaited: tuple[Awaited, ...]


class BranchFollower:
    """The monitor of a branch; it keeps its best partial matches.

    Raises `TooLarge`, and `TreeError` if no scenario is feasible. Under `scattered`, only better
    partial matches replace others, so one comparison at the end suffices. Otherwise they are compared
    after each event.
    """

    def __init__(self, prop: Property, semantics: Semantics, *, limit: int) -> None:
        self.verdict = Verdict.UNKNOWN
        self._tree, self._semantics = prop.tree, semantics
        self._ends = semantics is not Semantics.SCATTERED or bool(prop.absences)
        """Whether partial matches end before better ones come."""
        self._strategy = measured_strategy(_followed(prop), semantics, limit=limit)
        self._shortest = LackingEvents(self._strategy.compiled)
        self._lacking, self._last = self._shortest.fewest(Progress({}))[0], 0
        self._best: dict[Hashable, Callable[[], Collection[str]]] = {}
        """The functions that return the awaited nodes of the best partial matches."""
        self._look()

    def fork(self) -> Self:
        """Return an independent copy."""
        twin = copy(self)
        twin._strategy, twin._best = self._strategy.fork(), self._best.copy()  # noqa: SLF001
        return twin

    def follow(self, number: int, event: Json, *, fits: bool, relevant: bool = True) -> None:
        """Read the event with this number; skipped events change nothing.

        `fits` is False only if it is no event of this branch.
        """
        strategy = self._strategy
        hits = strategy.read(event, strategy.letters.classify(event)).hits if fits else ()
        self.verdict = strategy.advance(Reading(relevant, hits), number)
        if self.verdict is Verdict.TRUE:
            self._lacking, self._last = 0, number
            self._best.clear()
        elif self.verdict is Verdict.UNKNOWN and self._ends:
            self._look()

    def reach(self) -> Reach:
        """Return the progress at the end of the log; nothing is missing after a detection."""
        if self.verdict is Verdict.UNKNOWN and not self._ends:
            self._look()
        waiting = {name for awaited_by in self._best.values() for name in awaited_by()}
        return Reach(self._lacking, self._last, awaited(self._tree, waiting))

    def _look(self) -> None:
        for progress in self._strategy.progress():
            lacking, nodes = self._shortest.fewest(progress)
            last = max((position for node, position in progress.taken.items() if node in nodes), default=0)
            if (lacking, last) < (self._lacking, self._last):
                self._lacking, self._last = lacking, last
                self._best.clear()
            if (lacking, last) == (self._lacking, self._last):
                place = (*progress.taken.items(), *progress.dead, *progress.unfit, *progress.ended)
                self._best[place] = partial(progress.awaited, nodes)


def _followed(prop: Property) -> Property:
    """Return the property of a branch that a `BranchFollower` follows; raises `TreeError`."""
    present = {part.source.node for part in prop.parts if isinstance(part, Event | Times)}
    own = tuple(entry for entry in prop.alphabet if entry.node in present)
    # relevance is computed once for all branches; the missing events are counted without failing guards
    made = followed(replace(prop, alphabet=own, ignored=()), points=False)
    feasible = tuple(one.root for one in made.alternatives if not is_empty(one.rewritten(_unordered)))
    if not feasible:
        raise TreeError("no feasible scenario", rule="no-scenario", nodes=[prop.tree.root])
    return made.with_root(feasible[0] if len(feasible) == 1 else One(None, feasible))


def _unordered(part: Part, parts: tuple[Part, ...]) -> Part:
    return All(part.source, parts) if isinstance(part, EndInOrder) else with_parts(part, parts)


@dataclass(frozen=True, slots=True)
class BranchCoverage:
    """One branch: `reached` of the `needed` events were matched, and `detected` logs detect it.

    `log` and `event` locate the first detection, or otherwise the first best result; `event` is the
    number of the last event matched, from 1. The events `awaited` could have come next.
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
    """The coverage by all logs.

    `infeasible` are the numbers of branches without a feasible scenario. `nodes` counts the nodes
    with a runtime event in the other branches; `unseen` are those without an event in any log.
    `data_warnings` are events excluded by their data; `warnings` are their sentences.
    """

    semantics: Semantics
    logs: int
    branches: tuple[BranchCoverage, ...]
    infeasible: tuple[int, ...]
    nodes: int
    unseen: tuple[Awaited, ...]
    data_warnings: tuple[DataWarning, ...] = ()
    warnings: tuple[str, ...] = ()

    @property
    def exercised(self) -> int:
        """The number of branches that some log detects."""
        return sum(branch.detected > 0 for branch in self.branches)

    @property
    def seen(self) -> int:
        """The number of nodes with an event in some log."""
        return self.nodes - len(self.unseen)


class Coverage:
    """Measures the coverage of a tree by logs, one log at a time.

    Raises `OptionError`; `TreeError` for an invalid tree, an unknown branch or kind, or one without
    a feasible scenario; `TooLarge` beyond `limit` branches. `configurations` bounds the partial
    matches per branch.

    >>> import rvaft
    >>> coverage = Coverage(rvaft.loads("top or a x; x sand b c;"))
    >>> coverage.add("monday.jsonl", [{"event": "b"}])
    >>> [(branch.reached, branch.needed) for branch in coverage.report().branches]
    [(0, 1), (1, 2)]
    """

    def __init__(
        self,
        tree: RVAFT,
        semantics: Semantics | str | None = None,
        *,
        branch: int | None = None,
        kind: Kind | str | None = None,
        limit: int = DEFAULT_BRANCHES,
        configurations: int = DEFAULT_LIMIT,
    ) -> None:
        valid_part(tree, branch, kind)  # raises all errors about the selection
        self.tree = tree
        self.semantics = resolve_semantics(tree, semantics)
        self._branches: list[tuple[BranchFollower, frozenset[str]]] = []
        """For each branch, the monitor that is copied for each log, and the nodes."""
        self._best: list[BranchCoverage] = []
        self._infeasible: list[int] = []
        self._logs = 0
        self._seen: set[str] = set()
        prop = build(tree)
        self._own = {
            entry.node: None if entry.when is None else reader(0, Letter(entry.pattern, entry.when)).admits
            for entry in tree.alphabet
        }
        """The tests of the guards that an event decides, by node."""
        self._compiled = CompiledTree(
            prop.with_root(All(None, tuple(Event(Source(entry.node, 1), entry.pattern) for entry in tree.alphabet)))
        )
        self._letters = TreeLetters(self._compiled)
        self._types = EventTypeIndex(tree, [self._letters])
        self._warnings = DataWarnings(self._types)
        chosen = [numbered(tree, branch)] if branch is not None else list(islice(branches(tree), limit + 1))
        if branch is None and len(chosen) > limit:
            remedy = "--limit allows more; or choose one with --branch N, or prune the tree"
            raise TooLarge(f"a monitor for each branch of {tree.root}", limit=limit, remedy=remedy)
        for selected in chosen:
            if kind is not None and Kind(kind) not in selected.kinds:
                continue
            try:
                fresh = BranchFollower(of_branch(prop, selected), self.semantics, limit=configurations)
            except TreeError as error:
                if error.rule != "no-scenario":
                    raise
                self._infeasible.append(selected.number)
            else:
                start = fresh.fork().reach()
                self._best.append(
                    BranchCoverage(selected.number, selected.kinds, start.lacking, 0, awaited=start.awaited)
                )
                self._branches.append((fresh, frozenset(selected.nodes)))

    def add(self, log: str, events: Iterable[Json] | BinaryIO, *, strict_json: bool = False) -> None:
        """Read a whole log: its events, or the bytes of JSON Lines.

        Raises the errors of reading, and `TooLarge`; a log with an error does not count.
        """
        followers = [(fresh.fork(), nodes) for fresh, nodes in self._branches]
        live, seen, number, data_warnings = followers, set[str](), 0, DataWarnings(self._types)
        numbered = (
            self._numbered(log, cast("BufferedIOBase", events), strict_json, data_warnings)
            if isinstance(events, IOBase)
            else enumerate(events, 1)
        )
        strict, scattered = (self.semantics is semantics for semantics in (Semantics.STRICT, Semantics.SCATTERED))
        projects = self.semantics.projects
        try:
            for number, event, event_kind in data_warnings.over(numbered, f"{log}: "):
                hit = set[str]() if event_kind is None else self._hit(event, event_kind, projects=projects)
                seen |= hit
                if self.tree.absences:
                    in_time = event_kind is not None
                    for follower, _ in live if in_time or strict else ():
                        follower.follow(number, event, fits=in_time, relevant=bool(hit))
                    live = [entry for entry in live if not entry[0].verdict.final]
                elif hit or strict:
                    for follower, nodes in live:
                        fits = not nodes.isdisjoint(hit)
                        if fits or not scattered:  # otherwise it neither extends nor ends a partial match
                            follower.follow(number, event, fits=fits)
                    live = [entry for entry in live if not entry[0].verdict.final]
            reached = [follower.reach() for follower, _ in followers]
        except TooLarge as error:
            remedy = "" if getattr(error, "__notes__", ()) else "; --max-configurations allows more"
            error.add_note(f"at event {number} of {log}{remedy}")
            raise
        self._logs += 1
        self._seen |= seen
        self._warnings.merge(data_warnings)
        for place, ((follower, _), reach) in enumerate(zip(followers, reached, strict=True)):
            known = self._best[place]
            best = replace(known, detected=known.detected + (follower.verdict is Verdict.TRUE))
            if known.needed - reach.lacking > known.reached:
                came = known.needed - reach.lacking
                best = replace(best, reached=came, log=log, event=reach.event, awaited=reach.awaited)
            self._best[place] = best

    def _hit(self, event: Json, event_kind: EventKind, *, projects: bool) -> set[str]:
        """Return the nodes whose pattern and decidable guards an event matches, if the event
        counts.
        """
        (event_class,) = event_kind.classes
        if projects and not event_class.relevant:
            return set()
        reading = self._letters.read(event, event_class)
        found = (self._compiled.names[node] for hit in reading.hits for node in hit.nodes)
        return {name for name in found if (own := self._own[name]) is None or own(event)}

    def _numbered(
        self, log: str, stream: BufferedIOBase, strict_json: bool, data_warnings: DataWarnings
    ) -> Iterable[tuple[int, Json]]:
        """Return the relevant events of a log with their numbers.

        The last event of an irrelevant block may stand for the block.
        """
        reads = TreeReads(self.tree)
        found = None
        if self.semantics is not Semantics.STRICT and not self.tree.absences:
            found = sources.events_of_concern(
                reads,
                self._types,
                stream,
                log,
                strict_json=strict_json,
                warnings=data_warnings,
                concerns=lambda kind: bool(kind.relevant) if self.semantics.projects else kind.serves,
            )
        if found is None:
            found = enumerate(read(cast("BinaryIO", stream), name=log, reads=reads, strict=strict_json), 1)
        return found

    def report(self) -> CoverageReport:
        """Return the coverage by the logs so far."""
        kept = {name for _, nodes in self._branches for name in nodes if name in self._own}
        unseen = awaited(self.tree, kept - self._seen)
        counts = tuple(self._best), tuple(self._infeasible), len(kept)
        missed = tuple(replace(warning) for warning in self._warnings.found.values())
        return CoverageReport(self.semantics, self._logs, *counts, unseen, missed, tuple(self._warnings.lines))
