"""The interface that every specification language implements, and how backends are found.

A backend has two verbs: `translate` turns a tree into a `Specification`, `read` turns any text of the language into a
monitor. `Specification.monitor` reads the text back and never looks at the tree.
Built-in and third-party backends are found the same way: the entry-point group `rvaft.backends`, imported on use.
"""

import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from itertools import count
from time import perf_counter
from typing import Any, ClassVar, Final, TypeAlias, final

from rvaft.capabilities import Capabilities, Capability, Feature, Ties, Value, check
from rvaft.core.passes import Pass, decide_constants, property_of
from rvaft.core.property import Event, Part, Property
from rvaft.errors import NotExpressible, OptionError, RvaftError, ToolFailed, ToolMissing
from rvaft.model import guards, patterns
from rvaft.model.guards import Guard, Operator
from rvaft.model.patterns import Pattern
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import Monitor

GROUP = "rvaft.backends"
_EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)
_BEGIN: Final = 1_767_225_600_000_000_000
"""When a log begins whose events have no times, in nanoseconds: with the year 2026."""


Match: TypeAlias = frozenset[tuple[str, int]]
"""The occurrences of a match, each with the number of its event, from 1."""


@dataclass(frozen=True, slots=True)
class Metrics:
    """Sizes of a specification; None where a language has no such thing.

    `symbols` counts tokens of the property itself, without declarations, headers and comments;
    `subformulas` the distinct ones, or the atoms of a language that has no other parts; `states`
    those of an automaton, or the equations of RML; `seconds` is the time the translation took.

    >>> import rvaft
    >>> rvaft.translate(rvaft.loads("top sand a b;"), "rml", semantics="strict").metrics.symbols
    6
    """

    symbols: int
    subformulas: int | None = None
    states: int | None = None
    edges: int | None = None
    seconds: float = 0.0


@dataclass(frozen=True, slots=True)
class Specification:
    """A text in a specification language, with the reader that runs it.

    >>> import rvaft
    >>> specification = rvaft.translate(rvaft.loads("top sand a b;"), "rml", semantics="strict")
    >>> print(specification.text.splitlines()[-1])
    Main = a b all;
    >>> specification.monitor().step({"event": "b"}).symbol
    '⊥'
    """

    text: str
    language: str
    metrics: Metrics
    reader: Callable[[str], Monitor] | None = field(default=None, repr=False, compare=False)

    def monitor(self) -> Monitor:
        """A fresh, independent monitor that runs `text`.

        Raises `OptionError` where nothing here runs texts of the language.
        """
        if self.reader is None:
            raise OptionError(f"{self.language} is only emitted: nothing here runs its texts")
        return self.reader(self.text)


@dataclass(frozen=True, slots=True)
class SpecificationText:
    """What a backend writes: the text, its sizes, and a reader where `Backend.read` is not the one that runs it."""

    text: str
    metrics: Metrics
    reader: Callable[[str], Monitor] | None = None


@dataclass(frozen=True, slots=True)
class Highlighting:
    r"""What the package `listings` of LaTeX calls a language, and the `\lstdefinelanguage` of one
    that it does not know.
    """

    name: str
    definition: str = ""


@dataclass(frozen=True, slots=True)
class Observed:
    """One thing that a text asks of an event.

    To match a pattern, for some values of its variables under which the guard holds.

    Variables that start with `_` are this question's own; any other ties several events together.
    """

    pattern: Pattern
    when: Guard | None = None

    def fits(self, event: Json) -> bool:
        """Whether an event answers it by itself; a guard on a variable that has no value from it does not hold."""
        bound = patterns.match(self.pattern, event, {})
        if bound is None or self.when is None:
            return bound is not None
        return set(guards.variables(self.when)) <= bound.keys() and guards.holds(self.when, bound)

    def untied(self, names: Iterable[str] | None = None) -> "Observed":
        """The same question with variables of its own, these or all of them: some value each,
        whatever they are elsewhere.

        >>> from rvaft.language.parser import parse_pattern
        >>> patterns.variables(Observed(parse_pattern("{ a: X, b: _X }")).untied().pattern)
        ('__X', '_X')
        """
        taken = dict.fromkeys((*patterns.variables(self.pattern), *guards.variables(self.when)))
        own: dict[str, str] = {}
        for name in taken if names is None else names:
            if not name.startswith("_"):
                own[name] = next(other for n in count(1) if (other := "_" * n + name) not in taken)
        pattern = patterns.substitute(self.pattern, {old: patterns.Variable(new) for old, new in own.items()})
        return Observed(pattern, self.when and guards.renamed(self.when, own))


class Backend(ABC):
    """One specification language: its capabilities as class attributes, and `write`.

    `translate` checks a tree against the capabilities, runs the passes, and calls `write`. It
    cannot be overridden. What a backend does not list is refused, so a backend that lists nothing
    but `semantics` expresses single events alone.

    >>> rml = backend("rml")
    >>> rml.language, rml.suffix, rml.faithful, rml.readable
    ('rml', '.rml', True, True)
    """

    name: ClassVar[str]
    language: ClassVar[str]
    suffix: ClassVar[str]
    also: ClassVar[tuple[str, ...]] = ()
    """Other suffixes of files in the language."""
    faithful: ClassVar[bool] = True
    """Whether the text means the tree; an unfaithful backend is left out of comparisons unless named."""
    form_of: ClassVar[str | None] = None
    """The backend whose texts these are in another form, if any; left out of comparisons unless
    named, as they say nothing new.
    """
    readable: ClassVar[bool] = True
    """Whether `read` runs its texts; a language that is only emitted here is left out of comparisons."""
    verdicts: ClassVar[frozenset[Verdict]] = frozenset(Verdict)
    """What a run of its texts can tell. Without ⊥ in it `read` makes a `DetectionMonitor`:
    comparisons look at detections alone, and say so.
    """
    json_alone: ClassVar[bool] = False
    """Whether its texts speak of JSON's values alone, and leave open what a number that is not finite is.

    No comparison asks them of one.
    """
    extra: ClassVar[str] = ""
    """The extra of this package with which the program comes that runs its texts, where it is not there anyway."""
    modules: ClassVar[tuple[str, ...]] = ()
    """What of Python that program is imported as; where one is missing, the language is left out of
    comparisons unless named.
    """
    tools: ClassVar[tuple[str, ...]] = ()
    """Programs of others by which `read_with` can run a text as well."""
    highlighting: ClassVar[Highlighting | None] = None
    """How its texts are highlighted in a listing in LaTeX, if they are."""
    semantics: ClassVar[frozenset[Semantics]] = frozenset()
    """The semantics under which the language expresses trees."""
    says: ClassVar[frozenset[type[Part]]] = frozenset({Event})
    """The parts of a property that `write` handles."""
    passes: ClassVar[tuple[Pass, ...]] = ()
    """The passes that run before `write`, each of which removes parts; a tree may have these parts, too."""
    operators: ClassVar[frozenset[Operator]] = frozenset()
    """The operators of guards that `write` handles."""
    features: ClassVar[frozenset[Feature]] = frozenset()
    """Time points and late events, where the language has them."""
    values: ClassVar[frozenset[Value]] = frozenset()
    """The kinds of values, beside strings, that a text can require of an event."""
    ties: ClassVar[Ties] = Ties.NONE
    """Which variables over several events the language has."""
    reasons: ClassVar[Mapping[Capability, str]] = {}
    """Why the language lacks something, in a few words of its own.

    `Semantics` stands for all semantics that it lacks.
    """
    default_limit: ClassVar[int]
    """The size (in the unit the backend documents) above which `translate` raises `TooLarge`."""

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if "translate" in vars(cls):
            raise TypeError(f"{cls.__name__} must not override Backend.translate: it has to define `write`")

    @classmethod
    def capabilities(cls) -> Capabilities:
        """What the language can express, as data."""
        return Capabilities(
            cls.says, cls.operators, cls.features, cls.values, cls.ties, cls.semantics, cls.passes, cls.reasons
        )

    @final
    def translate(self, tree: RVAFT, semantics: Semantics, *, limit: int | None = None) -> Specification:
        """The tree as a specification.

        Raises `NotExpressible` where the language cannot express the tree, `TooLarge` where the
        text would exceed the limit.
        """
        start, semantics = perf_counter(), Semantics(semantics)
        prop = self.prepared(tree, semantics)
        with self._refusing(semantics):
            written = self.write(prop, semantics, self.default_limit if limit is None else limit)
        metrics = replace(written.metrics, seconds=perf_counter() - start)
        return Specification(written.text, self.language, metrics, written.reader or self.read)

    @final
    def prepared(self, tree: RVAFT, semantics: Semantics) -> Property:
        """The property of a tree after the passes of this backend; raises `NotExpressible` and `TooLarge`."""
        with self._refusing(semantics):
            prop = decide_constants(property_of(tree))
            check(prop, semantics, self.capabilities())
            for each in self.passes:
                prop = each(prop)
            if self.passes:
                prop = decide_constants(prop)  # a pass may make parts impossible
                check(prop, semantics, self.capabilities(), written=True)
        return prop

    @contextmanager
    def _refusing(self, semantics: Semantics) -> Iterator[None]:
        """Adds the backend and the semantics to a refusal."""
        try:
            yield
        except NotExpressible as refusal:
            if refusal.backend:
                raise
            raise NotExpressible(
                refusal.reason, backend=self.name, semantics=semantics, nodes=refusal.nodes
            ) from refusal.__cause__

    @abstractmethod
    def write(self, prop: Property, semantics: Semantics, limit: int) -> SpecificationText:
        """The text of a property that has only what this backend lists.

        Raises `NotExpressible` for what the capabilities cannot express, with a reason and nodes, and `TooLarge`.
        """

    def mapped(self, mapping: Mapping[str, Any]) -> "Backend":  # noqa: ARG002
        """The same backend for events whose fields are called as a mapping says, of each event type each field.

        Raises `OptionError`.
        """
        raise OptionError(f"{self.name} takes no mapping: in {self.language} the fields of events have their own names")

    def log(self, tree: RVAFT, trace: Sequence[Json]) -> str:  # noqa: ARG002
        """A trace as a log of the form that the programs which run the language take.

        Raises `OptionError` where there is none of its own.

        >>> import rvaft
        >>> print(backend("eql").log(rvaft.loads("top or a;"), [{"event": "a"}]), end="")
        {"@timestamp": "2026-01-01T00:00:00.000000000Z", "event": "a"}
        """
        raise OptionError(f"{self.language} has no logs of its own: its programs here read JSON Lines")

    def require(self) -> None:
        """Raises `ToolMissing` where the program that runs its texts is an extra which is not installed."""
        for module in self.modules:
            if find_spec(module) is None:
                raise ToolMissing(module, remedy=f"pip install '.[{self.extra}]' in a checkout of rvaft")

    @classmethod
    def dialect_backend(cls, dialect: str) -> str:
        """The name of the backend that writes its language in a dialect; raises `OptionError` where there is none."""
        raise OptionError(f"{cls.name} has no dialects, and so not {dialect}")

    def read(self, text: str, *, atoms: Mapping[str, Pattern] | None = None) -> Monitor:  # noqa: ARG002
        """A monitor that runs a text of the language, whoever wrote it; raises `LanguageError`.

        `atoms` gives the event of each atom that the text itself does not define; without it, `p`
        is `{"event": "p"}`. A language whose texts always define their events ignores it. One that
        is only emitted (not `readable`) raises `OptionError`.
        """
        raise OptionError(f"{self.name} is only emitted: nothing here runs its texts")

    def diagram(self, tree: RVAFT, semantics: Semantics, *, limit: int | None = None) -> str:  # noqa: ARG002
        """What the tree becomes in the language as a graph in the DOT language of Graphviz, for people to look at.

        `limit` bounds the size of the drawing, in the unit of the backend. Raises `TooLarge`, and
        `NotExpressible`, as by default, where the language has no graphs.
        """
        raise NotExpressible(
            "its texts are no graphs, so there is none to draw", backend=self.name, semantics=semantics
        )

    def observed(
        self,
        text: str,  # noqa: ARG002
        *,
        atoms: Mapping[str, Pattern] | None = None,  # noqa: ARG002
    ) -> tuple[Observed, ...] | None:
        """Everything that a text asks of events: two events with the same answers are the same to it.

        A proof of agreement needs this to know the letters. None, the default, says that it is not
        known, and the text is only tested. Raises `LanguageError` as `read` does.
        """
        return None

    def read_with(self, tool: str, text: str, *, atoms: Mapping[str, Pattern] | None = None) -> Monitor:  # noqa: ARG002
        """A monitor that runs a text by one of `tools` and not by this project's own reader.

        Raises `ToolMissing`, `ToolFailed`, `NotExpressible` for what the tool has no notion of,
        `TooLarge` for what is too much for it, `LanguageError` as `read` does, and `OptionError`
        for a tool that is none of these.
        """
        raise OptionError(f"no tool {tool} runs {self.language}; known: {', '.join(self.tools) or 'none'}")

    def matches(self, text: str, traces: Sequence[Sequence[Json]]) -> Sequence[frozenset[Match]] | None:  # noqa: ARG002
        """All matches in each trace, where the language gives them and the text says so; None, the
        default, where it does not.

        Raises `LanguageError` as `read` does, and what `read_with` may raise.
        """
        return None

    def masked(self, text: str, trace: Sequence[Json]) -> tuple[str, ...]:  # noqa: ARG002
        """Why the published tools of the language may differ from what `read` says of this text on
        this trace, in a few words each.

        These are known deviations of those tools; a comparison with them leaves such a pair out.
        Raises `LanguageError`.
        """
        return ()


def stamped(tree: RVAFT, trace: Iterable[Json], field: str) -> Iterator[Json]:
    """The events of a trace with their times as ISO 8601 in a field, if it is not there.

    Those that the tree reads, else one a second.
    """
    for number, event in enumerate(trace):
        time = _BEGIN + number * 1_000_000_000 if tree.time is None else tree.time.read(event)
        if time is None or field in event:
            yield event
        else:
            seconds, rest = divmod(time, 1_000_000_000)
            yield {field: f"{_EPOCH + timedelta(seconds=seconds):%Y-%m-%dT%H:%M:%S}.{rest:09d}Z", **event}


@cache
def all_backends() -> Mapping[str, EntryPoint]:
    """Every registered backend by name, without importing any.

    >>> sorted({"automaton", "ltlf", "rml"} & set(all_backends()))
    ['automaton', 'ltlf', 'rml']
    """
    return {entry.name: entry for entry in sorted(entry_points(group=GROUP), key=lambda entry: entry.name)}


def backend(name: str) -> Backend:
    """The backend of that name, imported now; raises `UnknownBackend`, and `ToolFailed` for one
    that cannot be loaded.
    """
    found = all_backends()
    if name not in found:
        raise UnknownBackend(name, tuple(found))
    try:
        made: Backend = found[name].load()()
    except Exception as error:  # a third party's module may fail in any way
        reason = f"it cannot be loaded: {type(error).__name__}: {error}"
        package = found[name].module.partition(".")[0]
        if isinstance(error, ModuleNotFoundError) and (error.name or "").startswith(f"{package}."):
            hiding = getattr(sys.modules.get(package), "__file__", None) or next(
                iter(getattr(sys.modules.get(package), "__path__", ())), package
            )
            reason = (
                f"{hiding} is imported in place of its package {package}; rename that, or move it off "
                "the path of Python"
            )
        raise ToolFailed(f"the backend {name}", reason=reason) from error
    return made


def speaking(word: str) -> str | None:
    """The name of the faithful backend whose language or suffix a word is, if there is one."""
    wanted = word.lower().removeprefix(".")
    for name in all_backends():
        with suppress(ToolFailed, AttributeError):  # one of somebody else that is broken; the others still count
            found = backend(name)
            suffixes = (suffix.removeprefix(".") for suffix in (found.suffix, *found.also))
            if found.faithful and wanted in (found.language.lower(), *suffixes):
                return name
    return None


class UnknownBackend(RvaftError, LookupError):
    """No backend of that name is registered.

    >>> print(UnknownBackend("hoa", ("automaton", "ltlf")))
    unknown backend hoa; known: automaton, ltlf
    """

    def __init__(self, name: str, known: tuple[str, ...]) -> None:
        self.name = name
        self.known = known
        super().__init__(f"unknown backend {name}; known: {', '.join(known) or 'none'}")
