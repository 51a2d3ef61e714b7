"""Parquet tables, read in batches by `pyarrow`: columns are fields.

A null means that the event lacks the field. Times become ISO 8601 texts in the column's precision
(UTC with a zone), durations integer nanoseconds, decimals numbers, and bytes UTF-8 text or else
base64.
"""

from array import array
from base64 import b64encode
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from itertools import accumulate, pairwise
from math import isfinite
from pathlib import Path
from typing import Any, ClassVar, Final, TypeAlias

from rvaft.errors import ToolMissing, TraceError, WrongType, installed
from rvaft.model.values import Json, as_json, decimal
from rvaft.readers.json_lines import settled
from rvaft.readers.log import Log, LogReader

_ROWS: Final = 4_096
_REMEDY: Final = "pip install '.[parquet]' in a checkout of rvaft"
_Batch: TypeAlias = Any
_Column: TypeAlias = Any


class ParquetReader(LogReader):
    """Parquet tables.

    >>> ParquetReader.suffixes, ParquetReader.unit, ParquetReader.needs_file
    (('.parquet', '.pq'), 'row', True)
    """

    name: ClassVar[str] = "parquet"
    suffixes: ClassVar[tuple[str, ...]] = (".parquet", ".pq")
    unit: ClassVar[str] = "row"
    needs_file: ClassVar[bool] = True

    def events(self, log: Log) -> Iterator[tuple[int, dict[str, Json]]]:
        """Yield the events with their row numbers."""
        try:
            import pyarrow  # noqa: PLC0415
        except ImportError as error:
            raise ToolMissing("pyarrow", remedy=_REMEDY) from error
        number = 0
        try:
            with _opened(log.path) as file:
                names = file.schema_arrow.names
                for name in names:
                    if names.count(name) > 1:
                        raise log.error_at(f"there are two columns {name}", None)
                log.require(names)
                read = [name for name in names if log.interest.fields is None or name in log.interest.fields]
                if not read:
                    yield from ((row, {}) for row in range(1, file.metadata.num_rows + 1))
                    return
                for batch in file.iter_batches(batch_size=_ROWS, columns=read):
                    for row, event in enumerate(_events(batch, log, number), number + 1):
                        if event is not None:
                            yield row, event
                    number += batch.num_rows
        except (pyarrow.ArrowException, OSError) as error:
            raise log.error_at(_damage(error), number + 1 if number else None) from error


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """Open a local file; `pyarrow` itself would take `s3:/day.parquet` and `~/day.parquet` for other places."""
    pyarrow, parquet = (installed(name, "pyarrow", _REMEDY) for name in ("pyarrow", "pyarrow.parquet"))
    with (
        pyarrow.OSFile(str(path)) as stream,
        parquet.ParquetFile(stream, pre_buffer=False, page_checksum_verification=True) as file,
    ):
        yield file


@contextmanager
def _readable(path: Path) -> Iterator[Any]:
    """Open a file; errors of `pyarrow` become `TraceError`."""
    pyarrow = installed("pyarrow", "pyarrow", _REMEDY)
    try:
        with _opened(path) as file:
            yield file
    except (pyarrow.ArrowException, OSError) as error:
        raise TraceError(_damage(error), file=str(path), line=None) from error


def _damage(error: Exception) -> str:
    reason = str(error).strip().partition("\n")[0].removesuffix(".")
    return f"not Parquet, or damaged: {reason}"


def column_names(path: Path) -> list[str]:
    """Return the names of the columns of a file; raises `ToolMissing` and `TraceError`."""
    with _readable(path) as file:
        names: list[str] = file.schema_arrow.names
        return names


def picked(log: Log, numbers: Iterable[int]) -> Iterator[tuple[int, dict[str, Json]]]:
    """Yield the events of rows with these increasing numbers; raises `TraceError`."""
    pyarrow = installed("pyarrow", "pyarrow", _REMEDY)
    wanted, first = iter(numbers), 1
    number = next(wanted, 0)
    with _readable(log.path) as file:
        for group in range(file.num_row_groups):
            after = first + file.metadata.row_group(group).num_rows
            rows: list[int] = []
            while first <= number < after:
                rows.append(number)
                number = next(wanted, 0)
            if rows:
                places = pyarrow.py_buffer(array("q", [row - first for row in rows]))  # from a list, it imports pandas
                chosen = pyarrow.Int64Array.from_buffers(pyarrow.int64(), len(rows), [None, places])
                batches = file.read_row_group(group).take(chosen).to_batches(_ROWS)
                found = (event for batch in batches for event in _events(batch, log, 0))
                for row, event in zip(rows, found, strict=True):
                    if event is None:
                        raise log.error_at("a value cannot be written as JSON", row)
                    yield row, event
            first = after


def frame_events(frame: object) -> Iterator[dict[str, Json]]:
    """Return the rows of a table of pandas, polars, Arrow or another library of Arrow's interface, as events.

    A missing value, and a number that is not finite, means that the event lacks the field. Raises `ToolMissing`,
    `TraceError`, and `WrongType` for another object.

    >>> import pyarrow
    >>> list(frame_events(pyarrow.table({"event": ["a", "b"], "x": [1, None]})))
    [{'event': 'a', 'x': 1}, {'event': 'b'}]
    """
    pyarrow = installed("pyarrow", "pyarrow", _REMEDY)
    of_pandas = hasattr(frame, "to_dict") and hasattr(frame, "iterrows")
    if not of_pandas and not hasattr(frame, "__arrow_c_stream__"):
        raise WrongType("a log", frame, "a DataFrame of pandas or polars, or a table of Arrow")
    try:
        table = pyarrow.Table.from_pandas(frame, preserve_index=False) if of_pandas else pyarrow.table(frame)
    except pyarrow.ArrowException:
        if not of_pandas:
            raise
        return _of_records(frame)
    return (event for batch in table.to_batches(_ROWS) for event in _of_batch(batch))


def _of_records(frame: Any) -> Iterator[dict[str, Json]]:
    """Iterate over the rows of a table of pandas whose columns have values of several types."""
    for row in frame.to_dict("records"):
        event = as_json({str(name): value for name, value in row.items()})
        yield {name: value for name, value in event.items() if value is not None and value == value}  # noqa: PLR0124


def _of_batch(batch: _Batch) -> Iterator[dict[str, Json]]:
    try:
        rows = zip(*map(_values, batch.columns), strict=True)
    except ValueError as error:
        raise TraceError(str(error), file="the table", line=None) from error
    names = batch.schema.names
    for row in rows:
        pairs = ((name, value) for name, value in zip(names, row, strict=True) if value is not None)
        yield {name: value for name, value in pairs if not isinstance(value, float) or isfinite(value)}


def _events(batch: _Batch, log: Log, before: int) -> list[dict[str, Json] | None]:
    """Return the events, None for a rejected row."""
    try:
        columns = [_values(column) for column in batch.columns]
        rows = zip(*columns, strict=True)
        names = batch.schema.names
        events = [{name: value for name, value in zip(names, row, strict=True) if value is not None} for row in rows]
        return [settled(event, log) for event in events] if _has_floats(batch) else list(events)
    except ValueError as error:
        if batch.num_rows > 1:
            ones = range(batch.num_rows)
            return [event for place in ones for event in _events(batch.slice(place, 1), log, before + place)]
        log.reject(before + 1, "not UTF-8" if isinstance(error, UnicodeDecodeError) else str(error))
        return [None]


def _has_floats(batch: _Batch) -> bool:
    from pyarrow import compute, types  # noqa: PLC0415

    return any(
        not compute.all(compute.is_finite(column)).as_py()
        if types.is_floating(column.type) and not types.is_float16(column.type)
        else types.is_nested(column.type) or types.is_float16(column.type)
        for column in batch.columns
    )


def _values(column: _Column) -> list[Json]:
    import pyarrow as pa  # noqa: PLC0415
    from pyarrow import compute, types  # noqa: PLC0415

    kind = column.type
    if isinstance(column, pa.ExtensionArray):
        return _values(column.storage)
    if types.is_dictionary(kind):
        return _values(column.dictionary_decode())
    if types.is_struct(kind):
        names = [kind.field(place).name for place in range(kind.num_fields)]
        rows = zip(*map(_values, column.flatten()), strict=True) if names else ((),) * len(column)
        present = zip(column.is_valid().to_pylist(), rows, strict=True)
        return [
            {name: value for name, value in zip(names, row, strict=True) if value is not None} if valid else None
            for valid, row in present
        ]
    if types.is_map(kind) or types.is_list(kind) or types.is_large_list(kind) or types.is_fixed_size_list(kind):
        if types.is_map(kind):
            column = column.cast(pa.list_(pa.struct([("key", kind.key_type), ("value", kind.item_type)])))
        lengths = compute.list_value_length(column).to_pylist()
        flat = _values(column.flatten())
        ends = accumulate((length or 0 for length in lengths), initial=0)
        lists = [None if length is None else flat[a:b] for length, (a, b) in zip(lengths, pairwise(ends), strict=True)]
        by_text = types.is_map(kind) and (types.is_string(kind.key_type) or types.is_large_string(kind.key_type))
        return [None if one is None else _object(one) for one in lists] if by_text else lists
    if types.is_timestamp(kind):
        zone = "Z" if kind.tz is not None else ""
        utc = column.cast(pa.timestamp(kind.unit, "UTC")) if zone else column
        return compute.strftime(utc, format=f"%Y-%m-%dT%H:%M:%S{zone}").to_pylist()  # type: ignore[no-any-return]
    if types.is_date(kind) or types.is_time(kind):
        return column.cast(pa.string()).to_pylist()  # type: ignore[no-any-return]
    if types.is_duration(kind):
        return column.cast(pa.duration("ns")).cast(pa.int64()).to_pylist()  # type: ignore[no-any-return]
    if types.is_decimal(kind):
        number = int if kind.scale <= 0 else lambda one: decimal(f"{one:f}")
        return [one if one is None else number(one) for one in column.to_pylist()]
    if types.is_binary(kind) or types.is_large_binary(kind) or types.is_fixed_size_binary(kind):
        return [None if one is None else _text(one) for one in column.to_pylist()]
    found: list[Json] = column.to_pylist()
    if not all(value is None or isinstance(value, (bool, int, float, str)) for value in found[:1]):
        raise ValueError(f"values of the type {kind} cannot be written as JSON")
    return found


def _object(entries: list[dict[str, Json]]) -> Json:
    if len({entry["key"] for entry in entries}) < len(entries):
        raise ValueError("a key of a map is repeated")
    return {entry["key"]: entry["value"] for entry in entries if "value" in entry}


def _text(data: bytes) -> str:
    try:
        return data.decode()
    except UnicodeDecodeError:
        return b64encode(data).decode()
