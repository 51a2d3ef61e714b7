"""The registered log formats (entry points `rvaft.readers`) and format detection."""

import os
import warnings
from collections.abc import AsyncIterator, Callable, Generator, Iterator, Mapping
from contextlib import nullcontext, suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Final

from rvaft.core.fields_to_read import Scope
from rvaft.errors import OptionError, RvaftError, ToolFailed, WrongType, expect
from rvaft.model.values import Json
from rvaft.readers.json_lines import JsonLinesReader
from rvaft.readers.log import (
    FieldType,
    InputOptions,
    Live,
    Log,
    LogReader,
    Source,
    required_stream,
    scheme,
    source_of,
    suffix,
)
from rvaft.support.plugins import entry_points
from rvaft.support.wording import did_you_mean

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

__all__ = [
    "LogReader",
    "UnknownFormat",
    "all_readers",
    "live_events",
    "read_log",
]

GROUP: Final = "rvaft.readers"


@cache
def all_readers() -> "Mapping[str, EntryPoint]":
    """Return the registered readers by format, without importing them.

    >>> sorted({"csv", "json", "jsonl"} & set(all_readers()))
    ['csv', 'json', 'jsonl']
    """
    return {entry.name: entry for entry in sorted(entry_points(group=GROUP), key=lambda entry: entry.name)}


def reader_class(name: str) -> type[LogReader]:
    """Import a reader class; raises `UnknownFormat` and `ToolFailed`."""
    if name == JsonLinesReader.name:
        return JsonLinesReader
    found = all_readers()
    if name not in found:
        raise UnknownFormat(name, tuple(found))
    try:
        made: type[LogReader] = found[name].load()
    except Exception as error:
        reason = f"it cannot be loaded: {type(error).__name__}: {error}"
        raise ToolFailed(f"the reader of {name}", reason=reason) from error
    if lacking := sorted(getattr(made, "__abstractmethods__", ())):
        raise ToolFailed(f"the reader of {name}", reason=f"{made.__name__} does not define {', '.join(lacking)}")
    return made


def reader(name: str, options: InputOptions = InputOptions()) -> LogReader:  # noqa: B008
    """Return a reader for a format; raises `UnknownFormat`, `ToolFailed` and `OptionError`.

    >>> reader("regex", InputOptions(records="Items"))
    Traceback (most recent call last):
    ...
    rvaft.errors.OptionError: records is not for the format regex, which takes pattern, types
    """
    kind = reader_class(name)
    for option in sorted(options.given - kind.takes):
        takes = ", ".join(sorted(kind.takes)) or "no options"
        raise OptionError(f"{option} is not for the format {name}, which takes {takes}")
    return kind(options)


@cache
def suffixes() -> frozenset[str]:
    """Return the suffixes of all formats."""
    found = set[str]()
    for name in all_readers():
        with suppress(ToolFailed):
            found.update(reader_class(name).suffixes)
    return frozenset(found)


def format_of(file: str, options: InputOptions = InputOptions()) -> str:  # noqa: B008
    """Return the format of a file or URL, by default JSON Lines; raises `OptionError`.

    >>> format_of("monday.csv.gz"), format_of("monday.log")
    ('csv', 'jsonl')
    """
    path, known = Path(file), dict[str, str]()
    if (begins := scheme(file)) and not path.exists():
        for name in all_readers():
            with suppress(ToolFailed):
                known |= dict.fromkeys(reader_class(name).schemes, name)
        if begins not in known:
            raise OptionError(f"unknown URL scheme {begins}://; known: {', '.join(f'{one}://' for one in known)}")
        return known[begins]
    if suffix(path) in JsonLinesReader.suffixes:
        return JsonLinesReader.name
    for name in all_readers():
        with suppress(ToolFailed):
            if reader_class(name).suits(path, options):
                return name
    if (foreign := _FOREIGN.get(suffix(path))) is not None:
        read = ", ".join(all_readers())
        raise OptionError(f"{file}: rvaft does not read {foreign}: convert it to JSON Lines, CSV or Parquet ({read})")
    return JsonLinesReader.name


_FOREIGN: Final[Mapping[str, str]] = {
    ".avro": "Avro",
    ".evtx": "event logs of Windows (EVTX)",
    ".h5": "HDF5",
    ".mat": "MATLAB files",
    ".mf4": "ASAM MDF",
    ".orc": "ORC",
    ".pcap": "network captures",
    ".pcapng": "network captures",
    ".xls": "spreadsheets",
    ".xlsx": "spreadsheets",
    ".xml": "XML",
}
"""Suffixes of formats that no reader has, so that they are not taken for JSON Lines."""


def read_log(
    source: Source,
    form: str | None = None,
    *,
    name: str | None = None,
    records: str | None = None,
    types: Mapping[str, FieldType | str] | None = None,
    pattern: str | None = None,
    profile: str | None = None,
    year: int | None = None,
    dbc: str | None = None,
    messages: str | None = None,
    reads: Scope | None = None,
    warn: Callable[[str], object] = warnings.warn,
    within: str | os.PathLike[str] | None = None,
) -> Iterator[dict[str, Json]]:
    """Yield the events of a log: a file, perhaps compressed, a binary stream, or a URL (without
    end).

    A stream is JSON Lines unless `form` names a format; the other options are as for
    `rvaft monitor`. Rejected records are reported after the last event: by `warn` for formats with
    unrelated text, else as `TraceError`. With `within`, only a regular file inside that folder is
    read, also where a link leads out of it. For URLs in asynchronous code use `live_events`. Raises
    `TraceError`, `UnknownFormat`, `OptionError`, `ToolMissing` and `OSError`.

    >>> import rvaft
    >>> for event in rvaft.read_log("docs/first/break_in.traces/monday.jsonl"):
    ...     print(event["event"])
    scan
    heartbeat
    guess
    copy
    """
    try:
        kinds = {field: FieldType(kind) for field, kind in (types or {}).items()}
    except ValueError as error:
        raise OptionError(f"types: {error}; known: {', '.join(FieldType)}") from None
    options = InputOptions(records, kinds, pattern, profile, year, dbc, messages)
    if profile is not None and (form is not None or len(options.given) > 1):
        raise OptionError("a profile states the format: omit its other options")
    declared = None if profile is None else profile_reader(profile, year)
    if isinstance(source, (str, os.PathLike)):
        file = os.fspath(source)
        chosen = declared or reader(form or format_of(file, options), options)
    elif hasattr(source, "read"):
        file = name or "<trace>"
        chosen = declared or reader(form or JsonLinesReader.name, options)
        required_stream(chosen, source)
    else:
        raise WrongType("the source of a log", source, "a path or a binary stream")
    folder = None if within is None else Path(within)
    return _events(source, name or chosen.shown(file), chosen, reads, Live(warn=warn), within=folder)


def profile_reader(name: str, year: int | None = None) -> LogReader:
    """Return the reader of a profile; raises `OptionError`, `OSError` and what `reader` raises.

    >>> profile_reader("cloudtrail").name
    'json'
    """
    from rvaft.readers.profile import profile  # noqa: PLC0415 -- imported on use
    from rvaft.readers.text_lines import PatternReader, SyslogReader  # noqa: PLC0415

    found = profile(name)
    base = None if found.input == "text" else reader(found.input, InputOptions(found.records, year=year))
    if base is not None and not found.pattern:
        if found.text or found.where:
            raise OptionError(f"{name}: text and where need a table [[pattern]]")
        return base
    if not found.pattern or (base is None and (found.text or found.where)):
        raise OptionError(f"{name}: the input text needs a table [[pattern]], and has neither text nor where")
    if base is not None and not isinstance(base, SyslogReader):
        raise OptionError(f"{name}: patterns need the input text or syslog, not {found.input}")
    return PatternReader(found.pattern, base=base, text=found.text or "message", where=found.where or {})


def live_events(url: str, *, warn: Callable[[str], object] = warnings.warn) -> AsyncIterator[dict[str, Json]]:
    """Yield the live events of a URL asynchronously, for `rvaft.watch`.

    The connection ends with the iteration. `warn` is called at once if events may be lost. Raises
    what `read_log` raises.

    >>> import rvaft
    >>> async def first(tree):  # the first event that detects the tree
    ...     async for event, verdict in rvaft.watch(tree, rvaft.live_events("mqtt://localhost/doors/#")):
    ...         if verdict is rvaft.Verdict.TRUE:
    ...             return event
    """
    from asyncio import to_thread  # noqa: PLC0415

    expect("the URL", url, str, "a text")
    chosen, ended = reader(format_of(url)), False
    if not chosen.schemes:
        raise OptionError("live events need a URL; use rvaft.read_log for files")
    events = _events(url, chosen.shown(url), chosen, None, Live(stop=lambda: ended, warn=warn), within=None)

    async def coming() -> AsyncIterator[dict[str, Json]]:
        nonlocal ended
        try:
            while (event := await to_thread(next, events, None)) is not None:
                yield event
        finally:
            ended = True
            with suppress(ValueError):  # the waiting thread ends by itself
                events.close()

    return coming()


def _events(
    source: Source, name: str, chosen: LogReader, reads: Scope | None, live: Live, *, within: Path | None
) -> Generator[dict[str, Json], None, None]:
    with (
        source_of(chosen, os.fspath(source), within)
        if isinstance(source, (str, os.PathLike))
        else nullcontext(source) as opened
    ):
        log = Log(chosen, opened, name, reads, live=live)
        yield from (event for event in log.events() if event is not None)
    if (fault := log.fault) is not None:
        if log.is_malformed(log.given):
            raise fault
        live.warn(str(fault))


class UnknownFormat(RvaftError, LookupError):
    """No reader of that format is registered.

    >>> print(UnknownFormat("cvs", ("csv", "json")))
    unknown format cvs; known: csv, json; did you mean csv?
    """

    def __init__(self, name: str, known: tuple[str, ...]) -> None:
        self.name = name
        self.known = known
        super().__init__(f"unknown format {name}; known: {', '.join(known) or 'none'}{did_you_mean(name, known)}")
