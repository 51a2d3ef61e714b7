"""What has a verdict of its own: the tree, and beside it each of its branches or each of its kinds.

These are the options (a), (b) and (c) of the paper, section 4.3, with the names that its Tables 2 and 3 give to the monitors.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from itertools import islice
from typing import Final

from rvaft.api import narrowed
from rvaft.branches import branches
from rvaft.errors import TooLarge, TreeError
from rvaft.model import Kind
from rvaft.tree import RVAFT

MOST: Final = 1_000
"""How many branches are monitored one by one."""


class Per(StrEnum):
    """What has a verdict of its own."""

    TREE = "tree"
    BRANCH = "branch"
    KIND = "kind"


@dataclass(frozen=True, slots=True)
class Column:
    """One monitor: `label` for programs (`tree`, the number of a branch, a kind), `title` for people, and what it monitors."""

    label: str
    title: str
    part: RVAFT


WHOLE: Final = "tree"
"""The label of the first column, which is always there."""


def columns(tree: RVAFT, per: Per = Per.TREE) -> tuple[Column, ...]:
    """The monitor of a tree (or of the part of one), and those of its parts; raises what `parts` raises."""
    return (Column(WHOLE, "φ", narrowed(tree)), *parts(tree, per))


def parts(tree: RVAFT, per: Per) -> Iterator[Column]:
    """The monitors of the branches of a tree, from 1, or of the kinds that it has.

    A part without a feasible scenario, where nothing can ever be detected, has none. Raises `TreeError` for a tree that breaks a rule,
    and `TooLarge` beyond `MOST` branches.
    """
    match per:
        case Per.TREE:
            return
        case Per.BRANCH:
            numbers = [branch.number for branch in islice(branches(tree), MOST + 1)]
            if len(numbers) > MOST:
                error = TooLarge(f"a monitor for each branch of {tree.root}", limit=MOST)
                error.add_note("take one for each kind with --per kind, or one branch with --branch N")
                raise error
            for number in numbers:
                yield from _feasible(tree, str(number), f"φ{number}", branch=number)
        case Per.KIND:
            present = {node.kind for node in tree.top_down()}
            for kind in Kind:
                if kind in present:
                    yield from _feasible(tree, kind.value, kind.value, kind=kind)


def _feasible(
    tree: RVAFT, label: str, title: str, *, branch: int | None = None, kind: Kind | None = None
) -> Iterator[Column]:
    """The monitor of a part; none of one without a feasible scenario, which nothing detects."""
    try:
        yield Column(label, title, narrowed(tree, branch, kind))
    except TreeError as error:
        if error.rule != "no-scenario":
            raise
