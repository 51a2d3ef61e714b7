"""Decides beforehand the choices that cannot wait.

A choice can wait when everything below each of its alternatives is reached through that alternative alone: then an
event below it is the decision. Where an alternative reaches a part that is also reached otherwise, the decision may add an
order between events that have happened by then, so it is taken before anything happens, each way in a graph of its own.
"""

from collections.abc import Iterator
from itertools import combinations
from typing import TypeAlias

from backends.automaton.structure import Content, Group, How, Part, Structure, below, reachable
from rvaft.errors import TooLarge

Graph: TypeAlias = dict[Part, Content]


def decided(structure: Structure, root: Part, *, at_least: bool, limit: int) -> list[Graph]:
    """The graphs, in a stable order, whose remaining choices can all wait; together they have the scenarios of the tree.

    `at_least` keeps the ways to choose more than K; raises `TooLarge` beyond `limit` graphs.
    """
    start = dict(enumerate(structure.parts))
    done: list[Graph] = []
    todo = [start]
    while todo:
        graph = todo.pop()
        order = reachable(root, graph)
        choice = _urgent(order, graph)
        if choice is None:
            done.append({part: graph[part] for part in order})
        else:
            content = graph[choice]
            assert isinstance(content, Group)
            ways = list(_ways(content, at_least=at_least, room=limit - len(done) - len(todo)))
            todo.extend({**graph, choice: Group(How.ALL, way)} for way in reversed(ways))
        if len(done) + len(todo) > limit:
            raise TooLarge("ways to decide choices between parts that share nodes", limit=limit)
    return done


def _ways(choice: Group, *, at_least: bool, room: int) -> Iterator[tuple[Part, ...]]:
    if choice.how is How.ONE:
        yield from ((child,) for child in choice.children)
        return
    most = len(choice.children) if at_least else choice.least
    seen: set[frozenset[Part]] = set()
    for size in range(choice.least, most + 1):
        for way in combinations(choice.children, size):
            kept = frozenset(way)
            if kept not in seen:
                seen.add(kept)
                yield tuple(dict.fromkeys(way))
            if len(seen) > room:
                return


def _urgent(order: list[Part], graph: Graph) -> Part | None:
    """The first choice with an alternative that reaches a part which is also reached otherwise."""
    references: dict[Part, int] = dict.fromkeys(order, 0)
    parents: dict[Part, int] = dict.fromkeys(order, 0)
    rank = {part: index for index, part in enumerate(order)}
    for part in order:
        for child in below(graph[part]):
            references[child] += 1
            parents[child] |= 1 << rank[part]
    if all(count <= 1 for count in references.values()):
        return None
    inside: dict[Part, int] = {}
    entered: dict[Part, int] = {}
    for part in reversed(order):
        inside[part], entered[part] = 1 << rank[part], 0
        for child in below(graph[part]):
            inside[part] |= inside[child]
            entered[part] |= entered[child] | parents[child]
    for part in order:
        content = graph[part]
        if isinstance(content, Group) and content.how in (How.ONE, How.SOME):
            for child in content.children:
                if references[child] > 1 or entered[child] & ~inside[child]:
                    return part
    return None
