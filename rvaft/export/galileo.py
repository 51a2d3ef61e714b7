"""The static part of a tree in Galileo's format, for fault-tree tools.

Galileo has no SAND: it becomes the priority AND (`pand`), `sand_rl` with its children turned round. Events, guards,
kinds, labels and `ignore` have no form there either; `losses` says what is lost, so that nobody takes the result for the tree.
"""

from collections.abc import Iterator

from rvaft.errors import OptionError
from rvaft.model.expressions import WORD, bare_value
from rvaft.model.nodes import Causality, Gate, Node
from rvaft.model.tree import RVAFT


def galileo_text(tree: RVAFT) -> str:
    """The reachable nodes as Galileo statements, parents first; raises `OptionError` for a name it cannot write."""
    lines = [f"toplevel {_name(tree.root)};"]
    lines.extend(_statement(node) for node in tree.top_down())
    return "\n".join(lines) + "\n"


def losses(tree: RVAFT) -> Iterator[str]:
    """What the Galileo text does not say, one clause each."""
    nodes = list(tree.top_down())
    if count := sum(node.gate is not None and node.gate.ordered for node in nodes):
        yield f"{count} sand {_plural(count, 'gate')} written as pand, which orders failures, not runtime events"
    if count := sum(node.on is not None for node in nodes):
        yield f"{count} runtime {_plural(count, 'event')} left out"
    if count := sum(node.when is not None for node in nodes):
        yield f"{count} {_plural(count, 'guard')} left out"
    if count := sum(node.kind is not None for node in nodes):
        yield f"{count} fault or attack {_plural(count, 'mark')} left out"
    if count := sum(node.label is not None for node in nodes):
        yield f"{count} {_plural(count, 'label')} left out"
    if count := sum(not _plain(*attribute) for node in nodes for attribute in node.attributes):
        yield f"{count} {_plural(count, 'attribute')} left out whose name or value Galileo cannot write"
    if tree.ignores:
        yield "ignore declarations left out"
    if tree.topics:
        yield "topic declarations left out"
    if tree.causality is Causality.BOTTOM_UP:
        yield "causality bottom_up left out"
    if count := sum(node.leaf and not node.attributes for node in nodes):
        yield f"{count} basic {_plural(count, 'event')} without a rate or probability, which most tools require"


def _statement(node: Node) -> str:
    words = [_name(node.name)]
    if node.gate is not None:
        words.append(_gate(node))
        children = node.children[::-1] if node.gate is Gate.SAND_RL else node.children
        words.extend(_name(child) for child in children)
    words.extend(f"{key}={value}" for key, value in node.attributes if _plain(key, value))
    return " ".join(words) + ";"


def _gate(node: Node) -> str:
    match node.gate:
        case Gate.VOT:
            return f"{node.threshold}of{len(node.children)}"
        case Gate.SAND | Gate.SAND_RL:
            return "pand"
        case _:
            return str(node.gate)


def _name(name: str) -> str:
    if '"' in name or not name.isprintable():
        raise OptionError(f"Galileo cannot write the name {name!r}: rename the node")
    return f'"{name}"'


def _plain(key: str, value: str) -> bool:
    """Whether an attribute can be written; Galileo has no quotes around what comes after a name."""
    return WORD.fullmatch(key) is not None and bare_value(value)


def _plural(count: int, noun: str) -> str:
    return noun if count == 1 else f"{noun}s"
