"""Rules about the structure of drafts, and about statements without effect."""

from collections import Counter
from collections.abc import Iterator
from pathlib import PurePath

from rvaft.core.feasibility import ScenarioSpace
from rvaft.core.property import unrepeatable
from rvaft.language.draft import UNMENTIONED, Draft, DraftNode, DraftTopic, GateUse, Located
from rvaft.language.markup import SUFFIX as XML
from rvaft.model.expressions import guard_text, name_text
from rvaft.model.guards import time_points
from rvaft.model.guards import variables as guard_variables
from rvaft.model.nodes import EventType, On, Place, ValueType, absolute, topic_of, wrong_name, wrong_type
from rvaft.model.patterns import Literal, Variable
from rvaft.model.patterns import variables as pattern_variables
from rvaft.model.tree import RVAFT, find_cycle, knots, sorted_topologically
from rvaft.model.verdict import Semantics
from rvaft.rules.rule import RuleReport
from rvaft.support.wording import did_you_mean, listing, similar


def duplicate_setting(draft: Draft) -> Iterator[RuleReport]:
    """Each part of a node is set once, in all files together."""
    words = {"gate": "gate", "on": "runtime event (`on`)", "when": "guard (`when`)"}
    for node in draft.nodes.values():
        for part, places in node.settings().items():
            for again in places[1:]:
                message = f"the {words.get(part, part)} of {node.name} is set twice, first at {places[0]}; remove one"
                yield RuleReport(again, message, (node.name,))
    for word, settings in draft.settings().items():
        for repeated in settings[1:]:
            first = settings[0]
            if repeated.value != first.value:
                to = f" to {first.value}" if isinstance(first.value, str) else ""
                message = f"`{word}` is set twice, first{to} at {first.place}; remove one"
                yield RuleReport(repeated.place, message)


def _gates(draft: Draft) -> Iterator[tuple[str, Located[GateUse]]]:
    return ((node.name, gate) for node in draft.nodes.values() for gate in node.gates)


def gate_without_children(draft: Draft) -> Iterator[RuleReport]:
    """A gate has children."""
    for name, gate in _gates(draft):
        if not gate.value.children:
            message = f"{name} is a gate without children; list them, or leave out the gate"
            yield RuleReport(gate.place, message, (name,))


def duplicate_child(draft: Draft) -> Iterator[RuleReport]:
    """No gate lists a child twice."""
    for name, gate in _gates(draft):
        seen: dict[str, int] = {}
        for child, place in gate.value.children:
            seen[child] = seen.get(child, 0) + 1
            if seen[child] == 2:
                message = f"{name} lists its child {child} twice; use two nodes if it must happen twice"
                yield RuleReport(place, message, (name, child))


def threshold(draft: Draft) -> Iterator[RuleReport]:
    """The K of a KofN is between 1 and N, and N is the number of children."""
    for name, (use, place) in _gates(draft):
        count, k = len(use.children), use.threshold
        if k is None or not count:
            continue
        total = count if use.out_of is None else use.out_of
        if total != count:
            mend = f"write {k}of{count}, or list {total} children" if k <= count else f"list {total} children"
            message = f"{name} is {k}of{total} but has {count} child{'ren' * (count != 1)}; {mend}"
            yield RuleReport(place, message, (name,))
        elif not 1 <= k <= count:
            message = f"{name} requires {k} of {count} children; K must be between 1 and {count}"
            yield RuleReport(place, message, (name,))


def times(draft: Draft) -> Iterator[RuleReport]:
    """`times` requires a leaf with an event."""
    for node in draft.nodes.values():
        for (count, *own), place in node.counts:
            counts = count > 1 or any(own)
            if counts and node.gates:
                mend = "move it to that leaf"
                yield RuleReport(
                    place, f"{node.name} is a gate, but `times` counts the events of a leaf; {mend}", (node.name,)
                )
            elif counts and node.whens and not node.ons:
                message = f"{node.name} has no event to count; add one with `on`"
                yield RuleReport(place, message, (node.name,))


def own_values(draft: Draft) -> Iterator[RuleReport]:
    """A variable of `distinct` or `each` stands in the event of its leaf, and at no other node."""
    for node in draft.nodes.values():
        for count, place in node.counts:
            own = (*count.distinct, *count.each)
            there = {name for on in node.ons for name in on.value.variables}
            for name in set(count.distinct) & set(count.each):
                message = f"`each {name}` at {node.name} is part of `distinct {name}`; remove `each {name}`"
                yield RuleReport(place, message, (node.name,))
            timed = any(time_points(guard) for guard, _ in node.whens)
            for name in dict.fromkeys(own):
                known = [one for one in there if one not in own]
                elsewhere = next((other for other in draft.nodes.values() if name in _used_by(other, node)), None)
                if name not in there:
                    message = f"the event of {node.name} does not have {name}{did_you_mean(name, known)}"
                    yield RuleReport(place, message, (node.name,))
                elif elsewhere is not None:
                    so = (
                        f"{name} has a value of its own in each event of {node.name}, so {elsewhere.name} cannot use it"
                    )
                    yield RuleReport(place, f"{so}; give one of the two another name", (node.name, elsewhere.name))
            if timed and any(name in guard_variables(guard) for guard, _ in node.whens for name in own):
                message = f"the guard of {node.name} compares times, and values that each of its events has for itself"
                yield RuleReport(place, f"{message}; write the times at a gate above", (node.name,))


def _used_by(other: DraftNode, leaf: DraftNode) -> set[str]:
    """Return the variables that a node uses; of the leaf itself, those of its absent events."""
    found = {name for clause, _ in other.withouts for name in clause.variables}
    if other is not leaf:
        found |= {name for on, _ in other.ons for name in on.variables}
        found |= {name for guard, _ in other.whens for name in guard_variables(guard)}
    return found


def within(draft: Draft) -> Iterator[RuleReport]:
    """`within` requires a gate."""
    for node in draft.nodes.values():
        for window in () if node.gates else node.withins:
            message = f"{node.name} is a leaf, but `within` applies to a gate; move it to a gate above the leaf"
            yield RuleReport(window.place, message, (node.name,))


def unknown_time(draft: Draft) -> Iterator[RuleReport]:
    """Every time point refers to a node of the tree."""
    known = [*draft.nodes, *(child.value for child in draft.undeclared())]
    there = set(known)
    for node in draft.nodes.values():
        for guard, place in node.whens:
            for point in time_points(guard):
                if point.node not in there:
                    problem = f"the guard of {node.name} uses {guard_text(point)}, but there is no node {point.node}"
                    yield RuleReport(place, f"{problem}{did_you_mean(point.node, known)}", (node.name,))


def no_root(draft: Draft) -> Iterator[RuleReport]:
    """One node is the root: the node of `toplevel`, or the only node without a parent."""
    if not draft.nodes:
        yield RuleReport(Place(draft.file), "the tree is empty; declare at least its root")
    elif draft.toplevels:
        first = draft.toplevels[0]
        known = set(draft.nodes) | {child.value for child in draft.undeclared()}
        for toplevel in draft.toplevels:
            if toplevel.value != first.value:
                message = f"`toplevel` names {toplevel.value}, but {first.value} at {first.place}; keep one of them"
                yield RuleReport(toplevel.place, message, (first.value, toplevel.value))
            elif toplevel.value not in known:
                guess = did_you_mean(toplevel.value, draft.nodes)
                yield RuleReport(toplevel.place, f"the root {toplevel.value} is not declared{guess}", (toplevel.value,))
    elif len(roots := draft.parentless()) > 1:
        names = tuple(node.name for node in roots)
        children = [child.value for child in draft.undeclared()][:_GUESSES]
        guesses = ((name, did_you_mean(name, children)) for name in names[:_GUESSES])
        guess = next((f"; {name}: {guess.removeprefix('; ')}" for name, guess in guesses if guess), "")
        mend = "declare the root with `toplevel NAME;`"
        if draft.file.lower().endswith(XML):
            mend = (
                f'name the root in a tree that imports this file: import "{PurePath(draft.file).name}"; toplevel NAME;'
            )
        message = f"{listing(names)} have no parent; {mend}{guess}"
        yield RuleReport(roots[1].place, message, names)


def cycle(draft: Draft) -> Iterator[RuleReport]:
    """No node is below itself."""
    nodes = draft.nodes
    below = {name: [child.value for child in node.children() if child.value in nodes] for name, node in nodes.items()}
    if sum(1 for _ in sorted_topologically(below)) == len(below):
        return
    order = [*below]
    rank = {name: index for index, name in enumerate(order)}
    for ranks in sorted(sorted(rank[name] for name in knot) for knot in knots(below)):
        members = [order[number] for number in ranks]
        inside = set(members)
        names = tuple(find_cycle({name: [child for child in below[name] if child in inside] for name in members}))
        message = f"{listing(names)} form a cycle" if len(names) > 1 else f"{names[0]} is its own child"
        place = next(child.place for child in draft.nodes[names[-1]].children() if child.value == names[0])
        yield RuleReport(place, f"{message}; a node cannot be below itself: remove {names[0]} here", names)


def prune(draft: Draft) -> Iterator[RuleReport]:
    """A pruned node exists, and the remaining tree does not need it."""
    for why, pruned, place, gate in draft.broken_prunes:
        guess = did_you_mean(pruned, draft.nodes) if why == UNMENTIONED else ""
        nodes = (pruned,) if gate is None else (gate, pruned)
        yield RuleReport(place, f"cannot prune {pruned}: {why}{guess}", nodes)


def dynamic_gate(draft: Draft) -> Iterator[RuleReport]:
    """Every translation of a dynamic gate is reported."""
    yield from (RuleReport(*gate) for gate in draft.dynamic_gates)


def number(draft: Draft) -> Iterator[RuleReport]:
    """The attributes that analyses of risk read are numbers with a meaning."""
    given_numbers = [node for node in draft.nodes.values() if node.attributes]
    if not given_numbers:
        return
    from rvaft.model.quantities import slips  # noqa: PLC0415 -- imported on use

    parameters = {parameter.value for parameter in draft.parameters}
    timed: dict[bool, str] = {}
    for draft_node in given_numbers:
        node = draft_node.build()
        given = dict(node.attributes)
        places = {key: place for (key, _), place in draft_node.attributes}
        for key in ("lambda", "rate"):
            if key in given and given[key] not in parameters:
                timed.setdefault("/" in given[key], node.name)
        for slip in slips(node):
            if given.get(slip.key) not in parameters and not slip.refused:
                yield RuleReport(places.get(slip.key, draft_node.place), str(slip), (node.name,))
    if len(timed) > 1:
        message = f"the rate of {timed[True]} has a unit and that of {timed[False]} has none: write all alike"
        yield RuleReport(draft.nodes[timed[False]].place, message, (timed[False], timed[True]))


def other_format(draft: Draft) -> Iterator[RuleReport]:
    """How a tree of another format is read is reported."""
    yield from (RuleReport(*reading) for reading in draft.readings)


def no_time(draft: Draft) -> Iterator[RuleReport]:
    """A tree with `assume order` or a parameter of type `time` declares the time field."""
    if draft.times:
        return
    orders = [("`assume order`", order.place) for order in draft.orders]
    typed = [(f"a parameter of event {one.name}", one.place) for one in draft.events if ValueType.TIME in one.types]
    for what, place in (*orders, *typed):
        mend = "add one, as in `time timestamp as iso8601;`"
        yield RuleReport(place, f"{what} uses times, but the tree has no `time` declaration; {mend}")


def duplicate_event(draft: Draft) -> Iterator[RuleReport]:
    """An event type is declared once, in all files together."""
    first: dict[str, EventType] = {}
    for event in draft.events:
        if first.setdefault(event.name, event) is not event:
            before = first[event.name].place
            yield RuleReport(event.place, f"event type {event.name} is declared twice, first at {before}; remove one")


def unused_parameter(draft: Draft) -> Iterator[RuleReport]:
    """Every parameter occurs in the pattern."""
    for event in draft.events:
        for parameter in event.parameters:
            if parameter not in pattern_variables(event.pattern):
                message = f"parameter {parameter} of event {event.name} is not in its pattern; use it there or drop it"
                yield RuleReport(event.place, message)


def _calls(draft: Draft) -> Iterator[tuple[On, Place, tuple[str, ...]]]:
    yield from ((on, place, (node.name,)) for node in draft.nodes.values() for on, place in node.ons)
    calls = ((node, clause, place) for node in draft.nodes.values() for clause, place in node.withouts)
    yield from ((clause.on, place, (node.name,)) for node, clause, place in calls)
    yield from ((ignore.on, ignore.place, ()) for ignore in draft.ignores)


def unknown_event(draft: Draft) -> Iterator[RuleReport]:
    """Every event type used is declared."""
    known = {event.name for event in draft.events}
    used = {on.event for on, _, _ in _calls(draft)}
    for on, place, nodes in _calls(draft):
        if on.event not in known:
            guess = did_you_mean(on.event, known & used) or f"; declare it with `event {on.event}(...) = {{ ... }};`"
            if unused := similar(on.event, known - used):
                guess = f"; no node uses {unused}, which is declared: correct one of the two names"
            yield RuleReport(place, f"unknown event type {on.event}{guess}", nodes)


def event_arity(draft: Draft) -> Iterator[RuleReport]:
    """An event type has as many arguments as parameters."""
    known = {event.name: event.parameters for event in reversed(draft.events)}
    for on, place, nodes in _calls(draft):
        parameters = known.get(on.event)
        if parameters is not None and len(on.arguments) != len(parameters):
            count = f"{len(parameters)} argument{'s' * (len(parameters) != 1)}, not {len(on.arguments)}"
            meant = f"write {on.event}({', '.join(parameters)}) with `_` for any value"
            yield RuleReport(place, f"event {on.event} takes {count}; {meant}", nodes)


def ignore_variable(tree: Draft | RVAFT) -> Iterator[RuleReport]:
    """The guard of an `ignore` uses only variables of the ignored event."""
    for ignore in tree.ignores:
        own = ignore.on.variables
        missing = [name for name in guard_variables(ignore.when) if name not in own]
        if missing:
            used = f"uses {listing(missing)}, which {ignore.on.event}(...) does not bind"
            message = f"the guard of this `ignore` {used}; the variables of an `ignore` are local to it"
            yield RuleReport(ignore.place, message)


def shown_variable(draft: Draft) -> Iterator[RuleReport]:
    """The event of some node binds every variable of a `show`, and that of `repeat by`."""
    known = {name for node in draft.nodes.values() for on in node.ons for name in on.value.variables}
    named = [("`show` lists", shown) for shown in draft.shows] + [("`repeat by` names", one) for one in draft.repeats]
    for what, (name, place) in named:
        if name not in known:
            guess = did_you_mean(name, known) or "; remove it, or add it to the `on` of a node"
            yield RuleReport(place, f"{what} {name}, which no event of a node binds{guess}")


def repeat_by(space: ScenarioSpace) -> Iterator[RuleReport]:
    """The semantics is `scattered` and every event binds the variable, where matches are repeated by a variable."""
    tree = space.tree
    if (name := tree.repeat_by) is None:
        return
    place = tree.nodes[tree.root].place()
    if tree.semantics is not Semantics.SCATTERED:
        declared = "declares no semantics" if tree.semantics is None else f"is {tree.semantics}"
        message = f"`repeat by {name}` needs `semantics scattered;`, but the tree {declared}"
        yield RuleReport(place, message)
    for node, why in space.prop.lacking(name):
        yield RuleReport(tree.nodes[node].place("on"), unrepeatable(name, why), (node,))


def variable_once(space: ScenarioSpace) -> Iterator[RuleReport]:
    """No variable is used only once, except at a counted leaf, whose events share it."""
    tree = space.tree
    uses: Counter[str] = Counter()
    where: dict[str, tuple[Place, str, tuple[str, ...]]] = {}
    for node in tree.top_down():
        own = node.on.variables if node.on is not None else ()
        for name in own:
            where.setdefault(name, (node.place("on"), name, (node.name,)))
        uses.update(own * min(node.times, 2))
        uses.update(node.distinct)
        uses.update(guard_variables(node.when))
        for clause in node.without:
            uses.update((*clause.on.variables, *guard_variables(clause.when)))
            for name in clause.on.variables:
                where.setdefault(name, (clause.place, name, (node.name,)))
    once = [found for name, found in where.items() if uses[name] == 1 and name not in (*tree.shows, tree.repeat_by)]
    for ignore in tree.ignores:
        inside = Counter([*ignore.on.variables, *guard_variables(ignore.when)])
        once += [(ignore.place, name, ()) for name in inside if inside[name] == 1]
    known = [name for name in uses if uses[name] > 1]
    for place, name, nodes in once:
        yield RuleReport(place, f"variable {name} is used once only; write `_`{did_you_mean(name, known)}", nodes)


def duplicate_topic(draft: Draft) -> Iterator[RuleReport]:
    """All declarations of a topic have the same message type."""
    first: dict[str, DraftTopic] = {}
    for topic in draft.topics:
        name, type_ = topic.name.value, topic.type.value
        before = first.setdefault(absolute(name), topic).type
        if before.value != type_:
            message = f"topic {name} has the message type {type_} here and {before.value} at {before.place}; remove one"
            yield RuleReport(topic.type.place, message)


def malformed_topic(draft: Draft) -> Iterator[RuleReport]:
    """The names of topics and publishers and the message types are valid in ROS."""
    for topic in draft.topics:
        for name in (topic.name, *topic.publishers):
            if wrong := wrong_name(name.value):
                yield RuleReport(name.place, wrong)
        if wrong := wrong_type(topic.type.value):
            yield RuleReport(topic.type.place, wrong)


def unused_topic(space: ScenarioSpace) -> Iterator[RuleReport]:
    """Every topic occurs in an event type."""
    tree = space.tree
    calls = [node.on for node in tree.nodes.values() if node.on is not None] + [ignore.on for ignore in tree.ignores]
    used: set[str] = set()
    for event in tree.events.values():
        topic_pattern = topic_of(event.pattern)
        patterns = [] if topic_pattern is None else [topic_pattern]
        if isinstance(topic_pattern, Variable):
            index = event.parameters.index(topic_pattern.name)
            patterns = [call.arguments[index] for call in calls if call.event == event.name]
        if not all(isinstance(pattern, Literal) for pattern in patterns):
            return  # any topic matches
        used.update(absolute(str(pattern.value)) for pattern in patterns if isinstance(pattern, Literal))
    for name, topic in tree.topics.items():
        if name not in used:
            mend = f"remove its declaration, or use it in a pattern{did_you_mean(name, used)}"
            yield RuleReport(topic.place, f"no event type has the topic {topic.name}; {mend}")


_GUESSES = 100
"""The maximum number of undeclared children with a suggestion, which takes time."""


def undeclared(space: ScenarioSpace) -> Iterator[RuleReport]:
    """Every child has a statement; one without is perhaps misspelt."""
    nodes = space.tree.nodes.values()
    declared = [node.name for node in nodes if node.declared]
    for number, node in enumerate(node for node in nodes if not node.declared):
        guess = did_you_mean(node.name, declared) if number < _GUESSES else ""
        mend = f"write `{name_text(node.name)};`"
        message = f"child {node.name} is not declared; it observes its default event ({mend}){guess}"
        yield RuleReport(node.place(), message, (node.name,))


def unreachable(space: ScenarioSpace) -> Iterator[RuleReport]:
    """Every node is below the root."""
    reachable = set(space.tree.order)
    for node in space.tree.nodes.values():
        if node.name not in reachable and node.declared:
            message = f"{node.name} cannot be reached from the root {space.tree.root}; make it a child, or prune it"
            yield RuleReport(node.place(), message, (node.name,))


def unused_event(space: ScenarioSpace) -> Iterator[RuleReport]:
    """Every event type is used by a node, a `without` or an `ignore`."""
    nodes = space.tree.nodes.values()
    used = {node.on.event for node in nodes if node.on is not None}
    used.update(clause.on.event for node in nodes for clause in node.without)
    used.update(ignore.on.event for ignore in space.tree.ignores)
    for event in space.tree.events.values():
        if event.name not in used:
            yield RuleReport(event.place, f"event type {event.name} is not used; use it with `on`, or remove it")


def root_event(space: ScenarioSpace) -> Iterator[RuleReport]:
    """A root with a gate has no runtime event."""
    root = space.tree.nodes[space.tree.root]
    if root.name in space.leaf and not root.leaf:
        message = f"the root {root.name} carries a runtime event, which every match must contain; move it to a child"
        yield RuleReport(root.place("on"), message, (root.name,))
