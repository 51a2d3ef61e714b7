"""The options that state the format of logs."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import wraps
from typing import Any, Final, cast

import click

from rvaft.cli.options import F, read_named, refuse, standard_input
from rvaft.readers.json_lines import JsonLinesReader
from rvaft.readers.log import (
    OF_FORMATS,
    SHIPPED,
    FieldType,
    InputOptions,
    LogReader,
    LogSource,
    required_stream,
    source_of,
)
from rvaft.readers.registry import format_of, profile_reader, reader, reader_class
from rvaft.support.wording import listing

strict_json: Final = click.option(
    "--strict-json", is_flag=True, help="Refuse NaN, infinities and overflowing numbers, which are not valid JSON."
)


@dataclass(frozen=True, slots=True)
class LogFormat:
    """The log format chosen by the options."""

    form: str | None
    options: InputOptions

    def readers(self, files: Sequence[str], *, live: bool = False) -> list[LogReader]:
        """Return a reader for each file (`-`: standard input); URLs must be `live`.

        Raises `OptionError`, `UnknownFormat` and `ToolFailed`.
        """
        if (name := self.options.profile) is not None:
            others = self.form is not None or len(self.options.given) > 1
            refuse(others, "--profile states the format: omit --input, --records, --types and --pattern")
            if name.endswith(".toml"):
                read_named(name)  # is one that may be read
            return [profile_reader(name, self.options.year) for _ in files]
        found: list[LogReader] = []
        unused = self.options.given
        for file in files:
            name = self.form or (JsonLinesReader.name if file == "-" else format_of(file, self.options))
            takes = reader_class(name).takes
            unused -= takes
            found.append(reader(name, self.options.only(takes)))
            refuse(
                found[-1].schemes and not live,
                "only rvaft monitor and rvaft view --follow read URLs, since their events do not end",
            )
        names = listing(sorted({one.name for one in found}), "nor")
        refuse(
            files and unused,
            f"--{min(unused, default='')} is not for the format {names}: choose one with --input FORMAT",
        )
        return found


def _types(_context: object, _parameter: object, given: Sequence[str]) -> dict[str, FieldType]:
    found: dict[str, FieldType] = {}
    for part in (part for text in given for part in text.split(",")):
        name, _, kind = part.rpartition("=")
        if not name or kind not in tuple(FieldType):
            known = ", ".join(FieldType)
            raise click.BadParameter(f"{part!r} is not FIELD=TYPE with one of the types {known}")
        if found.get(name, kind) != kind:
            raise click.BadParameter(f"{name} has two types: {found[name]} and {kind}")
        found[name] = FieldType(kind)
    return found


def log_format(function: F) -> F:
    """Add `--input` and the options of formats, as a `LogFormat` in `log_format`."""

    @wraps(function)
    def gathered(**given: Any) -> Any:
        year = click.get_current_context().meta.get("year")
        named = {name: given.pop(name) for name in OF_FORMATS}
        input_options = InputOptions(year=year, **named)
        log_format = LogFormat(given.pop("input_form"), input_options)
        return function(**given, log_format=log_format)

    known = "bag, can, csv, json, jsonl, mavlink, mqtt, parquet, regex, syslog, ulog, xes, zeek"
    what = f"Log format: {known}, or that of a plug-in.  [default: by the suffix of the file, else jsonl]"
    form = click.option("--input", "input_form", metavar="FORMAT", help=what)
    records = click.option(
        "--records", metavar="PATH", help="Path of the list of events in a JSON document.  [default: Records]"
    )
    kinds = "Types of fields that the log has as texts: number, text or bool."
    types = click.option("--types", multiple=True, metavar="FIELD=TYPE,...", callback=_types, help=kinds)
    pattern = click.option(
        "--pattern", metavar="REGEX", help="With --input regex: the pattern of a line; named groups are the fields."
    )
    what = f"Profile of a product's logs: {', '.join(SHIPPED)}, or a .toml file."
    declared = click.option("--profile", metavar="NAME", help=what)
    dbc = click.option(
        "--dbc", metavar="FILE", help="With a CAN log: the DBC file that names its messages and signals."
    )
    what = "With a recording of ROS: a folder with the message definitions that it lacks, as PACKAGE/msg/NAME.msg."
    messages = click.option("--messages", metavar="FOLDER", help=what)
    return cast("F", form(declared(records(types(pattern(dbc(messages(gathered))))))))


@contextmanager
def opened(reader: LogReader, file: str) -> Iterator[tuple[LogSource, str]]:
    """Open a log, or standard input (`-`), and yield it with its name for messages."""
    if file == "-":
        yield required_stream(reader, standard_input("LOG")), "<stdin>"
    else:
        with source_of(reader, file) as source:
            yield source, click.format_filename(file)
