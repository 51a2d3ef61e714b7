"""The checks of the conformance suite, and the results of a run."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import islice, product, zip_longest
from random import Random
from typing import Final, TypeAlias

from backends.conformance.requirements import Required, everything
from backends.conformance.trees import Example, examples
from rvaft.backend import Backend, Observed, Specification
from rvaft.errors import LanguageError, NotExpressible, TooLarge
from rvaft.model.assumptions import first_violation
from rvaft.model.guards import variables as guard_variables
from rvaft.model.patterns import variables, ways
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import DetectionMonitor, LeftOpen, Monitor

Oracle: TypeAlias = Callable[[RVAFT, Semantics], Monitor]
Trace: TypeAlias = Sequence[Json]
Finding: TypeAlias = tuple[str, str, Trace]
NOISE: Json = {"nothing": "of interest"}
VARIANTS: Final = 48
ALIKE: Final = 4


@dataclass(frozen=True, slots=True)
class ConformanceFailure:
    """A failed check with its tree, semantics and trace."""

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
    """The results of a run; `refusals` and `too_large` name example and semantics."""

    backend: str
    readable: bool = True
    translations: int = 0
    verdicts: int = 0
    failures: list[ConformanceFailure] = field(default_factory=list)
    refusals: list[tuple[str, Semantics, str]] = field(default_factory=list)
    too_large: list[tuple[str, Semantics]] = field(default_factory=list)

    @property
    def passed(self) -> bool:
        """Whether something was compared (if not readable: translated) and nothing failed."""
        return (self.verdicts if self.readable else self.translations) > 0 and not self.failures

    def __str__(self) -> str:
        summary = (
            f"{self.backend}: {self.translations} translations, {self.verdicts} verdicts compared, "
            f"{len(self.failures)} "
            f"failures, {len(self.refusals)} refusals, {len(self.too_large)} too large"
        )
        reasons = Counter(reason for _, _, reason in self.refusals)
        refused = [f"not expressible, {count} times: {reason}" for reason, count in reasons.most_common()]
        return "\n".join([summary, *refused, *map(str, self.failures[:10])])


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
    """Check a backend on the examples (or `trees`) under each semantics.

    `words` bounds the traces per tree and semantics; `limit` goes to `translate`.

    >>> from rvaft import monitor
    >>> from rvaft.backend import backend
    >>> engine = lambda tree, semantics: monitor(tree, semantics=semantics)
    >>> print(run(backend("rml"), engine, trees=[*examples()][:2], words=2))
    rml: 8 translations, 88 verdicts compared, 0 failures, 0 refusals, 0 too large
    """
    report = Report(backend.name, readable=backend.readable)
    for example, semantics in product(examples() if trees is None else trees, Semantics):
        found: list[Finding] = []
        try:
            specification = backend.translate(example.tree, semantics, limit=limit)
        except NotExpressible as refusal:
            report.refusals.append((example.name, semantics, refusal.reason))
            if required(example, semantics):
                found.append(("required", f"refused: {refusal.reason}", ()))
        except TooLarge as error:
            report.too_large.append((example.name, semantics))
            if limit is None:
                found.append(("size", f"a small tree is too large: {error.what}", ()))
        else:
            report.translations += 1
            found += _text(backend, example.tree, semantics, specification)
            if backend.readable:
                every = traces(example, words, Random(f"{seed} {example.name}"))  # noqa: S311 -- no secret
                tried = [trace for trace in every if not _breaks(specification, example.tree, trace)]
                try:
                    first = specification.monitor()
                    if first.verdict is not Verdict.UNKNOWN:
                        found.append(("start", "the verdict before any event is not unknown", ()))
                    if first.left_open is not None:
                        found += _left_open(example, first.left_open, specification)
                        tried = [trace for trace in tried if not first.left_open(trace)]
                except LanguageError as error:
                    found.append(("readable", f"the backend cannot read its own text: {error.message}", ()))
                else:
                    wanted = partial(oracle, example.tree, semantics)
                    if isinstance(first, DetectionMonitor):
                        found += _detections(backend, specification, wanted, tried, report)
                        tried = tried[:2]  # event by event, each step reads the whole prefix
                    found += _verdicts(specification, wanted, tried, report, expressible=backend.verdicts)
                    alone = [[*specification.monitor().run(trace)] for trace in tried[:3]]
                    found += _self_contained(backend, specification, tried[:3], alone)
                    found += _independent(specification, tried[:3], alone)
                    found += islice(_states(specification, tried), 1)
                    found += islice(_observed(backend, specification, tried), 1)
        report.failures += [
            ConformanceFailure(check, example.name, semantics, what, tuple(trace)) for check, what, trace in found
        ]
    return report


def traces(example: Example, most: int, random: Random) -> Iterator[Trace]:
    """Yield all words over the events, or a sample, and some longer traces."""
    yield from (trace for trace in (example.detects, example.misses) if trace)
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


def _text(backend: Backend, tree: RVAFT, semantics: Semantics, specification: Specification) -> Iterator[Finding]:
    if backend.translate(tree, semantics).text != specification.text:
        yield "repeatable", "the second translation differs from the first", ()
    if specification.metrics.symbols <= 0:
        yield "metrics", f"{specification.metrics.symbols} symbols", ()


def _breaks(specification: Specification, tree: RVAFT, trace: Trace) -> bool:
    """Whether a trace breaks an assumption of a text, which then says nothing about it."""
    return bool(specification.assumes) and first_violation(tree, trace, specification.assumes) is not None


def _left_open(example: Example, left_open: LeftOpen, specification: Specification) -> Iterator[Finding]:
    for trace in (example.detects, example.misses):
        if trace and not _breaks(specification, example.tree, trace) and (why := left_open(trace)):
            yield "left open", f"the text has no verdict for the trace of a row: {why}", trace


def _verdicts(
    specification: Specification,
    oracle: Callable[[], Monitor],
    tried: Sequence[Trace],
    report: Report,
    *,
    expressible: frozenset[Verdict],
) -> Iterator[Finding]:
    """Compare the verdict after every prefix; one that the language cannot express counts as
    unknown.
    """
    start = oracle()
    for trace in tried:
        monitor, expected = specification.monitor(), start.fork()
        for position, event in enumerate(trace, 1):
            got, wanted = monitor.step(event), expected.step(event)
            wanted = wanted if wanted in expressible else Verdict.UNKNOWN
            report.verdicts += 1
            if got is not wanted or monitor.verdict is not got:
                yield "verdict", f"{got.symbol} instead of {wanted.symbol}", trace[:position]
                break


def _detections(
    backend: Backend,
    specification: Specification,
    oracle: Callable[[], Monitor],
    tried: Sequence[Trace],
    report: Report,
) -> Iterator[Finding]:
    reader = backend.read(str(specification.text))
    assert isinstance(reader, DetectionMonitor)
    start = oracle()
    for trace, got in zip(tried, reader.first_detections(tried), strict=True):
        verdicts = [*start.fork().run(trace)]
        wanted = verdicts.index(Verdict.TRUE) + 1 if Verdict.TRUE in verdicts else None
        report.verdicts += len(trace)
        if got != wanted:
            yield "detection", f"first at event {got} instead of {wanted}", trace


def _self_contained(
    backend: Backend, specification: Specification, tried: Sequence[Trace], alone: Sequence[list[Verdict]]
) -> Iterator[Finding]:
    for trace, verdicts in zip(tried, alone, strict=True):
        if list(backend.read(str(specification.text)).run(trace)) != verdicts:
            yield "self-contained", "the text read back gives other verdicts", trace


def _independent(
    specification: Specification, tried: Sequence[Trace], alone: Sequence[list[Verdict]]
) -> Iterator[Finding]:
    beside: list[list[Verdict]] = [[] for _ in tried]
    monitors = [specification.monitor() for _ in tried]
    for events in zip_longest(*tried):
        for monitor, event, verdicts in zip(monitors, events, beside, strict=True):
            if event is not None:
                verdicts.append(monitor.step(event))
    for trace, verdicts, wanted in zip(tried, beside, alone, strict=True):
        if verdicts != wanted:
            yield "independent", "another monitor of the same text changes the verdicts", trace


def _states(specification: Specification, tried: Sequence[Trace]) -> Iterator[Finding]:
    def futures(prefix: Trace, monitor: Monitor) -> list[list[Verdict]]:
        left_open = monitor.left_open or (lambda _: "")
        some = [future for future in tried[-2:] if not left_open([*prefix, *future])]
        return [[monitor.verdict, *monitor.fork().run(future)] for future in some]

    first: dict[object, tuple[Trace, Monitor]] = {}
    known: dict[object, list[list[Verdict]]] = {}
    met: Counter[object] = Counter()
    for prefix, monitor in _after(specification, (one[:end] for one in tried[:6] for end in range(1, len(one) + 1))):
        state = monitor.state
        before, other = first.setdefault(state, (prefix, monitor))
        met[state] += 1
        if 1 < met[state] <= ALIKE:  # a state of a single prefix has no counterpart
            if state not in known:
                known[state] = futures(before, other)
            if futures(prefix, monitor) != known[state]:
                yield "state", f"the state equals that after {list(before)}, but the future verdicts differ", prefix


def _observed(backend: Backend, specification: Specification, tried: Sequence[Trace]) -> Iterator[Finding]:
    questions = backend.observed(specification.text)
    if questions is None:
        return
    groups: dict[tuple[object, ...], list[Json]] = {}
    for event in _variants(tried):
        groups.setdefault(tuple(_answer(question, event) for question in questions), []).append(event)
    prefixes = (trace[: len(trace) // part] for trace in tried[-2:] for part in (len(trace) + 1, 2))
    for prefix, monitor in _after(specification, prefixes):
        for first, *others in groups.values():
            wanted = _effect(monitor, first) if others else None
            for other in others:
                if _effect(monitor, other) != wanted:
                    yield "observed", f"{other} and {first} have different effects, but match the same patterns", prefix


def _after(specification: Specification, prefixes: Iterable[Trace]) -> Iterator[tuple[Trace, Monitor]]:
    read = {repr([]): specification.monitor()}
    for prefix in {repr(one): one for one in prefixes}.values():
        known = read.get(repr(prefix[:-1]))
        monitor = known.fork() if known else specification.monitor()
        list(monitor.run(prefix[-1:] if known else prefix))
        read[repr(prefix)] = monitor
        yield prefix, monitor


def _variants(traces: Sequence[Trace]) -> list[Json]:
    found: dict[str, Json] = {}
    for event in (NOISE, *(event for trace in traces for event in trace)):
        changed = [event, {**event, "one more": 1}]
        for name in event:
            changed.append({other: value for other, value in event.items() if other != name})
            changed += [{**event, name: value} for value in ("another", 7, [7])]
        found.update((repr(one), one) for one in changed)
    return list(found.values())[:: 1 + len(found) // VARIANTS]


def _answer(question: Observed, event: Json) -> object:
    bindings = [*ways(question.pattern, event, {})]
    names = [*variables(question.pattern), *guard_variables(question.when)]
    if any(not name.startswith("_") for name in names):
        return tuple(tuple((name, repr(value)) for name, value in one.items()) for one in bindings)
    return question.fits(event)


def _effect(monitor: Monitor, event: Json) -> object:
    after = monitor.fork()
    return after.step(event), after.state
