"""The engine as a monitor."""

from collections.abc import Hashable
from typing import Any, Self

from rvaft.engine.earliest import Earliest
from rvaft.engine.explain import explain
from rvaft.engine.following import Following
from rvaft.engine.letters import Letters
from rvaft.engine.pending import pending
from rvaft.engine.plan import plan_of
from rvaft.engine.suits import linear_starts
from rvaft.monitors import DEFAULT_BRANCHES, Ended, Explanation, Monitor, Pending
from rvaft.tree import RVAFT
from rvaft.values import Json
from rvaft.verdict import Semantics, Verdict

DEFAULT_LIMIT = 100_000


class Engine(Monitor):
    """The monitor of a tree; for one branch or one kind give it the restricted tree.

    The tree has to keep the rules of `rvaft check`. Raises `TooLarge`, from `step` too, where there are more than `limit` partial
    matches to follow, or where resolving the choices that share nodes takes more than `limit` steps.
    """

    def __init__(
        self, tree: RVAFT, semantics: Semantics | str = Semantics.PROJECTED, *, limit: int = DEFAULT_LIMIT
    ) -> None:
        super().__init__()
        self.tree = tree
        self.semantics = Semantics(semantics)
        self._position = 0
        self._explanation: Explanation | None = None
        self._ended: Ended | None = None
        self._limit = limit
        self._strategy = _strategy(tree, self.semantics, limit=limit)

    def __getstate__(self) -> dict[str, Any]:
        """The tree and what the events so far have left; what is compiled from the tree is compiled again."""
        return {**vars(self), "_strategy": self._strategy.snapshot()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._strategy = _strategy(self.tree, self.semantics, limit=self._limit)
        self._strategy.restore(state["_strategy"])

    def _advance(self, event: Json) -> Verdict:
        self._position += 1
        return self._strategy.advance(event, self._position)

    def fork(self) -> Self:
        """An independent monitor that has read the same events."""
        twin = object.__new__(type(self))  # not a copy, which would compile the tree again
        vars(twin).update({**vars(self), "_strategy": self._strategy.fork()})
        return twin

    @property
    def state(self) -> Hashable:
        """Equal states of monitors of one tree under one semantics have equal futures."""
        return self.verdict if self.verdict.final else (self.verdict, self._strategy.state)

    @property
    def explanation(self) -> Explanation | None:
        """After ⊤, one match of the lowest-numbered branch that has one."""
        if self._explanation is None and self.verdict is Verdict.TRUE:
            self._explanation = explain(self.tree, self._strategy)
        return self._explanation

    def pending(self, *, limit: int = DEFAULT_BRANCHES) -> tuple[Pending, ...]:
        """What each live branch waits for; raises `TooLarge` as `step` does."""
        return () if self.verdict.final else pending(self.tree, self._strategy, limit=limit)

    @property
    def ended(self) -> Ended | None:
        """After ⊥, the event that ended the last hope and what was expected there."""
        if self._ended is None and self.verdict is Verdict.FALSE:
            waiting = pending(self.tree, self._strategy, limit=DEFAULT_BRANCHES, before=self._position)
            self._ended = Ended(self._position, waiting)
        return self._ended


def _strategy(tree: RVAFT, semantics: Semantics, *, limit: int) -> Earliest | Following:
    plan = plan_of(tree)
    letters = Letters(tree, plan)
    starts = linear_starts(plan, letters) if semantics is Semantics.SCATTERED else None
    if starts is None:
        return Following(plan, letters, semantics, limit=limit)
    return Earliest(plan, letters, starts)


def engine(tree: RVAFT, semantics: Semantics | str = Semantics.PROJECTED, *, limit: int = DEFAULT_LIMIT) -> Engine:
    """A fresh monitor of a tree."""
    return Engine(tree, semantics, limit=limit)
