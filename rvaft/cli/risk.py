"""`rvaft cut-sets` and `rvaft risk`: what brings a tree about, and how likely it is."""

import csv
import io
import json
import math
import sys
from collections.abc import Iterable, Sequence
from typing import Any, Final

import click

from rvaft.cli import options, warn
from rvaft.cli.risk_tree import Horizon, number_text, risk_tree, time_option
from rvaft.errors import RvaftError
from rvaft.model.nodes import Kind
from rvaft.risk.cut_sets import CutSet, CutSets
from rvaft.risk.model import RiskTree, without
from rvaft.risk.probability import Analysis, Importance, leaf_probability
from rvaft.support.wording import counted

_POINTS: Final = 1000
_CHART: Final = 50


def _rows(rows: Iterable[Sequence[object]]) -> str:
    stream = io.StringIO()
    csv.writer(stream, lineterminator="\n").writerows(rows)
    return stream.getvalue()


def _aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return ["  ".join(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]


# ---- cut sets ---------------------------------------------------------------------------------------


@click.command("cut-sets")
@options.tree_argument
@options.part_options
@options.number("--max-order", least=0, text="Only sets of at most this many events.")
@options.number("--limit", default=100, least=0, text="Maximum number of sets to list.")
@click.option("--most-probable", is_flag=True, help="List the most probable sets, with their probabilities.")
@time_option("--time", "horizon")
@click.option("--without", "gone", multiple=True, metavar="NODE", help="As if this node never happened; repeatable.")
@options.output_format("text", "json", "csv", "tex")
def cut_sets_command(
    *,
    tree: str,
    branch: int | None,
    kind: Kind | None,
    max_order: int | None,
    limit: int,
    most_probable: bool,
    horizon: Horizon | None,
    gone: tuple[str, ...],
    form: str,
) -> int:
    """List the minimal cut sets of a tree: the least sets of leaves that bring its root about.

    Where order matters, a set says which event comes before which. A single point of failure is a
    set of one event.
    """
    options.refuse(horizon is not None and not most_probable, "--time needs --most-probable")
    given = risk_tree(tree, branch=branch, kind=kind)
    for name in gone:
        given = without(given, name)
    found = CutSets(given, order=max_order)
    if most_probable:
        given.require_numbers()
        chances = _chances(given, horizon)
        listed: list[tuple[CutSet, float | None]] = [*found.most_probable(limit, chances)]
    else:
        listed = [(one, None) for one in found.listed(limit)]
    if not found.complete:
        warn(f"only sets of at most {counted(max_order or 0)} were sought: there may be larger ones")
    match form:
        case "json":
            sys.stdout.write(json.dumps(_cut_sets_json(found, listed), indent=2) + "\n")
        case "csv":
            head = ("order", "probability", "leaves", "sequence")
            rows = [
                (one.order, "" if p is None else repr(p), " ".join(one.leaves), "; ".join(_order_texts(one)))
                for one, p in listed
            ]
            sys.stdout.write(_rows([head, *rows]))
        case "tex":
            sys.stdout.write(_cut_sets_tex(listed))
        case _:
            sys.stdout.write(_cut_sets_text(found, listed))
    return 0


def _chances(tree: RiskTree, horizon: Horizon | None) -> dict[str, float]:
    unit = tree.unit
    options.refuse(horizon is None and unit is not None, "the tree has rates: say --time TIME")
    if horizon is not None:
        horizon.require(unit)
    return {name: leaf_probability(leaf, horizon.value if horizon else 0.0) for name, leaf in tree.leaves.items()}


def _order_texts(one: CutSet) -> list[str]:
    found: list[str] = []
    for part in one.sequences:
        pairs = [f"{first} before {then}" for first, then in part.before]
        found.append(
            ", ".join(pairs) if not part.orders else " or ".join(" then ".join(order) for order in part.orders)
        )
    return found


def _cut_sets_text(found: CutSets, listed: list[tuple[CutSet, float | None]]) -> str:
    lines = [f"{counted(found.count, 'minimal cut set')}" + ("" if found.complete else " up to this order")]
    orders = found.by_order()
    lines += [f"  {counted(number, 'set')} of {counted(order)}" for order, number in sorted(orders.items())]
    kinds = found.by_kind()
    if any(kinds.keys() - {frozenset()}):
        named = {
            "faults only": frozenset([Kind.FAULT]),
            "attacks only": frozenset([Kind.ATTACK]),
            "faults and attacks": frozenset(Kind),
            "no kind": frozenset(),
        }
        lines += [f"  {kinds[key]:,} {text}" for text, key in named.items() if kinds[key]]
    lines.append("")
    for number, (one, p) in enumerate(listed, 1):
        chance = "" if p is None else f"{number_text(p)}  "
        order = "".join(f"  ({text})" for text in _order_texts(one))
        single = "  single point of failure" if one.order == 1 else ""
        lines.append(f"{number:>4}  {chance}{', '.join(one.leaves)}{order}{single}")
    if len(listed) < found.count:
        lines.append(f"      … {found.count - len(listed):,} more: --limit N lists N of them")
    return "\n".join(lines) + "\n"


def _cut_sets_json(found: CutSets, listed: list[tuple[CutSet, float | None]]) -> dict[str, Any]:
    return {
        "count": found.count,
        "complete": found.complete,
        "by_order": {str(order): number for order, number in sorted(found.by_order().items())},
        "by_kind": {" ".join(sorted(kinds)) or "none": number for kinds, number in found.by_kind().items()},
        "sets": [
            {"leaves": one.leaves, "order": one.order}
            | ({} if p is None else {"probability": p})
            | (
                {"sequences": [{"before": part.before, "orders": part.orders} for part in one.sequences]}
                if one.sequences
                else {}
            )
            for one, p in listed
        ],
    }


def _cut_sets_tex(listed: list[tuple[CutSet, float | None]]) -> str:
    from rvaft.export.latex import escaped  # noqa: PLC0415 -- imported on use

    lines = [r"\begin{tabular}{rrl}", r"\toprule", r"order & probability & minimal cut set \\", r"\midrule"]
    for one, p in listed:
        order = "".join(f" ({escaped(text)})" for text in _order_texts(one))
        names = ", ".join(map(escaped, one.leaves))
        lines.append(rf"{one.order} & {'--' if p is None else number_text(p)} & {names}{order} \\")
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}"]) + "\n"


# ---- probability ------------------------------------------------------------------------------------


@click.command("risk")
@options.tree_argument
@options.part_options
@time_option("--time", "horizon")
@options.number("--curve", least=1, most=_POINTS, text="Probabilities at this many equal steps up to --time.")
@click.option("--importance", is_flag=True, help="How much each leaf matters, the most important first.")
@click.option("--without", "gone", multiple=True, metavar="NODE", help="As if this node never happened; repeatable.")
@options.output_format("text", "json", "csv")
def risk_command(
    *,
    tree: str,
    branch: int | None,
    kind: Kind | None,
    horizon: Horizon | None,
    curve: int | None,
    importance: bool,
    gone: tuple[str, ...],
    form: str,
) -> int:
    """Compute the probability that the root of a tree has happened by a time.

    The leaves have prob=P, or lambda=RATE with a unit of time (0.002/h) or without. Static trees
    are computed by a decision diagram, those in which order matters by Markov chains of their parts;
    both are exact.
    """
    options.exclusive(curve=curve, importance=importance)
    given = risk_tree(tree, branch=branch, kind=kind)
    for name in gone:
        given = without(given, name)
    analysis = Analysis(given)
    options.refuse(horizon is None and analysis.unit is not None, "the tree has rates: say --time TIME")
    if horizon is not None:
        horizon.require(analysis.unit)
    time = horizon.value if horizon is not None else 0.0
    if given.assumed:
        warn(f"guards are taken to hold, so probabilities are upper bounds: {', '.join(given.assumed)}")
    if curve is not None:
        if horizon is None:
            raise click.UsageError("--curve needs --time", click.get_current_context())
        _write_curve(analysis, horizon, curve, form)
    elif importance:
        _write_importance(analysis.importance(time), form)
    else:
        _write_risk(analysis, horizon, time, form)
    return 0


def _write_risk(analysis: Analysis, horizon: Horizon | None, time: float, form: str) -> None:
    probability = analysis.at(time)
    mean, why = None, ""
    try:
        mean = analysis.mean_time() if analysis.unit is not None else None
    except RvaftError as error:
        why = f"not computed: {error}"
    chains = {part: len(solved.index) for part, solved in analysis.chains.items()}
    if form == "json":
        found = {"root": analysis.tree.root, "time": time if horizon else None, "probability": probability}
        extra = {"mean_time": _finite(mean), "states": chains, "upper_bound": bool(analysis.tree.assumed)}
        sys.stdout.write(json.dumps(found | extra, indent=2) + "\n")
        return
    if form == "csv":
        sys.stdout.write(_rows([("time", "probability"), (time, repr(probability))]))
        return
    by = f" by {horizon.text}" if horizon else ""
    lines = [(f"P({analysis.tree.root}{by})", number_text(probability))]
    if horizon is not None and mean is not None and math.isfinite(mean):
        lines.append(("mean time to it", horizon.shown(mean)))
    elif why or mean is not None:
        lines.append(("mean time to it", why or "infinite: it may never happen"))
    lines += [(f"Markov chain of {part}", counted(states, "state")) for part, states in chains.items()]
    sys.stdout.write("\n".join(_aligned(lines)) + "\n")


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


def _write_curve(analysis: Analysis, horizon: Horizon, points: int, form: str) -> None:
    times = [horizon.value * step / points for step in range(points + 1)]
    found = analysis.curve(times)
    if form == "json":
        sys.stdout.write(
            json.dumps([{"time": t, "probability": p} for t, p in zip(times, found, strict=True)], indent=2) + "\n"
        )
    elif form == "csv":
        sys.stdout.write(
            _rows([("time", "probability"), *((repr(t), repr(p)) for t, p in zip(times, found, strict=True))])
        )
    else:
        most = max(found) or 1.0
        rows = [
            (horizon.shown(t), number_text(p), "█" * round(_CHART * p / most))
            for t, p in zip(times, found, strict=True)
        ]
        sys.stdout.write("\n".join(_aligned([("time", "probability", ""), *rows])) + "\n")


_MEASURES: Final = {
    "leaf": "leaf",
    "probability": "probability",
    "birnbaum": "Birnbaum",
    "criticality": "criticality",
    "diagnostic": "DIF",
    "achievement": "RAW",
    "reduction": "RRW",
}
"""The measures of importance, by the names that safety engineers give them."""


def _write_importance(found: list[Importance], form: str) -> None:
    found = sorted(found, key=lambda one: -one.birnbaum)
    values = [[getattr(one, name) for name in _MEASURES] for one in found]
    if form == "json":
        keys = list(_MEASURES)
        rows = [
            dict(zip(keys, [_finite(v) if isinstance(v, float) else v for v in row], strict=True)) for row in values
        ]
        sys.stdout.write(json.dumps(rows, indent=2) + "\n")
    elif form == "csv":
        sys.stdout.write(_rows([[*_MEASURES.values()], *[["" if v is None else v for v in row] for row in values]]))
    else:
        texts = [["" if v is None else v if isinstance(v, str) else number_text(v) for v in row] for row in values]
        sys.stdout.write("\n".join(_aligned([[*_MEASURES.values()], *texts])) + "\n")
