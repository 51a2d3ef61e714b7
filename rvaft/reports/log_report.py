"""The data of a page about monitored logs: relevant events, changes of verdicts, missing events.

The lists are parallel, with an entry for each *place*: a relevant event while a verdict could
change. Repeated contents are numbered. All values are escaped texts or numbers. The events of
detections and their neighbours are complete, others up to `SHOWN`, as far as `TEXT` allows.

A page may be shown while logs grow: a browser sends a cursor and receives what is new. When there
are too many places, the oldest are dropped, the rest is renumbered, and all cursors become invalid.
"""

import json
import re
from bisect import bisect_left
from collections import Counter, defaultdict, deque
from collections.abc import Collection, Hashable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from html import escape
from itertools import chain, islice
from secrets import token_hex
from time import monotonic
from typing import Any, Final, Protocol

from rvaft.core.branches import branches
from rvaft.core.letters import Letter
from rvaft.core.restriction import whole
from rvaft.diagnosis.recent_events import RecentEvents
from rvaft.errors import TooLarge
from rvaft.export.property_text import property_text
from rvaft.export.svg import svg_text
from rvaft.model.event_time import UNITS, TimeFormat
from rvaft.model.expressions import event_text
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.monitors import DEFAULT_BRANCHES, Explanation, Pending
from rvaft.reports.page import filled, policy, template
from rvaft.stream.detection import places, unlike
from rvaft.stream.event_buffer import EventBuffer
from rvaft.stream.listeners import Listener
from rvaft.stream.order import OrderedField
from rvaft.stream.plan import MonitoringPlan
from rvaft.stream.verdict_change import MonitoredTrace, VerdictChange
from rvaft.support.terminal import cut, visible
from rvaft.support.wording import counted

PAGE: Final = "log_report.html"
PLACES: Final = 300_000
"""Default maximum number of places, except changes of verdicts."""
SHOWN: Final = 100_000
"""Maximum number of places with the text of their event, besides those near detections."""
LATEST: Final = 20_000
"""Default maximum number of places of a growing page."""
NEAR: Final = 2
"""Places before and after a detection, of the same key, whose events are kept."""
TEXT: Final = 24_000_000
"""Maximum number of characters of events; half of them are for the events of detections alone, and
another quarter for their neighbours.
"""
CHANGES: Final = 20_000
SECONDS: Final = 10.0
"""Time for the missing events of all traces and keys when they end, in seconds."""
RECORDS: Final = 8
"""Maximum number of bindings with missing events at one place, for each branch."""
LONGEST: Final = 240
PIECE: Final = 1_000
ENDED: Final = 1_000
"""Maximum number of ended traces and keys on a growing page."""
SHARE: Final = 0.1
"""Maximum share of the time for missing events on a growing page, and for scanning keys."""
FINISHED_SHARE: Final = 0.3
"""Time for missing events of a complete log, as a share of that for all else."""
_CURSOR: Final = re.compile(r"([0-9a-f]{16}-[0-9]{1,9})((?:-[0-9]{1,9}){8})")
_LATEST: Final = 10**15
"""Greater instants are left out of the time axis."""
_LISTS: Final = ("number", "watch", "nodes", "waits", "time", "instant", "event")
_OF_RISK: Final = ("risk", "outlook", "contradictions")
"""The lists of a page with the risk."""
Messages = Mapping[str, Sequence[str]]
"""Lines of text by heading: messages `said`, and the summary `held`."""


class FollowedRisk(Protocol):
    """The risk of the tree in each trace or key, up to the event that was last read."""

    @property
    def within(self) -> str:
        """The horizon, as the user wrote it."""

    @property
    def bound(self) -> bool:
        """Whether the numbers are upper bounds."""

    def of(self, watch: MonitoredTrace) -> Sequence[float]:
        """Return the risk of each column, that of the tree first."""

    def changed(self, watch: MonitoredTrace) -> bool:
        """Whether the last event changed a risk."""

    def coming(self, watch: MonitoredTrace) -> Mapping[str, Any]:
        """Return `next`, the awaited event that raises the risk most, `values` and `contradictions`, if any."""


class LogReport(Listener):
    """Collects data for a page about a tree; at most `most` events have a place.

    These are the first events, or the latest if the page `grows`. `unit` names what is monitored. A `risk`
    is asked after each event, so it must be notified before the report is.

    >>> import rvaft
    >>> from rvaft.stream.monitor_set import MonitorSet, columns
    >>> tree = rvaft.loads("top sand a b;")
    >>> plan = MonitoringPlan(MonitorSet(columns(tree), rvaft.monitor, rvaft.Semantics.PROJECTED))
    >>> LogReport(tree, plan).left_out
    []
    """

    concerned = whole = True

    def __init__(
        self,
        tree: RVAFT,
        plan: MonitoringPlan,
        *,
        most: int = PLACES,
        grows: bool = False,
        unit: str = "",
        risk: FollowedRisk | None = None,
    ) -> None:
        self.tree = tree = whole(tree)
        self.plan = plan
        self.most, self.grows = most, grows
        self.unit = unit or ("log" if plan.key is None else "key")
        self.number = tree.rank
        self._nodes = nodes = dict[Letter, list[int]]()
        for one in tree.alphabet:
            nodes.setdefault(Letter(one.pattern, one.when), []).append(self.number[one.node])
        self._watches: list[MonitoredTrace] = []
        self._own: dict[int, int] = {}
        self._latest: dict[int, int] = {}
        self._risk = risk
        self._lists: dict[str, list[Any]] = {name: [] for name in (*_LISTS, *(_OF_RISK if risk is not None else ()))}
        self._field = OrderedField("time" if tree.time is None else ".".join(tree.time.field), tree.time)
        self._texts: dict[Hashable, int] = {}
        self._size, self._cut = 0, False
        self._values: dict[str, Sequence[Any]] = {}
        self._near: defaultdict[int, deque[tuple[int, Json]]] = defaultdict(lambda: deque(maxlen=NEAR))
        """The last places of each watch whose events are not kept."""
        self._after: dict[int, int] = {}
        """How many further events of a watch are kept."""
        self._node_sets, self._waits = dict[Hashable, int](), dict[Hashable, int]()
        # the awaited events that raise a risk most, each with that risk and the values of the match
        self._outlooks: dict[Hashable, int] = {}
        self._changes: list[dict[str, Any]] = []
        self._at: list[int] = []
        self._most_left = self._left = SECONDS * SHARE
        self._found_late: list[tuple[int, int]] = []
        """Places with the results of missing events computed later."""
        self._unplaced = self._unchanged = 0
        self._first_unplaced = self._first_unchanged = ""
        self._detections, self._last_detection = 0, ""
        self._dropped = self._undetected = self._unwatched = 0
        """The numbers of dropped places, detections and ended watches."""
        self._before: dict[int, _Seen] = {}
        """The state of each watch before its first remaining place."""
        self._ended: dict[int, list[Any]] = {}
        """The final rows of ended watches on a growing page."""
        self._left_there = 0
        self._token, self._generation = token_hex(8), 0
        self._rows: list[list[Any]] = []
        """The last row of each watch."""
        self._revised: list[int] = []
        self._messages: Messages = {}
        self._messages_revised = self._revision = 0
        self._share = SHARE if grows else FINISHED_SHARE
        self._due = self._refilled = monotonic()
        whole_tree = plan.monitors.columns[0].part.part_of is None
        self._recent = RecentEvents() if whole_tree and not plan.monitors.repeat else None
        self._missed: list[list[Any]] = []
        """The near misses: a line, the place of the watch, and the number of the last event."""
        self._missed_due = 0.0

    def begin(self, watch: MonitoredTrace) -> None:
        """Register a trace or key."""
        if self.grows and len(self._ended) - self._left_there > ENDED:
            self._make_room()
        if id(watch) not in self._own:
            self._own[id(watch)] = len(self._watches)
            self._watches.append(watch)

    def event(self, watch: MonitoredTrace, number: int, event: Json) -> None:
        """Note a relevant event without a change."""
        if self._recent is not None:
            self._recent.event(watch, number, event)
        nodes = self._fitting(event)
        if not nodes and not (self._risk is not None and self._risk.changed(watch)):
            return  # relevant, but not an event of the tree
        if self.grows:
            self._make_room_where_full()
        elif len(self._lists["number"]) >= self.most:
            self._unplaced += 1
            self._first_unplaced = self._first_unplaced or self._place(watch, number)
            self._latest.pop(id(watch), None)
            return
        self._note(watch, number, event, nodes)

    def change(self, change: VerdictChange) -> None:
        """Note a change of verdicts."""
        if self._recent is not None:
            self._recent.change(change)
        if 0 in change.detected:
            self._detections += 1
            key = "".join(f"{_text(value)}, " for value in change.watch.key or ())
            self._last_detection = f"{key}{change.passed or self._place(change.watch, change.number)}"
        if self.grows:
            self._make_room_where_full()
        elif len(self._changes) >= CHANGES:
            self._unchanged += 1
            self._first_unchanged = self._first_unchanged or self._place(change.watch, change.number)
            return
        self._at.append(len(self._lists["number"]))
        self._note(change.watch, change.number, change.event, self._fitting(change.event))
        self._changes.append(self._changed(change))

    def end(self, watch: MonitoredTrace) -> None:
        """Note the end of a trace."""
        place = self._latest.get(id(watch))
        if place is not None and self._lists["waits"][place] < 0:
            self._find_late(place, watch, -SECONDS)
        if self.grows:
            at = self._own.pop(id(watch))
            self._latest.pop(id(watch), None)
            self._ended[at] = self._watch(watch)
            self._watches[at] = MonitoredTrace(watch.trace, self.plan.monitors, watch.key)

    def _find_late(self, place: int, watch: MonitoredTrace, limit: float = 0.0) -> None:
        state = self._lists["waits"][place] = self._waiting(watch, limit)
        if state >= 0:
            self._found_late.append((place, state))

    def stop(self, watch: MonitoredTrace) -> None:
        """Note that a log cannot be read further."""
        self.end(watch)

    @property
    def detects(self) -> tuple[str, int, str]:
        """What is detected, how often so far, and where last (key, event and trace)."""
        root = self.tree.nodes[self.tree.root]
        return root.label or root.name, self._detections, self._last_detection

    @property
    def left_out(self) -> list[str]:
        """Messages about gaps of the page."""
        found = []
        if self._dropped:
            gone = f"{counted(self._dropped)} with {counted(self._undetected, 'detection')}"
            kept = f"the slider has at most the latest {self.most}, and detections the latest {CHANGES}"
            more = "; --max-events N allows more" if self.unit != "connection" else ""
            found.append(f"{gone} are no longer on this page: {kept}{more}")
        if self._unwatched:
            found.append(f"{counted(self._unwatched, self.unit)} that ended are no longer listed")
        if self._unplaced:
            more = f"more than {self.most} are relevant; --max-events N allows more"
            found.append(f"{counted(self._unplaced)} not on this page: {more} (first: {self._first_unplaced})")
        if self._unchanged:
            more = f"only the first {CHANGES} changes of verdicts are shown"
            found.append(f"{counted(self._unchanged, 'change')} left out: {more} (first: {self._first_unchanged})")
        unasked = [place for place, state in enumerate(self._lists["waits"]) if state < 0]
        if unasked:
            watch, number = self._watches[self._lists["watch"][unasked[0]]], self._lists["number"][unasked[0]]
            why = f"computing them takes too long (first: {self._place(watch, number)})"
            found.append(f"missing events are not listed after {counted(len(unasked))}: {why}")
        if any(text < 0 for text in self._lists["event"]):
            found.append(f"only the first {SHOWN} events are shown in full, later ones only in and near detections")
        if self._cut:
            found.append(f"some events are cut to {LONGEST} characters: the page has room for {TEXT} characters")
        return found

    def page(self, name: str, messages: Messages, *, live: bool = False, home: str = "") -> bytes:
        """Return the page as one file; a `live` page requests updates, and `home` is the page of all trees."""
        if not self.grows:
            self._read_again()
        data = self._all(name, messages)
        if live:
            data["cursor"] = self._cursor
        # `<` could end the script element
        texts = (text.replace("<", "\\u003c") for text in _pieces(data))
        parts: dict[str, Iterable[str]] = {
            "TITLE": [escape(visible(self.tree.nodes[self.tree.root].label or name))],
            "HOME": [f'<a href="{home}">all trees</a>' if home else ""],
            "TREE": [svg_text(self.tree, badges=True)],
            "DATA": texts,
            "POLICY": [policy(PAGE, live=live)],
        }
        return filled(template(PAGE), parts)

    def _read_again(self) -> None:
        """Read the events of detections that are no longer stored, once for each trace."""
        lacking: defaultdict[EventBuffer, dict[int, list[Any]]] = defaultdict(lambda: defaultdict(list))
        for place, change in zip(self._at, self._changes, strict=True):
            buffer = self._watches[self._lists["watch"][place]].buffer
            for match in (match for one in change["detections"] for match in one["matched"] if match[3] < 0):
                lacking[buffer][match[1]].append(match)
        for buffer, matches in lacking.items():
            for number, event in buffer.events(matches, ended=True).items():
                for match in matches[number]:
                    match[2:] = self._known(event)

    def since(self, cursor: str, name: str, messages: Messages) -> tuple[str, bytes]:
        """Return a cursor and the JSON of the changes since another cursor.

        The JSON is empty without changes, complete for an invalid cursor.
        """
        self._revise(messages)
        here = self._cursor
        if cursor == here:
            return here, b""
        known, ends = _CURSOR.fullmatch(cursor), [*map(int, here.split("-")[2:])]
        from_ = [int(end) for end in known[2].split("-")[1:]] if known else ends
        if known is None or not here.startswith(f"{known[1]}-") or any(map(int.__gt__, from_, ends)):
            new: dict[str, Any] = {**self._all(name, messages), "cursor": here}
        else:
            places, node_sets, waits, texts, outlooks, changes, revision, late = from_
            new_messages = {"told": self._shown} if self._messages_revised > revision else {}
            new = {
                "places": {name: some[places:] for name, some in self._lists.items()},
                "node_sets": list(islice(self._node_sets, node_sets, None)),
                "waits": list(islice(self._waits, waits, None)),
                "texts": list(islice(self._texts, texts, None)),
                "outlooks": list(islice(self._outlooks, outlooks, None)),
                "late": self._found_late[late:],
                "at": self._at[changes:],
                "changes": self._changes[changes:],
                "watches": [[at, row] for at, row in enumerate(self._rows) if self._revised[at] > revision],
                "near": self._missed,
                "traces": self._traces,
                "clock": self._clock,
                **new_messages,
            }
        return here, json.dumps(new, separators=(",", ":")).encode()

    @property
    def _cursor(self) -> str:
        ends = (self._lists["number"], self._node_sets, self._waits, self._texts, self._outlooks, self._changes)
        return "-".join(
            map(str, (self._token, self._generation, *map(len, ends), self._revision, len(self._found_late)))
        )

    @property
    def _clock(self) -> str:
        """What an instant is: milliseconds of a date or a clock, or a number."""
        dated = self._field.holds_times or (self.tree.time is not None and self.tree.time.format is TimeFormat.ISO8601)
        return "date" if dated else "" if self.tree.time is None else "ms"

    @property
    def _traces(self) -> list[str]:
        return [visible(trace) for trace in dict.fromkeys(watch.trace for watch in self._watches)]

    @property
    def _shown(self) -> dict[str, list[str]]:
        return {heading: [visible(line) for line in lines] for heading, lines in self._messages.items()}

    def _all(self, name: str, messages: Messages) -> dict[str, Any]:
        monitors, tree = self.plan.monitors, self.tree
        self._due = 0.0
        self._revise(messages)
        return {
            "token": self._token,
            "unit": self.unit,
            "tree": visible(name),
            "semantics": monitors.semantics.value,
            "traces": self._traces,
            "key": None if self.plan.key is None else [visible(field.text) for field in self.plan.key.fields],
            "columns": [column.title for column in monitors.columns],
            "repeat": monitors.repeat,
            "nodes": [self._node(name) for name in tree.order],
            "branches": self._branches(),
            "watches": self._rows,
            "before": {
                number: [verdict, fresh, [[node, *one] for node, one in seen.items()]]
                for number, (seen, verdict, fresh) in self._before.items()
            },
            "places": self._lists,
            "node_sets": list(self._node_sets),
            "waits": list(self._waits),
            "texts": list(self._texts),
            "outlooks": list(self._outlooks),
            "risk": None
            if (risk := self._risk) is None
            else {"within": risk.within, "bound": risk.bound, "timed": tree.time is not None},
            "clock": self._clock,
            "undetected": self._undetected,
            "at": self._at,
            "changes": self._changes,
            "near": self._missed,
            "told": self._shown,
        }

    def _revise(self, messages: Messages) -> None:
        """Update the messages and, at intervals, the rows."""
        last = len(self._lists["waits"]) - 1
        if self.grows and last >= 0 and self._lists["waits"][last] < 0:
            at = self._lists["watch"][last]
            if at not in self._ended:
                self._find_late(last, self._watches[at])
        self._look_for_near_misses()
        if dict(messages) != self._messages:
            self._revision += 1
            self._messages, self._messages_revised = dict(messages), self._revision
        begun = monotonic()
        if begun < self._due and len(self._rows) == len(self._watches):
            return
        order = {trace: place for place, trace in enumerate(dict.fromkeys(watch.trace for watch in self._watches))}
        rows: list[list[Any]] = []
        for at, watch in enumerate(self._watches):
            ended = at in self._ended
            row = self._ended[at] if ended else self._watch(watch)
            rows.append([order[watch.trace], *row, *([ended] if self.grows else [])])
        new = [at for at, row in enumerate(rows) if at >= len(self._rows) or row != self._rows[at]]
        self._revised += [0] * (len(rows) - len(self._revised))
        self._revision += bool(new)
        for at in new:
            self._revised[at] = self._revision
        self._rows = rows
        self._due = monotonic() + (monotonic() - begun) / SHARE

    def _look_for_near_misses(self) -> None:
        """Update the near misses, at intervals in proportion to the time that it takes."""
        begun = monotonic()
        if self._recent is None or begun < self._missed_due:
            return
        at = {id(watch): place for place, watch in enumerate(self._watches)}
        closest = [one for one in self._recent.closest().found if id(one[0]) in at]
        found = [[visible(line), at[id(watch)], miss.events[-1]] for watch, miss, line in closest]
        self._revision += found != self._missed
        self._missed = found
        self._missed_due = monotonic() + (monotonic() - begun) / SHARE

    def _make_room_where_full(self) -> None:
        if len(self._lists["number"]) >= self.most or len(self._changes) >= CHANGES:
            self._make_room()

    def _make_room(self) -> None:
        total = len(self._lists["number"])
        gone = total - self.most * 3 // 4 if total >= self.most else 0
        if len(self._changes) >= CHANGES:
            gone = max(gone, self._at[-max(CHANGES * 3 // 4, 1)])
        changes = {place: change for place, change in zip(self._at, self._changes, strict=True) if place < gone}
        sets = list(self._node_sets)
        for place in range(gone):
            number, watch, nodes = (self._lists[name][place] for name in ("number", "watch", "nodes"))
            title, repeat = self._titles[0], self.plan.monitors.repeat
            before = self._before.get(watch)
            self._before[watch] = _after(before, number, sets[nodes], changes.get(place), title, repeat=repeat)
        self._dropped += gone
        self._undetected += sum(
            any(symbol == "⊤" for _, symbol, _ in change["verdicts"]) for change in changes.values()
        )
        lists = self._lists = {name: some[gone:] for name, some in self._lists.items()}
        self._changes = self._changes[bisect_left(self._at, gone) :]
        self._at = [place - gone for place in self._at if place >= gone]
        self._latest = {watch: place - gone for watch, place in self._latest.items() if place >= gone}
        self._keep_watches({*lists["watch"], *(at for at in range(len(self._watches)) if at not in self._ended)})
        matched = [match for change in self._changes for one in change["detections"] for match in one["matched"]]
        tables = (
            ("nodes", self._node_sets),
            ("waits", self._waits),
            ("outlook", self._outlooks),
            ("event", self._texts),
        )
        for name, table in tables if self._risk is not None else (*tables[:2], tables[3]):
            more = (match[3] for match in matched) if table is self._texts else ()
            used = [one for one in dict.fromkeys(chain(lists[name], more)) if one >= 0]
            words, number = list(table), {one: place for place, one in enumerate(used)}
            table.clear()
            table.update((words[one], place) for one, place in number.items())
            lists[name] = [number.get(one, -1) for one in lists[name]]
        for match in matched:  # the last table has the events
            match[3] = number.get(match[3], -1)
        self._size = sum(len(str(text)) for text in self._texts)
        self._found_late.clear()
        self._generation += 1

    def _keep_watches(self, needed: Collection[int]) -> None:
        idle = [at for at in range(len(self._watches)) if at not in needed]
        gone = set(idle[: max(len(idle) - ENDED // 2, 0)])
        number = {at: place for place, at in enumerate(at for at in range(len(self._watches)) if at not in gone)}
        self._unwatched += len(gone)
        self._watches = [self._watches[at] for at in number]
        self._own = {watch: number[at] for watch, at in self._own.items()}
        self._before = {number[at]: seen for at, seen in self._before.items() if at in number}
        self._ended = {number[at]: row for at, row in self._ended.items() if at in number}
        self._left_there = len(self._ended)
        self._lists["watch"] = [number[at] for at in self._lists["watch"]]
        self._rows, self._revised = [], []

    @property
    def _titles(self) -> list[str]:
        return [column.title for column in self.plan.monitors.columns]

    def _place(self, watch: MonitoredTrace, number: int) -> str:
        return f"event {number} of {watch.trace}"

    def _fitting(self, event: Json) -> tuple[int, ...]:
        types = self.plan.monitors.types
        found = (types.letters[number] for number in types.of(event).admitted)
        letters = [letter for kind, _, letter in found if kind == "entry"]
        return tuple(sorted({node for letter in letters for node in self._nodes[letter]}))

    def _note(self, watch: MonitoredTrace, number: int, event: Json, nodes: tuple[int, ...]) -> None:
        lists, own = self._lists, self._own[id(watch)]
        after = self._after.get(own, 0)
        kept = self.grows or len(lists["number"]) < SHOWN or after > 0
        if after:
            self._after[own] = after - 1
        if not kept:
            self._near[own].append((len(lists["number"]), event))
        lists["event"].append(self._content(event, share=2 if after else 4) if kept else -1)
        lists["number"].append(number)
        lists["watch"].append(own)
        lists["nodes"].append(self._node_sets.setdefault(nodes, len(self._node_sets)))
        lists["time"].append(self._time(event))
        lists["instant"].append(self._instant(event))
        lists["waits"].append(self._waiting(watch))
        if self._risk is not None:
            self._note_risk(watch, self._risk)
        self._latest[id(watch)] = len(lists["waits"]) - 1

    def _note_risk(self, watch: MonitoredTrace, risk: FollowedRisk) -> None:
        """Note the risk after the last event of a watch, and what may come."""
        coming = risk.coming(watch)
        following = coming.get("next")
        values = ", ".join(f"{name} = {_text(value)}" for name, value in coming.get("values", {}).items())
        outlook = (visible(following["node"]), following["risk"], values) if following else ("", None, values)
        self._lists["risk"].append(risk.of(watch)[0])
        self._lists["outlook"].append(self._outlooks.setdefault(outlook, len(self._outlooks)))
        self._lists["contradictions"].append(coming.get("contradictions", 0))

    def _content(self, event: Json, *, share: int = 1) -> int:
        """Return the number of the text of an event."""
        try:
            text = visible(json.dumps(event, ensure_ascii=False))
        except ValueError:  # more digits than Python converts
            text = "…"
        if text not in self._texts:
            if self._size + len(text) > TEXT // share:
                text, self._cut = cut(text, LONGEST), True
            self._size += len(text)
        return self._texts.setdefault(text, len(self._texts))

    def _known(self, event: Json) -> list[Any]:
        return [self._time(event), self._content(event), self._instant(event)]

    def _instant(self, event: Json) -> float | None:
        instant = self._field.place(event)
        if instant is not None and self._clock:
            instant //= UNITS["ms"]
        return instant if instant is not None and abs(instant) < _LATEST else None

    def _time(self, event: Json) -> str:
        time = places(event, self.tree).get("time", "")
        declared = self.tree.time
        if isinstance(time, Mapping) and declared is not None and (read := declared.read(event)) is not None:
            return f"{read // UNITS['s']}.{read % UNITS['s']:09}"
        return _text(time)

    def _waiting(self, watch: MonitoredTrace, limit: float = 0.0) -> int:
        """Return the number of the missing events, -1 after the time limit."""
        now = monotonic()
        self._left = min(self._most_left, self._left + (now - self._refilled) * self._share)
        self._refilled = now
        if self._left > limit:
            try:
                return self._state(watch.monitors.monitors[0].pending())
            except TooLarge:
                pass
            finally:
                spent = monotonic() - now  # the time of the process is slow to ask for
                self._left -= spent * (1 + self._share)  # the refill counts this time, too
        return -1

    def _state(self, found: Iterable[Pending]) -> int:
        """Return the number of the distinct records, the latest of each branch."""
        records = dict.fromkeys(map(self._record, reversed([*found])))
        counts: Counter[Hashable] = Counter()
        kept = []
        for record in records:
            counts[record[0]] += 1
            kept += [record] if counts[record[0]] <= RECORDS else []
        more = len(records) - len(kept)
        return self._waits.setdefault((*kept, *([more] if more else [])), len(self._waits))

    def _record(self, one: Pending) -> tuple[Hashable, ...]:
        nodes = tuple(self.number[awaited.node] for awaited in one.awaited if awaited.node in self.number)
        return one.branch, nodes, ", ".join(f"{name} = {_text(value)}" for name, value in one.variables.items())

    def _changed(self, change: VerdictChange) -> dict[str, Any]:
        titles, monitors, own = self._titles, change.watch.monitors, self._own[id(change.watch)]
        if change.detected and not self.grows:
            self._after[own] = NEAR
            for place, event in self._near.pop(own, ()):
                self._lists["event"][place] = self._content(event, share=2)
        found: dict[str, Any] = {
            "verdicts": [
                [
                    titles[column],
                    change.verdicts[column].symbol,
                    change.counts[column].notified if column in change.counts else None,
                ]
                for column in change.columns
            ],
            "detections": [
                self._detection([titles[one] for one in some], how, change) for some, how in unlike(change.explanations)
            ],
        }
        if change.passed:
            found["passed"] = visible(change.passed)
        if 0 in change.columns and 0 not in change.detected and (ended := monitors.ended(0)) is not None:
            found["ended"] = [self._record(one) for one in ended.pending[:RECORDS]]
        return found

    def _detection(self, titles: Sequence[str], how: Explanation, change: VerdictChange) -> dict[str, Any]:
        matched = []
        for node, numbers in how.events.items():
            for number in numbers:
                event = change.events.get(number)
                known = ["", -1, None] if event is None else self._known(event)
                matched.append([self.number.get(node, -1), number, *known])
        kept = how.scenario.items()
        absent = {"absent": [visible(one.text) for one in how.absences]} if how.absences else {}
        return {
            **absent,
            "titles": self._same(titles),
            "branch": how.branch,
            "kinds": self._same(sorted(kind.value for kind in how.kinds)),
            "matched": matched,
            "variables": [[name, _text(value)] for name, value in how.bound(self.tree).items()],
            "nodes": self._same(
                sorted({self.number[name] for name in (*how.scenario, *how.events) if name in self.number})
            ),
            "lines": self._same([[self.number[name], self.number[child]] for name, some in kept for child in some]),
        }

    def _same(self, value: Sequence[Any]) -> Sequence[Any]:
        """Return one object for equal values."""
        return self._values.setdefault(str(value), value)

    def _node(self, name: str) -> list[str]:
        node = self.tree.nodes[name]
        return [visible(name), visible(node.label or ""), visible(event_text(node)) if node.has_event else ""]

    def _branches(self) -> list[list[Any]] | None:
        """Return number, kinds, property and event nodes of branches, if few."""
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
                cut(visible(property_text(one)), LONGEST),
                [self.number[name] for name in one.nodes if self.tree.nodes[name].has_event],
            ]
            for one in watched
        ]

    def _watch(self, watch: MonitoredTrace) -> list[Any]:
        own = watch.monitors
        ends = [[verdict.symbol, own.since.get(at), own.found[at].notified] for at, verdict in enumerate(own.verdicts)]
        return [None if watch.key is None else list(map(_text, watch.key)), watch.events, ends]


_Seen = tuple[dict[int, tuple[int, int]], str, bool]
"""By node, last event and count; verdict; whether the monitor restarts next."""


def _after(
    before: _Seen | None, number: int, nodes: Any, change: Mapping[str, Any] | None, title: str, *, repeat: bool
) -> _Seen:
    """Return the state after one more place, as the script of the page does."""
    seen, verdict, fresh = before or ({}, "?", False)
    if fresh:
        seen, verdict, fresh = {}, "?", False
    for node in nodes:
        seen[node] = number, seen.get(node, (0, 0))[1] + 1
    for named, symbol, _ in change["verdicts"] if change is not None else ():
        if named == title:
            verdict, fresh = symbol, repeat and symbol == "⊤"
    return seen, verdict, fresh


def _pieces(value: Any) -> Iterator[str]:
    """Yield the JSON of a value, of long lists in pieces, for memory."""
    if isinstance(value, dict):
        for place, (name, part) in enumerate(value.items()):
            yield f"{',' if place else '{'}{json.dumps(str(name))}:"
            yield from _pieces(part)
        yield "}" if value else "{}"
    elif isinstance(value, list) and len(value) > PIECE:
        for start in range(0, len(value), PIECE):
            text = json.dumps(value[start : start + PIECE], separators=(",", ":"))
            yield f"{',' if start else '['}{text[1:-1]}"
        yield "]"
    else:
        yield json.dumps(value, separators=(",", ":"))


def _text(value: Json) -> str:
    if isinstance(value, str):
        return visible(cut(value, LONGEST))
    try:
        return visible(cut(json.dumps(value, ensure_ascii=False), LONGEST))
    except ValueError:  # more digits than Python converts
        return "…"
