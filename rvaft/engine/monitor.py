"""The engine as a monitor."""

from collections.abc import Hashable
from typing import Self

from rvaft.engine.earliest import Earliest
from rvaft.engine.explain import explain
from rvaft.engine.following import Following
from rvaft.engine.letters import Letters
from rvaft.engine.plan import plan_of
from rvaft.engine.suits import linear_starts
from rvaft.monitors import Explanation, Monitor
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
        plan = plan_of(tree)
        letters = Letters(tree, plan)
        starts = linear_starts(plan, letters) if self.semantics is Semantics.SCATTERED else None
        self._strategy: Earliest | Following
        if starts is None:
            self._strategy = Following(plan, letters, self.semantics, limit=limit)
        else:
            self._strategy = Earliest(plan, letters, starts)

    def _advance(self, event: Json) -> Verdict:
        self._position += 1
        return self._strategy.advance(event, self._position)

    def fork(self) -> Self:
        """An independent monitor that has read the same events."""
        twin = super().fork()
        vars(twin).update(_strategy=self._strategy.fork())
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


def engine(tree: RVAFT, semantics: Semantics | str = Semantics.PROJECTED, *, limit: int = DEFAULT_LIMIT) -> Engine:
    """A fresh monitor of a tree."""
    return Engine(tree, semantics, limit=limit)
