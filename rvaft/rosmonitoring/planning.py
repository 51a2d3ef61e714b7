"""Which monitors a tree gets: one for all of it, one for each branch, or one for each kind."""

import re
from dataclasses import dataclass
from keyword import iskeyword
from typing import Final

from rvaft.api import narrowed
from rvaft.errors import OptionError
from rvaft.model import Kind
from rvaft.monitoring.columns import Per, parts
from rvaft.rosmonitoring.options import Action, NoConfiguration, Options, Oracle
from rvaft.rosmonitoring.topics import Subscription, subscriptions
from rvaft.tree import RVAFT

_LAST_PORT: Final = 65_535
_IDENTIFIER: Final = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


@dataclass(frozen=True, slots=True)
class Planned:
    """A monitor: what it is called, what it looks at, where it asks, which topics it filters and which it only logs."""

    id: str
    tree: RVAFT
    port: int
    topics: tuple[tuple[Subscription, Action], ...]


def monitor_id(name: str) -> str:
    """A name as ROSMonitoring can call a monitor: a word of Python, which becomes a module and a node of ROS."""
    word = re.sub(r"[^A-Za-z0-9_]", "_", name) or "monitor"
    return f"monitor_{word}" if not _IDENTIFIER.fullmatch(word) or iskeyword(word) else word


def planned(
    tree: RVAFT,
    options: Options,
    *,
    per: Per = Per.TREE,
    branch: int | None = None,
    kind: Kind | None = None,
    name: str | None = None,
) -> tuple[Planned, ...]:
    """The monitors of a tree, called after `name` (by default after the root); with `branch` or `kind` that of this part alone.

    With `per`, a branch or kind without a feasible scenario is left out, since nothing can ever be detected there.
    Raises `NoConfiguration` for a tree that ROSMonitoring cannot monitor as asked, `TreeError` for one that breaks a rule,
    `TooLarge` beyond as many branches as can be monitored one by one, `OptionError` for a name or a last port that cannot be.
    """
    base = monitor_id(tree.root) if name is None else name
    if monitor_id(base) != base:
        raise OptionError(
            f'"{base}" cannot be the id of a monitor, which is a word of letters, digits and _ and no keyword of Python'
        )
    if branch is None and kind is None:
        wanted = _parts(tree, per, base)
    else:
        wanted = [(f"{base}_{kind}" if branch is None else f"{base}_branch_{branch}", narrowed(tree, branch, kind))]
    if options.port + len(wanted) - 1 > _LAST_PORT:
        raise OptionError(f"{len(wanted)} monitors need as many ports, and there are none above {_LAST_PORT}")
    made = []
    for index, (id_, part) in enumerate(wanted):
        topics = subscriptions(part, options.semantics)
        actions = [(topic, _action(topic, options, alone=len(wanted) == 1)) for topic in topics]
        made.append(Planned(id_, part, options.port + index, tuple(actions)))
    return tuple(made)


def _action(topic: Subscription, options: Options, *, alone: bool) -> Action:
    """To filter takes publishers to come between, a single monitor, and an oracle that answers false at a detection alone."""
    if options.action is not Action.FILTER:
        possible = topic.publishers and alone and options.oracle is Oracle.RVAFT
        return Action.FILTER if possible and options.action is None else Action.LOG
    if options.oracle is Oracle.RML:
        raise NoConfiguration(
            "the RML oracle answers currently_false until the tree is detected, and a filter would keep all messages back: use --action log"
        )
    if not alone:
        raise NoConfiguration(
            f"each of several monitors that filter would forward every message of {topic.name}: use --per tree, --branch or --kind"
        )
    if not topic.publishers:
        raise NoConfiguration(
            f"{topic.place}: the topic {topic.name} cannot be filtered without its publishers: add `from NODE` to its declaration"
        )
    return Action.FILTER


def _parts(tree: RVAFT, per: Per, base: str) -> list[tuple[str, RVAFT]]:
    if per is Per.TREE:
        return [(base, narrowed(tree))]
    infix = "_branch_" if per is Per.BRANCH else "_"
    found = [(f"{base}{infix}{part.label}", part.part) for part in parts(tree, per)]
    if not found:
        raise NoConfiguration("no branch has a kind: mark nodes with fault or attack, or use --per tree")
    return found
