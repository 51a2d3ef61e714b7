"""Rules about what makes a text a tree at all, on drafts."""

from collections import Counter
from collections.abc import Iterator

import networkx as nx

from rvaft.findings import Severity
from rvaft.language.draft import BrokenPrune, Draft, PruneFault
from rvaft.model import Gate, Place
from rvaft.rules.rule import Report, Rule
from rvaft.rules.words import did_you_mean, listing


def duplicate_setting(draft: Draft) -> Iterator[Report]:
    """Each part of a node is set once, in whichever files."""
    words = {"gate": "gate", "on": "runtime event (`on`)", "when": "guard (`when`)"}
    for node in draft.nodes.values():
        for part, places in node.settings().items():
            for again in places[1:]:
                said = f"the {words.get(part, part)} of {node.name} is set twice, first at {places[0]}; remove one"
                yield Report(again, said, (node.name,))
    for said_again in draft.causalities[1:]:
        first = draft.causalities[0]
        if said_again.value is not first.value:
            message = f"`causality` is set twice, first to {first.value} at {first.place}; remove one"
            yield Report(said_again.place, message)


def gate_without_children(draft: Draft) -> Iterator[Report]:
    """A gate has children."""
    for node in draft.nodes.values():
        for said in node.gates:
            if not said.value.children:
                message = f"{node.name} is a gate without children; list them, or leave out the gate"
                yield Report(said.place, message, (node.name,))


def duplicate_child(draft: Draft) -> Iterator[Report]:
    """No gate lists a child twice."""
    for node in draft.nodes.values():
        for said in node.gates:
            seen = Counter[str]()
            for child in said.value.children:
                seen[child.value] += 1
                if seen[child.value] == 2:
                    message = f"{node.name} lists its child {child.value} twice; use two nodes if it must happen twice"
                    yield Report(child.place, message, (node.name, child.value))


def threshold(draft: Draft) -> Iterator[Report]:
    """The K of a KofN is between 1 and N, and N is the number of children."""
    for node in draft.nodes.values():
        for said in node.gates:
            use, count = said.value, len(said.value.children)
            if use.gate is not Gate.VOT or use.threshold is None or not count:
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
                yield Report(said.place, message, (node.name,))
            elif not 1 <= use.threshold <= count:
                message = f"{node.name} asks for {use.threshold} of {count} children; K must be between 1 and {count}"
                yield Report(said.place, message, (node.name,))


def no_root(draft: Draft) -> Iterator[Report]:
    """One node is the root: what `toplevel` names, or the only node that is nobody's child."""
    top = Place(draft.file)
    if not draft.nodes:
        yield Report(top, "the tree is empty; state at least its root")
    elif draft.toplevels:
        first = draft.toplevels[0]
        known = set(draft.nodes) | {child.value for child in draft.undeclared()}
        for said in draft.toplevels:
            if said.value != first.value:
                message = f"`toplevel` names {said.value}, but {first.value} at {first.place}; there is one root"
                yield Report(said.place, message, (first.value, said.value))
            elif said.value not in known:
                guess = did_you_mean(said.value, draft.nodes)
                yield Report(said.place, f"the root {said.value} is not stated anywhere{guess}", (said.value,))
    else:
        roots = draft.parentless()
        if len(roots) > 1:
            names = tuple(node.name for node in roots)
            message = f"{listing(names)} are nobody's child; say which is the root with `toplevel NAME;`"
            yield Report(roots[1].place, message, names)


def cycle(draft: Draft) -> Iterator[Report]:
    """No node is below itself."""
    graph = nx.DiGraph()
    for node in draft.nodes.values():
        graph.add_edges_from((node.name, child.value) for child in node.children())
    rank = {name: index for index, name in enumerate(draft.nodes)}
    components = (members for members in nx.strongly_connected_components(graph) if members <= rank.keys())
    for members in sorted(components, key=lambda members: min(rank[name] for name in members)):
        first = min(members, key=rank.__getitem__)
        if len(members) > 1 or graph.has_edge(first, first):
            edges = nx.find_cycle(graph.subgraph(members), first)
            names = tuple(name for name, _ in edges)
            message = f"{listing(names)} form a cycle" if len(names) > 1 else f"{first} is its own child"
            node = draft.nodes[names[-1]]
            place = next(child.place for child in node.children() if child.value == edges[-1][1])
            yield Report(place, f"{message}; a node cannot be below itself: remove {edges[-1][1]} here", names)


def prune(draft: Draft) -> Iterator[Report]:
    """What is pruned exists, and what stays can do without it."""
    for broken in draft.broken_prunes:
        nodes = tuple(name for name in (broken.node, broken.pruned) if name is not None)
        yield Report(broken.place, _prune_message(draft, broken), nodes)


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


def unknown_child(_: Draft) -> Iterator[Report]:
    """A child is a node. In a text a child that is not declared becomes a leaf, so only trees built in code break this."""
    return iter(())


RULES = (
    Rule(
        "duplicate-setting",
        Severity.ERROR,
        "part of a node set twice",
        duplicate_setting,
        "Statements for one node are merged, but its gate, `on`, `when`, kind and label are each set once, in whichever files, and so is "
        "`causality`. The message names both places.",
        "top and a b;\na when 1 < 2;\na when 2 < 3;\nb;\n",
        "top and a b;\na when 1 < 2 and 2 < 3;\nb;\n",
    ),
    Rule(
        "gate-without-children",
        Severity.ERROR,
        "gate without children",
        gate_without_children,
        "A gate combines its children, so it has at least one; a leaf has no gate. A text without children is already refused by the grammar, so only "
        "trees built in code break this rule.",
        'RVAFT("top", [Node("top", Gate.AND)])',
        'RVAFT("top", [Node("top", Gate.AND, ("a",)), Node("a")])',
        python=True,
    ),
    Rule(
        "duplicate-child",
        Severity.ERROR,
        "child listed twice",
        duplicate_child,
        "A node happens once, so listing it twice under a gate asks for nothing more. Two nodes with the same `on` are two events.",
        "top and a b a;\na;\nb;\n",
        "top and a b;\na;\nb;\n",
    ),
    Rule(
        "threshold",
        Severity.ERROR,
        "K or N of a KofN out of range",
        threshold,
        "`2of3` means at least two of three children: K is between 1 and N, and as many children are listed as N says. Galileo's `vot2` "
        "counts the children itself.",
        "top 2of3 a b c d;\na;\nb;\nc;\nd;\n",
        "top 2of4 a b c d;\na;\nb;\nc;\nd;\n",
    ),
    Rule(
        "unknown-child",
        Severity.ERROR,
        "unknown child",
        unknown_child,
        "A gate lists a child that is no node. In a text such a child becomes a leaf (see `undeclared`), so only trees built in "
        "code break this rule.",
        'RVAFT("top", [Node("top", Gate.AND, ("a",))])',
        'RVAFT("top", [Node("top", Gate.AND, ("a",)), Node("a")])',
        python=True,
    ),
    Rule(
        "no-root",
        Severity.ERROR,
        "no root, or more than one",
        no_root,
        "The root is what `toplevel` names; without it, the one node that is nobody's child. `toplevel` of the importing file wins over those of "
        "imported files.",
        "top and a b;\nother and b c;\na;\nb;\nc;\n",
        "toplevel top;\ntop and a b other;\nother and b c;\na;\nb;\nc;\n",
    ),
    Rule(
        "cycle",
        Severity.ERROR,
        "cycle",
        cycle,
        "A tree is acyclic: following children from a node never leads back to it. A node may have several parents.",
        "top and a b;\na or b c;\nb and a;\nc;\n",
        "top and a b;\na or c d;\nb and d;\nc;\nd;\n",
    ),
    Rule(
        "prune",
        Severity.ERROR,
        "prune that cannot be carried out",
        prune,
        "A pruned node and what only it reaches disappear. `or`, `and`, `sand` lose the child; a KofN would mean something else with one child less, "
        "and a gate without children means nothing: prune these too, or rewrite them. The root cannot be pruned.",
        "top and v d;\nv 2of3 a b c;\na;\nb;\nc;\nd;\nprune c;\n",
        "top and v d;\nv 2of3 a b c;\na;\nb;\nc;\nd;\nprune v;\n",
    ),
)
