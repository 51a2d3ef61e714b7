"""The functions of `import rvaft` and the types that they take and return.

`branch` and `kind` restrict a tree to one branch, or to the branches of a kind. The engine and
drawings are imported on use: a translation needs neither.
"""

import os
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, Final

from rvaft.backend import Backend, Metrics, Specification, UnknownBackend, all_backends, backend
from rvaft.core.branches import Branch
from rvaft.core.branches import branches as branches_of
from rvaft.errors import (
    CheckpointError,
    LanguageError,
    NotExpressible,
    NoVerdict,
    OptionError,
    RvaftError,
    TooLarge,
    ToolFailed,
    ToolMissing,
    ToolTimeout,
    TraceError,
    TreeError,
    WrongType,
    expect,
)
from rvaft.language.printer import dumps
from rvaft.model.nodes import Causality, EventType, Gate, Ignore, Kind, Node, On, Side, Topic, Without
from rvaft.model.tree import RVAFT, resolve_semantics
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import (
    DEFAULT_LIMIT,
    Absence,
    Awaited,
    AwaitedAbsence,
    Ended,
    Explanation,
    Monitor,
    Pending,
    Repetition,
)
from rvaft.rules.rule import Finding, Severity
from rvaft.rules.validity import load, loads, valid_part

if TYPE_CHECKING:
    from rvaft.diagnosis.near_misses import NearMisses
    from rvaft.risk.attacks import Attacks
    from rvaft.risk.cut_sets import CutSets
    from rvaft.risk.model import RiskTree
    from rvaft.risk.probability import Analysis
    from rvaft.risk.runtime import RiskMonitor

__all__ = [
    "RVAFT",
    "Absence",
    "Awaited",
    "AwaitedAbsence",
    "Backend",
    "Branch",
    "Causality",
    "CheckpointError",
    "Ended",
    "EventType",
    "Explanation",
    "Finding",
    "Gate",
    "Ignore",
    "Kind",
    "LanguageError",
    "Metrics",
    "Monitor",
    "NoVerdict",
    "Node",
    "NotExpressible",
    "On",
    "OptionError",
    "Pending",
    "Repetition",
    "RvaftError",
    "Semantics",
    "Severity",
    "Side",
    "Specification",
    "TooLarge",
    "ToolFailed",
    "ToolMissing",
    "ToolTimeout",
    "Topic",
    "TraceError",
    "TreeError",
    "UnknownBackend",
    "Verdict",
    "Without",
    "WrongType",
    "all_backends",
    "analysis",
    "attacks",
    "branches",
    "check",
    "cut_sets",
    "dumps",
    "load",
    "loads",
    "log",
    "monitor",
    "near_misses",
    "risk_monitor",
    "to_dot",
    "translate",
]

_TREE: Final = "an RVAFT, as rvaft.load returns it"


def translate(
    tree: RVAFT,
    language: str,
    *,
    semantics: Semantics | str | None = None,
    branch: int | None = None,
    kind: Kind | str | None = None,
    limit: int | None = None,
    mapping: Mapping[str, Any] | None = None,
) -> Specification:
    r"""Return the tree as a specification, by the backend with the name `language`.

    `mapping` renames the fields of events, for backends that support it.

    Raises `UnknownBackend`, `OptionError`, `TreeError` for a tree that breaks a rule or has no such
    branch or kind, `NotExpressible`, `TooLarge` beyond the limit (default: that of the backend),
    and `WrongType`.

    >>> print(translate(loads("top or a b;"), "rml", semantics="strict").text.splitlines()[-1])
    Main = (a \/ b) all;
    """
    expect("tree", tree, RVAFT, _TREE)
    expect("language", language, str, "a str, the name of a backend")
    expect("branch", branch, int | None, "an int")
    expect("limit", limit, int | None, "an int")
    expect("mapping", mapping, Mapping | None, "a mapping of event types")
    speaks = backend(language) if mapping is None else backend(language).mapped(mapping)
    return speaks.translate(valid_part(tree, branch, kind), resolve_semantics(tree, semantics), limit=limit)


def monitor(
    tree: RVAFT,
    *,
    semantics: Semantics | str | None = None,
    branch: int | None = None,
    kind: Kind | str | None = None,
    limit: int = DEFAULT_LIMIT,
    repeat: bool = False,
    repeat_by: str | None = None,
) -> Monitor:
    """Return a new monitor of the tree; `limit` bounds the number of partial matches.

    With `repeat` it is a `Repetition`, which restarts after each detection; with `repeat_by`, or `repeat by` in the
    tree, only for the detected value of that variable. Raises `OptionError`,
    `TreeError` for a tree that breaks a rule or has no such branch or kind, `WrongType`, and, also
    while reading events, `TooLarge`.

    >>> watching = monitor(loads("top 2of3 a b c;"), semantics="scattered")
    >>> [watching.step({"event": name}).symbol for name in "cxa"]
    ['?', '?', '⊤']
    """
    expect("tree", tree, RVAFT, _TREE)
    expect("branch", branch, int | None, "an int")
    expect("limit", limit, int, "an int")
    expect("repeat", repeat, bool, "a bool")
    expect("repeat_by", repeat_by, str | None, "a str")
    part, meaning = valid_part(tree, branch, kind), resolve_semantics(tree, semantics)
    from rvaft.engine.monitor import repeating_engine  # noqa: PLC0415 -- imported on use

    repeat = repeat or repeat_by is not None
    engine = repeating_engine(part, meaning, limit=limit, repeat=repeat, by=repeat_by)
    return Repetition(engine) if repeat else engine


def near_misses(
    tree: RVAFT, events: Iterable[Any], *, semantics: Semantics | str | None = None, branch: int | None = None
) -> "NearMisses":
    """Return why nothing was detected: the matches that lack one condition, closest first (`rvaft.diagnosis`).

    They are looked for among the last 10,000 events. Raises the errors of `monitor`.

    >>> log = [{"event": name} for name in "ab"]
    >>> [miss.text for miss in near_misses(loads("top sand a b c;"), log, semantics="scattered").found]
    ['all but c']
    """
    expect("tree", tree, RVAFT, _TREE)
    expect("branch", branch, int | None, "an int")
    from rvaft.diagnosis.near_misses import near_misses as found  # noqa: PLC0415 -- imported on use

    return found(tree, events, semantics=semantics, branch=branch)


def analysis(tree: "RVAFT | str | os.PathLike[str]") -> "Analysis":
    """Return the analysis of the probability of a tree or a file: at a time, its curve, mean time, importance.

    Times are in seconds if the rates have a unit, else in the unit of the rates. Raises `RiskError` for
    what has no number (semantics, section 8), `TooLarge`, `ToolMissing` without the extra `risk`, and
    the errors of `load`.

    >>> found = analysis(loads("top sand x y; x lambda=0.5; y lambda=0.2;"))
    >>> round(found.at(1.0), 6), round(found.mean_time(), 6)
    (0.039803, 7.0)
    """
    from rvaft.risk.probability import Analysis  # noqa: PLC0415 -- imported on use

    return Analysis(_risk_tree(tree))


def cut_sets(tree: "RVAFT | str | os.PathLike[str]", *, order: int | None = None) -> "CutSets":
    """Return the minimal cut sets of a tree or a file, of at most `order` leaves.

    Raises `RiskError`, `TooLarge`, and the errors of `load`.

    >>> found = cut_sets(loads("top and g h; g or a b; h or a c;"))
    >>> [one.leaves for one in found.listed()]
    [('a',), ('b', 'c')]
    """
    from rvaft.risk.cut_sets import CutSets  # noqa: PLC0415 -- imported on use

    return CutSets(_risk_tree(tree), order=order)


def attacks(tree: "RVAFT | str | os.PathLike[str]", *, time: float | None = None) -> "Attacks":
    """Return the attacks of a tree or a file: minimal ones, and fronts of cost, probability and damage.

    `time` is needed where faults have rates. Raises `RiskError`, `TooLarge`, and the errors of `load`.

    >>> found = attacks(loads("top or a b; a cost=3 prob=0.5; b cost=2 prob=0.1;"))
    >>> [(one.steps, one.cost) for one in found.minimal()]
    [(('b',), 2.0), (('a',), 3.0)]
    """
    from rvaft.risk.attacks import Attacks  # noqa: PLC0415 -- imported on use

    return Attacks(_risk_tree(tree), time)


def risk_monitor(tree: "RVAFT | str | os.PathLike[str]", horizon: float) -> "RiskMonitor":
    """Return a monitor of the probability that a tree or a file is detected within a horizon, given the events so far.

    The horizon is in seconds if the rates have a unit. The semantics is `scattered`. Raises `RiskError`,
    `TooLarge`, and the errors of `load`.

    >>> watching = risk_monitor(loads("top sand x y; x lambda=0.5; y lambda=0.2;"), 1.0)
    >>> round(watching.risk, 6), round(watching.step({"event": "x"}), 6), watching.outlook().next[0].leaf
    (0.039803, 0.181269, 'y')
    """
    from rvaft.risk.runtime import RiskMonitor  # noqa: PLC0415 -- imported on use

    whole = tree if isinstance(tree, RVAFT) else load(tree)
    return RiskMonitor(whole, _risk_tree(tree if whole.translated else whole), horizon)


def _risk_tree(tree: "RVAFT | str | os.PathLike[str]") -> "RiskTree":
    from rvaft.risk.model import of_file, of_tree  # noqa: PLC0415 -- imported on use

    expect("tree", tree, RVAFT | str | os.PathLike, f"{_TREE}, or the path of a file")
    return of_tree(tree) if isinstance(tree, RVAFT) else of_file(tree)


def log(frame: object) -> Iterator[dict[str, Any]]:
    """Return the rows of a table as events: a DataFrame of pandas or polars, or a table of Arrow.

    A missing value means that the event lacks the field. Times are read as from Parquet, as texts in ISO 8601.
    Raises `ToolMissing` without `pyarrow` (extra `parquet`), `TraceError`, and `WrongType`.

    >>> import pandas
    >>> frame = pandas.DataFrame({"event": ["a", "b"], "size": [300, None]})
    >>> [verdict.symbol for verdict in monitor(loads("top sand a b;")).run(log(frame))]
    ['?', '⊤']
    """
    from rvaft.readers.parquet import frame_events  # noqa: PLC0415 -- imported on use

    return frame_events(frame)


def check(tree: RVAFT) -> list[Finding]:
    """Return the findings of `rvaft check` by position.

    >>> for finding in check(loads("top or a b; a; b when 1 > 2;")):
    ...     print(finding.code, finding.severity, *finding.nodes)
    infeasible-scenario warning b
    """
    expect("tree", tree, RVAFT, _TREE)
    from rvaft.rules.registry import check_tree  # noqa: PLC0415 -- imported on use

    return check_tree(tree)


def branches(tree: RVAFT) -> Iterator[Branch]:
    """Yield the branches of a tree, numbered from 1; there may be very many. Raises `WrongType`.

    >>> [(branch.number, branch.formula) for branch in branches(loads("top or a both; both sand b c;"))]
    [(1, 'a'), (2, 'b ; c')]
    """
    expect("tree", tree, RVAFT, _TREE)
    return branches_of(tree)


def to_dot(
    tree: RVAFT,
    *,
    events: bool = False,
    names: bool = True,
    wrap: int | None = None,
    depth: int | None = None,
    collapse: Iterable[str] = (),
    branch: int | None = None,
    legend: bool = False,
    stagger: bool = False,
) -> str:
    """Return a drawing of the tree in the DOT language of Graphviz.

    `events` shows runtime events and guards, `names` the names of labelled nodes. `wrap` is the
    width of texts in columns. `depth` and `collapse` hide nodes below a level or a node. `branch`
    marks a branch, `legend` explains the symbols, `stagger` lowers some leaves.
    Raises `OptionError`, `TreeError` and `WrongType`.

    >>> to_dot(loads("top or a b;")).startswith("digraph")
    True
    """
    expect("tree", tree, RVAFT, _TREE)
    from rvaft.export.dot import dot_text  # noqa: PLC0415 -- imported on use
    from rvaft.export.layout import looking  # noqa: PLC0415

    look = looking(
        tree,
        events=events,
        names=names,
        wrap=wrap,
        depth=depth,
        collapse=collapse,
        branch=branch,
        legend=legend,
        stagger=stagger,
    )
    return dot_text(tree, look)
