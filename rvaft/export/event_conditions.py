"""The tests of events in formal texts, which the program `rvaft-verified` reads."""

import json
from collections.abc import Iterable, Set
from dataclasses import dataclass, field
from typing import Any, Final

from rvaft.backend import Observed
from rvaft.core.times import untimed
from rvaft.errors import NotExpressible, unwritten
from rvaft.export.tree_json import condition_json, pattern_json, time_json
from rvaft.model import guards, patterns
from rvaft.model.event_time import EventTime
from rvaft.model.values import Json

EVERY: Final = Observed(patterns.ObjectPattern(()))
"""Every event is an object."""


@dataclass
class EventConditions:
    """The tests of events in a formal text: Boolean formulas over numbered predicates."""

    time: EventTime | None = None
    numbers: dict[str, int] = field(default_factory=dict)
    """The number of each predicate, which is written as JSON."""

    def _number(self, predicate: Json) -> Json:
        written = json.dumps(predicate)  # as values of Python, 1 and true are equal
        return ["predicate", self.numbers.setdefault(written, len(self.numbers))]

    def of(self, one: Observed, shared: Set[str] = frozenset()) -> Json:
        """Return a test whose variables are its own, or `shared`; raises `NotExpressible` for others."""
        if one == EVERY and not shared:
            return ["and"]
        own, asked = {*patterns.variables(one.pattern)}, {*guards.variables(one.when)}
        if not asked <= own | shared or not shared <= own | asked or any(name.startswith("_") for name in shared):
            raise NotExpressible(unwritten("a guard has variables that its event does not bind"))
        return self._number({"pattern": pattern_json(one.pattern), "condition": condition_json(one.when)})

    def atom(self, pattern: patterns.Pattern, when: Iterable[guards.Guard] = ()) -> Json:
        """Return a test whose variables have one value in a slice of a trace."""
        bare, time = untimed(pattern)
        if time is not None and time.startswith("_"):  # no slice binds a variable of one event
            time = None
        return self._number({"pattern": pattern_json(bare), "time": time, "guards": list(map(condition_json, when))})

    def relevance(self, relevant: Iterable[Any], ignored: Iterable[Any]) -> Json:
        """Return the test of an event that some of `relevant` and none of `ignored` accepts."""
        wanted, unwanted = ([self.of(Observed(one.pattern, one.when)) for one in kind] for kind in (relevant, ignored))
        return ["and", ["or", *wanted], ["not", ["or", *unwanted]]]

    def text(self, language: str, body: Json) -> dict[str, Any]:
        """Return the formal text with these predicates."""
        predicates = list(map(json.loads, self.numbers))
        return {"language": language, "time": time_json(self.time), "predicates": predicates, "text": body}
