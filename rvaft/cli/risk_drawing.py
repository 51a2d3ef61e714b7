"""What `rvaft show` draws of the numbers of a tree: a minimal cut set, and the probability of each node."""

from typing import Final

from rvaft.cli import warn
from rvaft.cli.horizon import Horizon
from rvaft.cli.risk_tree import risk_tree
from rvaft.errors import OptionError
from rvaft.export.layout import Marks, set_marks
from rvaft.model.tree import RVAFT
from rvaft.risk.cut_sets import CutSets
from rvaft.risk.model import RiskTree, later_leaves, of_tree
from rvaft.risk.probability import Analysis, dynamic_parts
from rvaft.support.wording import counted

_LATER: Final = "clock starts later"


def form_of(file: str, tree: RVAFT) -> RiskTree:
    """Return the form of a tree from a file; raises `OptionError` if it has other nodes than the drawing."""
    if not tree.translated:
        return of_tree(tree)
    form = risk_tree(file)
    lacking = next((name for name in form.order() if name not in tree.nodes), None)
    lacking = lacking or next((name for name in tree.order if name not in form.leaves and name not in form.gates), None)
    if lacking is not None or dynamic_parts(form):
        why = f", and {lacking} is in one of them only" if lacking else ""
        raise OptionError(
            "the drawing shows what the dynamic gates of Galileo are translated to for monitors, and numbers are for "
            f"the gates as they are written{why}: `rvaft cut-sets` and `rvaft risk` list them"
        )
    return form


def cut_set_marks(tree: RVAFT, form: RiskTree, number: int) -> Marks:
    """Return the marks of a cut set; raises `OptionError` if there are fewer."""
    sets = CutSets(form)
    if number > sets.count:
        raise OptionError(f"--cut-set {number}: the tree has {counted(sets.count, 'minimal cut set')}")
    found = sets.listed(number)[-1]
    leaves = {form.leaves[name].node for name in found.leaves}
    try:
        return set_marks(tree, leaves, f"cut set {number}: {', '.join(found.leaves)}")
    except ValueError as error:
        raise OptionError(f"--cut-set {number}: the drawing has other gates than the analysis: {error}") from None


def probabilities(tree: RVAFT, form: RiskTree, horizon: Horizon) -> dict[str, str]:
    """Return the probability of each node by a time, as a text.

    A node has none if its clock starts when an earlier part of a sequence is complete.
    """
    analysis = Analysis(form)
    horizon.require(analysis.unit)
    if form.assumed:
        warn(f"guards are taken to hold, so probabilities are upper bounds: {', '.join(form.assumed)}")
    later = later_leaves(form)
    sign = "P ≤" if form.assumed else "P ="
    found: dict[str, str] = {}
    for name in tree.order:
        found[name] = _LATER if name in later else f"{sign} {analysis.element(name, horizon.value):.4g}"
    return found
