"""`rvaft robust`: what one lost, doubled or swapped event does to the verdicts of a tree."""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from itertools import chain, islice, pairwise
from random import Random
from typing import Any, Final

import click

from cross_check.commands.cross_check import progress
from cross_check.generate.disturbances import near_miss
from cross_check.generate.traces import PLAIN, NoTraceFound, detecting
from rvaft.cli import FAILED, FOUND, Failures, log_options, options, warn
from rvaft.cli.monitor import limit_option
from rvaft.core.fields_to_read import TreeReads
from rvaft.engine.monitor import Engine
from rvaft.errors import TooLarge
from rvaft.model.patterns import match
from rvaft.model.tree import RVAFT, resolve_semantics
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import DEFAULT_LIMIT
from rvaft.readers.log import expanded
from rvaft.readers.registry import read_log
from rvaft.rules.validity import valid_part
from rvaft.stream.pipeline import WHOLE
from rvaft.stream.statistics import EventTypeIndex
from rvaft.support.terminal import columns, inert, readable_json, visible

DEFAULT_NUMBER: Final = 5
"""Number of generated detecting logs, and of near misses."""
STEPS: Final = 2_000_000
_SHOWN: Final = 100
"""Maximum length of a log whose verdicts are printed event by event."""
_UNTRIED: Final = "-"
_NO_NODE: Final = "-"


class Edit(StrEnum):
    """What may happen to the event at a place of a log."""

    LOST = "lost"
    TWICE = "twice"
    SWAPPED = "swapped"

    def rest(self, events: list[Json], place: int) -> list[Json]:
        """Return the events from that place on; a swap is with the next event."""
        match self:
            case Edit.LOST:
                return events[place + 1 :]
            case Edit.TWICE:
                return [events[place], *events[place:]]
            case Edit.SWAPPED:
                return [events[place + 1], events[place], *events[place + 2 :]]


@dataclass(frozen=True, slots=True)
class LogReplay:
    """The verdicts of one log, as it is and after each edit.

    `verdicts` has a symbol for each place, `-` for one that was not tried.
    """

    log: str
    semantics: Semantics
    verdict: Verdict
    events: int
    decided: int | None
    """The number of the event that made the verdict final; edits of later events change nothing."""
    verdicts: dict[Edit, str]
    nodes: Sequence[Sequence[str]]
    """By place, the nodes of the event."""

    @property
    def untried(self) -> int:
        """The number of edits that were not tried."""
        return sum(symbols.count(_UNTRIED) for symbols in self.verdicts.values())

    def effects(self, edit: Edit, place: int) -> Iterator[str]:
        """Yield the names of the counts to which an edit before the final verdict belongs."""
        symbol, before = self.verdicts[edit][place], self.verdict.symbol
        if symbol == _UNTRIED or place >= (self.decided or self.events):
            return
        yield "tried"
        yield from ["detected"] if self.verdict is Verdict.TRUE else []
        if symbol != before:
            yield from ["hidden"] if self.verdict is Verdict.TRUE else []
            yield from ["forged"] if symbol == Verdict.TRUE.symbol else []
            yield from ["ended"] if symbol == Verdict.FALSE.symbol else []


@dataclass(slots=True)
class Sums:
    """The effects of the edits of all logs under one semantics, by node and in all."""

    nodes: dict[tuple[str, Edit], Counter[str]] = field(default_factory=dict)
    all: dict[Edit, Counter[str]] = field(default_factory=lambda: {edit: Counter() for edit in Edit})

    def add(self, answer: LogReplay) -> None:
        """Count the edits of a log; a swap belongs to the nodes of both events."""
        for edit in Edit:
            for place in range(len(answer.verdicts[edit])):
                effects = Counter(answer.effects(edit, place))
                self.all[edit] += effects
                both = answer.nodes[place : place + 1 + (edit is Edit.SWAPPED)]
                for node in dict.fromkeys(chain(*both)):
                    self.nodes.setdefault((node, edit), Counter()).update(effects)

    @property
    def found(self) -> bool:
        """Whether an edit changes what is detected, or can be."""
        return any(count[effect] for count in self.all.values() for effect in ("hidden", "forged", "ended"))


class Trials:
    """Tries the edits of logs for one tree under one semantics; raises `TooLarge` as monitors do."""

    def __init__(self, part: RVAFT, semantics: Semantics, *, limit: int, steps: int) -> None:
        self._part, self._semantics, self._steps = part, semantics, steps
        self._fresh = Engine(part, semantics, limit=limit)
        self._types = EventTypeIndex(part, [self._fresh.letters])
        # without `late`, an irrelevant event changes nothing except under `strict`
        self._each = semantics is Semantics.STRICT or (part.time is not None and part.time.late is not None)

    def _concerns(self, event: Json) -> bool:
        kind = self._types.of(event)
        return self._each or bool(kind.relevant) or (kind.serves and not self._semantics.projects)

    def answer(self, log: str, events: Sequence[Json], advance: Callable[[], None]) -> LogReplay:
        """Try the edits of each place, or of evenly spaced places if all would take too many steps."""
        places = [place for place, event in enumerate(events) if self._concerns(event)]
        relevant = [events[place] for place in places]
        base = self._fresh.fork()
        final = next((at for at, event in enumerate(relevant) if base.step(event).final), None)
        tried = len(relevant) if final is None else final + 1
        steps = sum(len(relevant) - at for at in range(tried)) * len(Edit)
        stride = -(-steps // self._steps) if steps else 1
        symbols = {edit: [base.verdict.symbol] * len(events) for edit in Edit}
        symbols[Edit.SWAPPED][len(events) - 1 :] = []
        neighbours = {at for at, (one, other) in enumerate(pairwise(places)) if other == one + 1}
        before = self._fresh.fork()
        for at in range(tried):
            for edit in Edit:
                if edit is Edit.SWAPPED and at not in neighbours:
                    continue
                verdict = _UNTRIED if at % stride else _after(before.fork(), edit.rest(relevant, at)).symbol
                symbols[edit][places[at]] = verdict
            before.step(relevant[at])
            advance()
        verdicts = {edit: "".join(found) for edit, found in symbols.items()}
        explained = {} if base.explanation is None else base.explanation.events
        matched: dict[int, list[str]] = {}
        for node, numbers in explained.items():
            for number in numbers:
                matched.setdefault(places[number - 1], []).append(node)
        nodes = [
            matched.get(place, [_NO_NODE]) if matched else self._nodes(event) for place, event in enumerate(events)
        ]
        decided = None if final is None else places[final] + 1
        return LogReplay(log, self._semantics, base.verdict, len(events), decided, verdicts, nodes)

    def _nodes(self, event: Json) -> list[str]:
        """Return the nodes whose runtime event this may be."""
        alphabet = [one.node for one in self._part.alphabet if match(one.pattern, event, {}) is not None]
        return alphabet or [_NO_NODE]


def _after(monitor: Engine, events: list[Json]) -> Verdict:
    return next((verdict for event in events if (verdict := monitor.step(event)).final), monitor.verdict)


@click.command("robust")
@options.tree_argument
@click.argument("logs", nargs=-1, metavar="[LOG]...")
@click.option(
    "--semantics",
    callback=options.some(Semantics),
    metavar="S,...|all",
    help="Default: that of the tree, else projected.",
)
@options.part_options
@options.number("-n", "wanted", text=f"Without LOG: N detecting logs and N near misses.  [default: {DEFAULT_NUMBER}]")
@click.option("--seed", type=int, metavar="S", help="Without LOG: seed of the random generator.  [default: 0]")
@options.number("--steps", default=STEPS, text="Maximum number of events that monitors read for one log and semantics.")
@limit_option
@log_options.log_format
@options.output_format("text", "json")
def robust_command(
    *,
    tree: str,
    logs: tuple[str, ...],
    semantics: tuple[Semantics, ...] | None,
    log_format: log_options.LogFormat,
    **given: Any,
) -> int:
    """Try each single loss, repetition and swap of events in the LOGs, and report which verdicts
    change.

    A lost event is left out, a doubled one comes twice in a row, and a swapped one comes after the next. The
    edit hides a detection, forges one, or ends detection for good (⊥). Without a LOG, logs are
    generated as by `rvaft traces`. The exit status is 1 if an edit does one of the three.
    """
    options.refuse(logs and (given["wanted"] or given["seed"] is not None), "-n and --seed are for generated logs")
    of_logs = log_format.form is not None or log_format.options.given - {"year"}
    options.refuse(not logs and of_logs, "name a LOG for --input and the options of formats")
    whole = options.load_tree(tree)
    part, failures = valid_part(whole, given["branch"], given["kind"]), Failures()
    files = [file for some in failures.collect(expanded, logs) for file in some]
    log_format.readers(files)  # refuses options that no reader takes
    read = {file: events for file in files for events in failures.collect(_reading(part, log_format), [file])}
    answers, sums = list[LogReplay](), dict[Semantics, Sums]()
    for meaning in semantics or [resolve_semantics(whole)]:
        number, seed = given["wanted"] or DEFAULT_NUMBER, given["seed"] or 0
        found = read if logs else dict(_generated(part, meaning, number, seed))
        trials = Trials(part, meaning, limit=given["max_configurations"] or DEFAULT_LIMIT, steps=given["steps"])
        sums[meaning] = Sums()
        with progress(sum(map(len, found.values())), "trying edits") as advance:
            for name, events in found.items():
                shown = click.format_filename(name)
                with failures.reported():
                    try:
                        answers.append(trials.answer(shown, events, advance))
                    except TooLarge as error:
                        error.add_note(f"in {shown} or an edit of it; --max-configurations allows more")
                        raise
                    sums[meaning].add(answers[-1])
    if answers:
        lines = [_json_text(answers, sums)] if given["form"] == "json" else list(_text(answers, sums))
        click.echo(inert("\n".join(lines)))
    for answer in answers:
        if answer.untried:
            tried = sum(map(len, answer.verdicts.values())) - answer.untried
            warn(
                f"{answer.log}: {tried} edits tried under {answer.semantics}, and {answer.untried} not: "
                "--steps allows more"
            )
    return FAILED if failures.met else FOUND if any(one.found for one in sums.values()) else 0


def _reading(part: RVAFT, log_format: log_options.LogFormat) -> Callable[[str], list[Json]]:
    """Return the function from a file (`-`: standard input) to its events."""
    chosen, reads = log_format.options, TreeReads(part)
    named = {name: getattr(chosen, name) for name in ("records", "types", "pattern", "profile", "year")}

    def read(file: str) -> list[Json]:
        source: Any = options.standard_input("LOG") if file == "-" else file
        name = "<stdin>" if file == "-" else click.format_filename(file)
        events = read_log(source, log_format.form, name=name, reads=reads, warn=warn, **named)
        found: list[Json] = list(islice(events, WHOLE + 1))
        if len(found) > WHOLE:
            raise TooLarge(f"events of {click.format_filename(file)}", limit=WHOLE, remedy="name a part of the log")
        return found

    return read


def _generated(part: RVAFT, semantics: Semantics, wanted: int, seed: int) -> Iterator[tuple[str, list[Json]]]:
    """Yield logs with the names and events of `rvaft traces -o`; raises `ClickException`."""
    made: dict[str, Callable[[Random], list[Json]]] = {
        "detect": lambda random: detecting(random, part, semantics, PLAIN),
        "near-miss": lambda random: near_miss(random, part, semantics, PLAIN).trace,
    }
    for name, make in made.items():
        for number in range(1, wanted + 1):
            try:
                yield f"{name}-{number}", make(Random(f"{seed} {name} {number}"))  # noqa: S311 (no secret)
            except NoTraceFound as error:
                raise click.ClickException(f"{error}; name a LOG, or try another --seed") from error


def _text(answers: Sequence[LogReplay], sums: dict[Semantics, Sums]) -> Iterator[str]:
    for semantics, own in sums.items():
        yield f"under {semantics}:"
        for answer in answers:
            if answer.semantics is semantics:
                since = "" if answer.decided is None else f" at event {answer.decided}"
                yield visible(f"  {answer.log}: {answer.verdict.symbol}{since} of {answer.events}")
                if answer.events <= _SHOWN:
                    rows = [(edit, answer.verdicts[edit]) for edit in Edit]
                    yield from (f"    {line}" for line in columns(rows))
        titles = ("NODE", "EDIT", "TRIED", "HIDDEN", "FORGED", "ENDED FOR GOOD")
        counts = [
            (node, edit, *(str(count[name]) for name in ("tried", "hidden", "forged", "ended")))
            for (node, edit), count in sorted(own.nodes.items(), key=lambda one: (one[0][0], [*Edit].index(one[0][1])))
            if count["tried"]
        ]
        yield from (f"  {line}" for line in columns([titles, *counts]))
        for edit, count in own.all.items():
            hidden, detected = count["hidden"], count["detected"]
            share = f" ({100 * hidden / detected:.0f} %)" if detected else ""
            others = f"{count['forged']} of {count['tried'] - detected} forge one"
            ended = f"{count['ended']} end detection for good"
            yield f"  {edit}: {hidden} of {detected} hide a detection{share}, {others}, {ended}"


def _json_text(answers: Sequence[LogReplay], sums: dict[Semantics, Sums]) -> str:
    logs = [
        {
            "log": one.log,
            "semantics": one.semantics,
            "verdict": one.verdict.symbol,
            "events": one.events,
            "decided": one.decided,
            **one.verdicts,
            "untried": one.untried,
        }
        for one in answers
    ]
    counted = ("tried", "detected", "hidden", "forged", "ended")
    nodes = [
        {"semantics": semantics, "node": node, "edit": edit, **{name: count[name] for name in counted}}
        for semantics, own in sums.items()
        for (node, edit), count in own.nodes.items()
    ]
    totals = [
        {"semantics": semantics, "edit": edit, **{name: count[name] for name in counted}}
        for semantics, own in sums.items()
        for edit, count in own.all.items()
    ]
    found = {"format": "rvaft-robust", "version": 1, "logs": logs, "nodes": nodes, "totals": totals}
    return readable_json(found, indent=1)
