"""`rvaft risk`: how likely a tree is, and what matters to it."""

import json
import math
import sys
from contextlib import suppress
from dataclasses import asdict
from typing import Final

import click
from click.core import ParameterSource

from rvaft.cli import options
from rvaft.cli.horizon import Horizon, number_text, time_option
from rvaft.cli.risk_tree import (
    chart_option,
    csv_text,
    require_time,
    risk_tree,
    warn_of_bounds,
    without_option,
    write_chart,
)
from rvaft.engine.monitor import Engine
from rvaft.errors import OptionError, RvaftError, TooLarge
from rvaft.export.chart import Chart
from rvaft.model.expressions import name_text
from rvaft.model.nodes import Kind
from rvaft.model.verdict import Semantics
from rvaft.risk.cut_sets import CutSets
from rvaft.risk.model import RiskTree
from rvaft.risk.probability import Analysis, Importance, dynamic_parts, leaf_chances
from rvaft.risk.pruning import Pruning, prunable
from rvaft.risk.simulation import Simulation
from rvaft.support.terminal import columns
from rvaft.support.wording import counted

_POINTS: Final = 1000
_CHART: Final = 50
_BOUND_ORDER: Final = 4
_BOUND_NODES: Final = 1_000_000
_MOST_SETS: Final = 100_000
_PRUNE: Final = "List what may be pruned so that the probability falls by at most P."
_SIMULATE: Final = "Estimate the probability from N simulated logs, which also windows and absent events allow."


@click.command("risk")
@options.tree_argument
@options.part_options
@time_option("--time", "horizon")
@options.number("--curve", least=1, most=_POINTS, text="Probabilities at this many equal steps up to --time.")
@click.option("--importance", is_flag=True, help="How much each leaf matters, the most important first.")
@without_option
@click.option("--prune-below", type=click.FloatRange(0, 1), callback=options.finite, metavar="P", help=_PRUNE)
@options.number("--simulate", "samples", metavar="N", most=10_000_000, text=_SIMULATE)
@options.number("--seed", default=1, least=0, text="Seed of --simulate.")
@options.semantics_option
@options.output_format("text", "json", "csv")
@chart_option
def risk_command(
    *,
    tree: str,
    branch: int | None,
    kind: Kind | None,
    horizon: Horizon | None,
    curve: int | None,
    importance: bool,
    gone: tuple[str, ...],
    prune_below: float | None,
    samples: int | None,
    seed: int,
    semantics: Semantics | None,
    form: str,
    output: str | None,
) -> int:
    """Compute the probability that the root of a tree has happened by a time.

    The leaves have prob=P, or lambda=RATE with a unit of time (0.002/h) or without. Static trees
    are computed by a decision diagram, those in which order matters by Markov chains of their parts;
    both are exact.
    """
    context = click.get_current_context()
    options.refuse(
        samples is None and context.get_parameter_source("seed") is not ParameterSource.DEFAULT,
        "--seed needs --simulate",
    )
    options.exclusive(**{"curve": curve, "importance": importance, "prune-below": prune_below, "simulate": samples})
    options.refuse(output is not None and curve is None, "-o draws a curve: add --curve N")
    options.refuse(output is not None and form != "text", f"-o draws a chart, not the format {form}")
    given = risk_tree(tree, branch=branch, kind=kind, gone=gone)
    if samples is not None:
        options.refuse(gone, "--simulate draws logs of the whole tree: omit --without")
        return _simulate(given, horizon, samples=samples, seed=seed, semantics=semantics, form=form)
    options.refuse(semantics is not None, "--semantics needs --simulate: chains and diagrams are for scattered")
    analysis = Analysis(given)
    require_time(horizon, analysis.unit)
    time = horizon.value if horizon is not None else 0.0
    warn_of_bounds(given)
    if curve is not None:
        if horizon is None:
            raise click.UsageError("--curve needs --time", click.get_current_context())
        _write_curve(analysis, horizon, curve, form, output)
    elif importance:
        _write_importance(given, analysis.importance(time), time, form)
    elif prune_below is not None:
        _write_pruning(prunable(given, time, prune_below), form)
    else:
        _write_risk(analysis, horizon, time, form)
    return 0


def _write_risk(analysis: Analysis, horizon: Horizon | None, time: float, form: str) -> None:
    try:
        probability = analysis.at(time)
    except TooLarge as error:
        _note_bound(error, analysis.tree, time)
        raise
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
        sys.stdout.write(csv_text([("time", "probability"), (time, repr(probability))]))
        return
    by = f" by {horizon.text}" if horizon else ""
    lines = [(f"P({analysis.tree.root}{by})", number_text(probability))]
    if horizon is not None and mean is not None and math.isfinite(mean):
        lines.append(("mean time to it", horizon.shown(mean)))
    elif why or mean is not None:
        lines.append(("mean time to it", why or "infinite: it may never happen"))
    lines += [(f"Markov chain of {part}", counted(states, "state")) for part, states in chains.items()]
    sys.stdout.write("\n".join(columns(lines)) + "\n")


def _note_bound(error: TooLarge, tree: RiskTree, time: float) -> None:
    """Add what is known all the same: a lower bound from the smallest cut sets."""
    if dynamic_parts(tree):
        return
    chances = leaf_chances(tree, time)
    for order in range(_BOUND_ORDER, 0, -1):
        with suppress(TooLarge):
            found = CutSets(tree, order=order, nodes=_BOUND_NODES)
            bound = found.probability(chances, nodes=_BOUND_NODES)
            sets = f"{counted(found.count, 'minimal cut set')} of at most {counted(order)}"
            error.add_note(f"{sets} give the lower bound {bound:.10g}; no upper bound is known")
            return


def _simulate(
    given: RiskTree, horizon: Horizon | None, *, samples: int, seed: int, semantics: Semantics | None, form: str
) -> int:
    """Print an estimate."""
    if given.tree is None:
        raise OptionError("dynamic gates of Galileo are not simulated: their chains are exact")
    if horizon is None:
        raise click.UsageError("--simulate needs --time", click.get_current_context())
    horizon.require(given.unit)
    meaning = semantics or Semantics.SCATTERED
    simulation = Simulation(given.tree, given)
    found = simulation.estimate(Engine(given.tree, meaning), horizon.value, samples=samples, seed=seed)
    if form == "json":
        sys.stdout.write(json.dumps({"semantics": meaning, "time": horizon.value, **asdict(found)}, indent=2) + "\n")
    elif form == "csv":
        sys.stdout.write(csv_text([tuple(asdict(found)), tuple(asdict(found).values())]))
    else:
        lines = [
            (f"P({given.root} by {horizon.text})", f"{found.probability:.6g}"),
            ("95 % interval", f"{found.low:.6g} to {found.high:.6g}"),
            ("estimated from", f"{counted(samples, 'simulated log')}, seed {seed}, {meaning}"),
        ]
        sys.stdout.write("\n".join(columns(lines)) + "\n")
    return 0


def _write_pruning(found: Pruning, form: str) -> None:
    if form == "json":
        rows = {"nodes": found.nodes, "before": found.before, "after": found.after, "lost": found.lost}
        sys.stdout.write(json.dumps(rows, indent=2) + "\n")
    elif form == "csv":
        sys.stdout.write(csv_text([("node",), *((name,) for name in found.nodes)]))
    else:
        note = f"// P falls from {number_text(found.before)} to {number_text(found.after)}, by {found.lost:.3g}"
        lines = [f"prune {' '.join(map(name_text, found.nodes))};"] if found.nodes else ["// nothing can be pruned"]
        sys.stdout.write("\n".join([note, *lines]) + "\n")


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


def _write_curve(analysis: Analysis, horizon: Horizon, points: int, form: str, output: str | None) -> None:
    times = [horizon.value * step / points for step in range(points + 1)]
    found = analysis.curve(times)
    if output is not None:
        bound = " (upper bound)" if analysis.tree.assumed else ""
        title = f"Probability of {analysis.tree.root}{bound}"
        scaled = [(horizon.scaled(t), p) for t, p in zip(times, found, strict=True)]
        write_chart(Chart(title, f"time t{horizon.unit_text}", "P(by time t)", scaled), output)
    elif form == "json":
        sys.stdout.write(
            json.dumps([{"time": t, "probability": p} for t, p in zip(times, found, strict=True)], indent=2) + "\n"
        )
    elif form == "csv":
        sys.stdout.write(
            csv_text([("time", "probability"), *((repr(t), repr(p)) for t, p in zip(times, found, strict=True))])
        )
    else:
        most = max(found) or 1.0
        rows = [
            (horizon.shown(t), number_text(p), "█" * round(_CHART * p / most))
            for t, p in zip(times, found, strict=True)
        ]
        sys.stdout.write("\n".join(columns([("time", "probability", ""), *rows])) + "\n")


_SHARE: Final = "cut_set_share"
_MEASURES: Final = {
    "leaf": "leaf",
    "probability": "probability",
    "birnbaum": "Birnbaum",
    "criticality": "criticality",
    "diagnostic": "DIF",
    "achievement": "RAW",
    "reduction": "RRW",
    _SHARE: "cut-set FV",
}
"""The measures of importance, by the names that safety engineers give them."""


def _cut_set_shares(tree: RiskTree, found: list[Importance], time: float) -> dict[str, float]:
    """Return the cut-set Fussell-Vesely importance of each leaf of a static tree with few cut sets."""
    if dynamic_parts(tree):
        return {}
    chances = leaf_chances(tree, time)
    with suppress(TooLarge):
        sets = CutSets(tree, nodes=_BOUND_NODES)
        whole = sets.probability(chances, nodes=_BOUND_NODES)
        if whole and sets.count <= _MOST_SETS:
            return {one.leaf: sets.probability(chances, one.leaf, nodes=_BOUND_NODES) / whole for one in found}
    return {}


def _write_importance(tree: RiskTree, found: list[Importance], time: float, form: str) -> None:
    found = sorted(found, key=lambda one: -one.birnbaum)
    shares = _cut_set_shares(tree, found, time)
    values = [[shares.get(one.leaf) if name == _SHARE else getattr(one, name) for name in _MEASURES] for one in found]
    if form == "json":
        keys = list(_MEASURES)
        rows = [
            dict(zip(keys, [_finite(v) if isinstance(v, float) else v for v in row], strict=True)) for row in values
        ]
        sys.stdout.write(json.dumps(rows, indent=2) + "\n")
    elif form == "csv":
        sys.stdout.write(csv_text([[*_MEASURES.values()], *[["" if v is None else v for v in row] for row in values]]))
    else:
        texts = [["" if v is None else v if isinstance(v, str) else number_text(v) for v in row] for row in values]
        sys.stdout.write("\n".join(columns([[*_MEASURES.values()], *texts])) + "\n")
