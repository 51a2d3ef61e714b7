"""Carrying out `prune`: drop the named nodes and what only they reach (step 3 of the method: parts nobody will monitor)."""

from rvaft.language.draft import BrokenPrune, Draft, GateUse, PruneFault, Said
from rvaft.model import Gate, Place


def carry_out_prunes(draft: Draft) -> None:
    """Drop what is pruned from the draft; what cannot be dropped stays, and is noted in `broken_prunes`."""
    if not draft.prunes:
        return
    pruned: dict[str, Place] = {}
    for said in draft.prunes:
        pruned.setdefault(said.value, said.place)
    parents = _parent_counts(draft)
    roots = {said.value for said in draft.toplevels} or {node.name for node in draft.parentless()}
    for name, place in list(pruned.items()):
        if name not in draft.nodes and name not in parents:
            draft.broken_prunes.append(BrokenPrune(PruneFault.UNKNOWN, name, place))
            del pruned[name]
    gone = _unreached(draft, set(pruned), {said.value for said in draft.toplevels}, parents)
    if roots <= gone:
        root = min(roots & pruned.keys(), key=lambda name: pruned[name])
        draft.broken_prunes.append(BrokenPrune(PruneFault.ROOT, root, pruned[root]))
        return
    for name in gone & draft.nodes.keys():
        del draft.nodes[name]
    for node in draft.nodes.values():
        node.gates = [_without(gate, gone, node.name, pruned, draft.broken_prunes) for gate in node.gates]


def _parent_counts(draft: Draft) -> dict[str, int]:
    counts: dict[str, int] = {}
    for node in draft.nodes.values():
        for name in {child.value for child in node.children()}:
            counts[name] = counts.get(name, 0) + 1
    return counts


def _unreached(draft: Draft, pruned: set[str], kept: set[str], parents: dict[str, int]) -> set[str]:
    """The pruned nodes, and those that have lost all their parents to them (but never a toplevel)."""
    left = dict(parents)
    gone = set(pruned)
    todo = list(pruned)
    while todo:
        node = draft.nodes.get(todo.pop())
        for name in {child.value for child in node.children()} if node else ():
            left[name] -= 1
            if left[name] == 0 and name not in gone and name not in kept:
                gone.add(name)
                todo.append(name)
    return gone


def _without(
    gate: Said[GateUse], gone: set[str], name: str, pruned: dict[str, Place], broken: list[BrokenPrune]
) -> Said[GateUse]:
    use = gate.value
    left = tuple(child for child in use.children if child.value not in gone)
    if len(left) == len(use.children):
        return gate
    lost = next(child.value for child in use.children if child.value in gone)
    if use.gate is Gate.VOT or not left:
        fault = PruneFault.VOTE if use.gate is Gate.VOT else PruneFault.EMPTY
        broken.append(BrokenPrune(fault, lost, pruned[lost], name))
        return gate
    return Said(GateUse(use.gate, left), gate.place)
