"""The formats of logs that are known, those of other packages too, and which of them a log has.

Readers are found by the entry points `rvaft.readers` and imported on use.
"""

import os
import warnings
from collections.abc import AsyncIterator, Callable, Generator, Iterator, Mapping
from contextlib import nullcontext, suppress
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Final

from rvaft.core.classifier import Scope
from rvaft.errors import OptionError, RvaftError, ToolFailed, WrongType, expect
from rvaft.model.values import Json
from rvaft.readers.bag import message_event
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
from rvaft.rules.rule import did_you_mean

__all__ = [
    "LogReader",
    "UnknownFormat",
    "all_readers",
    "live_events",
    "message_event",
    "read_log",
]

GROUP: Final = "rvaft.readers"


@cache
def all_readers() -> Mapping[str, EntryPoint]:
    """Every registered reader by the name of its format, without importing any.

    >>> sorted({"csv", "json", "jsonl"} & set(all_readers()))
    ['csv', 'json', 'jsonl']
    """
    return {entry.name: entry for entry in sorted(entry_points(group=GROUP), key=lambda entry: entry.name)}


def reader_class(name: str) -> type[LogReader]:
    """The class of the reader of that name, imported now.

    Raises `UnknownFormat`, and `ToolFailed` for one that cannot be loaded.
    """
    found = all_readers()
    if name not in found:
        raise UnknownFormat(name, tuple(found))
    try:
        made: type[LogReader] = found[name].load()
    except Exception as error:  # a third party's module may fail in any way
        reason = f"it cannot be loaded: {type(error).__name__}: {error}"
        raise ToolFailed(f"the reader of {name}", reason=reason) from error
    if lacking := sorted(getattr(made, "__abstractmethods__", ())):
        raise ToolFailed(f"the reader of {name}", reason=f"{made.__name__} does not define {', '.join(lacking)}")
    return made


def reader(name: str, options: InputOptions = InputOptions()) -> LogReader:  # noqa: B008 (immutable)
    """The reader of the format of that name, imported now.

    Raises `UnknownFormat`, `ToolFailed` for one that cannot be loaded, and `OptionError` for
    options that it does not take.

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
    """The suffixes of logs of all formats.

    >>> ".csv" in suffixes()
    True
    """
    found = set[str]()
    for name in all_readers():
        with suppress(ToolFailed):
            found.update(reader_class(name).suffixes)
    return frozenset(found)


def format_of(file: str, options: InputOptions = InputOptions()) -> str:  # noqa: B008 (immutable)
    """The name of the format of a file or URL: that of a reader which it suits, or else JSON Lines.

    Raises `OptionError` for a URL that none reads.

    >>> format_of("monday.csv.gz"), format_of("monday.log")
    ('csv', 'jsonl')
    """
    path, known = Path(file), dict[str, str]()
    if (begins := scheme(file)) and not path.exists():
        for name in all_readers():
            with suppress(ToolFailed):
                known |= dict.fromkeys(reader_class(name).schemes, name)
        if begins not in known:
            raise OptionError(f"nothing is read from {begins}://, but from {', '.join(f'{one}://' for one in known)}")
        return known[begins]
    if suffix(path) in JsonLinesReader.suffixes:
        return JsonLinesReader.name
    for name in all_readers():
        with suppress(ToolFailed):  # one of somebody else that is broken; the others still count
            if reader_class(name).suits(path, options):
                return name
    return JsonLinesReader.name


def read_log(
    source: Source,
    form: str | None = None,
    *,
    name: str | None = None,
    records: str | None = None,
    types: Mapping[str, FieldType | str] | None = None,
    pattern: str | None = None,
    reads: Scope | None = None,
    warn: Callable[[str], object] = warnings.warn,
) -> Iterator[dict[str, Json]]:
    """The events of a log in turn: of a file by its name, compressed or not, or of a binary stream,
    which is JSON Lines unless `form` says else.

    Of a URL they come by themselves, without end; `live_events` is for asynchronous code.

    `form` names a format; `records`, `types` and `pattern` are as for `rvaft monitor`. What is no
    event is left out. After the last event that is told: to `warn` for text of which not all need
    be events, or else as `TraceError`. Raises `TraceError` also for what cannot be read on,
    `UnknownFormat`, `OptionError`, `ToolMissing`, and `OSError` for a file that cannot be opened.

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
    options = InputOptions(records, kinds, pattern)
    if isinstance(source, (str, os.PathLike)):
        file = os.fspath(source)
        chosen = reader(form or format_of(file, options), options)
    elif hasattr(source, "read"):
        file = name or "<trace>"
        chosen = reader(form or JsonLinesReader.name, options)
        required_stream(chosen, source)
    else:
        raise WrongType("the source of a log", source, "a path or a binary stream")
    return _events(source, name or chosen.shown(file), chosen, reads, Live(warn=warn))


def live_events(url: str, *, warn: Callable[[str], object] = warnings.warn) -> AsyncIterator[dict[str, Json]]:
    """The events of a URL as they come, for `rvaft.watch`; the connection ends with the iteration.

    What may have been missed is told to `warn` at once. Raises what `read_log` raises.

    >>> import rvaft
    >>> async def first(tree):  # the first event that detects the tree
    ...     async for event, verdict in rvaft.watch(tree, rvaft.live_events("mqtt://localhost/doors/#")):
    ...         if verdict is rvaft.Verdict.TRUE:
    ...             return event
    """
    from asyncio import to_thread  # noqa: PLC0415 -- imported on use

    expect("the URL", url, str, "a text")
    chosen, ended = reader(format_of(url)), False
    if not chosen.schemes:
        raise OptionError("events come by themselves from a URL alone: rvaft.read_log reads files")
    events = _events(url, chosen.shown(url), chosen, None, Live(stop=lambda: ended, warn=warn))

    async def coming() -> AsyncIterator[dict[str, Json]]:
        nonlocal ended
        try:
            while (event := await to_thread(next, events, None)) is not None:
                yield event
        finally:
            ended = True
            with suppress(ValueError):  # a thread that still waits will see that it is the end
                events.close()

    return coming()


def _events(
    source: Source, name: str, chosen: LogReader, reads: Scope | None, live: Live
) -> Generator[dict[str, Json], None, None]:
    with (
        source_of(chosen, os.fspath(source))
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
    """No reader of a format of that name is registered.

    >>> print(UnknownFormat("cvs", ("csv", "json")))
    unknown format cvs; known: csv, json; did you mean csv?
    """

    def __init__(self, name: str, known: tuple[str, ...]) -> None:
        self.name = name
        self.known = known
        super().__init__(f"unknown format {name}; known: {', '.join(known) or 'none'}{did_you_mean(name, known)}")
