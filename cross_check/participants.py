"""Who takes part in a comparison: the reference, the engine, and the text of each backend run by its own reader."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

from cross_check.sizes import SCENARIOS, most_scenarios
from rvaft.backend import Observed, Specification, all_backends, backend
from rvaft.engine import engine
from rvaft.errors import NotExpressible, RvaftError, TooLarge, ToolFailed, ToolMissing
from rvaft.guards import Guard, Operation
from rvaft.model import Kind
from rvaft.monitors import Monitor
from rvaft.patterns import ListPattern, Literal, ObjectPattern, Pattern, Variable, substitute, walk
from rvaft.patterns import variables as pattern_variables
from rvaft.restrict import restrict
from rvaft.semantics import Reference
from rvaft.tree import RVAFT
from rvaft.values import Json
from rvaft.verdict import Semantics, Verdict

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
    return found.faithful and found.form_of is None


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
