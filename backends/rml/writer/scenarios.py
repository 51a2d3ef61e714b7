"""The feasible scenarios of a tree as sets of bits (semantics, section 2).

A set of occurrences or of scenarios is an integer, bit i standing for the i-th. Choices are made from the root down; what is shared
is met once. Under `scattered` a VOT keeps exactly K children: one more never helps, since any position may be skipped.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import TypeAlias

from rvaft.analysis.normal_form import NormalForm, Op, normal_form
from rvaft.errors import TooLarge, TreeError
from rvaft.model.guards import variables
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics
from rvaft.support.bits import bits, union

Kept: TypeAlias = Mapping[int, tuple[int, ...]]
"""The parts of a normal form that a scenario keeps, each with the parts of it that are kept."""
Way: TypeAlias = tuple[int, tuple[tuple[int, ...], ...]]
"""The parts that are reached, and those kept of each choice so far."""


@dataclass(frozen=True, slots=True)
class BitScenario:
    """Its occurrences, what comes before each of them (generators of the precedence), and its nodes with a guard to check."""

    occurrences: int
    before: Mapping[int, int]
    guards: frozenset[str]


def feasible_scenarios(tree: RVAFT, semantics: Semantics, *, limit: int) -> list[BitScenario]:
    """The feasible scenarios, each once.

    Raises `TooLarge` beyond `limit`; `TreeError` where there is none, where one has no occurrence, or leaves a guard unbound.
    """
    form, index = normal_form(tree), {name: position for position, name in enumerate(tree.occurrences)}
    found: dict[object, BitScenario] = {}
    for number, kept in enumerate(_resolutions(form, semantics), 1):
        if number > limit:
            raise TooLarge("scenarios of the tree", limit=limit)
        one = _scenario(form, kept, index)
        if not tree.shared or _is_acyclic(one):
            found.setdefault((one.occurrences, tuple(sorted(one.before.items())), one.guards), one)
    if not found:
        raise TreeError("no scenario is feasible", rule="no-scenario", nodes=[tree.root])
    for scenario in found.values():
        _check(tree, scenario)
    return list(found.values())


def _resolutions(form: NormalForm, semantics: Semantics) -> Iterator[Kept]:
    """The ways to make the choices that are reached."""
    if not form.feasible:
        return
    surely: list[
        int
    ] = []  # of each part, the parts that are kept whenever it is: those below it up to the next choices
    for number, part in enumerate(form.parts):
        below = () if part.chooses else part.parts
        surely.append(1 << number | union(surely[inner] for inner in below))
    choices = [number for number in reversed(form.kept()) if form.parts[number].chooses]

    def further(reached: int, chosen: tuple[tuple[int, ...], ...]) -> Iterator[Way]:
        number = choices[len(chosen)]
        part = form.parts[number]
        most = part.need if part.op is Op.ONE or semantics is Semantics.SCATTERED else len(part.parts)
        sizes = range(part.need, most + 1) if reached >> number & 1 else range(1)
        for kept in (kept for size in sizes for kept in combinations(part.parts, size)):
            yield reached | union(surely[inner] for inner in kept), (*chosen, kept)

    start: Way = (surely[form.root], ())
    agenda: list[Iterator[Way]] = [iter([start])]  # not of ways: a VOT may have more than fit anywhere
    while agenda:
        step = next(agenda[-1], None)
        if step is None:
            agenda.pop()
        elif len(step[1]) < len(choices):
            agenda.append(further(*step))
        else:
            chosen = dict(zip(choices, step[1], strict=True))
            yield {number: chosen.get(number, form.parts[number].parts) for number in bits(step[0])}


def _scenario(form: NormalForm, kept: Kept, index: Mapping[str, int]) -> BitScenario:
    """One pass up for the events in each part, one pass down for what comes before it."""
    events: dict[int, int] = {}
    for number, parts in kept.items():
        part = form.parts[number]
        events[number] = 1 << index[part.node] if part.op is Op.EVENT else union(events[inner] for inner in parts)
    earlier, before = dict.fromkeys(kept, 0), dict[int, int]()
    for number, parts in reversed(list(kept.items())):
        part, above = form.parts[number], earlier[number]
        if part.op is Op.EVENT:
            before[index[part.node]] = above
        for inner in parts:
            earlier[inner] |= above
            above |= events[inner] if part.op is Op.SEQUENCE else 0
    guards = frozenset(form.parts[number].node for number in kept if form.parts[number].op is Op.CONDITION)
    return BitScenario(events[form.root], before, guards)


def _is_acyclic(scenario: BitScenario) -> bool:
    """Whether its occurrences have an order in which they can happen."""
    left = scenario.occurrences
    while left:
        now = [index for index in bits(left) if not scenario.before[index] & left]
        if not now:
            return False
        left &= ~union(1 << index for index in now)
    return True


def _check(tree: RVAFT, scenario: BitScenario) -> None:
    if not scenario.occurrences:
        raise TreeError("a feasible scenario has no occurrence", rule="silent-scenario", nodes=[tree.root])
    ons = [tree.nodes[tree.occurrences[index]].on for index in bits(scenario.occurrences)] if scenario.guards else []
    bound = {argument.name for on in ons if on is not None for argument in on.arguments if hasattr(argument, "name")}
    for name in sorted(scenario.guards):
        for variable in variables(tree.nodes[name].when):  # type: ignore[arg-type]
            if variable not in bound:
                message = f"the guard of {name} speaks of {variable}, which nothing binds in one of its scenarios"
                raise TreeError(message, rule="unbound-variable", nodes=[name])
