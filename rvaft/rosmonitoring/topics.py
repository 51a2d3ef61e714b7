"""Which topics a monitor subscribes to: those of the events that its verdicts depend on.

That is more than the events of a branch. Under `projected` an event that is relevant to the whole tree ends the matches of a
branch that it does not fit, and under `strict` any event does, so their monitors have to see all events of the whole tree.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from rvaft.model import Node, Place
from rvaft.patterns import Literal, Pattern
from rvaft.rosmonitoring.options import NoConfiguration
from rvaft.rules.context import Context
from rvaft.rules.rule import Undecided
from rvaft.rules.words import listing
from rvaft.topics import absolute, topic_of, wrong_name
from rvaft.tree import RVAFT
from rvaft.verdict import Semantics


@dataclass(frozen=True, slots=True)
class Subscription:
    """A topic as the patterns of the tree spell it, and what was declared of it."""

    name: str
    type: str
    publishers: tuple[str, ...]
    place: Place = field(default=Place(), compare=False)


def subscriptions(tree: RVAFT, semantics: Semantics) -> tuple[Subscription, ...]:
    """The topics that a monitor of this tree, or of this part of a tree, needs; in the order of its nodes.

    Raises `NoConfiguration` for an event that comes over no topic of its own, for a topic of which no message type is
    declared, and for two topics that one generated monitor cannot tell apart.
    """
    first: dict[str, Node] = {}
    for node, pattern in _observed(tree, semantics):
        first.setdefault(_topic(tree, node, pattern), node)
    _check_spelling(tree, first)
    _check_declared(tree, first)
    declared = {name: tree.topics[absolute(name)] for name in first}
    wanted = tuple(Subscription(name, topic.type, topic.publishers, topic.place) for name, topic in declared.items())
    _check_types(wanted)
    return wanted


def _observed(tree: RVAFT, semantics: Semantics) -> Iterator[tuple[Node, Pattern]]:
    """The runtime events that verdicts depend on, with the node that each belongs to."""
    whole = tree
    while semantics is not Semantics.SCATTERED and whole.part_of is not None:
        whole = whole.part_of.tree
    possible = _in_feasible(whole) if semantics is Semantics.SCATTERED else whole.occurrences
    for name in possible:
        pattern = whole.pattern(name)
        assert pattern is not None
        yield whole.nodes[name], pattern


def _in_feasible(tree: RVAFT) -> Iterator[str]:
    """The nodes with a runtime event that are in some feasible scenario; one of which that was not decided counts as such.

    The other semantics look at all events that are relevant, and those of infeasible scenarios are.
    """
    context = Context(tree)
    budget = context.budget()
    for name in tree.occurrences:
        try:
            if name in context.space and (context.acyclic or context.feasible(budget, [name]) is not None):
                yield name
        except Undecided:
            yield name


def _topic(tree: RVAFT, node: Node, pattern: Pattern) -> str:
    match topic_of(pattern):
        case Literal(str(name)):
            if wrong := wrong_name(name):
                raise NoConfiguration(f"{_place(tree, node)}: {wrong}; mend the field topic of {_event(tree, node)}")
            return name
        case _ if node.on is None:
            raise NoConfiguration(
                f"{_place(tree, node)}: {_event(tree, node)} comes over no topic: give it an event type with `on`"
            )
        case _:
            raise NoConfiguration(
                f"{_place(tree, node)}: {_event(tree, node)} comes over no topic: "
                'its pattern needs a text in the field topic, as in { topic: "/name" }'
            )


def _check_declared(tree: RVAFT, first: Mapping[str, Node]) -> None:
    missing = [name for name in first if absolute(name) not in tree.topics]
    if missing:
        name, *others = missing
        more = f" (and one for {listing(others)})" if others else ""
        raise NoConfiguration(
            f"{_place(tree, first[name])}: the topic {name} of {_event(tree, first[name])} has no message type: "
            f'add `topic "{name}" type "package.msg.Name";`{more}'
        )


def _event(tree: RVAFT, node: Node) -> str:
    if node.on is not None:
        return f"event type {node.on.event}"
    return f"the default event of {tree.origins.get(node.name, node.name)}"


def _place(tree: RVAFT, node: Node) -> Place:
    return node.place() if node.on is None else tree.events[node.on.event].place


def _check_spelling(tree: RVAFT, first: Mapping[str, Node]) -> None:
    spelled: dict[str, str] = {}
    for name, node in first.items():
        other = spelled.setdefault(absolute(name), name)
        if other != name:
            raise NoConfiguration(
                f"{_place(tree, node)}: the topics {other} and {name} are one in ROS: spell it the same way in all patterns"
            )


def _check_types(wanted: tuple[Subscription, ...]) -> None:
    """The generated monitor imports message types by their last word, and the later import would win."""
    packages: dict[str, Subscription] = {}
    for topic in wanted:
        word = topic.type.rpartition(".")[2]
        other = packages.setdefault(word, topic)
        if other.type != topic.type:
            raise NoConfiguration(
                f"{topic.place}: the message types {other.type} of {other.name} and {topic.type} of {topic.name} would both be "
                f"{word} in one monitor of ROSMonitoring, which takes the one for the other: rename one message"
            )
