"""`rvaft monitor`: watch events for a tree and give verdicts."""

import sys
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any, ClassVar, Final

import click

from rvaft.api import translate
from rvaft.cli import FAILED, Failures, log_options, options, warn
from rvaft.cli.alerts import FORMS, Template
from rvaft.cli.horizon import Horizon, time_option
from rvaft.cli.monitor_output import AFRESH, REPORTERS, MonitorSettings
from rvaft.cli.monitor_run import SUFFIXES, TraceSource, run
from rvaft.cli.trees import ONE_BRANCH, TreesCommand, about, loaded, trees_given
from rvaft.engine.monitor import Engine, repeating_engine
from rvaft.errors import NotExpressible, TooLarge
from rvaft.export import PICTURES, format_of
from rvaft.model.event_time import duration_text
from rvaft.model.expressions import on_text
from rvaft.model.nodes import Kind
from rvaft.model.patterns import match
from rvaft.model.tree import RVAFT, resolve_repetition, resolve_semantics
from rvaft.model.values import has_surrogate
from rvaft.model.verdict import Semantics
from rvaft.monitors import DEFAULT_LIMIT, Monitor
from rvaft.readers.json_lines import JsonLinesReader
from rvaft.readers.log import InputOptions, LogReader, expanded, required_stream
from rvaft.readers.merged import MergedReader
from rvaft.rules.validity import valid_part
from rvaft.stream.checkpoint import EVERY, CheckpointFile
from rvaft.stream.detection_commands import Hooks
from rvaft.stream.keys import MAX_DISTINCT, MAX_KEYS, Field, Key
from rvaft.stream.monitor_set import MonitorSet, Per, columns
from rvaft.stream.order import DEFAULT_WINDOW
from rvaft.stream.plan import MonitoringPlan
from rvaft.stream.publishers import publisher_class
from rvaft.stream.whole_log import QueryEngine, engine_class
from rvaft.support import output
from rvaft.support.files import note_input, require_target
from rvaft.support.wording import listing

if TYPE_CHECKING:
    from rvaft.cli.metrics import MetricsFile
    from rvaft.cli.monitor_risk import RiskListener
    from rvaft.cli.native_run import NativeRun

TERMINAL: Final = "-"
"""The value of `--explain` without FILE: draw in the text."""


class MonitorCommand(TreesCommand):
    """Parses `--explain [FILE]`, where FILE must have a drawing suffix, and `TREE... -- LOG...`."""

    groups: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "What is detected": ("semantics", "branch", "kind", "per", "word"),
        "The log": (
            *(
                "input_form",
                "profile",
                "records",
                "types",
                "pattern",
                "dbc",
                "messages",
                "merge",
                "order_by",
                "window",
                "distinct",
            ),
            *("max_distinct", "strict_json"),
        ),
        "Detections": ("repeat", "repeat_by", "cooldown", "key", "max_keys"),
        "Live logs": ("follow", "clock", "complete", "checkpoint", "checkpoint_every"),
        "Output": ("explain", "form", "detections", "template", "foxglove", "metrics"),
        "Risk": ("risk", "risk_above"),
        "Reactions": ("execute", "exec_fault", "exec_attack"),
        "Speed and limits": ("native", "engine", "backend", "jobs", "max_configurations"),
    }

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse, after making a bare `--explain` explicit."""
        made: list[str] = []
        for place, word in enumerate(args):
            if word == "--":
                made += args[place:]
                break
            following = args[place + 1] if place + 1 < len(args) else ""
            bare = word == "--explain" and PurePath(following).suffix.lower() not in SUFFIXES
            made.append(f"--explain={TERMINAL}" if bare else word)
        return super().parse_args(ctx, made)


def _drawable(_context: click.Context, _parameter: click.Parameter, value: str | None) -> str | None:
    if value is not None and value != TERMINAL and PurePath(value).suffix.lower() not in SUFFIXES:
        raise click.BadParameter(f"{value!r} has none of the suffixes {', '.join(SUFFIXES)}")
    return value


_UNQUERIED: Final = {
    "word": "a query reads a file",
    "backend": "choose one of them",
    "native": "choose one of them",
    "follow": "a query reads a whole file",
    "checkpoint": "a query reads a whole file",
    "order_by": "a query reads the events in the order of the file",
    "distinct": "a query reads every event",
    "foxglove": "it follows the events one by one",
    "strict_json": "DuckDB reads the words NaN and Infinity",
}
"""Options that an engine cannot honour, each with the reason."""
_OF_ONE_TREE: Final = {
    "native": "a compiled monitor has one; a program for each is made by rvaft build",
    "engine": "a query selects the events of one",
    "foxglove": "a server or file shows one",
}
"""Options that cannot serve several trees, each with the reason."""
_EXPLAIN: Final = "Draw the detections in the text, and list near misses; or draw the first detection to FILE."
_EXAMPLES: Final = """\b
Examples:
  rvaft monitor guessing.rvaft auth.jsonl --explain
  rvaft monitor guessing.rvaft logs/*.jsonl --repeat-by User --format ecs
  journalctl -f -o json | rvaft monitor guessing.rvaft --profile journald
"""
RISK: Final = "After each event, the probability of a detection within this time, as in '1 h'."
_ABOVE: Final = "With --risk and --exec: also run the command when the risk rises above this probability."
_METRICS: Final = "Write counts of events and detections to FILE every 5 seconds, for Prometheus."
_KEY: Final = "Monitor each value of this field separately; repeat for a key of several fields."
_DISTINCT: Final = "Skip an event whose id in this field came before; repeat for an id of several fields."
_ORDER: Final = "Sort events by this field, a number or an ISO 8601 time."
_MOST: Final = f"Maximum number of partial matches per monitor.  [default: {DEFAULT_LIMIT}]"


def stream_options(function: options.F) -> options.F:
    """Add `--key`, `--max-keys`, `--distinct`, `--max-distinct`, `--order-by` and `--window`."""
    for option in (
        options.number("--window", text=f"Number of events that --order-by holds back.  [default: {DEFAULT_WINDOW}]"),
        click.option("--order-by", metavar="FIELD", help=_ORDER),
        options.number("--max-distinct", text=f"Number of ids that are remembered.  [default: {MAX_DISTINCT}]"),
        click.option("--distinct", multiple=True, metavar="FIELD", help=_DISTINCT),
        options.number("--max-keys", text=f"Maximum number of values of --key.  [default: {MAX_KEYS}]"),
        click.option("--key", multiple=True, metavar="FIELD", help=_KEY),
    ):
        function = option(function)
    return function


merge_option: Final = click.option(
    "--merge", is_flag=True, help="Read all logs as one, in the order of the times of their events."
)
limit_option: Final = options.number("--max-configurations", text=_MOST)
"""The error beyond the limit also names this option."""


@click.command("monitor", cls=MonitorCommand, epilog=_EXAMPLES)
@click.argument("tree", metavar="TREE... [--]")
@options.reading_options
@options.semantics_option
@options.part_options
@click.argument("traces", nargs=-1, metavar="[TRACE]...")
@click.option("--word", metavar='"b a c"', help="Monitor the default events of these names instead of a trace.")
@click.option("--backend", metavar="BACKEND", help="Run the specification of this backend instead of the engine.")
@click.option("--engine", metavar="duckdb", help="Select the events of a whole log by a query in this database.")
@options.choice("--per", words=Per, default=Per.TREE, text="Also monitor each branch or each kind.")
@options.output_format(*REPORTERS, *FORMS)
@click.option("--template", metavar="TEXT|@FILE", help="Print each detection as this text with placeholders.")
@click.option("--detections", is_flag=True, help="With --format jsonl, print only events that detect.")
@click.option("--explain", metavar="[FILE]", callback=_drawable, help=_EXPLAIN)
@options.repeat_options
@stream_options
@click.option("--native", is_flag=True, help="Compile the monitor, which needs a C compiler.")
@click.option("--follow", is_flag=True, help="Keep reading as the file grows, until Ctrl-C.")
@options.deadline_options
@log_options.log_format
@log_options.strict_json
@merge_option
@options.number("--jobs", default=1, text="Number of processes.")
@time_option("--risk", "risk", RISK)
@click.option("--risk-above", type=click.FloatRange(0, 1), callback=options.finite, metavar="P", help=_ABOVE)
@click.option("--exec", "execute", metavar="CMD", help="Run this command on each detection.")
@click.option("--exec-fault", metavar="CMD", help="Run this command on each detection of a fault.")
@click.option("--exec-attack", metavar="CMD", help="Run this command on each detection of an attack.")
@click.option(
    "--foxglove", metavar="PORT|FILE", help="Send detections to Foxglove at PORT, or write them to FILE.mcap."
)
@click.option("--metrics", metavar="FILE", help=_METRICS)
@click.option("--checkpoint", metavar="FILE", help="Save the state in FILE, and continue from it.")
@options.number("--checkpoint-every", text=f"Number of events between checkpoints.  [default: {EVERY}]")
@limit_option
def monitor_command(*, tree: str, branch: int | None, kind: Kind | None, **given: Any) -> int:
    """Monitor the events of each TRACE and print changes of the verdict.

    A TRACE is a file in JSON Lines, or in the format given by its suffix or --input. It may be a
    pattern such as 'logs/**/*.jsonl', or a URL such as mqtt://HOST/TOPIC. Without a TRACE, or with -, events come
    from standard input. The exit status is 1 if a trace detects the tree.

    Several trees, as in 'rvaft monitor a.rvaft b.rvaft -- LOG', or all trees of a folder share the reading of each
    TRACE. Each tree is monitored on its own, and the output names it.
    """
    options.refuse(tree == "-", "TREE is a file: standard input is read as a log")
    files, given["traces"] = trees_given(tree, given["traces"])
    _check(given)
    wholes = loaded(files)
    many = len(wholes) > 1
    if many:
        _check_many(given, branch)
    plans: list[MonitoringPlan] = []
    native_run = None
    for file, whole in wholes.items():
        with about(file, many=many):
            part, semantics = valid_part(whole, branch, kind), resolve_semantics(whole, given["semantics"])
            native_run = _native_run(part, semantics, given) if given["native"] else None
            plans.append(plan_of(part, whole, given, native_run))
    parts = [plan.monitors.columns[0].part for plan in plans]
    engine: QueryEngine | None = None if given["engine"] is None else engine_class(given["engine"])(plans[0])
    traces = _traces(given, list(wholes.values()))
    if given["merge"]:
        traces.merge(wholes.values())
    if given["native"]:
        from rvaft.cli import native  # noqa: PLC0415 -- imported on use

        other = next((one.reader.name for one in traces.sources if one.reader is not None), None)
        options.refuse(other, f"--native reads JSON Lines, not {other}: omit --native, or convert the log")
        logs = [one.file for one in traces.sources if one.file is not None]
        readable = all(one.is_plain for one in traces.sources) and not has_surrogate("".join(logs))  # UTF-8
        if native.works_alone(given) and readable:
            semantics = plans[0].monitors.semantics
            how = {"repeat": given["repeat"], "by": _repeat_by(parts[0], given), "detections": given["detections"]}
            status = native.run(parts[0], semantics, logs, **how)
            if len(logs) > 1 and status == 0:
                warn(AFRESH.format(what="nothing was detected"))
            return FAILED if traces.missing.met else status
    _check_traces(given, traces, engine)
    _check_repetition(given, wholes.values())
    if engine is None and native_run is not None and (given["form"] == "text" or given["detections"]):
        engine = native_run.engine(plans[0])
    checkpoints = _checkpoints(given, traces.sources, plans)
    drawing = None if given["explain"] == TERMINAL else given["explain"]
    options.require_writable(one for one in (drawing, given["checkpoint"], given["metrics"]) if one is not None)
    metrics = _metrics(given)
    hooks, risks = _reactions(given, wholes, plans)
    settings = [
        MonitorSettings(
            plan,
            whole,
            name=click.format_filename(file),
            **{option: given[option] for option in ("per", "detections", "template")},
            form=given["form"] if given["template"] is None else "template",
            follow=given["follow"] or traces.live,
            clock=given["clock"],
            complete=given["complete"],
            several=traces.several,
            drawn=given["explain"] == TERMINAL,
            near=_has_near_misses(given, part) and engine is None and native_run is None,
            drawing=drawing,
            hooks=hooks,
            checkpoints=checkpoints,
            engine=engine,
            native=native_run,
            others=() if metrics is None else (metrics.of(click.format_filename(file)),),
            risk=risk,
            unchosen=given["semantics"] is None and whole.semantics is None and given["backend"] is None,
            many=many,
        )
        for (file, whole), plan, part, risk in zip(wholes.items(), plans, parts, risks, strict=True)
    ]
    for one in settings if given["template"] is not None else ():
        with about(one.name, many=many):
            Template(given["template"], one)
    if given["foxglove"] is not None:
        endless = traces.live or given["follow"] or (traces.streams and given["word"] is None)
        status = _with_foxglove(settings[0], traces.sources, given["foxglove"], given["jobs"], endless=endless)
    else:
        status = run(settings, traces.sources, given["jobs"])
    if metrics is not None:
        metrics.write()
    return FAILED if traces.missing.met else status


def _metrics(given: Mapping[str, Any]) -> "MetricsFile | None":
    """Return the file of counts, if one is asked for."""
    if given["metrics"] is None:
        return None
    from rvaft.cli.metrics import MetricsFile  # noqa: PLC0415 -- imported on use

    options.refuse(given["jobs"] > 1, "--metrics counts in one process: omit --jobs")
    for name in ("native", "engine", "foxglove"):
        options.refuse(given[name], f"--metrics counts events one by one: omit --{name}")
    return MetricsFile(Path(given["metrics"]))


def _check_risk(given: Mapping[str, Any]) -> None:
    """Refuse what cannot follow a risk."""
    options.refuse(given["risk_above"] is not None and not given["risk"], "--risk-above needs --risk")
    options.refuse(given["risk_above"] is not None and not given["execute"], "--risk-above needs --exec")
    if given["risk"] is None:
        return
    options.refuse(given["jobs"] > 1, "--risk follows the events in one process: omit --jobs")
    require_one_by_one(given)
    options.refuse(given["form"] in FORMS, f"--risk is for the formats {', '.join(REPORTERS)}, not for {given['form']}")


def require_one_by_one(given: Mapping[str, Any]) -> None:
    """Refuse options with which no risk can be followed."""
    for name in ("native", "engine", "backend", "foxglove", "checkpoint", "repeat_by", "order_by", "template"):
        options.refuse(
            given.get(name), f"--risk follows the events of the engine one by one: omit --{name.replace('_', '-')}"
        )


def _reactions(
    given: Mapping[str, Any], files: Iterable[str], plans: Iterable[MonitoringPlan]
) -> "tuple[Hooks, list[RiskListener | None]]":
    """Return the commands that run on detections, and what follows the risk of each tree."""
    hooks = Hooks(given["execute"], {Kind.FAULT: given["exec_fault"], Kind.ATTACK: given["exec_attack"]})
    return hooks, [_risk(file, plan, given, hooks) for file, plan in zip(files, plans, strict=True)]


def _risk(file: str, plan: MonitoringPlan, given: Mapping[str, Any], hooks: Hooks) -> "RiskListener | None":
    """Return what follows the risk of a tree, if it is asked for."""
    if given["risk"] is None:
        return None
    from rvaft.cli.monitor_risk import risk_listener  # noqa: PLC0415 -- imported on use

    horizon: Horizon = given["risk"]
    return risk_listener(file, plan, horizon, given["risk_above"], hooks)


def _has_near_misses(given: Mapping[str, Any], part: RVAFT) -> bool:
    """Whether the text of the engine's run over a tree ends with near misses."""
    text = given["explain"] == TERMINAL and given["form"] == "text" and given["template"] is None
    of_kind = part.part_of is not None and part.part_of.kind is not None
    return text and not given["detections"] and not given["repeat"] and given["backend"] is None and not of_kind


def _traces(given: dict[str, Any], trees: Sequence[RVAFT]) -> "TracesGiven":
    """Return the traces, or the events of `--word`."""
    names = given["traces"] or ("-",)
    if given["word"] is not None:
        options.refuse(
            given["log_format"] != log_options.LogFormat(None, InputOptions()),
            "--word is no log: omit --input and the options of formats",
        )
        names = ()
    traces = TracesGiven(names, given["log_format"], live=True)
    if given["word"] is not None:
        traces.sources.append(_word(given["word"], trees))
    return traces


def _check_traces(given: dict[str, Any], traces: "TracesGiven", engine: QueryEngine | None) -> None:
    """Refuse traces that the options do not suit."""
    if engine is not None:
        traces.require_whole(engine)
    if traces.live:
        options.refuse(traces.several, "events from a URL do not end: name one TRACE only")
        why = "--checkpoint needs a log that can be read again: events from a URL cannot"
        options.refuse(given["checkpoint"] is not None, why)
        given["follow"] = False
    for option in ("follow", "checkpoint"):
        if given[option] not in (None, False):
            traces.require_growing(f"--{option}", "TRACE")
    wrong = given["jobs"] > 1 and traces.streams and given["word"] is None
    options.refuse(wrong, "--jobs is for files: standard input is read by one process")
    if given["clock"] is not None:
        wrong = not (given["follow"] or traces.live)
        options.refuse(wrong, "--clock needs events that arrive: --follow, or a URL; a finished log takes --complete")
        options.refuse(given["order_by"], "--clock gives the present time, but --order-by holds events back")
    for option in ("clock", "complete"):
        wrong = given[option] and (given["backend"] is not None or given["native"] or engine is not None)
        options.refuse(
            wrong, f"--{option.replace('_', '-')} is for monitors of the engine: omit --backend, --native or --engine"
        )
    if given["follow"] or traces.live:
        output.unblock()


def _repeat_by(tree: RVAFT, given: Mapping[str, Any]) -> str | None:
    """Return the variable by which the monitor of a tree or part is repeated."""
    return resolve_repetition(tree, given["repeat_by"], repeat=given["repeat"])


def _check_repetition(given: Mapping[str, Any], trees: Collection[RVAFT]) -> None:
    """Refuse repetition by a variable where a monitor only starts afresh as a whole, and a clock without times."""
    options.require_times(given["clock"], trees)
    by = next((by for tree in trees if given["backend"] is not None and (by := _repeat_by(tree, given))), None)
    named = "--repeat-by" if given["repeat_by"] is not None else f"`repeat by {by};`"
    options.refuse(by, f"{named} is for monitors of the engine, and --native: omit --backend")


def _check_many(given: Mapping[str, Any], branch: int | None) -> None:
    """Refuse the options that are for a single tree."""
    for name, why in _OF_ONE_TREE.items():
        wrong = given[name] not in (None, False, (), "")
        options.refuse(wrong, f"--{name.replace('_', '-')} is for one tree: {why}")
    options.refuse(branch is not None, ONE_BRANCH)
    options.refuse(given["form"] == "table", "--format table is for one tree: it has a column for each verdict of it")
    drawn = given["explain"] not in (None, TERMINAL)
    options.refuse(drawn, "--explain FILE is for one tree: omit FILE to draw in the text")


def _checkpoints(
    given: dict[str, Any], sources: Sequence[TraceSource], plans: Sequence[MonitoringPlan]
) -> CheckpointFile | None:
    """Return the checkpoint file of a run, if one is asked for and there is a log."""
    if given["checkpoint"] is None:
        return None
    options.refuse(given["checkpoint"] == "-", "--checkpoint needs a file, not standard output")
    require_target(Path(given["checkpoint"]), regular=True)
    if not sources or (file := sources[0].file) is None:
        return None
    reader = sources[0].reader
    settings_by_option = {
        "--semantics": ", ".join(plan.monitors.semantics for plan in plans),
        "--per": given["per"],
        "--key": ", ".join(given["key"]) or None,
        "--distinct": ", ".join(given["distinct"]) or None,
        "--order-by": given["order_by"],
        "--window": given["window"],
        "--input": None if reader is None else f"{reader.name} {reader.options}",
        "--repeat": "" if given["repeat"] else None,
        "--repeat-by": given["repeat_by"],
        "--cooldown": given["cooldown"] and duration_text(given["cooldown"]),
    }
    return CheckpointFile(
        Path(given["checkpoint"]),
        trees=[plan.monitors.columns[0].part for plan in plans],
        trace=Path(file),
        every=given["checkpoint_every"] or EVERY,
        settings={name: str(value) for name, value in settings_by_option.items() if value is not None},
    )


def _with_foxglove(
    settings: MonitorSettings, traces: Sequence[TraceSource], target: str, jobs: int, *, endless: bool
) -> int:
    options.refuse(jobs > 1, "--foxglove needs a single process: omit --jobs")
    foxglove = publisher_class("foxglove")
    why = "--foxglove PORT needs live events (--follow, a URL or standard input); for a finished log name a FILE.mcap"
    options.refuse(foxglove.serves(target) and not endless, why)
    with foxglove(settings.tree, target, name=settings.name, key=settings.key, warn=warn) as sink:
        if sink.url:
            click.echo(f"rvaft: Foxglove connects to {sink.url}", err=True)
        return run([replace(settings, others=(sink,))], traces)


def _native_run(part: RVAFT, semantics: Semantics, given: Mapping[str, Any]) -> "NativeRun | None":
    """Return the run in which a compiled monitor replaces the engine, or None if that has few partial matches."""
    options.refuse(part.absences, "--native does not say which events were absent: omit --native")
    if semantics is not Semantics.SCATTERED or not Engine(part, semantics).joins:
        return None
    from rvaft.cli.native_run import NativeRun  # noqa: PLC0415 -- imported on use

    key = Key.parse(given["key"]) if given["key"] else None
    try:
        with options.suggesting():
            by, keys = _repeat_by(part, given), given["max_keys"] or MAX_KEYS
            return NativeRun(part, key=key, keys=keys, repeat=given["repeat"] or by is not None, by=by)
    except NotExpressible as error:
        error.add_note("omit --native")
        raise


def plan_of(
    part: RVAFT, whole: RVAFT, given: Mapping[str, Any], native_run: "NativeRun | None" = None
) -> MonitoringPlan:
    """Return how each trace is monitored, by default by the engine."""
    semantics, backend, limit = (
        resolve_semantics(whole, given["semantics"]),
        given.get("backend"),
        given["max_configurations"],
    )
    limit = limit or DEFAULT_LIMIT

    def make(part: RVAFT) -> Monitor:
        if backend is not None:
            with options.suggesting():
                return translate(part, backend, semantics=semantics).monitor()
        if native_run is not None:
            from rvaft.cli.native_run import NativeMatches  # noqa: PLC0415 -- imported on use

            return Engine(part, semantics, strategy=NativeMatches(part, native_run))
        try:
            return repeating_engine(part, semantics, limit=limit, repeat=given["repeat"], by=given["repeat_by"])
        except TooLarge as error:
            if error.limit == limit and not getattr(error, "__notes__", ()):
                error.add_note("--max-configurations allows more")
            raise

    repeating = {"repeat": given["repeat"] or given["repeat_by"] is not None, "cooldown": given["cooldown"]}
    monitors = MonitorSet(columns(part, given["per"]), make, semantics, **repeating)
    if given["order_by"] is not None:
        Field.parse(given["order_by"])
    return MonitoringPlan(
        monitors,
        Key.parse(given["key"]) if given["key"] else None,
        given["max_keys"] or MAX_KEYS,
        given["order_by"],
        given["window"] or DEFAULT_WINDOW,
        given["strict_json"],
        distinct=Key.parse(given["distinct"]) if given["distinct"] else None,
        max_distinct=given["max_distinct"] or MAX_DISTINCT,
    )


def _check(given: dict[str, Any]) -> None:
    refuse, form, explain = options.refuse, given["form"], given["explain"]
    refuse(given["word"] is not None and given["traces"], "--word and TRACE exclude each other")
    # backends provide neither explanations nor kinds nor snapshots
    for name in ("explain", "checkpoint", "max_configurations", "exec_fault", "exec_attack"):
        wrong = given["backend"] is not None and given[name] is not None
        refuse(wrong, f"--{name.replace('_', '-')} needs the engine: omit --backend")
    require_companions(given)
    _check_risk(given)
    if given["native"]:
        from rvaft.cli import native  # noqa: PLC0415 -- imported on use

        native.check(given)
    for name, why in _UNQUERIED.items():
        wrong = given["engine"] is not None and given[name] not in (None, False, (), "")
        refuse(wrong, f"--engine does not take --{name.replace('_', '-')}: {why}")
    wrong = given["engine"] is not None and form == "table"
    refuse(wrong, "--engine does not take --format table, which shows events one by one")
    chosen = "--template" if given["template"] is not None else f"--format {form}"
    refuse(given["template"] is not None and form != "text", f"--template and --format {form} exclude each other")
    alerts = given["template"] is not None or form in FORMS
    refuse(alerts and given["backend"] is not None, f"{chosen} needs the engine: omit --backend")
    why = f"--explain draws among the text: name a FILE for it with {chosen}"
    refuse(explain == TERMINAL and (alerts or form == "jsonl"), why)
    refuse(form == "table" and given["key"], "--format table is for whole traces, not for --key")
    why = "--detections needs --format jsonl: text output already has only changes of the verdict"
    refuse(given["detections"] and form != "jsonl", why)
    drawing = format_of(explain or "")
    if drawing is not None and drawing in PICTURES:
        from rvaft.export.svg import require_pictures  # noqa: PLC0415 -- imported on use

        require_pictures(drawing)


def require_companions(given: Mapping[str, Any]) -> None:
    """Refuse an option without the option that it requires."""
    pairs = (
        ("max_keys", "key"),
        ("max_distinct", "distinct"),
        ("window", "order_by"),
        ("checkpoint_every", "checkpoint"),
    )
    for name, needed in pairs:
        wrong = given.get(name) is not None and given[needed] in (None, ())
        options.refuse(wrong, f"--{name.replace('_', '-')} needs --{needed.replace('_', '-')}")


class TracesGiven:
    """The traces on the command line; missing files are reported."""

    def __init__(self, names: Sequence[str], log_format: log_options.LogFormat, *, live: bool) -> None:
        self.missing = Failures()
        found = list(self.missing.collect(expanded, names))
        files = [file for some in found for file in some]
        readers = log_format.readers(files, live=live)
        self.several = len(files) + len(names) - len(found) > 1
        self.sources = [source_of(*one) for one in zip(files, readers, strict=True)]
        for one in self.sources:
            if one.file is not None:
                note_input(one.file)

    def merge(self, trees: Iterable[RVAFT]) -> None:
        """Make one trace of all files, in the order of the time that the trees read."""
        times = {tree.time for tree in trees}
        options.refuse(self.streams or self.live, "--merge is for files")
        (time,) = times if len(times) == 1 else (None,)
        if time is None:
            why = "--merge needs one time of events: add `time FIELD as FORMAT;` to each tree"
            raise click.UsageError(why, click.get_current_context())
        files = [(one.file or "", one.reader or JsonLinesReader()) for one in self.sources]
        name = listing([one.name for one in self.sources])
        self.several = False
        self.sources = [TraceSource(name, files[0][0], reader=MergedReader(files, time))] if files else []

    @property
    def live(self) -> bool:
        """Whether some events come from a URL."""
        return any(one.live for one in self.sources)

    @property
    def streams(self) -> bool:
        """Whether some traces are not files."""
        return any(one.file is None for one in self.sources)

    def require_whole(self, engine: QueryEngine) -> None:
        """Refuse traces that an engine cannot query."""
        formats = ", ".join(sorted(engine.formats))
        options.refuse(self.streams, "--engine queries files: name a TRACE that is not standard input or a URL")
        for reader in (one.reader for one in self.sources if one.reader is not None):
            options.refuse(reader.name not in engine.formats, f"--engine does not read {reader.name}, only {formats}")
            given = ", ".join(sorted(reader.options.given))
            options.refuse(given, f"--engine does not take options of formats ({given})")

    def require_growing(self, option: str, noun: str) -> None:
        """Refuse an option that needs a single log of lines."""
        readers = [one.reader for one in self.sources if one.reader is not None]
        wrong = next((reader.name for reader in readers if not (reader.by_lines or reader.schemes)), None)
        options.refuse(wrong, f"{option} needs a log of lines (jsonl, regex, syslog): {wrong} is not one")
        options.refuse(self.several or self.streams, f"{option} needs one {noun}, a file")


def source_of(file: str, reader: LogReader) -> TraceSource:
    """Return a file or standard input as a trace; prompt on a terminal."""
    other = None if isinstance(reader, JsonLinesReader) else reader
    if file != "-":
        return TraceSource(click.format_filename(reader.shown(file)), file, reader=other)
    stream = required_stream(reader, options.standard_input("TRACE"))
    if sys.stdin.isatty():
        events = f"as {other.name}" if other else "one JSON object per line"
        click.echo(f"rvaft: reading events from standard input, {events} (Ctrl-D ends)", err=True)
    return TraceSource("<stdin>", events=stream, reader=other)


def _word(word: str, trees: Sequence[RVAFT]) -> TraceSource:
    """Return letters as default events; warn if a node has another event."""
    letters = word.split()
    unknown: list[str] = []
    for letter in dict.fromkeys(letters):
        nodes = [tree.nodes[letter] for tree in trees if letter in tree.nodes]
        if (node := next((node for node in nodes if node.on is not None), None)) is not None and node.on is not None:
            event = on_text(node.on)
            warn(f"the letter {letter} is its default event, but the node {letter} has the event {event}")
            continue
        absent = (pattern for tree in trees for *_, pattern in tree.absences)
        patterns = chain((relevant.pattern for tree in trees for relevant in tree.alphabet), absent)
        if not any(match(pattern, {"event": letter}, {}) is not None for pattern in patterns):
            unknown.append(letter)
    if unknown:
        warn(f"no node has the default event {listing(unknown, 'or')}")
    return TraceSource("word", events=[{"event": letter} for letter in letters])
