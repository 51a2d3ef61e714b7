"""The interface of specification languages, and the look-up of backends.

`translate` turns a tree into a `Specification`; `read` turns any text of the language into a
monitor. `Specification.monitor` reads the text back and never uses the tree. Backends are entry
points of the group `rvaft.backends`, imported on use.
"""

import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from functools import cache
from importlib.util import find_spec
from itertools import count
from time import perf_counter
from typing import TYPE_CHECKING, Any, ClassVar, Final, TypeAlias, cast, final

from rvaft.capabilities import Capabilities, Capability, Feature, Ties, Value, check, extended
from rvaft.core.passes import Pass, decide_constants
from rvaft.core.property import Event, Part, Property
from rvaft.core.restriction import property_of
from rvaft.errors import (
    NotExpressible,
    OptionError,
    Reason,
    RvaftError,
    TooLarge,
    ToolFailed,
    ToolMissing,
    unwritten,
)
from rvaft.model import guards, patterns
from rvaft.model.event_time import EventTime
from rvaft.model.expressions import assumptions_text
from rvaft.model.guards import Guard, Operator
from rvaft.model.nodes import Assumption
from rvaft.model.patterns import Pattern
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import Monitor
from rvaft.support.plugins import display, entry_points

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

GROUP = "rvaft.backends"
_EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)
_BEGIN: Final = 1_767_225_600_000_000_000
"""The start of a log without times, in nanoseconds: the year 2026."""


Match: TypeAlias = frozenset[tuple[str, int]]
"""The occurrences of a match, each with the number of its event, from 1."""


@dataclass(frozen=True, slots=True)
class Metrics:
    """Sizes of a specification; None if the language has no such size.

    `symbols` counts tokens of the property without declarations, headers and comments;
    `subformulas` the distinct ones (or atoms, if the language has no other parts); `states` those
    of an automaton, or the equations of RML; `seconds` is the time of the translation.

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
    assumes: frozenset[Assumption] = frozenset()
    """The assumptions that the text relies on."""
    extensions: tuple[str, ...] = ()
    """The extensions of rvaft that the text uses, which other programs of the language do not read."""

    def monitor(self) -> Monitor:
        """Return a new monitor that runs `text`; raises `OptionError` if the language is only
        emitted.
        """
        if self.reader is None:
            raise OptionError(f"{self.language} is only emitted: rvaft cannot run its texts")
        return self.reader(self.text)

    def _repr_html_(self) -> str:
        return cast("str", display("specification")(self))


@dataclass(frozen=True, slots=True)
class SpecificationText:
    """The output of `Backend.write`: text, sizes, and a reader if it is not `Backend.read`."""

    text: str
    metrics: Metrics
    reader: Callable[[str], Monitor] | None = None


@dataclass(frozen=True, slots=True)
class Highlighting:
    r"""The name of a language in the LaTeX package `listings`, and its definition if needed."""

    name: str
    definition: str = ""


@dataclass(frozen=True, slots=True)
class Observed:
    """A test of an event: it matches a pattern, and the guard holds for its bindings.

    Variables that start with `_` are local to the test; other variables join several events.
    """

    pattern: Pattern
    when: Guard | None = None

    def fits(self, event: Json) -> bool:
        """Whether an event passes on its own; a guard with unbound variables does not hold."""
        if self.when is None:
            return patterns.match(self.pattern, event, {}) is not None
        if not set(guards.variables(self.when)) <= set(patterns.variables(self.pattern)):
            return False
        return any(guards.holds(self.when, bound) for bound in patterns.ways(self.pattern, event, {}))

    def untied(self, names: Iterable[str] | None = None) -> "Observed":
        """Return the test with these variables (default: all) made local.

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
    """One specification language: capabilities as class attributes, and `write`.

    `translate`, which is final, checks a tree against the capabilities, runs the passes, and calls
    `write`. Capabilities that are not listed are refused: a backend that lists only `semantics`
    expresses single events.

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
    """Whether texts are equivalent to the tree; comparisons include others only if named."""
    form_of: ClassVar[str | None] = None
    """The backend with the same texts in another form, if any; comparisons exclude this one."""
    readable: ClassVar[bool] = True
    """Whether `read` runs texts; comparisons exclude languages that are only emitted."""
    verdicts: ClassVar[frozenset[Verdict]] = frozenset(Verdict)
    """The possible verdicts of `read`.

    Without ⊥ it returns a `DetectionMonitor`, and comparisons check detections only.
    """
    json_alone: ClassVar[bool] = False
    """Whether texts leave numbers that are not finite undefined; comparisons then exclude them."""
    extra: ClassVar[str] = ""
    """The extra of this package that installs the program for running texts, if needed."""
    modules: ClassVar[tuple[str, ...]] = ()
    """The Python modules of that program; without them, comparisons skip the language."""
    executes: ClassVar[bool] = False
    """Whether `read` compiles a text and runs it as a program; others interpret the text."""
    highlighting: ClassVar[Highlighting | None] = None
    """The highlighting in LaTeX listings, if any."""
    semantics: ClassVar[frozenset[Semantics]] = frozenset()
    """The supported semantics."""
    says: ClassVar[frozenset[type[Part]]] = frozenset({Event})
    """The parts of a property that `write` handles."""
    passes: ClassVar[tuple[Pass, ...]] = ()
    """The passes that run before `write`; a tree may have the parts that they remove."""
    operators: ClassVar[frozenset[Operator]] = frozenset()
    """The guard operators that `write` handles."""
    features: ClassVar[frozenset[Feature]] = frozenset()
    """Supported time points and late events."""
    values: ClassVar[frozenset[Value]] = frozenset()
    """The kinds of values, besides strings, that a text can require of an event."""
    ties: ClassVar[Ties] = Ties.NONE
    """The supported variables over several events."""
    needs: ClassVar[Mapping[Capability, frozenset[Assumption]]] = {}
    """Further supported capabilities, each with the assumptions that it needs."""
    relies: ClassVar[frozenset[Assumption]] = frozenset()
    """Assumptions that make texts simpler where a tree states them."""
    remark: ClassVar[str] = ""
    """A comment of the language with `{}` for its text; empty if texts have no comments."""
    remark_line: ClassVar[int] = 0
    """The number of lines before a remark."""
    reasons: ClassVar[Mapping[Capability, Reason]] = {}
    """Specific reasons for missing capabilities; `Semantics` stands for all missing semantics."""
    extensions: ClassVar[Mapping[Capability, str]] = {}
    """Capabilities that texts have by an extension of rvaft, each with its name.

    Other programs of the language do not read such texts.
    """
    most_nodes: ClassVar[int] = 20_000
    """The number of nodes above which `translate` raises `TooLarge` before any work, unless the
    limit is larger.

    Most translations keep for each node the set of others, which takes a gigabyte at 50,000 nodes.
    """
    default_limit: ClassVar[int]
    """The size, in the documented unit, above which `translate` raises `TooLarge`."""

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if "translate" in vars(cls):
            raise TypeError(f"{cls.__name__} must not override Backend.translate: it has to define `write`")
        kinds = {"semantics": frozenset, "says": frozenset, "operators": frozenset, "features": frozenset}
        for name, kind in {**kinds, "values": frozenset, "passes": tuple, "ties": Ties}.items():
            if not isinstance(getattr(cls, name), kind):
                raise TypeError(f"{cls.__name__}.{name} must be a {kind.__name__}: {getattr(cls, name)!r}")

    @classmethod
    def capabilities(cls) -> Capabilities:
        """Return the capabilities as data."""
        return Capabilities(
            cls.says,
            cls.operators,
            cls.features,
            cls.values,
            cls.ties,
            cls.semantics,
            cls.passes,
            cls.reasons,
            cls.needs,
            cls.extensions,
        )

    @final
    def translate(self, tree: RVAFT, semantics: Semantics, *, limit: int | None = None) -> Specification:
        """Return the tree as a specification; raises `NotExpressible` and `TooLarge`."""
        start, semantics = perf_counter(), Semantics(semantics)
        if len(tree.order) > (most := max(self.most_nodes, limit or 0)):
            raise TooLarge("nodes of the tree", limit=most)
        prop = self.prepared(tree, semantics)
        with self._refusing(semantics):
            written = self.write(prop, semantics, self.default_limit if limit is None else limit)
        if not isinstance(written, SpecificationText):
            reason = f"`write` returned {type(written).__name__}, not a SpecificationText"
            raise ToolFailed(f"the backend {self.name}", reason=reason)
        metrics = replace(written.metrics, seconds=perf_counter() - start)
        text = self._remarked(written.text, prop.assumes, tree) if prop.assumes else written.text
        return Specification(text, self.language, metrics, written.reader or self.read, prop.assumes, prop.extensions)

    def _remarked(self, text: str, assumes: frozenset[Assumption], tree: RVAFT) -> str:
        """Return the text with a comment that lists the assumptions."""
        lines = text.splitlines(keepends=True) if self.remark else [text]
        remark = self.remark.format(f"assumes {assumptions_text(assumes, tree.time)}") if self.remark else ""
        return "".join([*lines[: self.remark_line], remark, *lines[self.remark_line :]])

    @final
    def prepared(self, tree: RVAFT, semantics: Semantics) -> Property:
        """Return the property of a tree after the passes, with the assumptions that a text relies on.

        Under `assume order` no event is late, so a language that cannot drop late events gets the
        property without them. Raises `NotExpressible` and `TooLarge`.
        """
        with self._refusing(semantics):
            known = self.capabilities().known  # other operators are replaced by their definitions
            tree = tree.with_guards(lambda guard: guards.expanded(guard, known))
            prop = decide_constants(property_of(tree))
            assumes = check(prop, semantics, self.capabilities()) | (self.relies & tree.assumes)
            if prop.time is not None and prop.time.late is not None and Feature.LATE not in self.features:
                prop, assumes = replace(prop, time=replace(prop.time, late=None)), assumes | {Assumption.ORDER}
            prop = replace(prop, assumes=assumes, extensions=extended(prop, self.capabilities()))
            for each in self.passes:
                prop = each(prop)
            if self.passes:
                prop = decide_constants(prop)  # a pass may make parts impossible
                check(prop, semantics, self.capabilities(), written=True)
        return prop

    @contextmanager
    def _refusing(self, semantics: Semantics) -> Iterator[None]:
        try:
            yield
        except NotExpressible as refusal:
            if refusal.backend:
                raise
            named = NotExpressible(refusal.why, backend=self.name, semantics=semantics, nodes=refusal.nodes)
            if semantics not in self.semantics:
                known = [each.value for each in Semantics if each in self.semantics]
                named.add_note(f"{self.name} supports --semantics {' and '.join(known)}")
            raise named from refusal.__cause__

    @abstractmethod
    def write(self, prop: Property, semantics: Semantics, limit: int) -> SpecificationText:
        """Return the text of a property that has only listed capabilities.

        Raises `TooLarge`, and `NotExpressible` with reason and nodes for further limits.
        """

    def mapped(self, mapping: Mapping[str, Any]) -> "Backend":  # noqa: ARG002
        """Return the backend with renamed event fields; raises `OptionError`.

        `mapping` has, for each event type, its fields.
        """
        raise OptionError(f"{self.name} takes no mapping: {self.language} uses the field names of events")

    def timed(self, text: str, time: EventTime) -> str:  # noqa: ARG002
        """Return the text with this declaration of times, unless it has one or the language has none."""
        return text

    def log(self, tree: RVAFT, trace: Sequence[Json]) -> str:  # noqa: ARG002
        """Return a trace in the log format of the language's programs; raises `OptionError`.

        >>> import rvaft
        >>> print(backend("eql").log(rvaft.loads("top or a;"), [{"event": "a"}]), end="")
        {"@timestamp": "2026-01-01T00:00:00.000000000Z", "event": "a"}
        """
        raise OptionError(f"{self.language} has no log format of its own: use --format jsonl")

    def require(self) -> None:
        """Raise `ToolMissing` if the extra for running texts is not installed."""
        for module in self.modules:
            if find_spec(module) is None:
                raise ToolMissing(module, remedy=f"pip install '.[{self.extra}]' in a checkout of rvaft")

    @classmethod
    def dialect_backend(cls, dialect: str) -> str:
        """Return the name of the backend for a dialect; raises `OptionError`."""
        raise OptionError(f"{cls.name} has no dialects: omit --dialect {dialect}")

    def read(self, text: str, *, atoms: Mapping[str, Pattern] | None = None) -> Monitor:  # noqa: ARG002
        """Return a monitor of any text of the language; raises `LanguageError` and `OptionError`.

        `atoms` gives the patterns of atoms that the text does not define; by default, `p` is
        `{"event": "p"}`. Languages whose texts define their events ignore it.
        """
        raise OptionError(f"{self.name} is only emitted: rvaft cannot run its texts")

    def read_confined(
        self, text: str, *, confine: Callable[[], object], atoms: Mapping[str, Pattern] | None = None
    ) -> Monitor:
        """Return a monitor of a text that a stranger wrote, and believe nothing that it says of itself.

        `confine` ends the rights of this process. It is called before the text is read, or, if the
        text is compiled, before it runs. Raises what `read` raises.
        """
        confine()
        return self.read(text, atoms=atoms)

    def diagram(self, tree: RVAFT, semantics: Semantics, *, limit: int | None = None) -> str:  # noqa: ARG002
        """Return the graph of the specification in the DOT language.

        `limit` bounds its size in the unit of the backend. Raises `TooLarge`, and `NotExpressible`
        if the language has no graphs (the default).
        """
        raise NotExpressible(unwritten("the language has no graphs to draw"), backend=self.name, semantics=semantics)

    def formal(self, text: str) -> dict[str, Any]:  # noqa: ARG002
        """Return the abstract syntax of a text for `emit --certify`; raises `NotExpressible`."""
        raise NotExpressible(unwritten(f"{self.language} has no formal syntax in the proofs"), backend=self.name)

    def observed(
        self,
        text: str,  # noqa: ARG002
        *,
        atoms: Mapping[str, Pattern] | None = None,  # noqa: ARG002
    ) -> tuple[Observed, ...] | None:
        """Return all tests of events in a text: it cannot distinguish events with equal results.

        A proof of agreement needs them for its alphabet. With None (the default) texts are only
        tested. Raises `LanguageError`.
        """
        return None

    def fields(self, text: str) -> tuple[tuple[str, ...], ...]:  # noqa: ARG002
        """Return the paths of the fields of events that a text reads, that of the time included.

        It is empty (the default) if they are not known. Raises `LanguageError`, `ToolMissing`.
        """
        return ()

    def matches(self, text: str, traces: Sequence[Sequence[Json]]) -> Sequence[frozenset[Match]] | None:  # noqa: ARG002
        """Return all matches in each trace; None (the default) if the language does not report
        them.

        Raises `LanguageError`, `ToolMissing`, `ToolFailed`.
        """
        return None


def stamped(tree: RVAFT, trace: Iterable[Json], field: str) -> Iterator[Json]:
    """Yield the events; those without `field` get their time in it as ISO 8601, if defined.

    Without a time declaration, there is one event a second.
    """
    for number, event in enumerate(trace):
        time = _BEGIN + number * 1_000_000_000 if tree.time is None else tree.time.read(event)
        if time is None or field in event:
            yield event
        else:
            seconds, rest = divmod(time, 1_000_000_000)
            yield {field: f"{_EPOCH + timedelta(seconds=seconds):%Y-%m-%dT%H:%M:%S}.{rest:09d}Z", **event}


@cache
def all_backends() -> "Mapping[str, EntryPoint]":
    """Return the registered backends by name, without importing them.

    >>> sorted({"automaton", "ltlf", "rml"} & set(all_backends()))
    ['automaton', 'ltlf', 'rml']
    """
    return {entry.name: entry for entry in sorted(entry_points(group=GROUP), key=lambda entry: entry.name)}


def backend(name: str) -> Backend:
    """Import the backend of that name; raises `UnknownBackend` and `ToolFailed`."""
    found = all_backends()
    if name not in found:
        raise UnknownBackend(name, tuple(found))
    try:
        made: Backend = found[name].load()()
    except Exception as error:  # a third party's module may raise anything
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
    """Return the faithful backend with that language name or suffix, if any."""
    wanted = word.lower().removeprefix(".")
    for name in all_backends():
        with suppress(ToolFailed, AttributeError):  # skip broken third-party backends
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
