"""Rules about what makes a text a tree at all, on drafts, and about what is written but does nothing, on trees."""

from collections import Counter
from collections.abc import Iterable, Iterator

import networkx as nx

from rvaft.analysis.scenarios import ScenarioSpace
from rvaft.language.draft import BrokenPrune, Draft, DraftTopic, PruneFault
from rvaft.model.expressions import name_text
from rvaft.model.guards import variables as guard_variables
from rvaft.model.nodes import EventType, Ignore, On, Place
from rvaft.model.patterns import Literal, Pattern, Variable
from rvaft.model.patterns import variables as pattern_variables
from rvaft.model.topics import absolute, topic_of, wrong_name, wrong_type
from rvaft.model.tree import sorted_topologically
from rvaft.rules.rule import RuleReport, did_you_mean, listing


def duplicate_setting(draft: Draft) -> Iterator[RuleReport]:
    """Each part of a node is set once, in whichever files."""
    words = {"gate": "gate", "on": "runtime event (`on`)", "when": "guard (`when`)"}
    for node in draft.nodes.values():
        for part, places in node.settings().items():
            for again in places[1:]:
                said = f"the {words.get(part, part)} of {node.name} is set twice, first at {places[0]}; remove one"
                yield RuleReport(again, said, (node.name,))
    for said_again in draft.causalities[1:]:
        first = draft.causalities[0]
        if said_again.value is not first.value:
            message = f"`causality` is set twice, first to {first.value} at {first.place}; remove one"
            yield RuleReport(said_again.place, message)


def gate_without_children(draft: Draft) -> Iterator[RuleReport]:
    """A gate has children."""
    for node in draft.nodes.values():
        for said in node.gates:
            if not said.value.children:
                message = f"{node.name} is a gate without children; list them, or leave out the gate"
                yield RuleReport(said.place, message, (node.name,))


def duplicate_child(draft: Draft) -> Iterator[RuleReport]:
    """No gate lists a child twice."""
    for node in draft.nodes.values():
        for said in node.gates:
            seen = Counter[str]()
            for child in said.value.children:
                seen[child.value] += 1
                if seen[child.value] == 2:
                    message = f"{node.name} lists its child {child.value} twice; use two nodes if it must happen twice"
                    yield RuleReport(child.place, message, (node.name, child.value))


def threshold(draft: Draft) -> Iterator[RuleReport]:
    """The K of a KofN is between 1 and N, and N is the number of children."""
    for node in draft.nodes.values():
        for said in node.gates:
            use, count = said.value, len(said.value.children)
            if use.threshold is None or not count:
                continue
            total = count if use.out_of is None else use.out_of
            if total != count:
                written = f"{use.threshold}of{total}"
                mend = (
                    f"write {use.threshold}of{count}, or list {total} children"
                    if use.threshold <= count
                    else f"list {total} children"
                )
                message = f"{node.name} is {written} but has {count} child{'ren' * (count != 1)}; {mend}"
                yield RuleReport(said.place, message, (node.name,))
            elif not 1 <= use.threshold <= count:
                message = f"{node.name} asks for {use.threshold} of {count} children; K must be between 1 and {count}"
                yield RuleReport(said.place, message, (node.name,))


def no_root(draft: Draft) -> Iterator[RuleReport]:
    """One node is the root: what `toplevel` names, or the only node that is nobody's child."""
    top = Place(draft.file)
    if not draft.nodes:
        yield RuleReport(top, "the tree is empty; state at least its root")
    elif draft.toplevels:
        first = draft.toplevels[0]
        known = set(draft.nodes) | {child.value for child in draft.undeclared()}
        for said in draft.toplevels:
            if said.value != first.value:
                message = f"`toplevel` names {said.value}, but {first.value} at {first.place}; there is one root"
                yield RuleReport(said.place, message, (first.value, said.value))
            elif said.value not in known:
                guess = did_you_mean(said.value, draft.nodes)
                yield RuleReport(said.place, f"the root {said.value} is not stated anywhere{guess}", (said.value,))
    else:
        roots = draft.parentless()
        if len(roots) > 1:
            names = tuple(node.name for node in roots)
            message = f"{listing(names)} are nobody's child; say which is the root with `toplevel NAME;`"
            yield RuleReport(roots[1].place, message, names)


def cycle(draft: Draft) -> Iterator[RuleReport]:
    """No node is below itself."""
    below = {
        node.name: [child.value for child in node.children() if child.value in draft.nodes]
        for node in draft.nodes.values()
    }
    if sum(1 for _ in sorted_topologically(below)) == len(below):
        return
    graph = nx.DiGraph((name, child) for name, children in below.items() for child in children)
    rank = {name: index for index, name in enumerate(draft.nodes)}
    components = nx.strongly_connected_components(graph)
    for members in sorted(components, key=lambda members: min(rank[name] for name in members)):
        first = min(members, key=rank.__getitem__)
        if len(members) > 1 or graph.has_edge(first, first):
            edges = nx.find_cycle(graph.subgraph(members), first)
            names = tuple(name for name, _ in edges)
            message = f"{listing(names)} form a cycle" if len(names) > 1 else f"{first} is its own child"
            node = draft.nodes[names[-1]]
            place = next(child.place for child in node.children() if child.value == edges[-1][1])
            yield RuleReport(place, f"{message}; a node cannot be below itself: remove {edges[-1][1]} here", names)


def prune(draft: Draft) -> Iterator[RuleReport]:
    """What is pruned exists, and what stays can do without it."""
    for broken in draft.broken_prunes:
        nodes = tuple(name for name in (broken.node, broken.pruned) if name is not None)
        yield RuleReport(broken.place, _prune_message(draft, broken), nodes)


def _prune_message(draft: Draft, broken: BrokenPrune) -> str:
    match broken.fault:
        case PruneFault.UNKNOWN:
            return f"cannot prune {broken.pruned}: no statement mentions it{did_you_mean(broken.pruned, draft.nodes)}"
        case PruneFault.ROOT:
            return f"cannot prune {broken.pruned}: it is the root"
        case PruneFault.VOTE:
            mend = f"prune {broken.node} too, or rewrite it"
            return f"cannot prune {broken.pruned}: the KofN gate {broken.node} would lose a child; {mend}"
        case PruneFault.EMPTY:
            return f"cannot prune {broken.pruned}: the gate {broken.node} would have no child left; prune {broken.node} too"


def unknown_child(_: Draft) -> Iterator[RuleReport]:
    """A child is a node. In a text a child that is not declared becomes a leaf, so only trees built in code break this."""
    return iter(())


# Rules about event types and their use, on drafts.


def duplicate_event(draft: Draft) -> Iterator[RuleReport]:
    """An event type is declared once, in whichever file."""
    first: dict[str, EventType] = {}
    for event in draft.events:
        if first.setdefault(event.name, event) is not event:
            before = first[event.name].place
            yield RuleReport(event.place, f"event type {event.name} is declared twice, first at {before}; remove one")


def unused_parameter(draft: Draft) -> Iterator[RuleReport]:
    """Every parameter occurs in the pattern."""
    for event in draft.events:
        used = set(pattern_variables(event.pattern))
        for parameter in event.parameters:
            if parameter not in used:
                message = f"parameter {parameter} of event {event.name} is not in its pattern; use it there or drop it"
                yield RuleReport(event.place, message)


def unknown_event(draft: Draft) -> Iterator[RuleReport]:
    """Every event type that is applied is declared."""
    known = {event.name for event in draft.events}
    for on, place, nodes in _calls(draft):
        if on.event not in known:
            guess = did_you_mean(on.event, known) or f"; declare it with `event {on.event}(...) = {{ ... }};`"
            yield RuleReport(place, f"unknown event type {on.event}{guess}", nodes)


def event_arity(draft: Draft) -> Iterator[RuleReport]:
    """An event type is applied to as many arguments as it has parameters."""
    known: dict[str, EventType] = {}
    for event in draft.events:
        known.setdefault(event.name, event)
    for on, place, nodes in _calls(draft):
        if on.event in known and len(on.arguments) != len(known[on.event].parameters):
            parameters = known[on.event].parameters
            count = f"{len(parameters)} argument{'s' * (len(parameters) != 1)}, not {len(on.arguments)}"
            message = (
                f"event {on.event} takes {count}; write {on.event}({', '.join(parameters)}) with `_` for any value"
            )
            yield RuleReport(place, message, nodes)


def ignore_variable(draft: Draft) -> Iterable[RuleReport]:
    """The guard of an `ignore` speaks of the event that is ignored, and of nothing else."""
    return _foreign_variables(draft.ignores)


def ignore_variable_of_tree(space: ScenarioSpace) -> Iterable[RuleReport]:
    """The same of a tree that was built in code."""
    return _foreign_variables(space.tree.ignores)


def _foreign_variables(ignores: Iterable[Ignore]) -> Iterator[RuleReport]:
    """The `ignore` declarations whose guard uses a variable that their event does not bind."""
    for ignore in ignores:
        own = {argument.name for argument in ignore.on.arguments if isinstance(argument, Variable)}
        missing = [] if ignore.when is None else [name for name in guard_variables(ignore.when) if name not in own]
        if missing:
            message = (
                f"the guard of this `ignore` uses {listing(missing)}, which {ignore.on.event}(...) does not bind; "
                "the variables of an `ignore` are its own"
            )
            yield RuleReport(ignore.place, message)


def _calls(draft: Draft) -> Iterator[tuple[On, Place, tuple[str, ...]]]:
    for node in draft.nodes.values():
        for said in node.ons:
            yield said.value, said.place, (node.name,)
    for ignore in draft.ignores:
        yield ignore.on, ignore.place, ()


# Rules about `topic` declarations: of drafts, and, for those that are of no use, of trees.


def duplicate_topic(draft: Draft) -> Iterator[RuleReport]:
    """All declarations of a topic give it one message type, in whichever files."""
    first: dict[str, DraftTopic] = {}
    for topic in draft.topics:
        name, type_ = topic.name.value, topic.type.value
        before = first.setdefault(absolute(name), topic)
        if before.type.value != type_:
            message = f"topic {name} has the message type {type_} here and {before.type.value} at {before.type.place}; remove one"
            yield RuleReport(topic.type.place, message)


def malformed_topic(draft: Draft) -> Iterator[RuleReport]:
    """Topics, publishers and message types are called as ROS calls them."""
    for topic in draft.topics:
        for said in (topic.name, *topic.publishers):
            if wrong := wrong_name(said.value):
                yield RuleReport(said.place, wrong)
        if wrong := wrong_type(topic.type.value):
            yield RuleReport(topic.type.place, wrong)


def unused_topic(space: ScenarioSpace) -> Iterator[RuleReport]:
    """A topic over which no event type comes."""
    tree = space.tree
    calls = [node.on for node in tree.nodes.values() if node.on is not None] + [ignore.on for ignore in tree.ignores]
    used: set[str] = set()
    for event in tree.events.values():
        for asked in _topics(event, calls):
            if not isinstance(asked, Literal):
                return  # any topic will do
            used.add(absolute(str(asked.value)))
    for name, topic in tree.topics.items():
        if name not in used:
            guess = did_you_mean(name, used)
            message = f"no event type has the topic {topic.name}; remove its declaration, or use it in a pattern{guess}"
            yield RuleReport(topic.place, message)


def _topics(event: EventType, calls: list[On]) -> list[Pattern]:
    """What an event type asks of the topic: itself, or where that is a parameter, each of its calls."""
    asked = topic_of(event.pattern)
    if isinstance(asked, Variable):
        index = event.parameters.index(asked.name)
        return [call.arguments[index] for call in calls if call.event == event.name]
    return [] if asked is None else [asked]


# Rules about what is written but does nothing, or does what was perhaps not meant, on trees.


_GUESSES = 100
"""Children for which a similar name is looked for: whoever leaves out many does so on purpose, and each takes its time."""


def undeclared(space: ScenarioSpace) -> Iterator[RuleReport]:
    """A child that no statement defines is perhaps misspelt."""
    tree = space.tree
    declared = [name for name, node in tree.nodes.items() if node.declared]
    missing = [node for node in tree.nodes.values() if not node.declared]
    for number, node in enumerate(missing):
        guess = did_you_mean(node.name, declared) if number < _GUESSES else ""
        mend = f"write `{name_text(node.name)};`"
        message = f"child {node.name} is not declared; it observes its default event ({mend}){guess}"
        yield RuleReport(node.place(), message, (node.name,))


def unreachable(space: ScenarioSpace) -> Iterator[RuleReport]:
    """A node that does not lie below the root takes part in nothing."""
    tree = space.tree
    reachable = set(tree.order)
    for node in tree.nodes.values():
        if node.name not in reachable and node.declared:
            message = f"{node.name} cannot be reached from the root {tree.root}; make it a child, or prune it"
            yield RuleReport(node.place(), message, (node.name,))


def unused_event(space: ScenarioSpace) -> Iterator[RuleReport]:
    """An event type that neither a node nor an `ignore` uses."""
    tree = space.tree
    used = {node.on.event for node in tree.nodes.values() if node.on is not None}
    used.update(ignore.on.event for ignore in tree.ignores)
    for event in tree.events.values():
        if event.name not in used:
            yield RuleReport(event.place, f"event type {event.name} is not used; use it with `on`, or remove it")


def root_event(space: ScenarioSpace) -> Iterator[RuleReport]:
    """The undesired event is what the tree concludes, not what it observes."""
    root = space.tree.nodes[space.tree.root]
    if root.has_event:
        message = f"the root {root.name} carries a runtime event, which every match must contain; move it to a child"
        yield RuleReport(root.place("on"), message, (root.name,))
