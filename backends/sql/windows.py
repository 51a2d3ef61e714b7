"""Queries with window functions: the ends of counted leaves, and the nearest absent events.

They take `n log n` time where the dialect has the forms that `Dialect.distinct` and `Dialect.nearest` name.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import assert_never

from backends.joins import CountedEvents
from backends.sql.dialects import Dialect
from rvaft.core.property import WithoutEvent
from rvaft.model.nodes import Side


@dataclass(frozen=True)
class NamedTables:
    """The tables of a query: `named` returns the name of a table by its query and the beginning of the name."""

    named: Callable[[str, str], str]
    dialect: Dialect
    trace: tuple[str, ...]
    """The column that separates logs, if there is one."""

    def ranked(self, table: str, number: str, condition: str, name: str) -> str:
        """Return the table of the rows whose number, by a window function, meets a condition."""
        numbered = f"SELECT *, {number} AS found FROM {table}"
        return self.named(f"SELECT * FROM ({numbered}) AS numbered WHERE found {condition}", name)

    def literal(self, number: int) -> str:
        """Return an integer."""
        return self.dialect.number(number)


def over(keys: Sequence[str], order: str = "pos", frame: str = "") -> str:
    """Return the window of the rows with equal keys.

    >>> over(["user"]), over([], "time", "ROWS BETWEEN 1 PRECEDING AND CURRENT ROW")
    ('(PARTITION BY user ORDER BY pos)', '(ORDER BY time ROWS BETWEEN 1 PRECEDING AND CURRENT ROW)')
    """
    partition = f"PARTITION BY {', '.join(keys)} " if keys else ""
    return f"({partition}ORDER BY {order}{' ' * bool(frame)}{frame})"


@dataclass(frozen=True)
class CountedLeaf:
    """A counted leaf: the table and the columns of its events, those of the shared and of the different values."""

    queries: NamedTables
    count: CountedEvents
    events: str
    columns: Sequence[str]
    shared: Sequence[str]
    values: Sequence[str]

    @property
    def keys(self) -> list[str]:
        """The columns with equal values."""
        return [*self.queries.trace, *self.shared]

    @property
    def _first(self) -> list[str]:
        """What a row has of the first event."""
        return ["pos", "time"][: 1 + self.count.timed]

    @property
    def _length(self) -> str:
        return self.queries.literal(self.count.length or 0)

    def table(self) -> str:
        """Return the table of the last events, each with the latest first one where that is needed."""
        if not self.values:
            shown = [f"lag({name}, {self.count.count - 1}) OVER w AS first_{name}" for name in self._first]
            where = " WHERE time IS NOT NULL" if self.count.timed else ""
            window = f"WINDOW w AS {over(self.keys)}"
            return self.queries.named(f"SELECT *, {', '.join(shown)} FROM {self.events}{where} {window}", "count_")
        enough = f">= {self.count.count}"
        if self.count.length is None:
            first = f"row_number() OVER {over([*self.keys, *self.values])} = 1 AS is_first"
            numbered = self.queries.named(f"SELECT *, {first} FROM {self.events}", "first_")
            number = f"count(CASE WHEN is_first THEN 1 END) OVER {over(self.keys)}"
            ends = self.queries.ranked(numbered, number, enough, "count_")
            return ends if self.count.first is None else self._with_first(ends)
        earlier = f"lag(time, {self.count.count - 1}) OVER {over(self.keys)}"
        many = self.queries.ranked(self.events, earlier, f">= time - {self._length}", "many_")
        if self.queries.dialect.distinct:
            ends = self._within(many)
            return ends if self.count.first is None else self._with_first(ends)
        if self.count.first is None and len(self.values) == 1:
            return self._by_join(many)
        return self._with_first(many)

    def _within(self, many: str) -> str:
        """Return the table of events that end a window with enough values, by window functions.

        Events with equal times are ordered, so a range of times becomes a number of rows. Only
        events near the end of a window with as many events, in the table `many`, are looked at.
        """
        places = ", ".join([*self.keys, f"time // {max(self.count.length or 0, 1)}"])
        spans = f"SELECT {places} FROM {many} UNION ALL SELECT {places} - 1 FROM {many}"
        numbered = f"SELECT *, row_number() OVER {over(self.keys)} AS number FROM {self.events}"
        near = self.queries.named(f"{numbered} WHERE ({places}) IN ({spans})", "near_")
        within = f"RANGE BETWEEN {self._length} PRECEDING AND CURRENT ROW"
        reach = f"number - min(number) OVER {over(self.keys, 'time', within)} AS reach"
        reaching = self.queries.named(f"SELECT *, {reach} FROM {near}", "reach_")
        what = self.values[0] if len(self.values) == 1 else f"({', '.join(self.values)})"
        rows = over(self.keys, "pos", "ROWS BETWEEN reach PRECEDING AND CURRENT ROW")
        number = f"{self.queries.dialect.distinct.format(what)} OVER {rows}"
        return self.queries.ranked(reaching, number, f">= {self.count.count}", "count_")

    def _joined(self, ends: str) -> str:
        """Return the join of events with those that may precede them in a match, and with themselves."""
        where = [*(f"e.{key} = o.{key}" for key in self.keys), "o.pos <= e.pos"]
        where += [f"o.time >= e.time - {self._length}"] * (self.count.length is not None)
        return f"FROM {ends} AS e, {self.events} AS o WHERE {' AND '.join(where)}"

    def _by_join(self, ends: str) -> str:
        """Return the table of events that end a window with enough values."""
        columns = ", ".join(f"e.{column}" for column in self.columns)
        enough = f"HAVING count(DISTINCT o.{self.values[0]}) >= {self.count.count}"
        return self.queries.named(f"SELECT {columns} {self._joined(ends)} GROUP BY {columns} {enough}", "count_")

    def _with_first(self, ends: str) -> str:
        """Return the table of last events with the latest first one: the N-th latest of the latest of each value."""
        columns = [f"e.{column}" for column in self.columns]
        shown = ", ".join([*columns, *(f"max(o.{name}) AS first_{name}" for name in self._first)])
        groups = ", ".join([*columns, *(f"o.{value}" for value in self.values)])
        latest = self.queries.named(f"SELECT {shown} {self._joined(ends)} GROUP BY {groups}", "latest_")
        number = f"row_number() OVER {over([*self.queries.trace, 'pos'], 'first_pos DESC')}"
        return self.queries.ranked(latest, number, f"= {self.count.count}", "count_")


@dataclass(frozen=True)
class NearestAbsence:
    """A `without` whose nearest event with equal values tells whether an event breaks it.

    `absent` is the table of its events, `keys` their shared columns with those of a match, and `times`
    the table of all events with a time. Times of events are at most `lateness` behind earlier ones.
    """

    queries: NamedTables
    clause: WithoutEvent
    number: int
    absent: str
    keys: Mapping[str, str]
    times: str
    lateness: int | None

    def unbroken(self, matches: str) -> str:
        """Return the table of the matches in a table that no event breaks; for `after` with the deciding position."""
        length = self.queries.literal(self.clause.duration or 0)
        first, last = f"m.first_pos_{self.number}", f"m.last_pos_{self.number}"
        absent, order = self.absent, f"{last} < q.pos"
        match self.clause.side:
            case Side.DURING:
                order, kept = f"{first} < q.pos", f"q.pos >= {last}"
            case Side.BEFORE if self.clause.duration is None:
                order, kept = f"{first} > q.pos", "false"
            case Side.BEFORE:
                absent = self._extreme("max", "UNBOUNDED PRECEDING AND CURRENT ROW")
                order, kept = f"{first} > q.pos", f"q.found < m.first_time_{self.number} - {length}"
            case Side.AFTER if self.lateness is None:
                matches, kept = self._decided(matches), f"q.pos >= m.decided_{self.number}"
            case Side.AFTER:
                absent = self._extreme("min", "CURRENT ROW AND UNBOUNDED FOLLOWING")
                matches, kept = self._decided(matches), f"q.found > m.last_time_{self.number} + {length}"
            case _:
                assert_never(self.clause.side)
        same = [f"m.{name} = q.{name}" for name in self.queries.trace]
        same += [f"m.{key} = q.{name}" for name, key in self.keys.items()]
        join = f"{self.queries.dialect.nearest.format('LEFT ')} {absent} AS q ON {' AND '.join([*same, order])}"
        return self.queries.named(f"SELECT m.* FROM {matches} AS m {join} WHERE q.pos IS NULL OR {kept}", "unbroken_")

    def _extreme(self, word: str, frame: str) -> str:
        """Return the absent events, each with the extreme time of those up to it or from it on."""
        window = over([*self.queries.trace, *self.keys], "pos", f"ROWS BETWEEN {frame}")
        return self.queries.named(f"SELECT *, {word}(time) OVER {window} AS found FROM {self.absent}", "extreme_")

    def _decided(self, matches: str) -> str:
        """Return the table of the matches whose clause `after` is decided, with the position that decides it.

        It is the first event with the highest time so far, if that is late enough. A match that comes
        after such an event, since times went back, is looked up in a tree of the times.
        """
        decided, last = f"decided_{self.number}", f"last_pos_{self.number}"
        before = over(self.queries.trace, "pos", "ROWS BETWEEN UNBOUNDED PRECEDING AND 1 PRECEDING")
        highest = self.queries.ranked(self.times, f"max(time) OVER {before}", "IS NULL OR time > found", "highest_")
        wait = self.queries.literal((self.clause.duration or 0) + (self.lateness or 0))
        same = [f"m.{name} = d.{name}" for name in self.queries.trace]
        late = " AND ".join([*same, f"m.last_time_{self.number} + {wait} < d.time"])
        join = f"{matches} AS m {self.queries.dialect.nearest.format('')} {highest} AS d ON {late}"
        found = self.queries.named(f"SELECT m.*, d.pos AS {decided} FROM {join}", "decided_")
        if self.lateness is not None:
            return found
        ahead = f"SELECT * FROM {found} WHERE {decided} > {last}"
        return self.queries.named(f"{ahead} UNION ALL {self._looked_up(found, decided, last, wait)}", "decided_")

    def _looked_up(self, found: str, decided: str, last: str, wait: str) -> str:
        """Return the query for matches that come after the event in `found`, with the position that decides them.

        The nodes of a binary tree have the highest of 2^level times. Each search goes up and to the
        right to the first node with a time that is high enough, and then down to the leftmost one.
        """
        named, trace = self.queries.named, "".join(f"{name}, " for name in self.queries.trace)
        own = [f"{{0}}.{name} = {{1}}.{name}" for name in self.queries.trace]

        def on(left: str, right: str, *conditions: str) -> str:
            return " AND ".join([*(one.format(left, right) for one in own), *conditions])

        number = f"row_number() OVER {over(self.queries.trace)} - 1 AS place"
        numbered = named(f"SELECT *, {number} FROM {self.times}", "numbered_")
        same = on("m", "d", f"m.{last} = d.pos")
        bound = f"m.last_time_{self.number} + {wait} AS bound"
        behind = f"SELECT m.*, d.place, {bound} FROM {found} AS m JOIN {numbered} AS d ON {same}"
        behind = named(f"{behind} WHERE m.{decided} <= m.{last}", "behind_")
        leaves = f"SELECT {trace}CAST(0 AS BIGINT) AS level, place AS node, time AS top FROM {numbered}"
        inner = f"SELECT {trace}level + 1, node // 2, max(top) FROM tree WHERE level < 40 GROUP BY ALL"
        leaves += f" WHERE EXISTS (SELECT 1 FROM {behind})"
        tree = named(f"WITH RECURSIVE tree AS ({leaves} UNION ALL {inner}) SELECT * FROM tree", "tree_")
        start = f"SELECT DISTINCT {trace}place, bound, CAST(0 AS BIGINT) AS level, place + 1 AS node FROM {behind}"
        level = "CASE WHEN t.top > s.bound THEN s.level - 1 ELSE s.level + s.node % 2 END"
        down = "WHEN t.top > s.bound THEN CASE WHEN s.level > 0 THEN 2 * s.node ELSE s.node END"
        node = f"CASE {down} WHEN s.node % 2 = 1 THEN (s.node + 1) // 2 ELSE s.node + 1 END"
        columns = ", ".join([*(f"s.{name}" for name in self.queries.trace), "s.place", "s.bound", level, node])
        step = f"SELECT {columns} FROM search AS s JOIN {tree} AS t ON "
        step += on("s", "t", "s.level = t.level", "s.node = t.node")
        ended = "SELECT * FROM search WHERE level = -1"
        search = named(f"WITH RECURSIVE search AS ({start} UNION ALL {step}) {ended}", "search_")
        there = on("m", "s", "m.place = s.place", "m.bound = s.bound")
        return (
            f"SELECT m.* EXCLUDE (place, bound) REPLACE (d.pos AS {decided}) FROM {behind} AS m "
            f"JOIN {search} AS s ON {there} JOIN {numbered} AS d ON {on('s', 'd', 's.node = d.place')}"
        )
