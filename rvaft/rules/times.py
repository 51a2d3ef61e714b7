"""Rules about the time declaration, the time points, and contradictory conditions on time."""

from collections.abc import Iterator
from itertools import pairwise
from typing import Final, NamedTuple, TypeAlias

from rvaft.core.feasibility import ScenarioSpace, borne_surely
from rvaft.core.passes import MOST
from rvaft.core.precedence import Edge, node_of
from rvaft.core.property import Event, Kept, Times
from rvaft.core.scenarios import fewest_events
from rvaft.core.times import point_bounds
from rvaft.model.event_time import TextFormat, TimeFormat
from rvaft.model.expressions import guard_text
from rvaft.model.guards import ORDERINGS, POINTS, Operation, TimePoint, conjuncts, time_points, variables
from rvaft.model.nodes import Node
from rvaft.model.patterns import Anything, rigid_variables
from rvaft.rules.rule import RuleReport, branch_of
from rvaft.support.wording import listing


def no_time(space: ScenarioSpace) -> Iterator[RuleReport]:
    """A tree with conditions on time declares the time field, and a format with a year."""
    if (time := space.tree.time) is not None and isinstance(time.format, TextFormat) and time.format.needs_year:
        problem = f"the format {time.format} reads no year"
        mend = "write `year 2026` after it, or give the year with --year (from Python, `year`)"
        yield RuleReport(time.place, f"{problem}; {mend}")
    for node in space.tree.top_down() if space.tree.time is None else ():
        timed = ["without"] if any(clause.duration is not None for clause in node.without) else []
        for part in dict.fromkeys([*(part for part, _ in _points(node)), *timed]):
            problem = f"the {_WORDS[part]} of {node.name} uses times, but the tree has no `time` declaration"
            yield RuleReport(node.place(part), f"{problem}; add one, as in `time timestamp as iso8601;`", (node.name,))


_WORDS: Final = {"when": "guard", "within": "window", "without": "absent event"}


def _points(node: Node) -> list[tuple[str, TimePoint]]:
    points = [("when", point) for point in time_points(node.when)]
    return points if node.within is None else [*points, ("within", TimePoint.of("end", node.name))]


def unbound_time(space: ScenarioSpace) -> Iterator[RuleReport]:
    """Every time point refers to a node with events in every feasible scenario with the guard.

    `at` requires a node with one event.
    """
    tree = space.tree
    nodes = [node for node in tree.top_down() if space.whole[node.name] in space.resolutions]
    points = [(node, part, point) for node in nodes for part, point in _points(node)]
    if not points:
        return
    least = fewest_events(reversed(space.order), without=space.never)
    silent = {name for name, whole in space.whole.items() if whole in least and not least[whole].events}
    bearers = {point.node: [space.whole[point.node]] for _, _, point in points if point.node in space.whole}
    there = borne_surely(space, [(node.name, point.node) for node, _, point in points], bearers)
    budget = space.budget()
    for node, part, point in points:
        text, other, kept, name = guard_text(point), tree.nodes.get(point.node), None, node.name
        problem = f"{text} in the guard of {name}"
        if point.point == "at" and other is not None and (other.times > 1 or tree.pattern(point.node) is None):
            if space.feasible(budget, [name]) is not None:
                has = "has no event of its own" if other.times == 1 else f"has {other.times} events"
                mend = f"write start({text[3:-1]}) or end({text[3:-1]})"
                mend = "give it one with `on`" if other.leaf and other.times == 1 else mend
                message = f"{problem} is the time of one event, but {point.node} {has}; {mend}"
                yield RuleReport(node.place(part), message, (name,))
            continue
        if (name, point.node) not in there:
            kept = space.feasible(budget, [name], without=[point.node])
        if kept is not None:
            where = f"{point.node} is not in {branch_of(kept)}"
            message = f"{problem} has no event: {where}; use a node that is in every scenario with {name}"
            yield RuleReport(node.place(part), message, (name,))
        elif point.point != "at" and point.node in silent:
            kept = space.feasible(budget, [name], silent=point.node)
            if kept is not None:
                problem = problem if part == "when" else f"the window of {name}"
                where = f"the part of {point.node} has no event in {branch_of(kept)}"
                message = f"{problem} has no time: {where}; add an event with `on` to a node of that part"
                yield RuleReport(node.place(part), message, (name,))


# Conditions on time are differences x - y <= c; they contradict each other if a cycle has a
# negative sum.

Need: TypeAlias = str | Event | Times | Edge
"""What a bound on times requires: a node's condition, an event, or a child below its parent."""


class TimeBound(NamedTuple):
    """`time - other <= more` nanoseconds, in every scenario with `need`."""

    time: str
    other: str
    more: int
    need: Need


def contradictory_times(space: ScenarioSpace) -> Iterator[RuleReport]:
    """No branch has contradictory conditions on time."""
    tree = space.tree
    nodes = [node for node in tree.top_down() if space.whole[node.name] in space.resolutions]
    bounds = [bound for node in nodes for bound in _conditions(node)]
    if not bounds:
        return
    bounds += _containments(space)
    budget, reported = space.budget(), set[frozenset[Need]]()
    todo: list[frozenset[Need]] = [frozenset()]
    seen = set(todo)
    while todo:
        without = todo.pop()
        budget.spend(len(bounds))
        needs = _contradiction([bound for bound in bounds if bound.need not in without])
        if not needs:
            continue
        core = tuple(name for name in tree.order if name in needs)
        events = (node_of(need) for need in needs if isinstance(need, Event | Times))
        edges = [need for need in needs if isinstance(need, tuple)]
        kept = space.feasible(budget, [*core, *events], edges=edges)
        if kept is not None and frozenset(core) not in reported:
            reported.add(frozenset(core))
            yield _impossible(space, core, kept)
        new = [without | {need} for need in (needs if kept is None else core[-1:])]
        todo += [more for more in dict.fromkeys(new) if more not in seen]
        seen.update(new)


def _impossible(space: ScenarioSpace, core: tuple[str, ...], kept: Kept) -> RuleReport:
    found = list(dict.fromkeys((part, name) for name in core for part, _ in _points(space.tree.nodes[name])))
    named = [(word, [name for own, name in found if own == part]) for part, word in _WORDS.items()]
    conditions = " and ".join(
        f"the {word}{'s' * (len(names) > 1)} of {listing(names)}" for word, names in named if names
    )
    together = " together" * (len(found) > 1)
    message = f"{conditions} cannot hold{together} in {branch_of(kept)}, whatever the times are; change one"
    return RuleReport(space.tree.nodes[core[0]].place(found[0][0]), message, core)


def _conditions(node: Node) -> Iterator[TimeBound]:
    if node.within is not None:
        yield TimeBound(f"end({node.name})", f"start({node.name})", node.within, node.name)
    for guard in conjuncts(node.when):
        yield from (TimeBound(one.name, other.name, most, node.name) for one, other, most in point_bounds(guard))


def _containments(space: ScenarioSpace) -> Iterator[TimeBound]:
    """Return the bounds of every scenario: events lie between start and end of their part."""
    for part, inside in space.resolutions.union.items():
        at, start, end = (f"{point}({node_of(part)})" for point in POINTS)
        if isinstance(part, Event | Times):
            yield from (TimeBound(start, at, 0, part), TimeBound(at, end, 0, part))
            if isinstance(part, Event) and node_of(part) not in space.gate:
                yield from (TimeBound(at, start, 0, part), TimeBound(end, at, 0, part))
        for child in space.tree.nodes[node_of(part)].children:
            if (inner := space.whole[child]) in inside:
                yield TimeBound(start, f"start({child})", 0, (part, inner))
                yield TimeBound(f"end({child})", end, 0, (part, inner))


def _contradiction(bounds: list[TimeBound]) -> list[Need]:
    """Return the requirements of contradictory bounds, each once; none if the bounds are
    satisfiable.
    """
    least: dict[tuple[str, str], tuple[int, Need]] = {}
    for time, other, more, need in bounds:
        if time == other and more < 0:
            return [need]
        if time != other and ((other, time) not in least or more < least[other, time][0]):
            least[other, time] = more, need
    # Bellman and Ford: the latest time of each point, until none changes or a circle is negative
    latest = dict.fromkeys((point for edge in least for point in edge), 0)
    before: dict[str, str] = {}
    changed = ""
    for _ in latest:
        changed = ""
        for (other, time), (more, _) in least.items():
            if latest[other] + more < latest[time]:
                latest[time], before[time], changed = latest[other] + more, other, time
        if not changed:
            break
    if not changed:
        return []
    for _ in latest:  # back into the circle
        changed = before[changed]
    circle = [changed]
    while circle[-1] != changed or len(circle) < 2:
        circle.append(before[circle[-1]])
    return list(dict.fromkeys(least[step][1] for step in pairwise(circle[::-1])))


def too_many_events(space: ScenarioSpace) -> Iterator[RuleReport]:
    """No leaf counts more events than monitors support."""
    for node in space.tree.top_down():
        if node.times > MOST:
            message = (
                f"{node.name} counts {node.times:,} events, but monitors support at most {MOST:,}; count fewer events"
            )
            yield RuleReport(node.place("times"), message, (node.name,))


def ros_time(space: ScenarioSpace) -> Iterator[RuleReport]:
    """What the field `time` of messages has depends on who writes it."""
    time = space.tree.time
    if space.tree.topics and time is not None and time.field == ("time",) and time.format is not TimeFormat.SECONDS:
        so = "as recordings of ROS have it" if time.format is TimeFormat.NANOSECONDS else "and recordings have it as ns"
        what = f"the tree reads `time` as {time.format}, {so}, but ROSMonitoring writes seconds"
        yield RuleReport(time.place, f"{what}: give `--message-time seconds` to `rvaft serve`")


def tied_values(space: ScenarioSpace) -> Iterator[RuleReport]:
    """The guard of a counted leaf orders no value that `times` demands to be equal in all its events."""
    for node in space.tree.top_down():
        if node.times < 2 or node.on is None:
            continue
        for part in conjuncts(node.when):
            ordered = isinstance(part, Operation) and part.operator in ORDERINGS
            tied = [one for one in variables(part) if one in node.on.variables and one not in node.own_values]
            if ordered and tied:
                name = tied[0]
                problem = (
                    f"`times {node.times}` counts events with one and the same {name}, which the guard only bounds"
                )
                mend = f"write `times {node.times} each {name}` if it may differ"
                yield RuleReport(node.place("when"), f"{problem}; {mend}", (node.name,))
                break


def unstated_semantics(space: ScenarioSpace) -> Iterator[RuleReport]:
    """A tree with `times N` or `without` declares its semantics, because further such events may occur."""
    tree = space.tree
    if tree.semantics is not None:
        return
    mend = "add `semantics scattered;`, or the intended semantics"
    for node in tree.top_down():
        alone = tree.occurrences == (node.name,) and not rigid_variables(tree.pattern(node.name) or Anything())
        if node.times > 1 and not alone:
            problem = f"{node.name} waits for {node.times} events, but the tree declares no semantics"
            so = "under the default, `projected`, another such event, or one with other values, ends the match"
            yield RuleReport(node.place("times"), f"{problem}: {so}; {mend}", (node.name,))
        for clause in node.without[:1]:
            problem = f"{node.name} waits for what does not happen, but the tree declares no semantics"
            so = "under the default, `projected`, another of its events, such as one of another entity, ends the match"
            yield RuleReport(clause.place, f"{problem}: {so}; {mend}", (node.name,))
