"""The suite that every backend has to pass, for the author of any backend to run.

    from backends.conformance import run
    report = run(MyBackend(), oracle, required=without_variables)
    assert report.passed, report

The expected verdicts come from an oracle that the caller gives, a monitor for a tree and a semantics that shares nothing with the
backend. A refusal (`NotExpressible`) and a text that would be too large (`TooLarge`) are counted apart from each other and
from failures; a refusal of what the caller requires is one. Where a tool is missing, `ToolMissing` goes through to the caller.
"""

from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import islice, product
from random import Random
from typing import Final, TypeAlias

from backends.conformance_trees import Example, examples
from rvaft.backend import Backend, Observed, Specification
from rvaft.errors import LanguageError, NotExpressible, TooLarge
from rvaft.guards import Guard, Operation, Operator, holds
from rvaft.guards import variables as guard_variables
from rvaft.monitors import Monitor
from rvaft.patterns import Literal, Variable, match, variables
from rvaft.tree import RVAFT
from rvaft.values import Json
from rvaft.verdict import Semantics, Verdict

Oracle: TypeAlias = Callable[[RVAFT, Semantics], Monitor]
Required: TypeAlias = Callable[[Example, Semantics], bool]
Trace: TypeAlias = Sequence[Json]

NOISE: Json = {"nothing": "of interest"}

VARIANTS: Final = 48
"""So many events are held against what a backend says it observes."""


def everything(example: Example, semantics: Semantics) -> bool:  # noqa: ARG001 -- a `Required`
    """Every tree under every semantics must be expressible."""
    return True


def without_variables(example: Example, semantics: Semantics) -> bool:  # noqa: ARG001 -- a `Required`
    """Every tree without variables must be."""
    return not example.tree.variables


def without_variables_or_determinate(example: Example, semantics: Semantics) -> bool:
    """Also trees with variables that never have two assignments to follow, where no event is skipped at will.

    Except, with variables or without, where the order of strings has to be asked (`strings_ordered`).
    """
    if strings_ordered(example.tree, semantics):
        return False
    return not example.tree.variables or (example.determinate and semantics is not Semantics.SCATTERED)


def strings_ordered(tree: RVAFT, semantics: Semantics) -> bool:
    """Whether a guard orders what an event has against a string.

    That may be a guard of a node or, under `projected`, one that relevance depends on: of `ignore`, or of a node of the whole tree.
    """
    asked = [node.when for node in tree.top_down()]
    if semantics is Semantics.PROJECTED:
        asked += [entry.when for entry in tree.alphabet] + [ignore.when for ignore in tree.ignores]
    return any(_orders_a_string(guard) for guard in asked if guard is not None)


def _orders_a_string(guard: Guard) -> bool:
    match guard:
        case Operation(Operator.LT | Operator.LE | Operator.GT | Operator.GE, (left, right)):
            return any(
                isinstance(one, Variable) and isinstance(other, Literal) and isinstance(other.value, str)
                for one, other in ((left, right), (right, left))
            ) or any(map(_orders_a_string, (left, right)))
        case Operation(_, operands):
            return any(map(_orders_a_string, operands))
        case _:
            return False


@dataclass(frozen=True, slots=True)
class Failure:
    """One check that did not pass, on which tree and trace, and how."""

    check: str
    example: str
    semantics: Semantics
    what: str
    trace: tuple[Json, ...] = ()

    def __str__(self) -> str:
        trace = f" on {list(self.trace)}" if self.trace else ""
        return f"{self.check}: {self.example} under {self.semantics}{trace}: {self.what}"


@dataclass(slots=True)
class Report:
    """What a run has found; `refusals` and `too_large` name the example and the semantics."""

    backend: str
    translations: int = 0
    verdicts: int = 0
    failures: list[Failure] = field(default_factory=list)
    refusals: list[tuple[str, Semantics]] = field(default_factory=list)
    too_large: list[tuple[str, Semantics]] = field(default_factory=list)

    @property
    def passed(self) -> bool:
        """Whether something was compared and nothing failed."""
        return self.verdicts > 0 and not self.failures

    def __str__(self) -> str:
        summary = (
            f"{self.backend}: {self.translations} translations, {self.verdicts} verdicts compared, {len(self.failures)} "
            f"failures, {len(self.refusals)} refusals, {len(self.too_large)} too large"
        )
        return "\n".join([summary, *map(str, self.failures[:10])])


def run(
    backend: Backend,
    oracle: Oracle,
    *,
    required: Required = everything,
    trees: Iterable[Example] | None = None,
    words: int = 24,
    seed: int = 0,
    limit: int | None = None,
) -> Report:
    """Check a backend on the examples (or on other `trees`) under each semantics that it offers.

    `words` bounds the traces for each tree and semantics, `limit` is handed to `translate`.
    """
    report = Report(backend.name)
    for example in examples() if trees is None else trees:
        for semantics in Semantics:
            check = _Check(backend, oracle, example, semantics, report)
            specification = check.translated(required(example, semantics), limit)
            if specification is not None:
                traces = list(_traces(example, words, Random(f"{seed} {example.name}")))  # noqa: S311 -- no secret
                check.all(specification, traces)
    return report


def _traces(example: Example, most: int, random: Random) -> Iterator[Trace]:
    """All words over the events of an example where there are few, otherwise a sample, and some longer ones."""
    letters = [*example.events, NOISE]
    length = 2
    while len(letters) ** (length + 1) <= most:
        length += 1
    short = list(islice(product(letters, repeat=length), most * 10))
    yield from random.sample(short, min(len(short), most))
    yield list(example.events)
    yield list(reversed(example.events))
    for _ in range(most // 2):
        yield [random.choice(letters) for _ in range(random.randint(length, 7))]
    for _ in range(most // 4):
        shuffled = random.sample(example.events, len(example.events))
        shuffled.insert(random.randint(0, len(shuffled)), random.choice(letters))
        yield shuffled


def _variants(traces: Sequence[Trace]) -> list[Json]:
    """The events of some traces, each also with one more field, with one less, and with other values."""
    found: dict[str, Json] = {}
    for event in (NOISE, *(event for trace in traces for event in trace)):
        changed = [event, {**event, "one more": 1}]
        for name in event:
            changed.append({other: value for other, value in event.items() if other != name})
            changed += [{**event, name: value} for value in ("another", 7, [7])]
        found.update((repr(one), one) for one in changed)
    return list(found.values())[:: 1 + len(found) // VARIANTS]


def _answer(question: Observed, event: Json) -> object:
    """Whether an event matches and the guard holds; where other events share variables, the values that it gives them."""
    binding = match(question.pattern, event, {})
    names = [*variables(question.pattern), *(() if question.when is None else guard_variables(question.when))]
    if binding is None or any(not name.startswith("_") for name in names):
        return None if binding is None else tuple((name, repr(value)) for name, value in binding.items())
    return question.when is None or (set(names) <= binding.keys() and holds(question.when, binding))


def _effect(monitor: Monitor, event: Json) -> tuple[Verdict, Hashable]:
    after = monitor.fork()
    return after.step(event), after.state


@dataclass(frozen=True, slots=True)
class _Check:
    """The checks of one tree under one semantics."""

    backend: Backend
    oracle: Oracle
    example: Example
    semantics: Semantics
    report: Report

    def translated(self, required: bool, limit: int | None) -> Specification | None:
        """The specification, unless it is refused or too large."""
        try:
            specification = self.backend.translate(self.example.tree, self.semantics, limit=limit)
        except NotExpressible as refusal:
            self.report.refusals.append((self.example.name, self.semantics))
            if required:
                self._fail("required", f"refused: {refusal.reason}")
            return None
        except TooLarge as error:
            self.report.too_large.append((self.example.name, self.semantics))
            if limit is None:
                self._fail("size", f"a small tree is too large: {error.what}")
            return None
        self.report.translations += 1
        return specification

    def all(self, specification: Specification, traces: Sequence[Trace]) -> None:
        """Every check that needs a text."""
        self._repeatable(specification)
        try:
            self._fresh(specification)
        except LanguageError as error:
            self._fail("readable", f"the backend cannot read its own text: {error.message}")
            return
        self._verdicts(specification, traces)
        self._self_contained(specification, traces[:5])
        self._independent(specification, traces[:5])
        self._states(specification, traces)
        self._observed(specification, traces)

    def _repeatable(self, specification: Specification) -> None:
        again = self.backend.translate(self.example.tree, self.semantics)
        if again.text != specification.text:
            self._fail("repeatable", "the second translation differs from the first")
        if specification.language != self.backend.language:
            self._fail("language", f"{specification.language} is not {self.backend.language}")
        if specification.metrics.symbols <= 0:
            self._fail("metrics", f"{specification.metrics.symbols} symbols")

    def _fresh(self, specification: Specification) -> None:
        if specification.monitor().verdict is not Verdict.UNKNOWN:
            self._fail("start", "the verdict before any event is not unknown")

    def _verdicts(self, specification: Specification, traces: Sequence[Trace]) -> None:
        """After every prefix the verdict is the oracle's, also after a final one."""
        for trace in traces:
            monitor, expected = specification.monitor(), self.oracle(self.example.tree, self.semantics)
            for position, event in enumerate(trace, 1):
                got, wanted = monitor.step(event), expected.step(event)
                self.report.verdicts += 1
                if got is not wanted or monitor.verdict is not got:
                    self._fail("verdict", f"{got.symbol} instead of {wanted.symbol}", trace[:position])
                    break

    def _self_contained(self, specification: Specification, traces: Sequence[Trace]) -> None:
        """The text alone says everything."""
        for trace in traces:
            read = self.backend.read(str(specification.text))
            if list(read.run(trace)) != list(specification.monitor().run(trace)):
                self._fail("self-contained", "the text read back gives other verdicts", trace)

    def _independent(self, specification: Specification, traces: Sequence[Trace]) -> None:
        """Monitors that run side by side do not feel each other."""
        alone = [list(specification.monitor().run(trace)) for trace in traces]
        beside: list[list[Verdict]] = [[] for _ in traces]
        monitors = [specification.monitor() for _ in traces]
        for position in range(max(map(len, traces), default=0)):
            for number, trace in enumerate(traces):
                if position < len(trace):
                    beside[number].append(monitors[number].step(trace[position]))
        for trace, one, other in zip(traces, alone, beside, strict=True):
            if one != other:
                self._fail("independent", "another monitor of the same text changes the verdicts", trace)

    def _states(self, specification: Specification, traces: Sequence[Trace]) -> None:
        """Monitors with equal states give equal verdicts from there on."""
        by_state: dict[object, Trace] = {}
        futures = traces[-3:]
        for trace in traces[:10]:
            monitor = specification.monitor()
            for position, event in enumerate(trace, 1):
                monitor.step(event)
                known = by_state.setdefault(monitor.state, trace[:position])
                if known == trace[:position]:
                    continue
                if self._after(specification, known, futures) != self._after(specification, trace[:position], futures):
                    self._fail("state", f"the state is that after {list(known)}, the future is not", trace[:position])
                    return

    def _observed(self, specification: Specification, traces: Sequence[Trace]) -> None:
        """Where the backend says what a text asks of events, events with equal answers have equal effects."""
        questions = self.backend.observed(specification.text)
        if questions is None:
            return
        groups: dict[tuple[object, ...], list[Json]] = {}
        for event in _variants(traces):
            groups.setdefault(tuple(_answer(question, event) for question in questions), []).append(event)
        alike = [group for group in groups.values() if len(group) > 1]
        for trace in traces[-3:]:
            for position in (0, len(trace) // 3, len(trace) // 2):
                monitor = specification.monitor()
                list(monitor.run(trace[:position]))
                for first, *others in alike:
                    wanted = _effect(monitor, first)
                    for other in others:
                        if _effect(monitor, other) != wanted:
                            what = f"{other} has another effect than {first}, and the same answers"
                            self._fail("observed", what, trace[:position])
                            return

    @staticmethod
    def _after(specification: Specification, prefix: Trace, futures: Sequence[Trace]) -> list[list[Verdict]]:
        verdicts = []
        for future in futures:
            monitor = specification.monitor()
            for event in prefix:
                monitor.step(event)
            verdicts.append([monitor.verdict, *monitor.run(future)])
        return verdicts

    def _fail(self, check: str, what: str, trace: Trace = ()) -> None:
        self.report.failures.append(Failure(check, self.example.name, self.semantics, what, tuple(trace)))
