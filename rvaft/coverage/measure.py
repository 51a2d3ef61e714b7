"""Coverage of the branches of a tree by several logs."""

from collections.abc import Collection, Hashable, Iterable, Iterator, Mapping
from copy import copy
from dataclasses import dataclass, replace
from io import BufferedIOBase, IOBase
from itertools import chain, combinations, islice
from math import inf
from typing import BinaryIO, Final, NamedTuple, Self, TypeAlias, cast

from rvaft.api import narrowed, resolve_semantics
from rvaft.core.branches import branch as numbered
from rvaft.core.branches import branches
from rvaft.core.build import build
from rvaft.core.classifier import TreeReads
from rvaft.core.part_numbers import PartKind
from rvaft.core.passes import of_branch, reduced
from rvaft.core.property import All, Event, Property, Source, Times
from rvaft.core.scenarios import is_empty, transitive
from rvaft.engine import Engine
from rvaft.engine.alternatives import Alternatives
from rvaft.engine.compiled_tree import CompiledTree, Reading, TreeLetters
from rvaft.engine.configuration import Configuration, Witness, history
from rvaft.engine.explanation import awaited
from rvaft.engine.monitor import DEFAULT_LIMIT
from rvaft.engine.partial_matches import Following
from rvaft.engine.scattered_linear import LinearMonitor, LinearRun
from rvaft.errors import TooLarge, TreeError
from rvaft.model.guards import holds
from rvaft.model.nodes import Kind
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import Awaited
from rvaft.readers.json_lines import read
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


class LackingEvents:
    """The minimum number of missing events of a partial match, over the feasible scenarios of a
    branch.

    In a branch only KofN gates still choose. The cheapest children are optimal, except at gates
    above shared nodes (the *core*), whose choices are enumerated.
    """

    def __init__(self, compiled: CompiledTree) -> None:
        self._compiled = compiled
        self._occurrences = frozenset(node for node, own in enumerate(compiled.own) if own)

    def fewest(
        self, taken: Mapping[int, int], dead: Collection[int] = (), *, exact: bool = True
    ) -> tuple[int, Collection[int]]:
        """Return the minimum number of missing events, and the nodes of such a scenario.

        `taken` maps each taken node to the position of its event; the guards of `dead` nodes
        failed. If `exact`, the scenario contains all of `taken`, and must exist. Raises `TooLarge`.
        """
        compiled = self._compiled
        if not compiled.chooses:
            return len(self._occurrences) - len(taken), range(len(compiled.names))
        below = [node for node in reversed(range(len(compiled.names))) if node not in compiled.members]
        forced: set[int] = set()
        for node in below:
            if exact and (node in taken or not forced.isdisjoint(compiled.children[node])):
                forced.add(node)
        parts = self._cheapest(below, dead, taken, forced)
        best: tuple[int, Collection[int]] | None = None
        for kept in self._resolutions(parts, forced, dead):
            lacking = len(self._occurrences & kept.keys() - taken.keys())
            fits = (best is None or lacking < best[0]) and (not exact or taken.keys() <= kept.keys())
            if fits and (not compiled.core or self._keeps_order(kept, taken)):
                best = lacking, kept
        assert best is not None, "a partial match is part of a feasible scenario"
        return best

    def _cheapest(
        self, nodes: Iterable[int], dead: Collection[int], taken: Collection[int], forced: Collection[int]
    ) -> dict[int, tuple[int, tuple[int, ...]]]:
        """Return the minimum of missing events and the kept children per possible node, children
        first.
        """
        found: dict[int, tuple[int, tuple[int, ...]]] = {}
        for node in nodes:
            children, need = self._compiled.children[node], self._compiled.need[node]
            able = [child for child in children if child in found]
            must = {child for child in children if child in forced}
            if node in dead or len(able) < need or not must.issubset(able):
                continue
            rest = sorted((child for child in able if child not in must), key=lambda child: found[child][0])
            chosen = must.union(rest[: max(need - len(must), 0)])
            kept = tuple(child for child in children if child in chosen)
            own = node in self._occurrences and node not in taken
            found[node] = own + sum(found[child][0] for child in kept), kept
        return found

    def _resolutions(
        self, parts: Mapping[int, tuple[int, tuple[int, ...]]], forced: Collection[int], dead: Collection[int]
    ) -> Iterator[Kept]:
        """Iterate over scenarios: every choice in the core, the cheapest below it."""
        compiled = self._compiled
        agenda: list[tuple[dict[int, tuple[int, ...]], tuple[int, ...]]] = [({}, (compiled.root,))]
        tried = 0
        while agenda:
            kept, reached = agenda.pop()
            waiting = next((node for node in reached if node in compiled.members and node not in kept), None)
            if waiting is not None and waiting in dead:
                continue
            if waiting is not None:
                children = compiled.children[waiting]
                able = [child for child in children if child in compiled.members or child in parts]
                sizes = range(compiled.need[waiting], len(able) + 1)
                ways = chain.from_iterable(combinations(able, size) for size in sizes)
                possible = (way for way in ways if all(child in way for child in children if child in forced))
                agenda.extend(({**kept, waiting: way}, (*reached, *way)) for way in possible)
                continue
            tried += 1
            if tried > _WAYS:
                gates = (compiled.names[node] for node in compiled.core if compiled.chooses >> node & 1)
                what = f"ways to keep children of {', '.join([*gates][:10])}, which share nodes"
                remedy = "choose a branch without them with --branch N, or prune the tree"
                raise TooLarge(what, limit=_WAYS, remedy=remedy)
            todo = [node for node in reached if node not in compiled.members]
            if all(node in parts for node in todo):
                whole = dict(kept)
                while todo:
                    node = todo.pop()
                    whole[node] = parts[node][1]
                    todo += whole[node]
                yield whole

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


class AlternativeFollower(Engine):
    """The monitor of an alternative of a branch; it keeps its best partial matches.

    Under `scattered`, only better partial matches replace others, so one comparison at the end
    suffices. Otherwise they are compared whenever they grow.
    """

    _apart = False  # measure the joint progress of all parts

    def __init__(self, prop: Property, semantics: Semantics, *, limit: int) -> None:
        self._alternative = prop
        super().__init__(prop.tree, semantics, limit=limit)
        if isinstance(self._strategy, Following):
            # a partial match counts even if no time could complete it
            self._strategy.matching.early_differences.clear()
            self._strategy.matching.windows = frozenset()
        assert not isinstance(self._strategy, Alternatives), "an alternative has no others beside it"
        self._shortest = LackingEvents(self._strategy.compiled)
        self._size = 0
        self._lacking, self._last = self._shortest.fewest({})[0], 0
        self._best: list[Witness | None] = [None]

    def _property(self) -> Property:
        return self._alternative

    def follow(self, number: int, event: Json, *, fits: bool) -> None:
        """Read the event with this number; skipped events change nothing.

        `fits` is False only if it is no event of this branch.
        """
        self.skip(number - 1 - self._read)
        verdict = self.take(
            Reading(relevant=True, hits=self.read(event, self.letters.classify(event)).hits if fits else ())
        )
        if verdict is Verdict.UNKNOWN and self.semantics is not Semantics.SCATTERED:
            self._look()

    def reach(self) -> Reach:
        """Return the progress at the end of the log; nothing is missing after a detection."""
        if self.verdict is Verdict.TRUE:
            return Reach(0, self._position, ())
        strategy, waiting = self._strategy, set[str]()
        assert not isinstance(strategy, Alternatives), "an alternative has no others beside it"
        if isinstance(strategy, LinearMonitor):  # the best match may omit some events taken, so it is replayed alone
            fired = {node: position for node, (position, _) in strategy.run.fired.items()}
            lacking, nodes = self._shortest.fewest(fired, exact=False)
            run, last = LinearRun(strategy.compiled, strategy.starts), 0
            for node, (position, values) in strategy.run.fired.items():
                if node in nodes:
                    run.fire([(node, values)], position)
                    last = position
            return Reach(lacking, last, awaited(self.tree, {strategy.compiled.names[node] for node in run.awaited()}))
        if self.semantics is Semantics.SCATTERED:
            self._look()
        for witness in self._best:
            steps = ((step.node, step.values, step.position) for step in history(witness))
            match = strategy.matching.replayed(steps)
            assert match is not None, "a partial match can be made again"
            waiting.update(strategy.matching.admitted(match))
        return Reach(self._lacking, self._last, awaited(self.tree, waiting))

    def _look(self) -> None:
        assert isinstance(self._strategy, Following), "the linear way has no partial matches"
        partial = self._strategy.partial
        if self.semantics.ends:
            size = partial[0].taken.bit_count()  # equal for all: each has used all events that count
            if size == self._size:
                return
            self._size = size
        alike: dict[Hashable, Configuration] = {}  # the first of equivalent partial matches
        for match in partial:
            alike.setdefault((match.taken, match.dead, match.inversions), match)
        for match in alike.values():
            last = 0 if match.witness is None else match.witness.position
            taken = {step.node: step.position for step in history(match.witness)}
            lacking, _ = self._shortest.fewest(taken, [*bits(match.dead)])
            if (lacking, last) < (self._lacking, self._last):
                self._lacking, self._last, self._best = lacking, last, []
            if (lacking, last) == (self._lacking, self._last) and match.witness not in self._best:
                self._best = [*self._best, match.witness]


class BranchFollower:
    """The monitors of one branch, one per alternative; the best one counts.

    Raises `TooLarge`, and `TreeError` if no scenario is feasible.
    """

    def __init__(self, prop: Property, semantics: Semantics, *, limit: int) -> None:
        present = {part.source.node for part in prop.parts if isinstance(part, Event | Times)}
        own = tuple(entry for entry in prop.alphabet if entry.node in present)
        prop = replace(prop, alphabet=own, ignored=())  # relevance is computed once for all branches
        feasible = (alternative for alternative in reduced(prop).alternatives if not is_empty(alternative))
        self._parts = [AlternativeFollower(alternative, semantics, limit=limit) for alternative in feasible]
        if not self._parts:
            raise TreeError("no feasible scenario", rule="no-scenario", nodes=[prop.tree.root])

    def fork(self) -> Self:
        """Return an independent copy."""
        twin = copy(self)
        twin._parts = [part.fork() for part in self._parts]  # noqa: SLF001
        return twin

    @property
    def verdict(self) -> Verdict:
        """True if one alternative is true, false if all are false."""
        found = [part.verdict for part in self._parts]
        return next((verdict for verdict in (Verdict.TRUE, Verdict.UNKNOWN) if verdict in found), Verdict.FALSE)

    def follow(self, number: int, event: Json, *, fits: bool) -> None:
        """Read the event with this number, by all alternatives."""
        for part in self._parts:
            if part.verdict is Verdict.UNKNOWN:
                part.follow(number, event, fits=fits)

    def reach(self) -> Reach:
        """Return the progress of the best alternatives, with their awaited events joined."""
        found = [part.reach() for part in self._parts]
        best = min(found, key=lambda reach: (reach.lacking, reach.event))
        alike = [reach for reach in found if reach[:2] == best[:2]]
        return best._replace(awaited=tuple(dict.fromkeys(node for reach in alike for node in reach.awaited)))


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
        narrowed(tree, branch, kind)  # raises all errors about the selection
        self.tree = tree
        self.semantics = resolve_semantics(tree, semantics)
        self._branches: list[tuple[BranchFollower, frozenset[str]]] = []
        """For each branch, the monitor that is copied for each log, and the nodes."""
        self._best: list[BranchCoverage] = []
        self._infeasible: list[int] = []
        self._logs = 0
        self._seen: set[str] = set()
        prop = build(tree)
        self._own = {entry.node: entry.when for entry in tree.alphabet}
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
                if hit or strict:
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
        found = ((self._compiled.names[node], hit.values) for hit in reading.hits for node in hit.nodes)
        return {name for name, values in found if (own := self._own[name]) is None or holds(own, values)}

    def _numbered(
        self, log: str, stream: BufferedIOBase, strict_json: bool, data_warnings: DataWarnings
    ) -> Iterable[tuple[int, Json]]:
        """Return the relevant events of a log with their numbers.

        The last event of an irrelevant block may stand for the block.
        """
        reads = TreeReads(self.tree)
        found = None
        if self.semantics is not Semantics.STRICT:
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
