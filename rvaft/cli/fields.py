"""`rvaft fields` and `rvaft infer`: what a log has, and a tree to start from."""

from contextlib import nullcontext
from typing import Final, cast

import click

from rvaft.cli import log_options, options, warn
from rvaft.cli.monitor import source_of as trace_of
from rvaft.errors import OptionError
from rvaft.readers.log import Log, LogSource, expanded, source_of
from rvaft.readers.profile import profile
from rvaft.reports.log_fields import LogFields, fields_json, fields_text, inferred_tree
from rvaft.stream.keys import Field
from rvaft.support.files import deliver
from rvaft.support.terminal import ProgressBar, readable_json, visible

_BY: Final = "Field whose value is the kind of an event.  [default: chosen by the first 1,000 events]"
_OFTEN: Final = 1_000


def log_argument(function: options.F) -> options.F:
    """Add the argument LOG, `--by` and the options of formats."""
    by = click.option("--by", metavar="FIELD", help=_BY)
    return click.argument("log", metavar="LOG")(by(log_options.log_format(options.year_option(function))))


def _read(log: str, by: str | None, log_format: log_options.LogFormat) -> LogFields:
    """Read a log; raises `TraceError` if it is damaged or malformed."""
    files = expanded(log)
    options.refuse(len(files) > 1, f"{log} matches {len(files)} files: name one log")
    [chosen] = log_format.readers(files)
    trace = trace_of(files[0], chosen)
    declared = None if log_format.options.profile is None else profile(log_format.options.profile)
    by = by if by is not None or declared is None else declared.by
    time = None if declared is None else declared.time
    found = LogFields(None if by is None else Field.parse(by).text, time, log_format.options.year)
    file = trace.file
    progress = ProgressBar(trace.size, "reading")
    opened = nullcontext(cast("LogSource", trace.events)) if file is None else source_of(chosen, file)
    with opened as source:
        read = Log(chosen, source, trace.name)
        for number, event in enumerate(read.events()):
            if event is not None:
                found.add(event)
            if number % _OFTEN == 0:
                progress.reach(source)
        found.finish()
        progress.hide()
    if (fault := read.fault) is not None:
        if read.is_malformed(read.given):
            raise fault
        warn(str(fault))
    if by is not None and found.events and not found.kinds:
        raise OptionError(f"no event has a text or an integer in {by}: see rvaft fields without --by")
    return found


@click.command("fields")
@log_argument
@options.output_format("text", "json")
def fields_command(*, log: str, by: str | None, log_format: log_options.LogFormat, form: str) -> int:
    """List the kinds of events in LOG, the fields of each, and candidates for the time.

    LOG is given as for `monitor`; it ends. A list is one value. Memory is bounded: at most 200 kinds, 200 fields
    each, six names deep; the output says what was not counted.
    """
    found = _read(log, by, log_format)
    if form == "json":
        click.echo(readable_json(fields_json(found), indent=2))
    else:
        click.echo("\n".join(map(visible, fields_text(found))))
    return 0


@click.command("infer")
@log_argument
@options.output_option
def infer_command(*, log: str, by: str | None, log_format: log_options.LogFormat, output: str | None) -> int:
    """Write a tree to start from: typed event types for the kinds of events in LOG, and the
    assumptions that hold on it.

    LOG is given as for `fields`. The tree detects every event of a kind; edit it as its comments say.
    """
    options.require_writable([output or "-"], [log])
    deliver(inferred_tree(_read(log, by, log_format)).encode(), output)
    return 0
