"""`rvaft cut-sets`: the least sets of leaves that bring a tree about."""

import json
import sys
from typing import Any

import click

from rvaft.cli import options, warn
from rvaft.cli.horizon import Horizon, number_text, time_option
from rvaft.cli.risk_tree import csv_text, require_time, risk_tree, without_option
from rvaft.model.nodes import Kind
from rvaft.risk.cut_sets import CutSet, CutSets
from rvaft.risk.model import RiskTree
from rvaft.risk.probability import leaf_chances
from rvaft.support.wording import counted


@click.command("cut-sets")
@options.tree_argument
@options.part_options
@options.number("--max-order", least=0, text="Only sets of at most this many events.")
@options.number("--limit", default=100, least=0, text="Maximum number of sets to list.")
@click.option("--most-probable", is_flag=True, help="List the most probable sets, with their probabilities.")
@time_option("--time", "horizon")
@without_option
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
    given = risk_tree(tree, branch=branch, kind=kind, gone=gone)
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
            sys.stdout.write(csv_text([head, *rows]))
        case "tex":
            sys.stdout.write(_cut_sets_tex(listed))
        case _:
            sys.stdout.write(_cut_sets_text(found, listed))
    return 0


def _chances(tree: RiskTree, horizon: Horizon | None) -> dict[str, float]:
    require_time(horizon, tree.unit)
    return leaf_chances(tree, horizon.value if horizon else 0.0)


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
