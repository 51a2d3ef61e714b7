"""Monitoring on Apache Spark: a monitor per key, over a table or a stream of events.

Spark distributes the keys, sorts the events of each key by time, and keeps its state. Verdicts
equal those of `rvaft monitor`, since the same run processes the events. Needs PySpark 4 (the extra
`spark`) and Java.
"""

import json
from collections.abc import Iterable, Iterator, Sequence
from functools import cache, partial
from hashlib import sha256
from itertools import count, groupby
from math import floor
from operator import itemgetter
from typing import TYPE_CHECKING, Any, Final, NamedTuple, cast

import msgspec

import rvaft
from rvaft.api import loads
from rvaft.engine.monitor import repeating_engine
from rvaft.errors import OptionError, RvaftError, ToolMissing
from rvaft.language.printer import dumps
from rvaft.model.event_time import duration
from rvaft.model.nodes import Kind, Side
from rvaft.model.tree import RVAFT, resolve_semantics
from rvaft.model.values import Json, decimal, is_finite
from rvaft.model.verdict import Semantics
from rvaft.monitors import DEFAULT_LIMIT
from rvaft.readers.json_lines import decode
from rvaft.rules.validity import valid_part
from rvaft.stream import pipeline
from rvaft.stream.checkpoint import packed, unpacked
from rvaft.stream.data_warnings import DataWarnings
from rvaft.stream.detection import detection, places
from rvaft.stream.event_buffer import EventBuffer
from rvaft.stream.keys import Field, Key
from rvaft.stream.listeners import Listener
from rvaft.stream.monitor_set import MonitorSet, Per, columns
from rvaft.stream.order import OrderedField
from rvaft.stream.plan import MonitoringPlan, Totals
from rvaft.stream.run import TraceRun
from rvaft.stream.trace_progress import RunState
from rvaft.stream.verdict_change import VerdictChange
from rvaft.support.wording import counted

if TYPE_CHECKING:
    import pandas
    import pyarrow
    from pyspark.sql import DataFrame

SCHEMA: Final = (
    "key string, event bigint, time string, detection int, branch int, kinds array<string>, "
    "record string, warning string"
)
"""The columns of detections and warnings as a Spark schema."""
_KEYED: Final = "key string, place bigint, part double, came bigint, text string"
_ORDER: Final = ["place", "part", "came"]
_FIRST: Final = -(1 << 63)
_NO_KEY: Final = ""
_STATE: Final = "state binary"
_QUICK: Final = msgspec.json.Decoder(float_hook=decimal)


class _Options(NamedTuple):
    """The options of a worker as plain values, with the tree as text."""

    text: str
    name: str
    key: tuple[str, ...]
    order_by: str | None
    semantics: str
    branch: int | None
    kind: str | None
    per: str
    limit: int
    repeat: bool
    cooldown: int | None
    strict_json: bool
    complete: bool = False
    latest: int | None = None
    """The greatest time of the table in nanoseconds, if it decides verdicts."""

    @property
    def digest(self) -> bytes:
        """Return a digest of the options and the rvaft version."""
        return sha256(f"{rvaft.__version__} {tuple(self)}".encode()).digest()


class _Plan(NamedTuple):
    tree: RVAFT
    run: MonitoringPlan
    key: Key
    order_by: str


def monitor(
    events: "DataFrame",
    tree: RVAFT,
    *,
    key: str | Sequence[str],
    order_by: str | None = None,
    column: str | None = None,
    name: str | None = None,
    semantics: Semantics | str | None = None,
    branch: int | None = None,
    kind: Kind | str | None = None,
    per: Per | str = Per.TREE,
    limit: int = DEFAULT_LIMIT,
    repeat: bool = False,
    cooldown: str | None = None,
    strict_json: bool = False,
    complete: bool = False,
) -> "DataFrame":
    """Return the detections in a table or stream of events, in `SCHEMA`.

    The options are those of `rvaft monitor`. `key` names the key fields (dotted paths). `order_by`
    orders the events of a key, by default by the `time` of the tree. `cooldown` is a duration like
    `10 min`. Events are JSON texts in `column`, or in `value` if it is the only column; otherwise
    rows are events, without null fields.

    A detection has the `key` as JSON, the number of the `event` within its key, its `time`,
    `branch` and `kinds`. `detection` is its number (with `repeat`), and `record` the JSON object
    that `rvaft monitor` passes to commands. Rows with a `warning` and no record report events
    without the key, lines that are not JSON objects, undefined guards, late events, and failed
    monitors.

    A stream keeps the state of a key in Spark's state store. A query that is restarted from its
    `checkpointLocation` continues, reports each detection once, and refuses another tree or
    options. Events are sorted within a micro-batch; an event of an earlier time in a later batch is
    processed on arrival, with a warning.

    `for D after` is decided by the next event of the key, or by the greatest time in the table, for which
    Spark reads it twice; with `complete`, by the end of the table. `rvaft monitor --key` may decide it
    earlier, by an event of another key, and with `repeat` begin anew earlier. A stream of such a tree is
    refused.

    Raises `OptionError`, `TreeError` as `rvaft.monitor` does, and `ToolMissing`.
    """
    try:
        import pandas  # noqa: F401, PLC0415 -- imported on use
        import pyarrow  # noqa: F401, PLC0415
        from pyspark.sql import functions as spark  # noqa: PLC0415
    except ImportError as error:
        raise ToolMissing(error.name or "pyspark", remedy="pip install 'rvaft[spark]'") from error
    if order_by is None and tree.time is None:
        raise OptionError("a table has no order: give order_by=FIELD, or declare `time FIELD as FORMAT;` in the tree")
    options = _Options(
        dumps(tree),
        name or tree.root,
        (key,) if isinstance(key, str) else tuple(key),
        order_by,
        resolve_semantics(tree, semantics).value,
        branch,
        None if kind is None else str(kind),
        str(per),
        limit,
        repeat,
        None if cooldown is None else duration(cooldown),
        strict_json,
        complete,
    )
    timed = any(clause.side is Side.AFTER for _, clause, _ in _planned(options).tree.absences)
    if timed and events.isStreaming:
        raise OptionError(
            "a stream of Spark has no time of all keys, which decides `for D after`: use a table, or "
            "rvaft monitor --follow --clock"
        )
    if timed and order_by is not None:
        raise OptionError("`for D after` is decided in the order of times: omit order_by")
    if column is None and events.columns == ["value"]:
        column = "value"
    text = spark.to_json(spark.struct("*")) if column is None else spark.col(column)
    keyed = events.select(text).mapInArrow(partial(_keyed, options), _KEYED)
    if events.isStreaming:
        stepped = partial(_stepped, options)
        return keyed.groupBy("key").applyInPandasWithState(stepped, SCHEMA, _STATE, "append", "NoTimeout")
    if timed and not complete:
        ((latest,),) = keyed.agg({"place": "max"}).collect()
        options = options._replace(latest=latest)
    in_order = keyed.repartition("key").sortWithinPartitions("key", *_ORDER)
    return in_order.mapInArrow(partial(_monitored, options), SCHEMA)


@cache
def _planned(options: _Options) -> _Plan:
    tree = loads(options.text)
    semantics = Semantics(options.semantics)
    parts = columns(valid_part(tree, options.branch, options.kind), Per(options.per))
    make = partial(repeating_engine, semantics=semantics, limit=options.limit, repeat=options.repeat)
    monitors = MonitorSet(parts, make, semantics, repeat=options.repeat, cooldown=options.cooldown)
    key = Key.parse(options.key)
    order_by = options.order_by or ".".join(tree.time.field if tree.time else ())
    also = (*key.fields, Field.parse(order_by))
    return _Plan(tree, MonitoringPlan(monitors, strict_json=options.strict_json, also=also), key, order_by)


def _keyed(options: _Options, batches: Iterable["pyarrow.RecordBatch"]) -> Iterator["pyarrow.RecordBatch"]:
    """Yield the events with key and place; rows without a key come first.

    Nulls would make pandas convert columns to floats.
    """
    from pyspark import TaskContext  # noqa: PLC0415

    context = TaskContext.get()
    came = count((0 if context is None else context.partitionId()) << 40)
    plan = _planned(options)
    order = OrderedField(plan.order_by, plan.tree.time)
    for batch in batches:
        rows: list[tuple[str, int, float, int, str]] = []
        for text in batch.column(0).to_pylist():
            event = _object_in(text or "")
            values = None if event is None else plan.key.of(event)
            known = values is not None and is_finite(values)
            place = order.place(event) if known else None
            whole = _FIRST if place is None else max(_FIRST + 1, min(floor(place), -_FIRST - 1))
            part = 0.0 if place is None else float(place - floor(place))
            rows.append((_key_text(values) if known else _NO_KEY, whole, part, next(came), text or ""))
        yield _batch(rows, _KEYED)


def _object_in(text: str) -> dict[str, Json] | None:
    try:
        event = _QUICK.decode(text)
    except (ValueError, RecursionError):
        try:
            event = decode(text.encode())
        except ValueError:
            return None
    return event if isinstance(event, dict) else None


def _key_text(values: tuple[Json, ...] | None) -> str:
    """Return the values of a key as JSON, the same for equal values."""
    text = json.dumps(values, sort_keys=True)
    if all(isinstance(value, (str, int, type(None))) for value in values or ()):
        return text
    return json.dumps(json.loads(text, parse_float=lambda digits: _whole(float(digits))), sort_keys=True)


def _whole(number: float) -> int | float:
    return int(number) if number.is_integer() else number


class _Detections(Listener):
    def __init__(self, plan: _Plan, options: _Options, key: Json) -> None:
        self.rows: list[tuple[Any, ...]] = []
        self._plan = plan
        self._options = options
        self._key = key

    def change(self, change: VerdictChange) -> None:
        """Add a row for each match."""
        tree, key = self._plan.tree, self._key
        for explanation, _, counts in change.detections:
            about = {
                "tree": self._options.name,
                "key": key,
                "event": change.number,
                **(counts.fields if counts else {}),
            }
            record = detection(about, explanation, change.events, tree)
            time = places(change.event, tree).get("time")
            written = time if isinstance(time, str) or time is None else json.dumps(time)
            number, branch, kinds = record.get("detection"), record["branch"], record["kinds"]
            self.rows.append((json.dumps(key), change.number, written, number, branch, kinds, json.dumps(record), None))


class _KeyRun:
    """The run of one key, from a stored state."""

    def __init__(self, options: _Options, group: str, state: bytes | None = None) -> None:
        self._options = options
        plan = self._plan = _planned(options)
        self.key = plan.key.as_json(tuple(json.loads(group)))
        self._listener = _Detections(plan, options, self.key)
        buffer = EventBuffer(reads=plan.run.reads)
        totals = Totals(None, DataWarnings(plan.run.monitors.types))
        self._run = TraceRun(plan.run, "", [self._listener], totals, buffer=buffer)
        self._failure = ""
        self._rejected = self._unplaced = 0
        if state is not None:
            size = len(options.digest)
            if state[:size] != options.digest:
                raise OptionError(
                    "the checkpoint of this query belongs to another tree, other options or another"
                    " version of rvaft: use another checkpointLocation to start again"
                )
            found = cast("tuple[str, int, int, int, RunState]", unpacked(state[size:]))
            self._failure, self._rejected, self._unplaced, number, kept = found
            if not self._failure:
                self._run.restore(kept, number)
        self._reported = set(self._lines)

    @property
    def state(self) -> bytes:
        """The state from which another run continues."""
        kept = None if self._failure else self._run.state
        return self._options.digest + packed((self._failure, self._rejected, self._unplaced, self._run.number, kept))

    @property
    def _lines(self) -> list[str]:
        lines = [*self._run.warnings, *self._run.totals.data_warnings.lines]
        if self._unplaced:
            what = f"without a number or time in the field {self._plan.order_by} are placed before all others"
            lines.append(f"{counted(self._unplaced)} {what}")
        return [*lines, self._failure] if self._failure else lines

    def end(self) -> Iterator[tuple[Any, ...]]:
        """Yield the rows for what the end of the table, or the time of another key, decides."""
        if self._options.complete and not self._failure:
            self._run.finish()
        elif (latest := self._options.latest) is not None and latest > _FIRST and not self._failure:
            self._run.decide(latest)
        yield from self._listener.rows
        self._listener.rows.clear()

    def read(self, texts: Iterable[tuple[int, str]]) -> Iterator[tuple[Any, ...]]:
        """Yield the rows for further events of this key, in order."""
        plan, rejected = self._plan, self._rejected
        refusals: list[str] = []

        def events() -> Iterator[dict[str, Json]]:
            for place, text in texts:
                self._unplaced += place == _FIRST
                try:
                    yield decode(text.encode(), reads=plan.run.reads, strict=plan.run.strict_json)
                except ValueError as error:
                    self._rejected += 1
                    refusals.append(str(error))

        try:
            for _ in () if self._failure else pipeline.read([self._run], events(), ""):
                if self._listener.rows:
                    yield from self._listener.rows
                    self._listener.rows.clear()
        except RvaftError as error:
            self._failure = f"not monitored from event {self._run.number} on: {error}"
        yield from self._listener.rows
        self._listener.rows.clear()
        if refusals:
            yield _warning(self.key, f"{counted(self._rejected - rejected)} rejected (first: {refusals[0]})")
        for line in self._lines:
            if line not in self._reported:
                self._reported.add(line)
                yield _warning(self.key, line)


def _warning(key: Json, text: str) -> tuple[Any, ...]:
    return (None if key is None else json.dumps(key), None, None, None, None, None, None, text)


def _without_key(options: _Options, texts: Iterable[tuple[int, str]]) -> Iterator[tuple[Any, ...]]:
    plan = _planned(options)
    lacking, refusals, refused = 0, 0, ""
    for _, text in texts:
        try:
            decode(text.encode(), reads=plan.run.reads, strict=plan.run.strict_json)
            lacking += 1
        except ValueError as error:
            refusals += 1
            refused = refused or str(error)
    if lacking:
        names = " or ".join(options.key)
        yield _warning(None, f"{counted(lacking)} without the field {names}, not monitored")
    if refusals:
        yield _warning(None, f"{counted(refusals)} rejected (first: {refused})")


def _monitored(options: _Options, batches: Iterable["pyarrow.RecordBatch"]) -> Iterator["pyarrow.RecordBatch"]:
    """Yield the rows of a partition, sorted by key and place."""

    def events() -> Iterator[tuple[str, int, str]]:
        for batch in batches:
            yield from zip(*(batch.column(number).to_pylist() for number in (0, 1, 4)), strict=True)

    for group, found in groupby(events(), key=itemgetter(0)):
        texts = ((place, text) for _, place, text in found)
        if group == _NO_KEY:
            rows = list(_without_key(options, texts))
        else:
            run = _KeyRun(options, group)
            rows = [*run.read(texts), *run.end()]
        if rows:
            yield _batch(rows, SCHEMA)


def _batch(rows: Sequence[tuple[Any, ...]], schema: str) -> "pyarrow.RecordBatch":
    import pyarrow  # noqa: PLC0415

    text = pyarrow.string()
    kinds = {"string": text, "bigint": pyarrow.int64(), "double": pyarrow.float64(), "int": pyarrow.int32()}
    named = _columns(schema)
    found = zip(*rows, strict=True) if rows else [()] * len(named)
    arrays = [
        pyarrow.array(column, kinds.get(kind, pyarrow.list_(text)))
        for column, kind in zip(found, named.values(), strict=True)
    ]
    return pyarrow.RecordBatch.from_arrays(arrays, list(named))


def _columns(schema: str) -> dict[str, str]:
    return dict(column.split(" ", 1) for column in schema.split(", "))


def _stepped(
    options: _Options, key: tuple[str], tables: Iterable["pandas.DataFrame"], state: Any
) -> Iterator["pandas.DataFrame"]:
    import pandas  # noqa: PLC0415

    found = pandas.concat(list(tables)).sort_values(_ORDER, kind="stable")
    texts = zip(found["place"].tolist(), found["text"].tolist(), strict=True)
    if key[0] == _NO_KEY:
        rows = list(_without_key(options, texts))
    else:
        run = _KeyRun(options, key[0], bytes(state.get[0]) if state.exists else None)
        rows = list(run.read(texts))
        state.update((run.state,))
    if rows:
        yield pandas.DataFrame(rows, columns=list(_columns(SCHEMA)), dtype=object)
