"""Who takes part in a comparison: the reference, the engine, and the text of each backend run by its own reader."""

import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from rvaft.analysis.branches import restrict
from rvaft.analysis.scenarios import SCENARIOS, most_scenarios
from rvaft.api import loads
from rvaft.backend import Observed, Specification, all_backends, backend, speaking
from rvaft.engine import engine
from rvaft.errors import LanguageError, NotExpressible, OptionError, RvaftError, TooLarge, ToolFailed, ToolMissing
from rvaft.language.printer import dumps
from rvaft.model.guards import Guard, Operation
from rvaft.model.nodes import Kind
from rvaft.model.patterns import ListPattern, Literal, ObjectPattern, Pattern, Variable, substitute, walk
from rvaft.model.patterns import variables as pattern_variables
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import Monitor
from rvaft.semantics import Reference

REFERENCE: Final = "reference"
ENGINE: Final = "engine"


@dataclass(frozen=True, slots=True)
class Participant:
    """Somebody who gives verdicts; `start` makes a fresh monitor.

    `observed` is all that it asks of events, None where nobody knows; `specification` is there for a text, `tree` for the meaning of
    another tree than the one that is compared.
    """

    name: str
    start: Callable[[], Monitor]
    specification: Specification | None = None
    observed: tuple[Observed, ...] | None = None
    tree: RVAFT | None = None


@dataclass(frozen=True, slots=True)
class Answer:
    """What a program of others says of one trace.

    `verdicts` has one verdict for each event; it is None where the program could not run, which `error` then explains.
    `deviations` names the known deviations of the program that can show on this trace: where there are any and it says something
    else, that says nothing about the text.
    """

    verdicts: tuple[Verdict, ...] | None = None
    error: str = ""
    deviations: tuple[str, ...] = ()
    expired: bool = False
    """Whether the time was too short for it."""


@dataclass(frozen=True, slots=True)
class Outside:
    """A program of others, which answers many whole traces at once; `answers` raises what `Absent` can hold."""

    name: str
    answers: Callable[[Sequence[Sequence[Json]]], Sequence[Answer]]
    specification: Specification


@dataclass(frozen=True, slots=True)
class Absent:
    """Somebody who cannot take part, and why; never counted as agreement."""

    name: str
    error: RvaftError

    @property
    def status(self) -> str:
        """In two words what the matter is."""
        match self.error:
            case NotExpressible():
                return "not expressible"
            case TooLarge():
                return "too large"
            case ToolMissing():
                return "tool missing"
            case _:
                return "could not run"


def faithful_backends() -> tuple[str, ...]:
    """The backends whose texts should mean the tree, each in one form."""
    return tuple(name for name in all_backends() if _compared(name))


def _compared(name: str) -> bool:
    try:
        found = backend(name)
    except ToolFailed:
        return True  # absent, and said to be
    return found.faithful and found.readable and found.form_of is None


def observed_by(tree: RVAFT) -> tuple[Observed, ...]:
    """What the meaning of a tree asks of events: its runtime events, its alphabet, and what it ignores."""
    patterns = (tree.pattern(name) for name in tree.occurrences)
    served = [Observed(pattern) for pattern in patterns if pattern is not None]
    relevant = [Observed(*_own(entry.pattern, entry.when)) for entry in tree.alphabet]
    ignored = [Observed(*_own(tree.instantiate(ignore.on), ignore.when)) for ignore in tree.ignores]
    return tuple(dict.fromkeys([*served, *relevant, *ignored]))


def literals(term: Pattern | Guard) -> Iterator[Json]:
    """The constants in a pattern or a guard."""
    todo: list[Pattern | Guard] = [term]
    while todo:
        match todo.pop():
            case Literal(value):
                yield value
            case Operation(_, operands):
                todo.extend(operands)
            case ObjectPattern() | ListPattern() as pattern:
                todo.extend(part for part in walk(pattern) if isinstance(part, Literal))
            case _:
                pass


def _own(pattern: Pattern, when: Guard | None) -> tuple[Pattern, Guard | None]:
    """The same question with variables of its own: some value each, whatever they are elsewhere."""
    by = {name: Variable(f"_{name}") for name in pattern_variables(pattern) if not name.startswith("_")}
    return substitute(pattern, dict(by)), None if when is None else _renamed(when, by)


def _renamed(guard: Guard, by: dict[str, Variable]) -> Guard:
    match guard:
        case Variable(name):
            return by.get(name, guard)
        case Operation(_, operands):
            return replace(guard, operands=tuple(_renamed(operand, by) for operand in operands))
        case _:
            return guard


def engine_of(part: RVAFT, semantics: Semantics) -> Participant | Absent:
    """The monitor that people run."""
    try:
        first = engine(part, semantics)
    except RvaftError as error:
        return Absent(ENGINE, error)
    return Participant(ENGINE, first.fork, observed=observed_by(part))


def reference_of(
    tree: RVAFT, semantics: Semantics, *, name: str = REFERENCE, branch: int | None = None, kind: Kind | None = None
) -> Participant | Absent:
    """The definition at work; absent where there are too many scenarios to try them all."""
    scenarios = most_scenarios(tree)
    if scenarios > SCENARIOS:
        return Absent(name, TooLarge(f"about {scenarios:.0e} scenarios to try one by one", limit=SCENARIOS))
    try:
        first = Reference(tree, semantics, branch=branch, kind=kind)
    except RvaftError as error:
        return Absent(name, error)
    observed = observed_by(restrict(tree, branch=branch, kind=kind))
    return Participant(name, first.fork, observed=observed)


def translated(name: str, part: RVAFT, semantics: Semantics, *, limit: int | None = None) -> Participant | Absent:
    """The text of one backend, run by its own reader; `limit` is that of the translation, None the backend's own."""
    try:
        language = backend(name)
        if not language.readable:
            raise OptionError(f"{name} is only emitted: nothing here runs its texts, so there is nothing to compare")
        specification = language.translate(part, semantics, limit=limit)
        first = specification.monitor()
        observed = language.observed(specification.text)
    except RvaftError as error:
        return Absent(name, error)
    return Participant(name, first.fork, specification, observed)


def verdicts_of(participant: Participant | Outside | Absent, trace: Sequence[Json]) -> tuple[Verdict, ...] | RvaftError:
    """What one participant says after every prefix, or why it says nothing."""
    try:
        match participant:
            case Absent(error=error):
                return error
            case Outside(name=name):
                (answer,) = participant.answers([trace])
                return ToolFailed(name, reason=answer.error) if answer.verdicts is None else answer.verdicts
            case Participant():
                return tuple(participant.start().run(trace))
    except RvaftError as error:
        return error


# Specifications written by hand, or by another tool, to be held against a tree.

TREE: Final = "rvaft"
"""The language of trees, beside those of the backends."""


@dataclass(frozen=True, slots=True)
class Handwritten:
    """The text of a file and the name of what reads it: a backend, or `rvaft` for another tree."""

    path: str
    language: str
    text: str

    def enlist(self, tree: RVAFT, semantics: Semantics) -> Participant | Absent:
        """The participant that this text makes; an atom that the text does not define is the event of the tree's node."""
        if self.language == TREE:
            other = loads(self.text)
            found = reference_of(other, semantics, name=self.path)
            return found if isinstance(found, Absent) else replace(found, tree=other)
        reader = backend(self.language)
        atoms = _Events(self.path, tree)
        first = reader.read(self.text, atoms=atoms)
        return Participant(self.path, first.fork, observed=reader.observed(self.text, atoms=atoms))


def handwritten(named: str) -> Handwritten:
    """What `[LANG:]FILE` names; the language follows the suffix where it is not given, and the file `-` is standard input.

    Raises `OSError` where the file cannot be read, `OptionError` where nobody can tell its language, `LanguageError` where it is no
    text in that language.
    """
    language, path = _split(named)
    data = sys.stdin.buffer.read() if path == "-" else Path(path).read_bytes()
    file = "<stdin>" if path == "-" else path
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        message = f"not UTF-8 (byte {error.start + 1})"
        raise LanguageError(message, file=file) from None
    shown = file.encode(errors="surrogateescape").decode(errors="replace")
    if language == TREE:  # with what it imports
        return Handwritten(shown, language, dumps(loads(text, file)))
    found = Handwritten(shown, language, text)
    _check(found)
    return found


def is_specification(path: str) -> bool:
    """Whether the name of a file says that it is a specification and no tree."""
    suffix = Path(path).suffix.removeprefix(".")
    return suffix != TREE and bool(suffix) and _language(suffix) is not None


def _split(named: str) -> tuple[str, str]:
    """The name of what reads a file, and its path."""
    before, colon, path = named.partition(":")
    if colon and path and (language := _language(before)) is not None:
        return language, path
    if colon and path and before.isidentifier() and not Path(named).exists():
        raise OptionError(f"{named}: unknown language {before}; known: {', '.join(_known())}")
    suffix = Path(named).suffix
    if (language := _language(suffix.removeprefix("."))) is not None and suffix:
        return language, named
    reason = f"the suffix {suffix} tells no language" if suffix else "without a suffix nobody can tell its language"
    raise OptionError(f"{named}: {reason}; write LANG:{Path(named).name} with LANG one of {', '.join(_known())}")


def _known() -> tuple[str, ...]:
    return (TREE, *all_backends())


def _language(word: str) -> str | None:
    """The name of what reads a language: its own, or that of the backend whose language or suffix the word is."""
    return word.lower() if word.lower() in _known() else speaking(word)


def _check(found: Handwritten) -> None:
    """Read the text once, so that what is wrong with it is said before anything runs."""
    try:
        backend(found.language).read(found.text)
    except LanguageError as error:
        raise LanguageError(
            error.message, file=found.path, line=error.line, column=error.column, source=error.source
        ) from None


class _Events(dict[str, Pattern]):
    """The events of a tree's nodes; an atom of another name is an error and not the default event."""

    def __init__(self, path: str, tree: RVAFT) -> None:
        self._path = path
        patterns = ((name, tree.pattern(name)) for name in tree.occurrences)
        super().__init__((name, pattern) for name, pattern in patterns if pattern is not None)

    def get(self, name: str, default: Any = None) -> Any:  # noqa: ARG002 (as in every mapping)
        """The event of a node; raises `LanguageError`."""
        if name not in self:
            reason = f"the atom {name} is no node with a runtime event, and the text does not say which event it is"
            raise LanguageError(reason, file=self._path)
        return self[name]


# The participant `ltlf-mona`: the emitted formula run by the automaton that ltlf2dfa and MONA make of it.
#
# It checks our own reading of formulas, which the participant `ltlf` runs; it is for small trees without variables.

NAME: Final = "ltlf-mona"


def mona_of(part: RVAFT, semantics: Semantics) -> Participant | Absent:
    """MONA's verdicts for a tree; absent where a tool is missing, the tree has variables, or it is too large for MONA."""
    ltlf = backend("ltlf")
    try:
        specification = ltlf.translate(part, semantics)
        first = ltlf.read_with("mona", specification.text)
        observed = ltlf.observed(specification.text)
    except RvaftError as error:
        return Absent(NAME, error)
    return Participant(NAME, first.fork, specification, observed)
