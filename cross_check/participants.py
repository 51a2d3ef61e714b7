"""Participants of a comparison: the reference, the engine, and backends with their readers."""

import sys
import tomllib
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial, wraps
from itertools import chain
from pathlib import Path
from typing import Any, Final, ParamSpec, TypeAlias, TypeVar, assert_never

from cross_check.confined_text import ConfinedText, require_permission
from cross_check.letters import ties
from cross_check.results import Status
from rvaft.backend import Backend, Match, Observed, Specification, all_backends, backend, speaking
from rvaft.core.build import build
from rvaft.core.restriction import property_of, restrict
from rvaft.core.scenarios import LIMIT, most_scenarios
from rvaft.engine import Engine
from rvaft.errors import LanguageError, OptionError, RvaftError, TooLarge, ToolFailed, ToolMissing
from rvaft.language.printer import dumps
from rvaft.model.assumptions import first_violation
from rvaft.model.event_time import EventTime, TimeFormat
from rvaft.model.expressions import time_text
from rvaft.model.guards import Guard
from rvaft.model.guards import variables as guard_variables
from rvaft.model.guards import walk as guard_walk
from rvaft.model.nodes import Assumption, Kind
from rvaft.model.patterns import (
    Anything,
    ListPattern,
    Literal,
    ObjectPattern,
    Pattern,
    SomeItem,
    Variable,
    rigid_variables,
    walk,
)
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import DetectionMonitor, FirstDetections, LeftOpen, Monitor
from rvaft.rules.validity import loads
from rvaft.semantics import Reference
from rvaft.semantics.reference import Partial
from rvaft.support.budget import Budget
from rvaft.support.confinement import Limits
from rvaft.support.files import opened

REFERENCE: Final = "reference"
ENGINE: Final = "engine"
PATIENCE: Final = 60.0
"""Seconds for an answer of an external program or of a text that a person wrote."""

P = ParamSpec("P")
T = TypeVar("T")


AllMatches: TypeAlias = Callable[[Sequence[Sequence[Json]]], Sequence[frozenset[Match]] | None]
"""Return all matches per trace, or None if only some are known."""


@dataclass(frozen=True, slots=True)
class Participant:
    """A source of verdicts; `start` returns a new monitor.

    - `observed`: the patterns that it depends on, apart from times; None if unknown.
    - `timed`: it depends on times.
    - `json_alone`: it does not get non-finite numbers.
    - `first_detections`: it reports only detections, on whole traces.
    - `left_open`: gives the reason if a trace has no verdict.
    - `matches`: returns all matches per trace, or None.
    - `specification`: its text, if any.
    - `tree`: another tree that it monitors.
    - `budget`: the remaining steps of a reference, which raises `Undecided` without any.
    - `assumes`: what traces keep on which a text that a person wrote has to agree.
    - `written`: this text, whose constants the traces try, before those of `known`, a translation.
    - `times`: the declaration of times that the text has from the tree.
    - `unknown`: the fields, with dots, that this text reads and no event of the tree has.
    - `remembers`: its state has all events so far, so that few proofs end.
    """

    name: str
    start: Callable[[], Monitor]
    specification: Specification | None = None
    observed: tuple[Observed, ...] | None = None
    tree: RVAFT | None = None
    timed: bool = False
    json_alone: bool = False
    first_detections: FirstDetections | None = None
    left_open: LeftOpen | None = None
    matches: AllMatches | None = None
    budget: Budget | None = None
    assumes: frozenset[Assumption] = frozenset()
    written: str = ""
    known: str = ""
    times: str = ""
    unknown: tuple[str, ...] = ()
    remembers: bool = False

    def answers(self, traces: Sequence[Sequence[Json]]) -> list[tuple[Verdict, ...]]:
        """Return the verdict after every prefix of each trace."""
        if self.first_detections is None:
            return [tuple(self.start().run(trace)) for trace in traces]
        return [*map(detected, traces, self.first_detections(traces))]

    @property
    def ties(self) -> bool:
        """Whether its patterns share variables between events."""
        return any(map(ties, self.observed or ()))


@dataclass(frozen=True, slots=True)
class Answer:
    """The result of a participant on one trace.

    `verdicts` has one verdict per event, or is None if an external program failed (`error`) or
    timed out (`expired`). `deviations` names known deviations of the program on the trace; a
    disagreement then proves nothing about the text.
    """

    verdicts: tuple[Verdict, ...] | None = None
    error: str = ""
    deviations: tuple[str, ...] = ()
    expired: bool = False


@dataclass(frozen=True, slots=True)
class Outside:
    """An external program for whole traces; `answers` raises the errors that `Absent` holds.

    `specification` is the text that it runs, or None if it reads the tree.
    """

    name: str
    answers: Callable[[Sequence[Sequence[Json]]], Sequence[Answer]]
    specification: Specification | None = None
    detections_only: bool = False


@dataclass(frozen=True, slots=True)
class Absent:
    """A participant that cannot take part, with the reason; never counted as agreement."""

    error: RvaftError

    @property
    def status(self) -> Status:
        """The status for the error."""
        return Status.of(self.error)


Enlisted: TypeAlias = Participant | Outside | Absent


def absent_on_error(enlist: Callable[P, T]) -> Callable[P, T | Absent]:
    """Return the function with `RvaftError` converted to an `Absent` result."""

    @wraps(enlist)
    def enlisted(*args: P.args, **options: P.kwargs) -> T | Absent:
        try:
            return enlist(*args, **options)
        except RvaftError as error:
            return Absent(error)

    return enlisted


def faithful_backends() -> tuple[str, ...]:
    """Return the faithful backends with a reader, one form of each language."""
    found = {name: loaded(name) for name in all_backends()}  # backends that cannot be loaded are reported as absent
    faithful = [
        name for name, one in found.items() if one is None or (one.faithful and one.readable and not one.form_of)
    ]
    without = missing_extras()
    return tuple(name for name in faithful if name not in without)


def missing_extras() -> dict[str, ToolMissing]:
    """Return the backends that take part only if named, because their extra is not installed."""
    found: dict[str, ToolMissing] = {}
    for name in all_backends():
        try:
            if (one := loaded(name)) is not None and one.faithful and one.readable and not one.form_of:
                one.require()
        except ToolMissing as error:
            found[name] = error
    return found


def loaded(name: str) -> Backend | None:
    """Return the backend, or None if it cannot be loaded."""
    with suppress(ToolFailed):
        return backend(name)
    return None


def times_matter(tree: RVAFT) -> bool:
    """Return whether verdicts can depend on event times."""
    if tree.time is None:
        return False
    prop = property_of(tree)
    return tree.time.late is not None or prop.timed or prop.times_absences


def observed_by(tree: RVAFT) -> tuple[Observed, ...]:
    """Return the patterns that a tree's verdicts depend on: runtime, alphabet, ignored and absent events.

    A variable of a single, uncounted runtime event is local if all guards on it concern only that
    event.
    """
    patterns = [(name, pattern) for name in tree.occurrences if (pattern := tree.pattern(name)) is not None]
    often = ((pattern, min(2, tree.nodes[name].times)) for name, pattern in patterns)
    uses = Counter(name for pattern, times in often for name in rigid_variables(pattern) * times)
    guards: dict[str, list[Guard]] = {}
    for guard in (node.when for node in tree.top_down() if node.when is not None):
        for name in guard_variables(guard):
            guards.setdefault(name, []).append(guard)
    found: list[Observed] = []
    for _, pattern in patterns:
        names = rigid_variables(pattern)
        about = {name: guards.get(name, []) for name in names if uses[name] == 1}
        own = [name for name, some in about.items() if all(set(guard_variables(g)) <= set(names) for g in some)]
        found += [Observed(pattern, guard).untied(own) for guard in (None, *chain(*(about[name] for name in own)))]
        # The engine drops values that a guard rejects, so events that bind a shared variable also
        # meet its guards.
        shared = chain(*(guards.get(name, []) for name in names if name not in own))
        found += [Observed(pattern, guard).untied() for guard in shared]
    for _, clause, pattern in tree.absences:
        found += [Observed(pattern).untied(tree.own_variables(clause)), Observed(pattern, clause.when).untied()]
    found += [Observed(entry.pattern, entry.when).untied() for entry in tree.alphabet]
    found += [Observed(tree.instantiate(ignore.on), ignore.when).untied() for ignore in tree.ignores]
    return tuple(dict.fromkeys(found))


def literals(question: Observed) -> Iterator[Json]:
    """Return the constants of a question."""
    parts = (*walk(question.pattern), *guard_walk(question.when))
    return (part.value for part in parts if isinstance(part, Literal))


# The participants.


@absent_on_error
def engine_of(part: RVAFT, semantics: Semantics) -> Participant:
    """Return the engine."""
    return Participant(ENGINE, Engine(part, semantics).fork, observed=observed_by(part), timed=times_matter(part))


@absent_on_error
def reference_of(
    tree: RVAFT, semantics: Semantics, *, name: str = REFERENCE, branch: int | None = None, kind: Kind | None = None
) -> Participant:
    """Return the reference, or `Absent` if there are too many scenarios to enumerate."""
    scenarios = most_scenarios(build(tree))
    if scenarios > LIMIT:
        raise TooLarge(f"about {scenarios:.0e} scenarios to try one by one", limit=LIMIT)
    first = _CountedReference(tree, semantics, branch=branch, kind=kind)
    part = restrict(tree, branch=branch, kind=kind)
    return Participant(
        name,
        first.fork,
        observed=observed_by(part),
        timed=times_matter(part),
        remembers=bool(tree.absences),
        budget=first.budget,
    )


class _CountedReference(Reference):
    """The reference with a budget of steps, which its forks share: a step tries one occurrence."""

    def __init__(self, tree: RVAFT, semantics: Semantics, *, branch: int | None, kind: Kind | None) -> None:
        super().__init__(tree, semantics, branch=branch, kind=kind)
        self.budget = Budget(sys.maxsize)

    def _extended(self, partial: Partial, event: Json, time: int | None) -> Iterator[Partial]:
        self.budget.spend(len(self.scenarios[partial.scenario].occurrences))
        return super()._extended(partial, event, time)


@absent_on_error
def translated(name: str, part: RVAFT, semantics: Semantics, *, limit: int | None = None) -> Participant:
    """Return a backend's text, run by its reader."""
    language = backend(name)
    if not language.readable:
        raise OptionError(f"{name} has no reader, so its texts cannot be compared")
    specification = language.translate(part, semantics, limit=limit)
    first = specification.monitor()
    observed = language.observed(specification.text)
    asks = times_matter(part), language.json_alone, *_of_whole_traces(first)
    matches = partial(language.matches, specification.text)
    return Participant(name, first.fork, specification, observed, None, *asks, matches)


def _of_whole_traces(monitor: Monitor) -> tuple[FirstDetections | None, LeftOpen | None]:
    return monitor.first_detections if isinstance(monitor, DetectionMonitor) else None, monitor.left_open


def reports_detections_only(one: Enlisted) -> bool:
    """Return whether a participant reports detections only, never ⊥."""
    match one:
        case Participant(first_detections=first):
            return first is not None
        case Outside(detections_only=only):
            return only
        case Absent():
            return False


def relied_on(one: Participant | Outside | None) -> frozenset[Assumption]:
    """Return the assumptions on which the text of a participant relies."""
    known = None if one is None else one.specification
    own = one.assumes if isinstance(one, Participant) else frozenset[Assumption]()
    return own if known is None else own | known.assumes


def leaves_open(one: Participant | Outside | None, tree: RVAFT, trace: Sequence[Json]) -> str:
    """Return why a participant owes no verdict on a trace, or an empty text."""
    assumes = relied_on(one)
    if assumes and (broken := first_violation(tree, trace, assumes)) is not None:
        return f"it breaks the assumption '{broken.assumption}'"
    return one.left_open(trace) if isinstance(one, Participant) and one.left_open is not None else ""


def detected(trace: Sequence[Json], first: int | None) -> tuple[Verdict, ...]:
    """Return the verdict after every prefix of a trace with this first detection, if any."""
    reached = (first is not None and number >= first for number in range(1, len(trace) + 1))
    return tuple(Verdict.TRUE if one else Verdict.UNKNOWN for one in reached)


def detections(verdicts: Sequence[Verdict]) -> tuple[Verdict, ...]:
    """Return the verdicts with ⊥ replaced by ?, for comparison with detections."""
    return tuple(Verdict.UNKNOWN if verdict is Verdict.FALSE else verdict for verdict in verdicts)


def verdicts_of(participant: Enlisted, trace: Sequence[Json]) -> tuple[Verdict, ...] | RvaftError:
    """Return the verdict after every prefix, or the error."""
    try:
        match participant:
            case Absent(error):
                return error
            case Outside(name=name):
                (answer,) = participant.answers([trace])
                return ToolFailed(name, reason=answer.error) if answer.verdicts is None else answer.verdicts
            case Participant():
                return participant.answers([trace])[0]
    except RvaftError as error:
        return error


# Specifications written by hand or by other tools.

TREE: Final = "rvaft"
RULE: Final = "toml"
_CHANGING: Final = frozenset({"filters", "exceptions_list", "event_category_override", "tiebreaker_field"})
"""Keys of a rule that change what its query finds."""
"""The language of trees, beside those of backends."""


@dataclass(frozen=True, slots=True)
class Handwritten:
    """A text, and the backend that reads it, or `rvaft` for another tree."""

    path: str
    language: str
    text: str
    seconds: float = PATIENCE
    """The time limit of an answer."""
    run_c: bool = False
    """Whether a text that is compiled may run."""

    @absent_on_error
    def enlist(self, tree: RVAFT, semantics: Semantics) -> Participant | Absent:
        """Return the participant for this text.

        An undefined atom of the text is the event of the node of that name. A text that declares no
        times has those of the tree.
        """
        if self.language == TREE:
            other = loads(self.text)
            found = reference_of(other, semantics, name=self.path)
            return found if isinstance(found, Absent) else replace(found, tree=other, assumes=tree.assumes)
        reader = backend(self.language)
        written = self.text if tree.time is None else reader.timed(self.text, tree.time)
        times = "" if written == self.text or tree.time is None else time_text(tree.time)
        patterns = ((name, tree.pattern(name)) for name in tree.occurrences)
        atoms = _NodeEvents((name, pattern) for name, pattern in patterns if pattern is not None)
        atoms.path = self.path
        require_permission(reader, file=self.path, run_c=self.run_c)
        text = ConfinedText(self.path, reader, written, Limits(seconds=self.seconds), atoms=atoms)
        asks = text.observed, None, False, reader.json_alone, text.first_detections, text.left_open
        found = Participant(self.path, text.start, None, *asks, text.matches)
        with suppress(RvaftError):
            own = reader.translate(tree, semantics).text
            found = replace(found, known=own)
        return replace(
            found,
            assumes=tree.assumes,
            written=self.text,
            times=times,
            unknown=tuple(".".join(path) for path in text.fields if not has_field(tree, path)),
        )


def has_field(tree: RVAFT, path: Sequence[str]) -> bool:
    """Whether an event of a tree may have a field: a pattern or the time has it, or a value above it of any kind.

    >>> tree = loads("event e(x) = { a: { b: 1 }, c: x }; top on e(_);")
    >>> [has_field(tree, path.split(".")) for path in ("a", "a.b", "a.d", "c.d", "d")]
    [True, True, False, True, False]
    """
    patterns = (
        *(relevant.pattern for relevant in tree.alphabet),
        *(tree.instantiate(ignore.on) for ignore in tree.ignores),
        *(pattern for *_, pattern in tree.absences),
    )
    time = () if tree.time is None else tree.time.field
    return tuple(path) in (time[:end] for end in range(1, len(time) + 1)) or any(_leads(one, path) for one in patterns)


def _leads(pattern: Pattern, path: Sequence[str]) -> bool:
    """Whether a path may lead to a value in an event that matches a pattern."""
    match pattern:
        case _ if not path:
            return True
        case ObjectPattern(fields):
            first, *rest = path
            return any(name == first and _leads(inner, rest) for name, inner in fields)
        case Literal():
            return False
        case Variable() | Anything() | ListPattern() | SomeItem():
            return True
        case _:
            assert_never(pattern)


class _NodeEvents(dict[str, Pattern]):
    """The events of a tree's nodes; an unknown name is an error instead of a default event."""

    path = ""

    def get(self, name: str, default: Any = None) -> Any:  # noqa: ARG002 (as in every mapping)
        if name not in self:
            reason = f"the atom {name} is not defined in the text, and no node with a runtime event has this name"
            raise LanguageError(reason, file=self.path)
        return self[name]


def handwritten(named: str, *, seconds: float = PATIENCE, run_c: bool = False, confined: bool = False) -> Handwritten:
    """Return the specification `[LANG:]FILE`; by default the suffix gives LANG; `-` is standard
    input. A `.toml` file is a rule of Elastic. A `confined` file is a regular one in its folder.

    It is read and run in a child process, `seconds` for each answer; a text in C only with `run_c`.
    Raises `OSError` for unreadable files, `OptionError` for an unknown language, `LanguageError`
    for invalid texts, `ToolFailed` for a text that exceeds a limit.
    """
    language, path = _split(named)
    if path == "-":
        data = sys.stdin.buffer.read()
    else:
        with opened(Path(path), Path(path).parent if confined else None) as stream:
            data = stream.read()
    file = "<stdin>" if path == "-" else path
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise LanguageError(f"not UTF-8 (byte {error.start + 1})", file=file) from None
    shown = file.encode(errors="surrogateescape").decode(errors="replace")
    if language == TREE:  # with its imports
        return Handwritten(shown, language, dumps(loads(text, file, confine_imports=confined)))
    line = 0
    if language == RULE:
        language, text, line = _query(text, shown)
    require_permission(reader := backend(language), file=shown, run_c=run_c)
    try:
        ConfinedText(shown, reader, text, Limits(seconds=seconds))  # report errors before the comparison
    except LanguageError as error:
        error.file, error.line = shown, max(1, error.line + line)
        raise
    return Handwritten(shown, language, text, seconds, run_c)


def _query(text: str, file: str) -> tuple[str, str, int]:
    """Return language and query of a rule of Elastic, and the lines of the file before the query.

    Keys that change what the query finds are refused.
    """

    def refused(reason: str) -> LanguageError:
        return LanguageError(reason, file=file)

    try:
        found = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise refused(f"not TOML: {error}") from None
    rule = found.get("rule")
    if not isinstance(rule, dict) or not isinstance(language := rule.get("language"), str):
        raise refused("not a rule of Elastic: it needs a table `rule` with `language` and `query`")
    if language != "eql":
        raise refused(f'the language of the rule is {language}, and only rules with `language = "eql"` are read')
    if changing := sorted(_CHANGING & rule.keys()):
        reason = f"`{changing[0]}` changes what the rule finds, and is not read"
        raise refused(f"{reason}; remove it to compare the query alone")
    query, field = rule.get("query"), rule.get("timestamp_field", "@timestamp")
    if not isinstance(query, str) or not isinstance(field, str) or not field.isprintable():
        raise refused("not a rule of Elastic: `query` and `timestamp_field` must be texts")
    time = EventTime(tuple(field.split(".")), TimeFormat.ISO8601)
    first = "" if field == "@timestamp" else f"// {time_text(time)}\n"
    return language, f"{first}{query}", text.count("\n", 0, max(0, text.find(query))) - first.count("\n")


def is_specification(path: str) -> bool:
    """Return whether a file name has the suffix of a specification."""
    return _language(Path(path).suffix.removeprefix(".")) not in (None, TREE)


def _split(named: str) -> tuple[str, str]:
    known = ", ".join((TREE, *all_backends()))
    before, colon, path = named.partition(":")
    if colon and path and (language := _language(before)) is not None:
        return language, path
    if colon and path and before.isidentifier() and not Path(named).exists():
        raise OptionError(f"{named}: unknown language {before}; known: {known}")
    suffix = Path(named).suffix
    if (language := _language(suffix.removeprefix("."))) is not None:
        return language, named
    reason = f"the suffix {suffix} belongs to no language" if suffix else "the file has no suffix to select a language"
    raise OptionError(f"{named}: {reason}; write LANG:{Path(named).name} with LANG one of {known}")


def _language(word: str) -> str | None:
    return word.lower() if word.lower() in (TREE, RULE, *all_backends()) else speaking(word)
