"""One stream that holds the events of many: a bank of monitors for each value of a field."""

from collections.abc import Hashable, Iterator
from typing import Final

from rvaft.errors import TooLarge
from rvaft.monitoring.fields import Field
from rvaft.monitoring.watch import Watch
from rvaft.values import Json, key

MAX_KEYS: Final = 100_000
"""How many values of a field are told apart."""


class Keyed:
    """The watches of one trace by the values of a field; values are told apart as everywhere: 1 and 1.0 are one, true is another.

    `fresh` has read nothing; each value gets a copy. Raises `TooLarge` beyond `limit` values.
    """

    def __init__(self, field: Field, fresh: Watch, *, limit: int = MAX_KEYS) -> None:
        self.field = field
        self.limit = limit
        self.without = 0
        """How many events do not have the field."""
        self.first_without = 0
        """The number of the first of them."""
        self._fresh = fresh
        self._watches: dict[Hashable, Watch] = {}

    def __iter__(self) -> Iterator[Watch]:
        """The watches in the order in which their keys came."""
        return iter(self._watches.values())

    def of(self, event: Json, number: int) -> tuple[Watch | None, bool]:
        """The watch that an event is for, None for one without the field, and whether it is new."""
        found = self.field.of(event)
        if found is None:
            self.without += 1
            self.first_without = self.first_without or number
            return None, False
        name = key(found[0])
        watch = self._watches.get(name)
        if watch is not None:
            return watch, False
        if len(self._watches) >= self.limit:
            error = TooLarge(f"different values of {self.field.text}", limit=self.limit)
            error.add_note("raise it with --max-keys N, or name another field")
            raise error
        fresh = self._fresh
        watch = self._watches[name] = Watch(fresh.trace, fresh.bank.fork(), found, fresh.recall)
        return watch, True

    def add(self, watch: Watch) -> None:
        """A watch with a key that goes on from before."""
        assert watch.key is not None
        self._watches[key(watch.key[0])] = watch
