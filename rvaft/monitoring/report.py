"""What a page says of monitored logs: every event that concerns the tree, what each changed, and what was waited for after it.

A listener notes it while the logs are read, compactly, since logs are long: lists with an entry for each place (an event that concerned the tree
while a verdict could still change), which name by number what many places have in common. All values are texts, safe to show, or numbers.
"""

import json
from collections.abc import Hashable, Mapping, Sequence
from contextlib import suppress
from html import escape
from importlib.resources import files
from itertools import islice
from time import process_time
from typing import Any, Final

from rvaft.analysis.branches import branches
from rvaft.analysis.pattern_index import Decided, Letter, PatternIndex, Reader, reader
from rvaft.engine.explanation import whole
from rvaft.errors import TooLarge
from rvaft.export.svg import svg_text
from rvaft.model.event_time import UNITS
from rvaft.model.expressions import event_text
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.monitoring.detection import counted, places, unlike
from rvaft.monitoring.run import Listener, MonitoredTrace, MonitoringPlan, VerdictChange
from rvaft.monitors import DEFAULT_BRANCHES, Explanation, Pending
from rvaft.support.terminal import cut, visible

PLACES: Final = 300_000
"""Events of all logs together that have a place, unless told otherwise; what changes a verdict always has one."""
SHOWN: Final = 20_000
"""Places whose event is there as text."""
CHANGES: Final = 20_000
"""Changes of verdicts that are there."""
SECONDS: Final = 10.0
"""How much time of the processor it may take together to find out what was waited for."""
RECORDS: Final = 50
"""Ways to bind variables of which it is said at one place what they waited for."""
LONGEST: Final = 240
"""Characters of an event, or of a value of a variable."""


class LogReport(Listener):
    """Notes what happens in logs for a page about a tree; `most` events have a place, and of others it is told that they have none.

    >>> import rvaft
    >>> from rvaft.analysis.pattern_index import TreeReads
    >>> from rvaft.monitoring.monitor_set import MonitorSet, columns
    >>> tree = rvaft.loads("top sand a b;")
    >>> plan = MonitoringPlan(MonitorSet(columns(tree), rvaft.monitor, rvaft.Semantics.PROJECTED), TreeReads(tree))
    >>> LogReport(tree, plan).left_out
    []
    """

    concerned = True

    def __init__(self, tree: RVAFT, plan: MonitoringPlan, *, most: int = PLACES) -> None:
        self.tree = tree = whole(tree)
        self.plan = plan
        self.most = most
        self.number = {name: place for place, name in enumerate(tree.order)}
        letters = [(self.number[one.node], Letter(one.pattern, one.when)) for one in tree.alphabet]
        readers = [(node, reader(place, letter)) for place, (node, letter) in enumerate(letters)]
        self._nodes: PatternIndex[list[tuple[int, Reader]]] = PatternIndex(
            (letter.pattern for _, letter in letters), lambda decided: _readers(decided, readers)
        )
        self._watches: list[MonitoredTrace] = []
        self._own: dict[int, int] = {}
        self._latest: dict[int, int] = {}
        """The place of the latest event of each watch, if it has one."""
        self._lists: dict[str, list[Any]] = {
            name: [] for name in ("number", "watch", "nodes", "waits", "time", "event")
        }
        self._node_sets: dict[Hashable, int] = {}
        self._waits: dict[Hashable, int] = {}
        self._changes: list[dict[str, Any]] = []
        self._at: list[int] = []
        """The places of the changes."""
        self._left = SECONDS
        self._unplaced = self._unchanged = 0
        self._first_unplaced = self._first_unchanged = ""

    def begin(self, watch: MonitoredTrace) -> None:
        """A log begins, or the first event of a key came."""
        if id(watch) not in self._own:
            self._own[id(watch)] = len(self._watches)
            self._watches.append(watch)

    def event(self, watch: MonitoredTrace, number: int, event: Json) -> None:
        """An event concerned the tree and changed no verdict."""
        nodes = self._fitting(event)
        if not nodes:  # an event that is none of the tree's, where nobody counts these
            return
        if len(self._lists["number"]) >= self.most:
            self._unplaced += 1
            self._first_unplaced = self._first_unplaced or self._place(watch, number)
            self._latest.pop(id(watch), None)
            return
        self._note(watch, number, event, nodes)

    def change(self, change: VerdictChange) -> None:
        """An event changed verdicts."""
        if len(self._changes) >= CHANGES:
            self._unchanged += 1
            self._first_unchanged = self._first_unchanged or self._place(change.watch, change.number)
            return
        self._at.append(len(self._lists["number"]))
        self._note(change.watch, change.number, change.event, self._fitting(change.event))
        self._changes.append(self._told(change))

    def end(self, watch: MonitoredTrace) -> None:
        """A log ends: what is still waited for is wanted most."""
        place = self._latest.get(id(watch))
        if place is not None and self._lists["waits"][place] < 0:
            self._lists["waits"][place] = self._waiting(watch, limit=-SECONDS)

    def stop(self, watch: MonitoredTrace) -> None:
        """A log cannot be read further."""
        self.end(watch)

    @property
    def left_out(self) -> list[str]:
        """What is not on the page since it is too much, each as a sentence."""
        found = []
        if self._unplaced:
            more = f"more than {self.most} concern the tree; --max-events N allows more"
            found.append(f"{counted(self._unplaced)} without a place: {more} (first: {self._first_unplaced})")
        if self._unchanged:
            more = f"only the first {CHANGES} changes of verdicts are here"
            found.append(f"{counted(self._unchanged, 'change')} left out: {more} (first: {self._first_unchanged})")
        unasked = [place for place, state in enumerate(self._lists["waits"]) if state < 0]
        if unasked:
            watch, number = self._watches[self._lists["watch"][unasked[0]]], self._lists["number"][unasked[0]]
            why = f"to find it out takes too long (first: {self._place(watch, number)})"
            found.append(f"what is waited for is not said after {counted(len(unasked))}: {why}")
        if len(self._lists["number"]) > SHOWN:
            found.append(
                f"only the first {SHOWN} events are shown with what is in them, others where they were detected"
            )
        return found

    def page(self, name: str, told: Mapping[str, Sequence[str]]) -> bytes:
        """The page, one file that needs no other: `name` is that of the tree, and `told` are lines of text by their heading."""
        monitors, tree = self.plan.monitors, self.tree
        traces = {watch.trace: None for watch in self._watches}
        order = {trace: place for place, trace in enumerate(traces)}
        data = {
            "tree": visible(name),
            "semantics": monitors.semantics.value,
            "traces": list(map(visible, traces)),
            "key": None if self.plan.key is None else [visible(field.text) for field in self.plan.key.fields],
            "columns": [column.title for column in monitors.columns],
            "repeat": monitors.repeat,
            "nodes": [self._node(name) for name in tree.order],
            "branches": self._branches(),
            "watches": [self._watch(watch, order[watch.trace]) for watch in self._watches],
            "places": self._lists,
            "node_sets": list(self._node_sets),
            "waits": list(self._waits),
            "at": self._at,
            "changes": self._changes,
            "told": {heading: [visible(line) for line in lines] for heading, lines in told.items()},
        }
        # A `<` could end the element that holds it; nothing else is special there.
        text = json.dumps(data, separators=(",", ":")).replace("<", "\\u003c")
        page = files("rvaft.monitoring").joinpath("report.html").read_text(encoding="utf-8")
        parts = {"TITLE": escape(visible(name)), "TREE": svg_text(tree), "DATA": text}
        before, *rest = page.split("{{")
        found = [before]
        for piece in rest:
            word, after = piece.split("}}", 1)
            found += [parts[word], after]
        return "".join(found).encode("utf-8", errors="replace")

    def _place(self, watch: MonitoredTrace, number: int) -> str:
        return f"event {number} of {watch.trace}"

    def _fitting(self, event: Json) -> tuple[int, ...]:
        """The nodes whose event it may be."""
        return tuple(dict.fromkeys(node for node, one in self._nodes.of(event) if one.admits(event)))

    def _note(self, watch: MonitoredTrace, number: int, event: Json, nodes: tuple[int, ...]) -> None:
        lists = self._lists
        lists["event"] += [_text(event)] if len(lists["number"]) < SHOWN else []
        lists["number"].append(number)
        lists["watch"].append(self._own[id(watch)])
        lists["nodes"].append(self._node_sets.setdefault(nodes, len(self._node_sets)))
        lists["time"].append(self._time(event))
        lists["waits"].append(self._waiting(watch))
        self._latest[id(watch)] = len(lists["waits"]) - 1

    def _time(self, event: Json) -> str:
        time = places(event, self.tree).get("time", "")
        declared = self.tree.time
        if isinstance(time, Mapping) and declared is not None and (read := declared.read(event)) is not None:
            return f"{read // UNITS['s']}.{read % UNITS['s']:09}"  # a stamp of ROS
        return _text(time)

    def _waiting(self, watch: MonitoredTrace, limit: float = 0.0) -> int:
        """What the monitor of the whole waits for, by its number; -1 where that is too much to find out in what is left of the time."""
        if self._left > limit:
            begun = process_time()
            try:
                found = watch.monitors.monitors[0].pending()
            except TooLarge:
                self._left -= process_time() - begun
            else:
                state = tuple(self._record(one) for one in found[:RECORDS]) + (
                    (len(found) - RECORDS,) * (len(found) > RECORDS)
                )
                self._left -= process_time() - begun
                return self._waits.setdefault(state, len(self._waits))
        return -1

    def _record(self, one: Pending) -> tuple[Hashable, ...]:
        nodes = tuple(self.number[awaited.node] for awaited in one.awaited if awaited.node in self.number)
        return one.branch, nodes, ", ".join(f"{name} = {_text(value)}" for name, value in one.variables.items())

    def _told(self, change: VerdictChange) -> dict[str, Any]:
        titles, monitors = [column.title for column in self.plan.monitors.columns], change.watch.monitors
        found: dict[str, Any] = {
            "verdicts": [
                [
                    titles[column],
                    change.verdicts[column].symbol,
                    change.counts[column].told if column in change.counts else None,
                ]
                for column in change.columns
            ],
            "detections": [
                self._detection([titles[one] for one in some], how, change) for some, how in unlike(change.explanations)
            ],
        }
        if 0 in change.columns and 0 not in change.detected and (ended := monitors.ended(0)) is not None:
            found["ended"] = [self._record(one) for one in ended.pending[:RECORDS]]
        return found

    def _detection(self, titles: Sequence[str], how: Explanation, change: VerdictChange) -> dict[str, Any]:
        matched = []
        for node, numbers in how.observed(self.tree).items():
            for number in numbers:
                event = change.events.get(number)
                known = ["", ""] if event is None else [self._time(event), _text(event)]
                matched.append([self.number.get(node, -1), number, *known])
        kept = how.scenario.items()
        return {
            "titles": titles,
            "branch": how.branch,
            "kinds": sorted(kind.value for kind in how.kinds),
            "matched": matched,
            "variables": [[name, _text(value)] for name, value in how.bound(self.tree).items()],
            "nodes": sorted(
                {self.number[name] for name in (*how.scenario, *how.observed(self.tree)) if name in self.number}
            ),
            "lines": [[self.number[name], self.number[child]] for name, some in kept for child in some],
        }

    def _node(self, name: str) -> list[str]:
        node = self.tree.nodes[name]
        return [visible(name), visible(node.label or ""), visible(event_text(node)) if node.has_event else ""]

    def _branches(self) -> list[list[Any]] | None:
        """Number, kinds, property, and nodes with an event of each branch; None where there are too many."""
        found = []
        with suppress(TooLarge):
            found = list(islice(branches(self.tree), DEFAULT_BRANCHES + 1))
        if not 0 < len(found) <= DEFAULT_BRANCHES:
            return None
        part = self.plan.monitors.columns[0].part.part_of
        watched = [
            one
            for one in found
            if part is None or (part.branch in (None, one.number) and (part.kind is None or part.kind in one.kinds))
        ]
        return [
            [
                one.number,
                sorted(kind.value for kind in one.kinds),
                cut(visible(one.formula), LONGEST),
                [self.number[name] for name in one.nodes if self.tree.nodes[name].has_event],
            ]
            for one in watched
        ]

    def _watch(self, watch: MonitoredTrace, trace: int) -> list[Any]:
        own = watch.monitors
        ends = [[verdict.symbol, own.since.get(at), own.found[at].told] for at, verdict in enumerate(own.verdicts)]
        return [trace, None if watch.key is None else list(map(_text, watch.key)), watch.events, ends]


def _readers(decided: Decided, readers: Sequence[tuple[int, Reader]]) -> list[tuple[int, Reader]]:
    """The nodes whose patterns some events of a shape fit, with what is still asked of the event itself."""
    return [readers[place] for place in sorted((*decided.fits, *decided.open))]


def _text(value: Json) -> str:
    """A value as it is shown: a text as it is, others as JSON."""
    if isinstance(value, str):
        return visible(cut(value, LONGEST))
    try:
        return visible(cut(json.dumps(value, ensure_ascii=False), LONGEST))
    except ValueError:  # an integer of more digits than Python writes
        return "…"
