"""Properties to patterns: AND, OR and FOLLOWEDBY require distinct observations, as matches do."""

import re
from collections.abc import Iterable
from decimal import Decimal
from itertools import groupby
from typing import Final, NoReturn

from backends.nests import NEVER, TIE, WINDOW, Nest, Nesting
from backends.stix.comparisons import StixConditions, step
from backends.stix.observations import EVENT, StixHeader, Way, property_of
from rvaft.core.property import PartKind, Property, Within
from rvaft.errors import NotExpressible, naming, unwritten
from rvaft.model.assumptions import declared
from rvaft.model.patterns import Literal, ObjectPattern

_SECOND: Final = 1_000_000_000
_LONGEST: Final = 1_000 * 366 * 86_400 * _SECOND
_EXACT: Final = 1_000_000_000 * _SECOND
"""Longest window with fractional seconds that the matcher does not round."""
_NEVER: Final = f"[{EVENT}:type != '{EVENT}']"
_TOKEN: Final = re.compile(r"'(?:[^'\\]|\\.)*'|[\w.:-]+|\S", re.DOTALL)
_SIGNS: Final = {PartKind.ALL: " AND ", PartKind.SEQUENCE: " FOLLOWEDBY ", PartKind.ONE: " OR "}


class StixPattern:
    """One translation of a property; `limit` counts observation expressions."""

    def __init__(self, prop: Property, header: StixHeader, limit: int) -> None:
        self._prop, self._header = prop, header
        for window in reversed(prop.parts):
            if isinstance(window, Within):
                within = window.duration
                if within < 1 or within % 1_000 or within > _LONGEST or (within > _EXACT and within % _SECOND):
                    reason = "WITHIN takes whole microseconds, at least one, and whole seconds beyond 30 years"
                    raise NotExpressible(unwritten(reason), nodes=[window.source.node])
        unit = "observation expressions of the pattern"
        self._nest = Nesting(prop, self._inseparable, limit=limit, unit=unit).nest()

    def text(self) -> tuple[str, int]:
        """Return the pattern with its header, and its number of symbols without the header."""
        pattern = self._written(self._nest)
        return f"{self._header}{pattern}", len(_TOKEN.findall(pattern))

    def _refuse(self, reason: str, nodes: Iterable[str]) -> NoReturn:
        raise NotExpressible(unwritten(reason), nodes=dict.fromkeys(nodes))

    def _inseparable(self, why: str, nodes: Iterable[str]) -> NoReturn:
        if why == WINDOW:
            self._refuse(
                "a window covers one expression, and parts with common events or variables become several", nodes
            )
        what = "a guard does" if why == TIE else f"two of them share {why}"
        self._refuse(f"a pattern cannot compare two observations, and {what}", nodes)

    def _written(self, nest: Nest, *, inside: bool = False) -> str:
        if nest == NEVER:
            return _NEVER
        if nest.op is PartKind.EVENT:
            return self._event(nest)
        nest = nest.ways()
        parts = [self._written(part, inside=True) for part in nest.parts]
        written = list[str]()
        for one, same in groupby(parts if nest.op is PartKind.SEQUENCE else sorted(parts, key=parts.index)):
            count = len([*same]) if nest.op is not PartKind.ONE else 1
            counted = count > 1 and one[0] == "[" and one[-1] == "]"
            written += [f"{one} REPEATS {count} TIMES"] if counted else [one] * count
        text = _SIGNS[nest.op].join(written)
        if nest.within is not None:
            return f"({text}) WITHIN {format((Decimal(nest.within) / _SECOND).normalize(), 'f')} SECONDS"
        return f"({text})" if inside and len(written) > 1 else text

    def _event(self, nest: Nest) -> str:
        assert nest.event is not None
        node, pattern = nest.event.source.node, nest.event.pattern
        on = self._prop.tree.nodes[node].on
        match pattern:
            case ObjectPattern((("event", Literal(name)),)) if on is None or on.event not in self._header.types:
                kind = str(name)
            case _:
                kind = on.event if on else node

        def path(way: Way) -> str:
            names = ".".join(step(property_of(name)) for name in way)
            return self._header.path(kind, way) if self._header.types else f"{EVENT}:{names}"

        with naming(node):
            known = declared(self._prop.tree, node, self._prop.assumes)
            return f"[{StixConditions(path).of(pattern, nest.guards, known)}]"
