"""The capabilities of a specification language as data, and the check of a property against them.

A backend lists parts, guard operators, features and kinds of values. Everything else is refused,
including parts and operators that are added later.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from enum import Enum
from itertools import islice
from typing import Final, NamedTuple, TypeAlias, assert_never

from rvaft.core.overlaps import overlaps
from rvaft.core.passes import Pass
from rvaft.core.property import (
    PARTS,
    All,
    AtLeast,
    Condition,
    EndInOrder,
    Event,
    One,
    Part,
    Property,
    Sequence,
    Times,
    Within,
    WithoutEvent,
)
from rvaft.core.scenarios import most_events, resolutions
from rvaft.errors import Cause, NotExpressible, Reason, TooLarge, unwritten
from rvaft.model import patterns
from rvaft.model.guards import (
    OPERATORS,
    Duration,
    Guard,
    Operation,
    Operator,
    conjuncts,
    expanded,
    holds,
    time_points,
    variables,
    walk,
)
from rvaft.model.nodes import Assumption, Side, ValueType
from rvaft.model.patterns import ListPattern, Literal, ObjectPattern, Pattern, SomeItem
from rvaft.model.verdict import Semantics


class Ties(Enum):
    """The supported variables over several events.

    `check` refuses them for NONE. For ALL_EVENTS, `write` refuses variables that only some events
    of a scenario share, and guards over several events.
    """

    NONE = "no variables over several events"
    ALL_EVENTS = "variables that all events of a match share"
    ANY = "variables over any events"


class Value(Enum):
    """A kind of value, apart from strings, that a text can require of an event."""

    NUMBER = "numbers"
    BOOLEAN = "true and false"
    NULL = "null"
    LIST = "lists"
    SOME_ITEM = "tests of some item of a list (`[..., P, ...]`)"
    SOME_VARIABLE = "variables inside `[..., P, ...]`"


class Feature(Enum):
    """Constructs of a tree besides parts, operators and values."""

    TIME_POINTS = "times of events in guards (`at`, `start`, `end`)"
    LATE = "dropping late events (`late`)"
    OWN_VALUES = "values of each counted event (`distinct`, `each`)"


JSON_VALUES: Final = frozenset({Value.NUMBER, Value.BOOLEAN, Value.NULL, Value.LIST})

_O = Operator
LOGICAL: Final = frozenset({_O.NOT, _O.AND, _O.OR})
COMPARING: Final = frozenset({_O.EQ, _O.NE, _O.LT, _O.LE, _O.GT, _O.GE, _O.IN})
CALCULATING: Final = frozenset({_O.ADD, _O.SUB, _O.MUL, _O.DIV, _O.NEGATE, _O.ABS, _O.MIN, _O.MAX})
READING: Final = frozenset({_O.NUMBER})
TEXTUAL: Final = frozenset({_O.STARTSWITH, _O.ENDSWITH, _O.CONTAINS, _O.LIKE, _O.LOWER})
EVERY_OPERATOR: Final = LOGICAL | COMPARING | CALCULATING | READING | TEXTUAL
"""All groups of operators.

The groups are written out, not derived from the operator table, so that no backend lists a new
operator. Add an operator to a group only together with its support in each backend.
"""

GATES: Final[frozenset[type[Part]]] = frozenset({Event, All, Sequence, One, AtLeast})
"""Events, and the gates `and`, `sand`, `or` and k-of-n."""

Capability: TypeAlias = type[Part] | Operator | Feature | Value | Ties | type[Semantics]
"""The subject of a reason; `Semantics` stands for every missing semantics."""

_OPEN: Final[Mapping[Ties, str]] = {
    Ties.ALL_EVENTS: "the backend does not list the values that guards and types leave",
    Ties.ANY: "the backend does not take this guard apart",
}
"""Why a tie is refused that tests of single events might replace."""
_CONSTRUCTS: Final[Mapping[type[Part], str]] = {
    Event: "events",
    Times: "counted events (`times`)",
    Condition: "guards (`when`)",
    All: "events in any order (`and`)",
    Sequence: "events in order (`sand`)",
    One: "choices (`or`)",
    AtLeast: "votes (k-of-n)",
    EndInOrder: "parts that end in order (`pand`)",
    Within: "windows (`within`)",
    WithoutEvent: "absent events (`without`)",
}
assert set(_CONSTRUCTS) == set(PARTS)


@dataclass(frozen=True, slots=True)
class Capabilities:
    """The capabilities of one language; everything else is refused.

    Parts removed by `passes` need not be listed. `reasons` has specific texts: `Semantics` for all
    missing semantics, `Ties.ALL_EVENTS` for variables over several events, `Ties.ANY` for guards
    over several events.
    """

    says: frozenset[type[Part]]
    operators: frozenset[Operator]
    features: frozenset[Feature]
    values: frozenset[Value]
    ties: Ties
    semantics: frozenset[Semantics]
    passes: tuple[Pass, ...] = ()
    reasons: Mapping[Capability, Reason] = field(default_factory=dict)
    needs: Mapping[Capability, frozenset[Assumption]] = field(default_factory=dict)
    """Further capabilities, each with the assumptions without which it is refused."""
    extensions: Mapping[Capability, str] = field(default_factory=dict)
    """Capabilities that texts have by an extension of rvaft, which other programs of the language
    do not read, each with the name of the extension."""

    @property
    def constructs(self) -> frozenset[type[Part]]:
        """The parts that a tree may have: those of `says`, and those that a pass removes."""
        return self.says.union(*(each.removes for each in self.passes))

    @property
    def known(self) -> frozenset[Operator]:
        """The operators that a text can have, some of them with assumptions."""
        return self.operators.union(one for one in self.needs if isinstance(one, Operator))

    def reason(self, lacking: Capability) -> Reason:
        """Return the reason for a refusal; what a backend only does not list says nothing of its language."""
        if lacking in self.reasons:
            return self.reasons[lacking]
        match lacking:
            case Operator():
                return unwritten(f"the backend writes no operator `{lacking.value}`")
            case Feature() | Value():
                return unwritten(f"the backend writes no {lacking.value}")
            case Ties():
                return unwritten(f"the backend writes {Ties.NONE.value}")
            case type() if lacking is Semantics:
                return unwritten("the backend does not write this semantics")
            case _:
                return unwritten(f"the backend writes no {described(lacking)}")

    def unassumed(self, lacking: Capability, missing: Iterable[Assumption]) -> Reason:
        """Return the refusal of a capability without the assumptions that it needs."""
        wanted = f"`assume {', '.join(one for one in Assumption if one in missing)};`"
        match lacking:
            case Operator():
                return unwritten(f"`{lacking.value}` needs {wanted}")
            case Feature() | Value() | Ties():
                return unwritten(f"{lacking.value} need {wanted}")
            case type():
                return unwritten(f"{described(lacking)} need {wanted}")
            case _:
                assert_never(lacking)


def described(part: type) -> str:
    """Return a kind of part in the words of the tree language.

    >>> described(Within)
    'windows (`within`)'
    """
    return _CONSTRUCTS[part]


def check(
    prop: Property, semantics: Semantics, capabilities: Capabilities, *, written: bool = False
) -> frozenset[Assumption]:
    """Return the assumptions that the constructs of a property need.

    Raises `NotExpressible`, with nodes, for the first missing capability or assumption. With
    `written` the passes have run, and the parts that they remove are refused.
    """
    if semantics not in capabilities.semantics:
        raise NotExpressible(capabilities.reason(Semantics))
    constructs = capabilities.says if written else capabilities.constructs
    listed = constructs.union(capabilities.operators, capabilities.features, capabilities.values)
    lacking: dict[Capability, dict[str, None]] = {}
    assumed = set[Assumption]()
    for need, node in _needs(prop, semantics):
        if need in listed:
            continue
        if need in capabilities.needs and capabilities.needs[need] <= prop.tree.assumes:
            assumed |= capabilities.needs[need]
        else:
            lacking.setdefault(need, {})[node] = None
    for need, nodes in lacking.items():
        missing = capabilities.needs.get(need, frozenset()) - prop.tree.assumes
        reason = capabilities.unassumed(need, missing) if missing else capabilities.reason(need)
        if need is Value.NULL and not (_demands_null(prop) and _has_one_scenario(prop)):
            reason = unwritten(reason.text)  # a guard, or another scenario, may leave no null to tell apart
        if need is WithoutEvent and not (_breaks_matches(prop) and _has_one_scenario(prop)):
            reason = unwritten(reason.text)  # the tree may say the same without them
        raise NotExpressible(reason, nodes=[node for node in nodes if node])
    if capabilities.ties is Ties.NONE and (tie := _tied(prop, semantics)) is not None:
        why = capabilities.reason(tie.lacking) if tie.endless else unwritten(_OPEN[tie.lacking])
        raise NotExpressible(why.about(tie.by), nodes=tie.nodes)
    return frozenset(assumed)


def _demands_null(prop: Property) -> bool:
    """Whether an event has to be null at some place."""
    events = (part for part in prop.parts if isinstance(part, Event | Times))
    return any(Value.NULL in _values(part.pattern) for part in events)


def _breaks_matches(prop: Property) -> bool:
    """Whether an event that no match uses can be added to the events of a match such that it breaks this one."""
    used = [part.pattern for part in prop.parts if isinstance(part, Event | Times)]
    most = most_events(prop.parts)
    return any(
        clause.guard is None
        and clause.duration != 0
        and (clause.side is not Side.DURING or most[clause] > 1)
        and not any(overlaps(clause.pattern, pattern) for pattern in used)
        for clause in prop.absences
    )


def _has_one_scenario(prop: Property) -> bool:
    """Whether no scenario can stand for another one."""
    try:
        return len([*islice(resolutions(prop), 2)]) == 1
    except TooLarge:
        return False


def extended(prop: Property, capabilities: Capabilities) -> tuple[str, ...]:
    """Return the extensions of rvaft with which a language has the constructs of a property.

    A variable in several events, or a guard over several, counts also where no scenario has both.
    """
    used: list[Capability] = [Feature.TIME_POINTS] if prop.timed else []
    used += [Ties.ALL_EVENTS] if _binding(prop).ties else []
    return tuple(dict.fromkeys(capabilities.extensions[one] for one in used if one in capabilities.extensions))


def _needs(prop: Property, semantics: Semantics) -> Iterator[tuple[Capability, str]]:
    """Yield the needed capabilities with their nodes ("" for statements of the tree)."""
    guarded = list[str]()
    for part in reversed(prop.parts):
        node = part.source.node if part.source is not None else ""
        if isinstance(part, All) and sum(not isinstance(inner, Condition) for inner in part.parts) < 2:
            guarded.append(node)  # the part only adds a guard, so the refusal names the guard
        else:
            yield type(part), node
        if isinstance(part, Event | Times):
            yield from ((value, node) for value in _values(part.pattern))
        if isinstance(part, Times) and part.own:
            yield Feature.OWN_VALUES, node
        if isinstance(part, WithoutEvent):
            yield from ((need, node) for need in (*_values(part.pattern), *_of_guard(part.guard)))
        if isinstance(part, Condition):
            yield from ((need, node) for need in _of_guard(part.guard))
    yield from ((All, node) for node in guarded)
    if semantics.projects:
        for name, pattern, guard in (
            *((entry.node, entry.pattern, entry.when) for entry in prop.alphabet),
            *(("", ignored.pattern, ignored.when) for ignored in prop.ignored),
        ):
            yield from ((need, name) for need in (*_values(pattern), *_of_guard(guard)))


def _of_guard(guard: Guard | None) -> Iterator[Capability]:
    if guard is None:
        return
    if time_points(guard):
        yield Feature.TIME_POINTS
    for part in walk(guard):
        if isinstance(part, Operation):
            yield part.operator
        elif isinstance(part, Literal) and not isinstance(part, Duration):
            yield from _values(part)


def _values(pattern: Pattern) -> Iterator[Value]:
    for part in patterns.walk(pattern):
        match part:
            case Literal(bool()):
                yield Value.BOOLEAN
            case Literal(None):
                yield Value.NULL
            case Literal(int() | float()):
                yield Value.NUMBER
            case ListPattern():
                yield Value.LIST
            case SomeItem(item):
                yield Value.SOME_ITEM
                if patterns.rigid_variables(item):
                    yield Value.SOME_VARIABLE
            case Literal(str()) | ObjectPattern() | patterns.Variable() | patterns.Anything():
                pass
            case _:
                raise AssertionError(f"no kind of value is known for {part}")


class _Tie(NamedTuple):
    """Events of one scenario with a common variable or guard.

    `endless` tells that no choice of finitely many tests of single events could replace the tie: no
    type and no other guard bounds the values, and no other scenario may stand for this one.
    """

    lacking: Ties
    by: str
    nodes: tuple[str, ...]
    endless: bool


def _tied(prop: Property, semantics: Semantics) -> _Tie | None:
    """Return the first events of one scenario that share a variable, or occur in one conjunct.

    Under `scattered` a vote needs no more parts than its threshold.
    """
    binding, times, variables_of, ties = _binding(prop)
    if not ties:
        return None
    mentioned = [names for found in variables_of.values() for names in found]
    assumes = prop.tree.assumes
    finite = {ValueType.BOOLEAN, *((ValueType.INTEGER,) if Assumption.EXACT in assumes else ())}
    bounded = any(finite & {*event.types} for event in prop.tree.events.values())
    unbounded = not (Assumption.TYPES in assumes and bounded) and _has_one_scenario(prop)
    for kept in resolutions(prop, minimal=semantics is Semantics.SCATTERED):
        if any(isinstance(part, Condition) and _never_holds(part.guard) for part in kept):
            continue
        events = [part for part in kept if isinstance(part, Event | Times)]
        for part in events:
            for name in sorted(binding[part]):
                having = [event for event in events if name in binding[event]]
                if len(having) > 1 or times[part] > 1:
                    endless = unbounded and not any(name in names for names in mentioned)
                    return _Tie(Ties.ALL_EVENTS, f"variable {name}", _names(having), endless)
        for condition in (part for part in kept if isinstance(part, Condition)):
            for conjunct, names in zip(conjuncts(condition.guard), variables_of[condition], strict=True):
                if names and not any(names <= binding[event] for event in events):
                    having = [event for event in events if names & binding[event]]
                    nodes = dict.fromkeys((condition.source.node, *_names(having)))
                    alone = sum(bool(names & others) for others in mentioned) == 1
                    endless = unbounded and alone and _compares(conjunct)
                    return _Tie(Ties.ANY, "a guard over several events", tuple(nodes), endless)
    return None


class _Binding(NamedTuple):
    """The variables of each event, its number of occurrences up to 2, and those of each conjunct.

    `ties` tells that events of the property have a common variable or guard.
    """

    binding: Mapping[Event | Times, set[str]]
    times: Mapping[Event | Times, int]
    variables_of: Mapping[Condition, list[set[str]]]
    ties: bool


def _binding(prop: Property) -> _Binding:
    binding = {
        part: set(patterns.rigid_variables(part.pattern)) for part in prop.parts if isinstance(part, Event | Times)
    }
    times = {event: 2 if isinstance(event, Times) and event.count > 1 else 1 for event in binding}
    uses = Counter(name for event, names in binding.items() for name in names for _ in range(times[event]))
    variables_of = {
        part: [
            set(variables(conjunct)) - {point.name for point in time_points(conjunct)}
            for conjunct in conjuncts(part.guard)
        ]
        for part in prop.parts
        if isinstance(part, Condition)
    }
    alone = all(any(names <= bound for bound in binding.values()) for found in variables_of.values() for names in found)
    return _Binding(binding, times, variables_of, not alone or any(count > 1 for count in uses.values()))


def _compares(guard: Guard) -> bool:
    """Whether a guard compares two different variables."""
    return (
        isinstance(guard, Operation)
        and guard.operator in COMPARING - {Operator.IN}
        and len({part.name for part in guard.operands if isinstance(part, patterns.Variable)}) == 2
    )


def _never_holds(guard: Guard) -> bool:
    return any(not variables(conjunct) and not holds(conjunct, {}) for conjunct in conjuncts(guard))


def _names(events: Iterable[Event | Times]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(event.source.node for event in events))


def table(languages: Mapping[str, Capabilities]) -> list[tuple[str, ...]]:
    """Return the table of capabilities by language; operators with equal support share a row.

    A cell is `yes`, the assumption or the extension of rvaft that is needed, `no` where the
    language cannot, or `-` where rvaft does not write it.

    >>> one = Capabilities(frozenset({Event}), frozenset(), frozenset(), frozenset(), Ties.NONE, frozenset())
    >>> table({"mine": one})[:2], table({"mine": one})[5]
    ([('', 'mine'), ('semantics strict', '-')], ('events', 'yes'))
    """
    rows = [("", *languages)]

    def add(title: str, cells: Iterable[str]) -> None:
        rows.append((title, *cells))

    def supported(language: Capabilities, capability: Capability, *, listed: bool) -> str:
        if listed:
            return language.extensions.get(capability, "yes")
        if capability in language.needs:
            return f"assume {', '.join(one for one in Assumption if one in language.needs[capability])}"
        cause = language.reason(capability).cause
        match cause:
            case Cause.LANGUAGE:
                return "no"
            case Cause.WRITER:
                return "-"
            case _:
                assert_never(cause)

    each = languages.values()
    for semantics in Semantics:
        listed = (supported(one, Semantics, listed=semantics in one.semantics) for one in each)
        add(f"semantics {semantics}", listed)
    for part in PARTS:
        add(described(part), (supported(one, part, listed=part in one.constructs) for one in each))
    for tie, title in ((Ties.ALL_EVENTS, "variables that all events share"), (Ties.ANY, Ties.ANY.value)):
        add(title, (supported(one, tie, listed=one.ties in (tie, Ties.ANY)) for one in each))
    for feature in Feature:
        add(feature.value, (supported(one, feature, listed=feature in one.features) for one in each))
    for value in Value:
        add(value.value, (supported(one, value, listed=value in one.values) for one in each))
    alike: dict[tuple[str, ...], list[str]] = {}

    def written(language: Capabilities, operator: Operator) -> str:
        operands = map(patterns.Variable, "123"[: OPERATORS[operator].arity or 2])
        call = Operation(operator, tuple(operands))
        used = [part.operator for part in walk(expanded(call, language.known)) if isinstance(part, Operation)]
        cells = [supported(language, one, listed=one in language.operators) for one in used]
        return next((cell for cell in cells if cell != "yes"), "yes")

    for operator in Operator:
        word = "- x" if operator is Operator.NEGATE else operator.value
        cells = tuple(written(one, operator) for one in each)
        alike.setdefault(cells, []).append(word)
    for cells, words in alike.items():
        add(f"operators {' '.join(words)}", cells)
    return rows
