"""The search for matches by replaying the steps of partial matches, for strategies that follow these."""

from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import Final

from rvaft.core.passes import with_choices
from rvaft.engine.compiled_tree import CompiledTree
from rvaft.engine.configuration import SURE, TOUCHED, Configuration, Mark, Witness, events_of, history
from rvaft.engine.explanation import Choices, CompiledSearch, FoundMatch, Step, Waiting, found_match
from rvaft.engine.partial_matches import Matching
from rvaft.model.values import Json, fingerprint
from rvaft.monitors import DEFAULT_BRANCHES, AwaitedAbsence
from rvaft.support.bits import mask_of

_new: Final = tuple.__new__  # twice as fast as the constructors of the classes


class ReplaySearch(CompiledSearch):
    """A search among matches, and among the partial matches with some steps.

    If the strategy `drops` subsumed partial matches, those of a branch may be among the dropped.
    """

    def __init__(
        self,
        matching: Matching,
        matches: Sequence[Configuration],
        histories: Sequence[list[Witness]] = (),
        *,
        limit: int,
        drops: bool,
    ) -> None:
        super().__init__(matching.compiled)
        self._matching = matching
        self._matches = matches
        self._histories = histories
        self._limit = limit
        self._drops = drops

    def find(self, choices: Choices) -> FoundMatch | None:
        """Return a match with these choices, or None."""
        histories = [history(match.witness) for match in self._matches]
        for matching in self._under(choices):
            matching.effort.begin()
            for match in self._replayed(matching, histories):
                if matching.standing(match)[0]:
                    steps = steps_of(matching.compiled, events_of(match.witness))
                    return found_match(matching.compiled, steps, _scenario(matching, match))
        return None

    def waiting(self, choices: Choices | None) -> Iterable[Waiting]:
        """Return the awaited nodes under these choices, by the values of variables."""
        found: dict[Hashable, tuple[set[str], Mapping[str, Json], dict[AwaitedAbsence, None]]] = {}
        for matching in self._under(choices):
            matching.effort.begin()
            replayed = list(self._replayed(matching, self._histories))
            # the partial matches of this branch have been subsumed
            if not replayed and choices and self._drops:
                sources, own = self.compiled.events, matching.compiled.occurrences
                rest = [
                    [step for step in steps if step.node < 0 or sources[step.node] in own] for steps in self._histories
                ]
                replayed = list(self._replayed(matching, rest)) or list(self._replayed(matching, [[]]))
            for match in replayed:
                place = fingerprint(match.binding)
                names, _, absent = found.setdefault(place, (set(), dict(match.binding), {}))
                names.update(matching.admitted(match))
                absent.update(dict.fromkeys(matching.awaited_absences(match)))
        return [Waiting(names, variables, tuple(absent)) for names, variables, absent in found.values()]

    @cached_property
    def came(self) -> frozenset[int]:
        """The nodes whose own event, if any, is in a match."""
        taken = mask_of(step.node for match in self._matches for step in events_of(match.witness))
        return frozenset(node for node, own in enumerate(self.compiled.own) if not own or taken >> node & 1)

    def _under(self, choices: Choices | None) -> Sequence[Matching]:
        """Return the extension of partial matches under choices, for each alternative."""
        if not choices:
            return (self._matching,)
        under, made = self._matching.under, frozenset(choices.items())
        if made not in under:
            if len(under) >= DEFAULT_BRANCHES:
                under.clear()
            chosen, early = with_choices(self.prop, choices), self._matching.early
            trees = map(CompiledTree, (one for one in chosen.alternatives if one.feasible))
            under[made] = tuple(Matching(tree, limit=self._limit, early=early) for tree in trees)
        return under[made]

    def _replayed(self, matching: Matching, histories: Iterable[list[Witness]]) -> Iterator[Configuration]:
        """Iterate over the partial matches after these steps of the tree."""
        if matching is self._matching:
            for steps in histories:
                match = matching.after(steps[-1] if steps else None)
                if match is not None:
                    yield match
            return
        for steps in histories:
            taken = [(self._node_in(matching, step), step) for step in steps]
            if all(node is not None or step.node < 0 for node, step in taken):
                known = ((node, step.values, step.position) for node, step in taken if node is not None)
                match = matching.replayed(known)
                if match is not None:
                    yield match

    def _node_in(self, matching: Matching, step: Witness) -> int | None:
        """Return the node of a step in another tree; None if that lacks its event or absent event."""
        other = matching.compiled
        if step.node >= 0:
            source = self.compiled.events[step.node]
            return None if source is None else other.occurrences.get(source)
        mark, node = Mark.of(step.node)
        if mark is Mark.FINISHED:
            return mark.at(other.root)
        place = self.compiled.clauses[node].place
        return next((mark.at(clause.node) for clause in other.clauses.values() if clause.place == place), None)


def steps_of(compiled: CompiledTree, steps: Iterable[Witness]) -> list[Step]:
    """Return steps with occurrences instead of nodes."""
    return [_new(Step, (compiled.events[node], position, values)) for _, node, position, values in steps]


def _scenario(matching: Matching, match: Configuration) -> dict[int, tuple[int, ...]]:
    compiled = matching.compiled
    kept: dict[int, tuple[int, ...]] = {}
    agenda = [compiled.root]
    if compiled.core:
        kept.update(next(matching.shared.resolutions(match, complete=True)))
        agenda = [child for children in kept.values() for child in children if child not in compiled.members]
    while agenda:
        node = agenda.pop()
        children = compiled.children[node]
        if compiled.chooses >> node & 1:
            flags = {child: matching.progress.flags(match, child) for child in children}
            touched = tuple(child for child in children if flags[child] & TOUCHED)
            silent = tuple(child for child in children if flags[child] & SURE and not flags[child] & TOUCHED)
            children = touched + silent[: max(compiled.need[node] - len(touched), 0)]
        kept[node] = children
        agenda.extend(children)
    return kept
