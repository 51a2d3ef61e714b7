"""`rvaft rates`: estimate the rates of the leaves of a tree from logs."""

import json
import math
import sys
from typing import Final

import click

from rvaft.cli import FAILED, Failures, log_options, options, warn
from rvaft.cli.horizon import number_text
from rvaft.core.fields_to_read import TreeReads
from rvaft.model.event_time import UNITS
from rvaft.model.expressions import name_text
from rvaft.model.quantities import NANOSECONDS
from rvaft.readers.log import Interest, Log, expanded
from rvaft.risk.model import of_tree
from rvaft.risk.rates import Rate, RateEstimate
from rvaft.stream.detection import identifying_fields
from rvaft.support.terminal import columns
from rvaft.support.wording import counted

_UNIT: Final = "The unit of time of the rates."


@click.command("rates")
@options.tree_argument
@click.argument("logs", nargs=-1, required=True, metavar="LOG...")
@options.choice("--per", "unit", words=tuple(UNITS), default="h", text=_UNIT)
@log_options.log_format
@log_options.strict_json
@options.output_format("text", "json", "tree")
def rates_command(
    *,
    tree: str,
    logs: tuple[str, ...],
    unit: str,
    log_format: log_options.LogFormat,
    strict_json: bool,
    form: str,
) -> int:
    """Estimate the rates of the leaves of a tree from the times of the events in LOGs.

    Each LOG is observed from its first to its last event. A rate is the number of events divided by
    the time, with an exact interval of 95 % confidence. With --format tree, the output is statements
    to append to the tree, or to import.
    """
    whole = options.load_tree(tree)
    estimate = RateEstimate(whole, of_tree(whole))
    failures = Failures()
    files = [file for some in failures.collect(expanded, logs) for file in some]
    for file, reader in zip(files, log_format.readers(files), strict=True):
        with failures.reported(), log_options.opened(reader, file) as (source, name):
            reads = TreeReads(whole)
            log = Log(reader, source, name, reads, strict_json, interest=Interest.of(reads, identifying_fields(whole)))
            estimate.add(event for event in log.events() if event is not None)
            if log.is_malformed(log.given) and log.fault is not None:
                raise log.fault
            if log.fault is not None:
                warn(str(log.fault))
    if failures.met:
        warn("nothing is estimated, since not all logs could be read")
        return FAILED
    sys.stdout.write(_written(list(estimate.rates()), unit, form))
    return 0


def _written(found: list[Rate], unit: str, form: str) -> str:
    size = UNITS[unit] / NANOSECONDS
    if form == "json":
        rows = [
            {"leaf": one.leaf, "events": one.events, "seconds": one.seconds, "left_out": one.left_out}
            | (
                {}
                if one.left_out
                else {"unit": unit, "rate": one.rate * size, "low": one.low * size, "high": one.high * size}
            )
            for one in found
        ]
        return json.dumps(rows, indent=2) + "\n"
    if form == "tree":
        return "".join(f"{_statement(one, unit, size)}\n" for one in found)
    table = [("LEAF", "EVENTS", "TIME", f"RATE/{unit}", "95 % INTERVAL", "")]
    for one in found:
        time = f"{number_text(one.seconds / size)} {unit}"
        if one.left_out:
            table.append((one.leaf, str(one.events), time, "-", "-", one.left_out))
        else:
            interval = f"{one.low * size:.4g} to {one.high * size:.4g}"
            table.append((one.leaf, str(one.events), time, f"{one.rate * size:.6g}", interval, ""))
    return "".join(f"{line}\n" for line in columns(table))


def _statement(one: Rate, unit: str, size: float) -> str:
    if one.left_out:
        return f"// {one.leaf}: {one.left_out}"
    if not one.events or not math.isfinite(one.rate):
        return f"// {one.leaf}: no event was seen; with 95 % confidence, the rate is below {one.high * size:.4g}/{unit}"
    note = f"{counted(one.events)}; 95 %: {one.low * size:.4g} to {one.high * size:.4g}"
    return f"{name_text(one.leaf)} lambda={one.rate * size:.6g}/{unit}; // {note}"
