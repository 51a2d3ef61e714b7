"""`rvaft attacks`: minimal attacks, and what attackers gain for what they spend."""

import json
import sys
from dataclasses import asdict
from typing import Final

import click
from click.core import ParameterSource

from rvaft.cli import options
from rvaft.cli.horizon import Horizon, number_text, time_option
from rvaft.cli.risk_tree import chart_option, csv_text, require_time, risk_tree, without_option, write_chart
from rvaft.export.chart import Chart
from rvaft.model.nodes import Kind
from rvaft.risk.attacks import Attack, Attacks
from rvaft.support.terminal import columns

_ROWS: Final = 12
"""Maximum number of attacks that a chart lists."""
_BY: Final = ("cheapest", "most-probable", "front", "damage-front")
_LIST: Final = (
    "Minimal attacks, the cheapest or the most probable first, or the attacks that no other beats in cost and "
    "probability, or in cost, probability and damage."
)


@click.command("attacks")
@options.tree_argument
@options.part_options
@options.choice("--list", "by", words=_BY, default="cheapest", text=_LIST)
@time_option("--time", "horizon")
@options.number("--max-order", least=1, text="Only minimal attacks of sets of at most this many leaves.")
@options.number("--limit", default=100, least=1, text="Maximum number of minimal attacks to list.")
@without_option
@options.output_format("text", "json", "csv")
@chart_option
def attacks_command(
    *,
    tree: str,
    branch: int | None,
    kind: Kind | None,
    by: str,
    horizon: Horizon | None,
    max_order: int | None,
    limit: int,
    gone: tuple[str, ...],
    form: str,
    output: str | None,
) -> int:
    """List attacks with cost, probability and expected damage.

    A step of an attack is a leaf with cost=C; it succeeds with its prob=P, or for certain. Other
    leaves are faults with prob=P or lambda=RATE, which nobody chooses. A node with damage=D hurts when
    it happens.
    """
    options.refuse(output is not None and by != "front", "-o draws a front of two axes: add --list front")
    options.refuse(output is not None and form != "text", f"-o draws a chart, not the format {form}")
    if by in ("front", "damage-front"):
        context = click.get_current_context()
        for name in ("max_order", "limit"):
            chosen = context.get_parameter_source(name) is not ParameterSource.DEFAULT
            options.refuse(chosen, f"--{name.replace('_', '-')} is for minimal attacks: omit it with --list {by}")
    given = risk_tree(tree, branch=branch, kind=kind, gone=gone)
    require_time(horizon, given.unit)
    attacks = Attacks(given, None if horizon is None else horizon.value)
    if by in ("front", "damage-front"):
        found = attacks.front(damage=by == "damage-front")
    else:
        found = attacks.minimal(limit, order=max_order, by="cost" if by == "cheapest" else "probability")
    if output is not None:
        write_chart(_chart(found, given.root, horizon), output)
    else:
        sys.stdout.write(_written(found, form))
    return 0


def _chart(found: list[Attack], root: str, horizon: Horizon | None) -> Chart:
    """Return the greatest probability for each budget, with the attacks that reach it if they are few."""
    points = [(one.cost, one.probability) for one in found]
    rows = [
        f"cost {number_text(one.cost)}, P {number_text(one.probability)}: {', '.join(one.steps) or '(none)'}"
        for one in found
    ]
    by = "" if horizon is None else f" by {horizon.text}"
    title = f"Attacks on {root} that no other beats"
    return Chart(title, "cost", f"greatest P({root}{by})", points, steps=True, rows=rows if len(rows) <= _ROWS else ())


def _written(found: list[Attack], form: str) -> str:
    if form == "json":
        return json.dumps([asdict(one) for one in found], indent=2) + "\n"
    if form == "csv":
        head = ("cost", "probability", "damage", "steps")
        return csv_text([head, *((one.cost, one.probability, one.damage, " ".join(one.steps)) for one in found)])
    rows = [("COST", "PROBABILITY", "DAMAGE", "STEPS")]
    rows += [
        (number_text(one.cost), number_text(one.probability), number_text(one.damage), ", ".join(one.steps) or "(none)")
        for one in found
    ]
    return "".join(f"{line}\n" for line in columns(rows))
