"""The partial matches of one stage, found by the values they remember."""

from collections.abc import Hashable, Iterable, Iterator, Mapping
from typing import Final, NamedTuple, TypeAlias

from rvaft.engine.configuration import Configuration
from rvaft.engine.dominance import at_least, scale
from rvaft.engine.stages import Stage
from rvaft.engine.variables import exact
from rvaft.values import Json, key

_PLAIN: Final = (str, int, float)


class Member(NamedTuple):
    """A partial match that is followed, and its number: an earlier one has a lower number."""

    number: int
    configuration: Configuration


_Index: TypeAlias = dict[Hashable, dict[int, Member]]


class Group:
    """The members of one stage."""

    def __init__(self, stage: Stage) -> None:
        self.stage = stage
        self.members: dict[Hashable, Member] = {}
        """By their keys."""
        self._by_values: dict[tuple[str, ...], _Index] = {}
        self._rivals: _Index = {}
        """Where values have directions, the members that can be compared with one another."""

    def fitting(self, names: tuple[str, ...], values: Mapping[str, Json]) -> Iterable[Member]:
        """The members to which some variables have values equal to these."""
        if not names:
            return self.members.values()
        index = self._by_values.get(names)
        if index is None:
            index = self._by_values[names] = {}
            for member in self.members.values():
                _add(index, _keys(names, member.configuration.binding), member)
        return index.get(_keys(names, values), {}).values()

    def excels(self, binding: Mapping[str, Json]) -> bool:
        """Whether some member can do all that one with this binding could."""
        directions = self.stage.directions
        return any(at_least(rival.configuration.binding, binding, directions) for rival in self._comparable(binding))

    def excelled(self, binding: Mapping[str, Json]) -> list[Member]:
        """The members that can do no more than one with this binding."""
        directions = self.stage.directions
        return [r for r in self._comparable(binding) if at_least(binding, r.configuration.binding, directions)]

    def has(self, member: Member) -> bool:
        """Whether this very member is here."""
        return self.members.get(self.stage.key(member.configuration.binding)) is member

    def add(self, member: Member) -> None:
        """Take a member in."""
        binding = member.configuration.binding
        self.members[self.stage.key(binding)] = member
        for index, place in self._places(binding):
            _add(index, place, member)

    def remove(self, member: Member) -> None:
        """Leave a member out."""
        binding = member.configuration.binding
        del self.members[self.stage.key(binding)]
        for index, place in self._places(binding):
            del index[place][member.number]
            if not index[place]:
                del index[place]

    def _places(self, binding: Mapping[str, Json]) -> Iterator[tuple[_Index, Hashable]]:
        """Where a member is found."""
        for names, index in self._by_values.items():
            yield index, _keys(names, binding)
        if self.stage.directions:
            yield self._rivals, self._contest(binding)

    def _comparable(self, binding: Mapping[str, Json]) -> Iterable[Member]:
        return self._rivals.get(self._contest(binding), {}).values() if self.stage.directions else ()

    def _contest(self, binding: Mapping[str, Json]) -> Hashable:
        """Equal for members that differ at most in values that have a direction and are on one scale."""
        directions = self.stage.directions
        kinds = ((scale(binding[name]) if name in directions else None, binding[name]) for name in self.stage.names)
        return tuple([exact(value) if kind is None else kind for kind, value in kinds])


def _add(index: _Index, place: Hashable, member: Member) -> None:
    index.setdefault(place, {})[member.number] = member


def _keys(names: tuple[str, ...], binding: Mapping[str, Json]) -> Hashable:
    """Equal for bindings to which these variables have equal values."""
    return tuple([value if type(value) in _PLAIN else key(value) for value in (binding[name] for name in names)])
