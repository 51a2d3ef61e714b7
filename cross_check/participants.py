"""Who takes part in a comparison: the reference, the engine, and the text of each backend run by its own reader."""

import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial, wraps
from itertools import chain
from pathlib import Path
from typing import Any, Final, ParamSpec, TypeAlias, TypeVar

from cross_check.letters import ties
from cross_check.results import Status
from rvaft.api import loads
from rvaft.backend import Backend, Match, Observed, Specification, all_backends, backend, speaking
from rvaft.core.branches import restrict
from rvaft.core.build import build
from rvaft.core.passes import property_of
from rvaft.core.scenario_space import most_scenarios
from rvaft.core.scenarios import LIMIT
from rvaft.engine import Engine
from rvaft.errors import LanguageError, OptionError, RvaftError, TooLarge, ToolFailed, ToolMissing
from rvaft.language.printer import dumps
from rvaft.model.guards import Guard
from rvaft.model.guards import variables as guard_variables
from rvaft.model.guards import walk as guard_walk
from rvaft.model.nodes import Kind
from rvaft.model.patterns import Literal, Pattern, rigid_variables, walk
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import DetectionMonitor, FirstDetections, LeftOpen, Monitor
from rvaft.semantics import Reference

REFERENCE: Final = "reference"
ENGINE: Final = "engine"
MONA: Final = "ltlf-mona"

P = ParamSpec("P")
T = TypeVar("T")


AllMatches: TypeAlias = Callable[[Sequence[Sequence[Json]]], Sequence[frozenset[Match]] | None]
"""All matches in each trace, or None where only some are known."""


@dataclass(frozen=True, slots=True)
class Participant:
    """Somebody who gives verdicts; `start` makes a fresh monitor.

    `observed` is all that it asks of events but their times, None where nobody knows; `timed` says
    that it asks for these, too. With `json_alone` it is not asked about numbers that are not
    finite. With `first_detections` it tells detections alone, of whole traces, and says with
    `left_open` why its language tells nothing of one. `matches` gives all matches in each trace, or
    None where it knows only some. `specification` is there for a text, `tree` for the meaning of
    another tree than the one that is compared.
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

    def answers(self, traces: Sequence[Sequence[Json]]) -> list[tuple[Verdict, ...]]:
        """What it says after every prefix of each trace."""
        if self.first_detections is None:
            return [tuple(self.start().run(trace)) for trace in traces]
        return [*map(detected, traces, self.first_detections(traces))]

    @property
    def ties(self) -> bool:
        """Whether a variable may tie events together in what it asks."""
        return any(map(ties, self.observed or ()))


@dataclass(frozen=True, slots=True)
class Answer:
    """What somebody says of one trace.

    `verdicts` has one verdict for each event; it is None where a program of others could not run,
    which `error` then explains, or where the time was too short (`expired`). `deviations` names the
    known deviations of the program that can show on this trace: where there are any and it says
    something else, that says nothing about the text.
    """

    verdicts: tuple[Verdict, ...] | None = None
    error: str = ""
    deviations: tuple[str, ...] = ()
    expired: bool = False


@dataclass(frozen=True, slots=True)
class Outside:
    """A program of others, which answers many whole traces at once; `answers` raises what `Absent` can hold."""

    name: str
    answers: Callable[[Sequence[Sequence[Json]]], Sequence[Answer]]
    specification: Specification
    detections_only: bool = False


@dataclass(frozen=True, slots=True)
class Absent:
    """Somebody who cannot take part, and why; never counted as agreement."""

    error: RvaftError

    @property
    def status(self) -> Status:
        """In two words what the matter is."""
        return Status.of(self.error)


Enlisted: TypeAlias = Participant | Outside | Absent


def absent_on_error(enlist: Callable[P, T]) -> Callable[P, T | Absent]:
    """The function, which returns an `Absent` instead of raising an `RvaftError`."""

    @wraps(enlist)
    def enlisted(*args: P.args, **options: P.kwargs) -> T | Absent:
        try:
            return enlist(*args, **options)
        except RvaftError as error:
            return Absent(error)

    return enlisted


def faithful_backends() -> tuple[str, ...]:
    """The backends whose texts should mean the tree, each in one form, and that somebody here reads."""
    found = {name: loaded(name) for name in all_backends()}  # who cannot be loaded is absent, and said to be
    faithful = [
        name for name, one in found.items() if one is None or (one.faithful and one.readable and not one.form_of)
    ]
    without = missing_extras()
    return tuple(name for name in faithful if name not in without)


def missing_extras() -> dict[str, ToolMissing]:
    """The backends that take part where they are named alone, as what runs their texts is an extra
    that is not installed.
    """
    found: dict[str, ToolMissing] = {}
    for name in all_backends():
        try:
            if (one := loaded(name)) is not None and one.faithful and one.readable and not one.form_of:
                one.require()
        except ToolMissing as error:
            found[name] = error
    return found


def loaded(name: str) -> Backend | None:
    """The backend, or None where it is installed and cannot be loaded."""
    with suppress(ToolFailed):
        return backend(name)
    return None


def times_matter(tree: RVAFT) -> bool:
    """Whether a verdict can depend on the times of events: then they tie events together."""
    return tree.time is not None and (tree.time.late is not None or property_of(tree).timed)


def observed_by(tree: RVAFT) -> tuple[Observed, ...]:
    """What the meaning of a tree asks of events but their times: its runtime events, its alphabet, and what it ignores.

    A variable that only one runtime event has ties nothing, if that is not counted and every guard
    that looks at the variable looks at that event alone.
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
        # What a shared variable may be is also asked of each event that binds it: a value that some
        # guard refuses is forgotten.
        shared = chain(*(guards.get(name, []) for name in names if name not in own))
        found += [Observed(pattern, guard).untied() for guard in shared]
    found += [Observed(entry.pattern, entry.when).untied() for entry in tree.alphabet]
    found += [Observed(tree.instantiate(ignore.on), ignore.when).untied() for ignore in tree.ignores]
    return tuple(dict.fromkeys(found))


def literals(question: Observed) -> Iterator[Json]:
    """The constants in a question."""
    parts = (*walk(question.pattern), *guard_walk(question.when))
    return (part.value for part in parts if isinstance(part, Literal))


# -- the participants -----------------------------------------------------------------------------------------------


@absent_on_error
def engine_of(part: RVAFT, semantics: Semantics) -> Participant:
    """The monitor that people run."""
    return Participant(ENGINE, Engine(part, semantics).fork, observed=observed_by(part), timed=times_matter(part))


@absent_on_error
def reference_of(
    tree: RVAFT, semantics: Semantics, *, name: str = REFERENCE, branch: int | None = None, kind: Kind | None = None
) -> Participant:
    """The definition at work; absent where there are too many scenarios to try them all."""
    scenarios = most_scenarios(build(tree))
    if scenarios > LIMIT:
        raise TooLarge(f"about {scenarios:.0e} scenarios to try one by one", limit=LIMIT)
    first = Reference(tree, semantics, branch=branch, kind=kind)
    part = restrict(tree, branch=branch, kind=kind)
    return Participant(name, first.fork, observed=observed_by(part), timed=times_matter(part))


@absent_on_error
def translated(
    name: str, part: RVAFT, semantics: Semantics, *, limit: int | None = None, tool: str | None = None
) -> Participant:
    """The text of one backend, run by its own reader, or by a tool of others.

    `limit` is that of the translation, None the backend's own.
    """
    language = backend(name)
    if not language.readable:
        raise OptionError(f"{name} is only emitted: nothing here runs its texts, so there is nothing to compare")
    specification = language.translate(part, semantics, limit=limit)
    first = specification.monitor() if tool is None else language.read_with(tool, specification.text)
    called = name if tool is None else f"{name}-{tool}"
    observed = language.observed(specification.text)
    asks = times_matter(part), language.json_alone, *_of_whole_traces(first)
    found = None if tool is not None else partial(language.matches, specification.text)
    return Participant(called, first.fork, specification, observed, None, *asks, found)


def _of_whole_traces(monitor: Monitor) -> tuple[FirstDetections | None, LeftOpen | None]:
    return (monitor.first_detections, monitor.left_open) if isinstance(monitor, DetectionMonitor) else (None, None)


def tells_detections_only(one: Enlisted) -> bool:
    """Whether somebody tells detections alone, and no ⊥."""
    match one:
        case Participant(first_detections=first):
            return first is not None
        case Outside(detections_only=only):
            return only
        case Absent():
            return False


def detected(trace: Sequence[Json], first: int | None) -> tuple[Verdict, ...]:
    """The verdict after every prefix of a trace of which this event, if any, is the first detection."""
    reached = (first is not None and number >= first for number in range(1, len(trace) + 1))
    return tuple(Verdict.TRUE if one else Verdict.UNKNOWN for one in reached)


def detections(verdicts: Sequence[Verdict]) -> tuple[Verdict, ...]:
    """The verdicts as they are told by somebody who tells detections alone."""
    return tuple(Verdict.UNKNOWN if verdict is Verdict.FALSE else verdict for verdict in verdicts)


def verdicts_of(participant: Enlisted, trace: Sequence[Json]) -> tuple[Verdict, ...] | RvaftError:
    """What one participant says after every prefix, or why it says nothing."""
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


# -- specifications written by hand, or by another tool, to be held against a tree
# --------------------------------------

TREE: Final = "rvaft"
"""The language of trees, beside those of the backends."""


@dataclass(frozen=True, slots=True)
class Handwritten:
    """The text of a file and the name of what reads it: a backend, or `rvaft` for another tree."""

    path: str
    language: str
    text: str

    def enlist(self, tree: RVAFT, semantics: Semantics) -> Participant | Absent:
        """The participant that this text makes.

        An atom that the text does not define is the event of the tree's node.
        """
        if self.language == TREE:
            other = loads(self.text)
            found = reference_of(other, semantics, name=self.path)
            return found if isinstance(found, Absent) else replace(found, tree=other)
        reader = backend(self.language)
        patterns = ((name, tree.pattern(name)) for name in tree.occurrences)
        atoms = _NodeEvents((name, pattern) for name, pattern in patterns if pattern is not None)
        atoms.path = self.path
        first = reader.read(self.text, atoms=atoms)
        observed = reader.observed(self.text, atoms=atoms)
        asks = observed, None, False, reader.json_alone, *_of_whole_traces(first)
        return Participant(self.path, first.fork, None, *asks, partial(reader.matches, self.text))


class _NodeEvents(dict[str, Pattern]):
    """The events of a tree's nodes; an atom of another name is an error and not the default event."""

    path = ""

    def get(self, name: str, default: Any = None) -> Any:  # noqa: ARG002 (as in every mapping)
        if name not in self:
            reason = f"the atom {name} is no node with a runtime event, and the text does not say which event it is"
            raise LanguageError(reason, file=self.path)
        return self[name]


def handwritten(named: str) -> Handwritten:
    """What `[LANG:]FILE` names; the language follows the suffix where it is not given, and the file
    `-` is standard input.

    Raises `OSError` where the file cannot be read, `OptionError` where nobody can tell its
    language, `LanguageError` where it is no text in that language.
    """
    language, path = _split(named)
    data = sys.stdin.buffer.read() if path == "-" else Path(path).read_bytes()
    file = "<stdin>" if path == "-" else path
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise LanguageError(f"not UTF-8 (byte {error.start + 1})", file=file) from None
    shown = file.encode(errors="surrogateescape").decode(errors="replace")
    if language == TREE:  # with what it imports
        return Handwritten(shown, language, dumps(loads(text, file)))
    try:
        backend(language).read(text)  # so that what is wrong with it is said before anything runs
    except LanguageError as error:
        error.file = shown
        raise
    return Handwritten(shown, language, text)


def is_specification(path: str) -> bool:
    """Whether the name of a file says that it is a specification and no tree."""
    return _language(Path(path).suffix.removeprefix(".")) not in (None, TREE)


def _split(named: str) -> tuple[str, str]:
    """The name of what reads a file, and its path."""
    known = ", ".join((TREE, *all_backends()))
    before, colon, path = named.partition(":")
    if colon and path and (language := _language(before)) is not None:
        return language, path
    if colon and path and before.isidentifier() and not Path(named).exists():
        raise OptionError(f"{named}: unknown language {before}; known: {known}")
    suffix = Path(named).suffix
    if (language := _language(suffix.removeprefix("."))) is not None:
        return language, named
    reason = f"the suffix {suffix} tells no language" if suffix else "without a suffix nobody can tell its language"
    raise OptionError(f"{named}: {reason}; write LANG:{Path(named).name} with LANG one of {known}")


def _language(word: str) -> str | None:
    """The name of what reads a language: its own, or that of the backend whose language or suffix the word is."""
    return word.lower() if word.lower() in (TREE, *all_backends()) else speaking(word)
