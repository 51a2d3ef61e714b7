"""What strategies have in common that follow all partial matches."""

from abc import abstractmethod
from collections.abc import Collection, Hashable, Iterable, Iterator, Sequence
from copy import copy
from functools import partial
from typing import Any, ClassVar, Final, Self

from rvaft.engine.compiled_tree import CompiledTree, TreeLetters
from rvaft.engine.configuration import Configuration, Witness, events_of, flattened, history, unflattened
from rvaft.engine.explanation import explained_match, explanation_of, pending
from rvaft.engine.partial_matches import Matching
from rvaft.engine.replay import ReplaySearch, steps_of
from rvaft.engine.strategy import Measured, Progress
from rvaft.errors import TooLarge
from rvaft.model.values import key
from rvaft.monitors import Explanation, Pending
from rvaft.support.bits import bits, union

REMEMBERED: Final = 10_000
"""The maximum number of remembered searches for the match to explain."""


class Following(Measured):
    """A strategy that follows all partial matches; raises `TooLarge` beyond `limit` of them."""

    uses_up: ClassVar = True
    """Whether a partial match must use every event that counts."""

    def __init__(
        self,
        compiled: CompiledTree,
        letters: TreeLetters,
        *,
        limit: int,
        early: bool = False,
        repeat_by: str | None = None,
    ) -> None:
        self.compiled = compiled
        self.repeat_by = repeat_by
        self._others: list[Configuration] = []
        """After a detection, the partial matches with other values of `repeat_by`."""
        self.limit = limit
        self.matching = Matching(compiled, limit=limit, early=early)
        self.letters = letters
        self.noted = True
        """Whether the last event may be in a match."""
        self.matches: list[Configuration] = []
        """The matches, after a detection."""
        self.lost: list[Configuration] = []
        """After ⊥, the partial matches before the last event, perhaps with a step of it."""

    def restart(self, name: str) -> None:
        """Go on with the partial matches that have other values of a variable."""
        assert name == self.repeat_by, "made to repeat by it"
        self.follow(self._others)

    def _detected(self, matches: list[Configuration]) -> None:
        """Note the matches, which end all partial matches, but for a restart."""
        self.matches = matches
        if self.repeat_by is not None:
            found = {self._value(match, self.repeat_by) for match in matches}
            others = [one for one in self.partial if self._value(one, self.repeat_by) not in {None, *found}]
            self._others = [self.matching.start(), *others]
        self.follow([])

    @staticmethod
    def _value(match: Configuration, name: str) -> Hashable:
        """Return a key of the value of a variable that every event binds; None before the first event."""
        events = events_of(match.witness)
        return (key(events[0].values[name]),) if events else None

    def _begin(self) -> None:
        start = self.matching.start()
        self.follow([start] if self.matching.standing(start)[1] else [])

    @abstractmethod
    def follow(self, configurations: Iterable[Configuration]) -> None:
        """Replace the followed partial matches."""

    @property
    @abstractmethod
    def partial(self) -> list[Configuration]:
        """The followed partial matches."""

    @property
    def combined(self) -> list[Configuration]:
        """The partial matches, combined over independent parts."""
        return self.partial

    def fork(self) -> Self:
        """Return an independent copy."""
        twin = copy(self)
        twin.follow(self.partial)
        return twin

    @property
    def state(self) -> Hashable:
        """Equal states have equal futures."""
        return frozenset(configuration.key for configuration in self.partial)

    def snapshot(self) -> object:
        """Return the state for `restore`."""
        return flattened(self.partial, self.matches, self.lost)

    def restore(self, snapshot: Any) -> None:
        """Restore a snapshot of the same tree."""
        self.matching.effort.begin()
        followed, self.matches, self.lost = unflattened(snapshot)
        self.follow(followed)

    def explain(self) -> Explanation:
        """Return a match of the lowest-numbered branch; its branch is None if the search takes too long.

        The branch depends on the nodes of the matches, in order, and on their failed guards only.
        """
        compiled, matches, known = self.compiled, self.matches, self.compiled.explained
        histories = [events_of(match.witness) for match in matches]
        nodes = [(*[step[1] for step in steps],) for steps in histories]
        alike = tuple([(own, one.place) for own, one in zip(nodes, matches, strict=True)])
        if alike not in known:
            if len(known) >= REMEMBERED:
                known.clear()
            found, explained = explained_match(self._replay(()))
            place = next(place for place, steps in enumerate(histories) if steps_of(compiled, steps) == found.steps)
            known[alike] = explained._replace(match=place)
        explained = known[alike]
        return explanation_of(compiled.prop.tree, steps_of(compiled, histories[explained.match]), explained)

    def pending(self, limit: int, *, before: int | None = None) -> tuple[Pending, ...]:
        """Return the awaited events of each live branch."""
        histories = [history(match.witness) for match in (self.combined if before is None else self.lost)]
        if before is not None:
            histories = [[step for step in steps if step.position < before] for steps in histories]
        return pending(self._replay(histories), limit=limit)

    def _replay(self, histories: Sequence[list[Witness]]) -> ReplaySearch:
        self.matching.effort.begin()
        return ReplaySearch(self.matching, self.matches, histories, limit=self.limit, drops=not self.uses_up)

    def progress(self) -> Iterator[Progress]:
        """Iterate over the progress of the partial matches, without those with equal futures."""
        self.matching.effort.begin()
        alike: dict[Hashable, Configuration] = {}
        for match in self.partial:
            alike.setdefault(match.place, match)
        for match in alike.values():
            taken = {step.node: step.position for step in events_of(match.witness)}
            unfit, ended = (*bits(match.unfit | match.owing | match.unanswered),), (*bits(match.ended),)
            awaited = partial(self._awaited, match.witness)
            yield Progress(taken, (*bits(match.dead),), unfit, ended, match.broken, awaited=awaited)

    def _awaited(self, last: Witness | None, _: Collection[int]) -> frozenset[str]:
        match = self.matching.replayed((step.node, step.values, step.position) for step in history(last))
        assert match is not None, "a partial match can be made again"
        return self.matching.admitted(match)

    def _bound(self, count: int) -> None:
        """Raise `TooLarge` beyond the limit, with the variables or nodes that differ."""
        if count <= self.limit:
            return
        bound = {name for configuration in self.partial for name in configuration.binding}
        if bound:
            grows = f"the variables {', '.join(sorted(bound))} keep too many values"
        else:
            taken = union(configuration.taken for configuration in self.partial)
            grows = f"too many ways to match {self.compiled.some(bits(taken))}"
        raise TooLarge(f"partial matches to follow; {grows}", limit=self.limit, remedy=self.compiled.prop.remedy)
