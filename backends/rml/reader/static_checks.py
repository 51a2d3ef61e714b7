"""What cannot run: undefined equations, equations that unfold without an event, event types derived from themselves.

All but the last are refused by the published compiler too; its monitor does not return from the last.
"""

import networkx as nx

from backends.rml.reader import syntax as s
from rvaft.errors import LanguageError, TooLarge

DERIVATION_LIMIT = 100
"""How many event types may be derived from each other in a row."""


def check(program: s.Program) -> None:
    """Raises `LanguageError` for a program that cannot run, and `TooLarge`."""
    if "Main" not in program.equations:
        raise LanguageError("the specification has no equation Main", file="<rml>")
    _check_derived(program)
    for equation in program.equations.values():
        for part in s.bottom_up(equation.body):
            if isinstance(part, s.Reference) and part.name not in program.equations:
                raise _refuse(f"undefined equation {part.name}", part.place)
            if isinstance(part, s.Occurs | s.Filtered):
                _check_use(part.use)
    _check_contractive(program)


def _refuse(message: str, place: tuple[int, int]) -> LanguageError:
    return LanguageError(message, file="<rml>", line=place[0], column=place[1])


def _check_use(use: s.TypeUse) -> None:
    for parameter in use.parameters:
        text = isinstance(parameter, s.Constant) and isinstance(parameter.value, str)
        if text or isinstance(parameter, (s.Ignored, s.Fields, s.Items)):
            raise _refuse(
                f"{use.name}: a string, `_`, list or object is no argument in an expression; derive an event type",
                use.place,
            )


def _check_derived(program: s.Program) -> None:
    graph = nx.DiGraph()
    for declaration in program.declarations:
        for parent in declaration.parents:
            if any(isinstance(v, s.Either) for parameter in parent.parameters for v in s.parts_of(parameter)):
                raise _refuse(f"{parent.name}: no `|` inside an argument", parent.place)
        child = declaration.name, len(declaration.parameters)
        for parent in declaration.parents:
            if (parent.name, len(parent.parameters)) == child:
                raise _refuse(f"the event type {child[0]} is derived from itself", parent.place)
            graph.add_edge(child, (parent.name, len(parent.parameters)), place=parent.place)
    cycle = next((c for c in nx.strongly_connected_components(graph) if len(c) > 1), None)
    if cycle is not None:
        name, arity = min(cycle)
        place = min(place for _, parent, place in graph.out_edges((name, arity), data="place") if parent in cycle)
        raise _refuse(f"the event type {name} is derived from itself", place)
    if nx.dag_longest_path_length(graph, weight=None) > DERIVATION_LIMIT:
        raise TooLarge("event types derived from each other in a row", limit=DERIVATION_LIMIT)


def _check_contractive(program: s.Program) -> None:
    halting = _halting(program)
    graph = nx.DiGraph()
    for equation in program.equations.values():
        graph.add_edges_from((equation.name, name) for name in _unguarded(equation.body, halting))
    reachable = _reachable(program)
    cycle = next((c for c in nx.strongly_connected_components(graph) if _loops(graph, c) and c & reachable), None)
    if cycle is not None:
        name = min(cycle)
        raise _refuse(f"{name} unfolds without an event (it is not contractive)", program.equations[name].place)


def _loops(graph: nx.DiGraph, component: set[str]) -> bool:
    return len(component) > 1 or any(graph.has_edge(name, name) for name in component)


def _reachable(program: s.Program) -> set[str]:
    seen, todo = {"Main"}, ["Main"]
    while todo:
        for part in s.bottom_up(program.equations[todo.pop()].body):
            if isinstance(part, s.Reference) and part.name not in seen:
                seen.add(part.name)
                todo.append(part.name)
    return seen


def _halting(program: s.Program) -> dict[str, bool]:
    """Which equations may halt at once, by the least fixed point: an equation is looked at again when one it uses halts."""
    known = dict.fromkeys(program.equations, False)
    users: dict[str, list[str]] = {name: [] for name in program.equations}
    for equation in program.equations.values():
        for part in s.bottom_up(equation.body):
            if isinstance(part, s.Reference):
                users[part.name].append(equation.name)
    waiting = list(program.equations)
    while waiting:
        name = waiting.pop()
        body = program.equations[name].body
        if not known[name] and _halts(body, known)[id(body)]:
            known[name] = True
            waiting.extend(users[name])
    return known


def _halts(body: s.Expression, known: dict[str, bool]) -> dict[int, bool]:
    done: dict[int, bool] = {}
    for part in s.bottom_up(body):
        below = [done[id(child)] for child in s.children(part)]
        match part:
            case s.Leaf():
                halts = True
            case s.Occurs():
                halts = False
            case s.Reference(name):
                halts = known[name]
            case s.Joined("or"):
                halts = any(below)
            case s.Repeated("star" | "optional" | "closure") | s.Repeated("times", _, 0):
                halts = True
            case _:
                halts = all(below)
        done[id(part)] = halts
    return done


def _unguarded(body: s.Expression, halting: dict[str, bool]) -> set[str]:
    """The equations that a body may unfold before any event."""
    halts = _halts(body, halting)
    found: set[str] = set()
    todo = [body]
    while todo:
        part = todo.pop()
        if isinstance(part, s.Reference):
            found.add(part.name)
        elif isinstance(part, s.Joined) and part.operator == "cat":
            for inner in part.parts:
                todo.append(inner)
                if not halts[id(inner)]:
                    break
        else:
            todo.extend(s.children(part))
    return found
