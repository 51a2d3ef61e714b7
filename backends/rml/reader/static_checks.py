"""What cannot run: undefined equations, equations that unfold without an event, event types derived from themselves.

All but the last are refused by the published compiler too; its monitor does not return from the last.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import lru_cache
from typing import Final, TypeAlias

import networkx as nx

from backends.rml.reader.parser import parse, refusal
from backends.rml.reader.syntax import (
    Constant,
    Either,
    Expression,
    Fields,
    Ignored,
    Items,
    RmlProgram,
    TypeUse,
    expressions,
    fold,
    walk,
)
from rvaft.errors import TooLarge

DERIVATION_LIMIT: Final = 100
"""How many event types may be derived from each other in a row."""


@lru_cache(maxsize=64)
def checked(text: str) -> RmlProgram:
    """The specification of a text; raises `LanguageError` for what is no RML or cannot run, and `TooLarge`."""
    program = parse(text)
    if "Main" not in program.equations:
        raise refusal("the specification has no equation Main")
    _check_derived(program)
    for equation in program.equations.values():
        for part in expressions(equation.body):
            if part.operator == "call" and part.data[0] not in program.equations:
                raise refusal(f"undefined equation {part.data[0]}", part.place)
            if isinstance(part.data, TypeUse):
                _check_use(part.data)
    _check_contractive(program)
    return program


def _check_use(use: TypeUse) -> None:
    for parameter in use.parameters:
        text = isinstance(parameter, Constant) and isinstance(parameter.value, str)
        if text or isinstance(parameter, Ignored | Fields | Items):
            message = f"{use.name}: a string, `_`, list or object is no argument in an expression; derive an event type"
            raise refusal(message, use.place)


def _check_derived(program: RmlProgram) -> None:
    graph = nx.DiGraph()
    for declaration in program.declarations:
        parents = [parent for parent in declaration.alternatives if isinstance(parent, TypeUse)]
        for parent in parents:
            if any(isinstance(part, Either) for part in walk(parent)):
                raise refusal(f"{parent.name}: no `|` inside an argument", parent.place)
        for parent in parents:
            if parent.signature == declaration.signature:
                raise refusal(f"the event type {declaration.name} is derived from itself", parent.place)
            graph.add_edge(declaration.signature, parent.signature, place=parent.place)
    cycle = next((c for c in nx.strongly_connected_components(graph) if len(c) > 1), None)
    if cycle is not None:
        name = min(cycle)
        place = min(place for _, parent, place in graph.out_edges(name, data="place") if parent in cycle)
        raise refusal(f"the event type {name[0]} is derived from itself", place)
    if nx.dag_longest_path_length(graph, weight=None) > DERIVATION_LIMIT:
        raise TooLarge("event types derived from each other in a row", limit=DERIVATION_LIMIT)


# -- equations ---------------------------------------------------------------------------------------------------------


def references(body: Expression) -> list[str]:
    """The equations that an expression refers to."""
    return [part.data[0] for part in expressions(body) if part.operator == "call"]


def reachable(program: RmlProgram, names: Iterable[str]) -> Iterator[tuple[str, Expression]]:
    """The equations that some can unfold, these among them, with their bodies."""
    seen = dict.fromkeys(names)
    waiting = list(seen)
    while waiting:
        name = waiting.pop()
        yield name, (body := program.equations[name].body)
        fresh = [used for used in dict.fromkeys(references(body)) if used not in seen]
        seen.update(dict.fromkeys(fresh))
        waiting += fresh


def settle(uses: Mapping[str, Iterable[str]], is_new: Callable[[str], bool]) -> None:
    """Ask `is_new` of every equation, and again of those that use one of which something was new, until nothing is."""
    users: dict[str, list[str]] = {name: [] for name in uses}
    for name, used in uses.items():
        for other in used:
            if other in users:
                users[other].append(name)
    waiting = list(uses)
    while waiting:
        name = waiting.pop()
        if is_new(name):
            waiting.extend(users[name])


Beginning: TypeAlias = tuple[bool, frozenset[str]]
"""Whether an expression may halt at once, and the equations that it may unfold before any event."""


def _check_contractive(program: RmlProgram) -> None:
    halting = dict.fromkeys(program.equations, False)

    def beginning(part: Expression, below: list[Beginning]) -> Beginning:
        first = below
        match part:
            case Expression("call", data=(name, _, _)):
                return halting[name], frozenset([name])
            case Expression("cat"):
                first = below[: next((i for i, (halts, _) in enumerate(below, 1) if not halts), len(below))]
                halts = len(first) == len(below) and first[-1][0]
            case Expression("event"):
                halts = False
            case Expression("star" | "optional" | "closure") | Expression("times", data=0):
                halts = True
            case Expression("or"):
                halts = any(halts for halts, _ in below)
            case _:
                halts = all(halts for halts, _ in below)
        return halts, frozenset[str]().union(*(names for _, names in first))

    def of(name: str) -> Beginning:
        return fold(program.equations[name].body, beginning, lambda part: part.parts)

    def is_new(name: str) -> bool:
        before, halting[name] = halting[name], halting[name] or of(name)[0]
        return halting[name] is not before

    settle({name: references(equation.body) for name, equation in program.equations.items()}, is_new)
    graph = nx.DiGraph((name, unfolded) for name in program.equations for unfolded in of(name)[1])
    known = {name for name, _ in reachable(program, ["Main"])}
    for cycle in nx.strongly_connected_components(graph):
        name = min(cycle)
        if cycle & known and (len(cycle) > 1 or graph.has_edge(name, name)):
            raise refusal(f"{name} unfolds without an event (it is not contractive)", program.equations[name].place)
