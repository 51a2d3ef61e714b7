"""What is watched, one trace or one key in it, and who is told of it."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar

from rvaft.monitoring.bank import Bank
from rvaft.monitoring.recall import Recall
from rvaft.values import Json


@dataclass(slots=True)
class Watch:
    """The monitors of one trace, or of one value of a field in it; `key` is that value, in a tuple since it may be null."""

    trace: str
    bank: Bank
    key: tuple[Json] | None = None
    recall: Recall = field(default_factory=Recall)
    events: int = 0
    """How many events it was given."""


class Listener:
    """Told of what happens to watches; does nothing with it.

    With `every` it is told of every event, else only of those that change a verdict: what reads events quickly need not stop for the
    others.
    """

    every: ClassVar[bool] = False

    def begin(self, watch: Watch) -> None:
        """A trace begins, or the first event of a key came."""

    def event(self, watch: Watch, number: int, event: Json, changed: Sequence[int]) -> None:
        """The event of that number was read and changed the verdicts of these columns."""

    def end(self, watch: Watch) -> None:
        """The trace ends, and was not malformed."""

    def stop(self, watch: Watch) -> None:
        """The trace was malformed, or could not be read further: no event and no end comes any more."""
