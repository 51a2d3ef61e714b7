"""A conformance suite for backends.

    from backends.conformance import run

    report = run(MyBackend(), oracle, required=without_variables)
    assert report.passed, report

The oracle returns a monitor for a tree and a semantics, and shares nothing with the backend.
Refusals (`NotExpressible`) and too large texts (`TooLarge`) are counted separately; a refusal of a
required tree is a failure. If a backend is not `readable`, only its texts are checked.

Every operator of guards and every construct has an example: a tree, a detecting trace, and a trace
that fails only this operator or construct. A backend refuses the tree, or its text gives both
verdicts.
"""

import tomllib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from importlib.resources import files
from itertools import islice, product, zip_longest
from random import Random
from typing import Any, Final, TypeAlias, get_args

from rvaft.backend import Backend, Observed, Specification
from rvaft.core.restriction import restrict
from rvaft.errors import LanguageError, NotExpressible, TooLarge
from rvaft.language.parser import parse
from rvaft.model.assumptions import first_violation
from rvaft.model.event_time import TimeFormat
from rvaft.model.expressions import CLAUSES, GATES
from rvaft.model.guards import FUNCTIONS, NUMERIC, ORDERINGS, POINTS, Operation, Operator, walk
from rvaft.model.guards import variables as guard_variables
from rvaft.model.nodes import Causality, Gate, Kind, Side
from rvaft.model.patterns import ListPattern, Literal, Pattern, SomeItem, Variable, rigid_variables, variables, ways
from rvaft.model.patterns import walk as walk_pattern
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import DetectionMonitor, LeftOpen, Monitor

# The trees, each with its relevant events: gates with one to three children, with and without an
# event, under both causalities; every gate in every other; shared nodes; events that match several
# nodes; guards, variables, `ignore`; and parts that keep the alphabet of the whole tree.


@dataclass(frozen=True, slots=True)
class Example:
    """A tree with matching events, which are always tried in their order and in reverse.

    `determinate`: no event matches two occurrences that may come next. Under the semantics `shown`,
    the tree detects `detects` and not `misses`.
    """

    name: str
    tree: RVAFT
    events: tuple[Json, ...]
    determinate: bool = False
    detects: Sequence[Json] = ()
    misses: Sequence[Json] = ()
    shown: frozenset[Semantics] = frozenset(Semantics)


WRITTEN_GATES = (*GATES, "1of{n}", "2of{n}", "3of{n}")
EVENTS = "event at(k) = { k: k }; event px(p) = { x: p }; event py(p) = { y: p }; event pxy(p, q) = { x: p, y: q }; "
TYPED = 'event done() = { k: "d" }; ' + " ".join(
    f'event {name}(p: {type_}) = {{ k: "{name}", x: p }};'
    for name, type_ in (("ta", "text"), ("na", "number"), ("ia", "integer"), ("ba", "boolean"))
)
"""Event types of which each has a parameter of a declared type."""

GROUPS: dict[str, dict[str, Any]] = tomllib.loads(files("backends").joinpath("conformance.toml").read_text("utf-8"))
"""Trees by topic."""

CONSTRUCTS: Final = frozenset(
    {
        *Gate,
        *Causality,
        *POINTS,
        *(clause for clause in CLAUSES if clause not in (*Kind, "label", "without")),
        *(f"without, {side}" for side in Side),
        *(pattern.__name__ for pattern in get_args(Pattern)),
        *("ignore", "late", "shared", "a variable over two events", "a variable of some item", "when, on a gate"),
    }
)
"""All constructs of trees except operators of guards, and kinds and labels, which change no
verdict.
"""

assert set(GROUPS["operator"]) == set(Operator), set(GROUPS["operator"]) ^ set(Operator)
assert {*TimeFormat} <= set(GROUPS["format"]), set(GROUPS["format"]) ^ set(TimeFormat)
assert set(GROUPS["construct"]) == CONSTRUCTS, set(GROUPS["construct"]) ^ CONSTRUCTS

DETERMINATE = {
    "one value twice",
    "two values that must differ",
    "a guard on an event",
    "a guard on a later event",
    "guards as alternatives",
    "undefined guards",
}

VALUES: tuple[Json, ...] = tuple({name: value} for name in "xyk" for value in range(name != "x", 4))
PAIRS: tuple[Json, ...] = tuple({"x": x, "y": y} for x, y in ((1, 1), (1, 2), (2, 1)))

TIMES: Final = (0, "1.0", 2.5)
TEXTS: Final = ("ab", "Ab", "b", "1e0", "01", 1, -1.5, 2, None, [1])

AT_A: Final = "r sand a b; b on py(_); a on "
DECISIVE: dict[str, tuple[str, Json]] = {
    "at least, and equal": ("px(X) when X >= 2", 2),
    "more than, and equal": ("px(X) when X > 2", 2),
    "at most, and equal": ("px(X) when X <= 2", 2),
    "less than, and equal": ("px(X) when X < 2", 2),
    "one of two conditions": ("px(X) when X < 1 or X > 2", 3),
    "the other of two conditions": ("px(X) when X > 2 or X < 1", 3),
    "the first of both conditions": ("px(X) when X > 0 and X < 3", 3),
    "the second of both conditions": ("px(X) when X < 3 and X > 0", 0),
    "a condition that does not hold": ("px(X) when not (X == 1)", 1),
    "a text for a number": ("px(1)", "1"),
    "a number for a text": ('px("1")', 1),
    "a truth for a number": ("px(1)", True),
    "a number for a truth": ("px(true)", 1),
    "a number written otherwise": ("px(1)", 1.0),
    "nothing for a number": ("px(0)", None),
    "a text equal to a number": ("px(X) when X == 1", "1"),
    "a truth equal to a number": ("px(X) when X == 1", True),
    "a text unequal to a number": ("px(X) when X != 1", "1"),
    "a text more than a number": ("px(X) when X > 0", "1"),
    "a truth more than a number": ("px(X) when X > 0", True),
}
"""Per example: an event pattern, and a value that is easily confused with a matching one."""


def examples() -> Iterator[Example]:
    """Yield all examples in a stable order."""
    leaves = ("a", "b", "c")
    for size, gate in product((1, 2, 3), WRITTEN_GATES):
        if not gate[0].isdigit() or int(gate[0]) <= size:
            text = f"r {gate.format(n=size)} {' '.join(leaves[:size])};"
            yield _default(text, text)
            for causality in ("top_down", "bottom_up"):
                own = f"causality {causality}; t sand r z; {text.removesuffix(';')} on at(1);"
                yield _default(f"{text} with an event, {causality}", own)
    for outer, inner in product((*GATES, "2of3"), repeat=2):
        text = f"r {outer} a g{' d' * (outer == '2of3')}; g {inner} b c{' e' * (inner == '2of3')};"
        yield _default(text, text)
    for name, text in (GROUPS["plain"] | GROUPS["shared"]).items():
        yield _default(name, text)
        yield _default(f"{name}, bottom up", f"causality bottom_up; {text}")
    values: list[Json] = [{"x": 1}, {"y": 1}, {"x": 1, "y": 1}, {"x": 2}, {"y": 2}, {"k": 1}, {"k": 2}]
    for name, text in (GROUPS["overlapping"] | GROUPS["ignoring"]).items():
        yield Example(name, _tree(text), tuple(values))
    for name, text in GROUPS["variables"].items():
        events = [event for event in VALUES if "k" not in event or "at(" in text]
        events += [*(PAIRS if "pxy" in text else ()), {"x": "1"}, {"x": 1.0}]
        yield Example(name, _tree(text), tuple(events), name in DETERMINATE)
    for name, (event, value) in DECISIVE.items():
        yield Example(name, _tree(f"{AT_A}{event};"), ({"x": value}, {"y": 1}, {"x": 0}), determinate=True)
    for name, text in (GROUPS["counted"] | GROUPS["ending"]).items():
        one = _default(name, text)
        yield replace(one, events=(*one.events, *(event for event in VALUES if "k" not in event and "px" in text)))
    for name, text in GROUPS["timed"].items():
        one = _default(name, text)
        times: list[Json] = [*({"t": time} for time in TIMES), {}]
        yield replace(one, events=tuple({**event, **time} for event, time in product(one.events, times)))
    for name, text in GROUPS["text"].items():
        yield Example(name, _tree(text), tuple({field: value} for field in "xy" for value in TEXTS), determinate=True)
    for name, text in GROUPS["assuming"].items():
        kind = next((kind for kind in ("na", "ia", "ba") if f" {kind}(" in text), "ta")
        typed: list[Json] = [{"k": kind, "x": value} for value in (*TEXTS, True, False, "AB", "bc", 2**53)]
        others: list[Json] = [{"k": kind}, {"k": kind.upper(), "x": "ab"}, {"k": "d"}, {"k": "d"}]
        stamped: list[Json] = [{field: 1, "t": time} for field in "xy" for time in TIMES]
        yield Example(
            name, _tree(f"{TYPED}{text}"), tuple(stamped if "time" in text else [*typed, *others]), determinate=True
        )
    yield from rows()
    whole = _default("the whole", "r or p q; p sand a b; q sand a t; t or c d; c fault; d attack;")
    for number in (1, 2, 3):
        yield Example(f"branch {number}", restrict(whole.tree, branch=number), whole.events)
    for kind in ("fault", "attack"):
        yield Example(f"the {kind}s", restrict(whole.tree, kind=kind), whole.events)


def rows() -> Iterator[Example]:
    """Yield a tree per operator on one event and on two, and a tree per construct."""
    for name, row in GROUPS["operator"].items():
        guard, holding, failing = row["one"]
        text = f"r sand a b; a on px(X) when {guard}; b on py(_);"
        yield _row(
            f"operator `{name}`, one event", text, *([{"x": x}, {"y": 1}] for x in (holding, failing)), determinate=True
        )
        guard, *pairs = row["two"]
        text = f"r sand a b; a on px(X); b on py(Y) when {guard};"
        yield _row(f"operator `{name}`, two events", text, *([{"x": x}, {"y": y}] for x, y in pairs), determinate=True)
    for name, row in GROUPS["construct"].items():
        traces = (
            [{"event": one} if isinstance(one, str) else one for one in row[key]] for key in ("detects", "misses")
        )
        shown = frozenset(map(Semantics, row.get("semantics", Semantics)))
        yield replace(_row(f"construct `{name}`", row["tree"], *traces), shown=shown)
    for name, (first, near, far) in GROUPS["format"].items():
        found = ([{"event": "a", "t": first}, {"event": "b", "t": time}] for time in (near, far))
        yield _row(f"times as {name}", f"time t as {name}; r sand a b within 2 s;", *found)


def _row(name: str, text: str, detects: list[Json], misses: list[Json], *, determinate: bool = False) -> Example:
    events = {repr(event): event for event in (*detects, *misses)}
    return Example(name, _tree(text), tuple(events.values()), determinate, detects, misses)


def _tree(text: str) -> RVAFT:
    return parse(f"{EVENTS} toplevel {'t' if ' t sand r z' in text else 'r'}; {text}").build()


def _default(name: str, text: str) -> Example:
    tree = _tree(text)
    words = [n.name for n in tree.top_down() if n.has_event and n.on is None]
    numbers = [{"k": number} for number in (1, 2) if f"at({number})" in text]
    return Example(name, tree, (*({"event": word} for word in sorted(words)), *numbers))


# Requirements, and the results of a run.

Oracle: TypeAlias = Callable[[RVAFT, Semantics], Monitor]
Required: TypeAlias = Callable[[Example, Semantics], bool]
Trace: TypeAlias = Sequence[Json]
Finding: TypeAlias = tuple[str, str, Trace]

NOISE: Json = {"nothing": "of interest"}

VARIANTS: Final = 48

ALIKE: Final = 4


OF_STRINGS: Final = FUNCTIONS - NUMERIC


def everything(example: Example, semantics: Semantics) -> bool:  # noqa: ARG001 -- a `Required`
    """Require every tree under every semantics."""
    return True


def no_variables_of_items(example: Example, semantics: Semantics) -> bool:  # noqa: ARG001 -- a `Required`
    """Require every tree, except variables inside `[..., P, ...]`."""
    return not any(rigid_variables(part.item) for part in _some_items(example.tree))


def _some_items(tree: RVAFT) -> Iterator[SomeItem]:
    patterns = (pattern for name in tree.occurrences if (pattern := tree.pattern(name)) is not None)
    return (part for pattern in patterns for part in walk_pattern(pattern) if isinstance(part, SomeItem))


def no_texts_of_several(example: Example, semantics: Semantics) -> bool:
    """Require every tree, except guards that search a string of one event in that of another."""
    functions = (Operator.STARTSWITH, Operator.ENDSWITH, Operator.CONTAINS)
    names = (f"operator `{name}`, two events" for name in functions)
    return everything(example, semantics) and example.name not in names


def without_variables(example: Example, semantics: Semantics) -> bool:  # noqa: ARG001 -- a `Required`
    """Require every tree without variables, also of counted events, and times."""
    return not (example.tree.variables or _has_own_values(example.tree)) and example.tree.time is None


def without_variables_or_determinate(example: Example, semantics: Semantics) -> bool:
    """Require also determinate trees with variables, unless the semantics skips events.

    Trees that test strings or times are not required.
    """
    if asks_of_strings(example.tree, semantics) or example.tree.time is not None or any(_some_items(example.tree)):
        return False
    anywhere = semantics in (Semantics.SCATTERED, Semantics.CONSECUTIVE)
    determinate = example.determinate and not anywhere and not _has_own_values(example.tree)
    return without_variables(example, semantics) or determinate


def _has_own_values(tree: RVAFT) -> bool:
    return any(node.own_values for node in tree.top_down())


def scattered_by_single_events(example: Example, semantics: Semantics) -> bool:
    """Require `scattered` trees without variables and times whose patterns compare with constants."""
    parts = (
        part
        for name in example.tree.occurrences
        if (p := example.tree.pattern(name)) is not None
        for part in walk_pattern(p)
    )
    simple = all(not isinstance(part, ListPattern | SomeItem) and part != Literal(None) for part in parts)
    return semantics is Semantics.SCATTERED and without_variables(example, semantics) and simple


def asks_of_strings(tree: RVAFT, semantics: Semantics) -> bool:
    """Return whether a guard orders or searches strings.

    Under `projected` and `consecutive`, the guards of `ignore` and of the alphabet count too.
    """
    tested_guards = [node.when for node in tree.top_down()]
    if semantics.projects:
        tested_guards += [entry.when for entry in tree.alphabet] + [ignore.when for ignore in tree.ignores]
    parts = [part for guard in tested_guards for part in walk(guard)]
    if any(isinstance(part, Operation) and part.operator in OF_STRINGS for part in parts):
        return True
    ordering = [part for part in parts if isinstance(part, Operation) and part.operator in ORDERINGS]
    kinds = ([type(one.value) if isinstance(one, Literal) else type(one) for one in part.operands] for part in ordering)
    return any(Variable in some and str in some for some in kinds)


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
