"""Trees to compare: a fixed catalogue, and random trees from a seed."""

import gc
from collections.abc import Generator, Iterable, Iterator
from contextlib import closing, suppress
from dataclasses import dataclass
from itertools import cycle, islice, product, starmap
from random import Random
from typing import Final

from cross_check.comparison import Comparison, Roster
from cross_check.generate.trees import Shape, random_tree
from cross_check.results import Job, Result, Status, raised
from cross_check.traces import Effort
from rvaft.core.branches import branches
from rvaft.core.restriction import restrict
from rvaft.errors import TreeError
from rvaft.model.guards import FUNCTIONS, Operation, Operator, time_points
from rvaft.model.guards import walk as guard_walk
from rvaft.model.nodes import Causality, Gate, Kind
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics
from rvaft.rules.validity import loads, require_valid
from rvaft.support.processes import Killed, in_processes

# The catalogue of a run without arguments, in code so that installed packages contain it. Under all
# semantics it finds every fault that the tests plant in translations and readers. It has every gate with one to four
# children, with and without an event under both causalities; every ordered pair of gates; shared
# nodes; children with equal events; monitors of branches and kinds; votes with many orders; guards
# in every place; and literals that differ only in type.

EVENTS: Final = """
event seen(what) = { event: what };
event at(place, time) = { at: place, time: time };
event read(value) = { value: value };
"""
GUARDS: Final = {
    "a bound": "T > 3",
    "a bound that counts": "T >= 3",
    "a sum": "T >= S + 2",
    "an inequality": "Q != P",
    "a string": 'Q != "home"',
    "two conditions": "T > 1 and T <= 3",
    "a negation": "not (T == S or Q == P)",
    "a negated order": "not (T < 3)",
}


@dataclass(frozen=True, slots=True)
class Entry:
    """A named tree, and the branch or kind to compare, if not all."""

    name: str
    tree: RVAFT
    branch: int | None = None
    kind: Kind | None = None


def gates(children: int) -> Iterator[str]:
    """Yield every gate for this number of children; a vote with every threshold."""
    for gate in Gate:
        yield from (f"{k}of{children}" for k in range(1, children + 1)) if gate.counts else [str(gate)]


def _above(gate: Gate, children: str, further: str) -> tuple[str, str]:
    return ("2of3", f"{children} {further}") if gate.counts else (gate, children)


def catalogue() -> Iterator[Entry]:
    """Yield the trees of a run without arguments, small and decisive ones first."""
    yield from _single(1, 2)
    yield from starmap(_entry, _WRITTEN.items())
    tree = loads("r or p q; p sand a b; q sand a t; t or c d; c fault; d attack;")
    for number, _ in enumerate(branches(tree), 1):  # events of other branches stay relevant
        yield Entry("branches", tree, branch=number)
    for kind in Kind:
        yield Entry("branches", tree, kind=kind)
    for gate in gates(3):
        yield _entry(f"{gate}, two children with one event", f'r {gate} a b c; a on seen("e"); b on seen("e");')
    for gate in gates(2):
        text = f'r {gate} p q; p sand a b; q sand c d; a on seen("e"); c on seen("e");'
        yield _entry(f"{gate}, two children that begin alike", text)  # deciding at the common event is too early
    for gate in gates(2):  # the `or` leaves an ordered gate a feasible scenario
        yield _entry(f"{gate} over a shared node", f"r {gate} p q; p or a s; q sand b s;")
    for gate in ("and", "2of3"):
        yield _entry(f"{gate} with an order that a choice adds", f"r {gate} o x s; o or q c; q sand x s;")
    for outer, middle in product(Gate, ("sand", "or")):
        above, upper = _above(outer, "a s", "e")
        yield _entry(f"{above} over {middle} over and", f"r {above} {upper}; s {middle} g d; g and b c;")
    yield _entry("1of2 with two to follow", "r sand v y z; v 1of2 a b;")
    for (name, guard), gate in product(GUARDS.items(), ("sand", "and")):
        yield _entry(f"{gate}, a guard with {name}", f"r {gate} a b; a on at(P, S); b on at(Q, T) when {guard};")
    yield from starmap(_entry, (_WRITTEN_LATE | _IN_PRACTICE).items())
    yield from _single(3, 4)  # slow trees, before small ones, so that all processes stay busy
    for outer, inner in product(Gate, repeat=2):
        above, upper = _above(outer, "a g" if outer.counts else "g a", "d")
        below, lower = _above(inner, "b c", "e")
        yield _entry(f"{above} over {below}", f"r {above} {upper}; g {below} {lower};")


_TURNS: Final = (Semantics.PROJECTED, Semantics.CONSECUTIVE, Semantics.SCATTERED, Semantics.STRICT)
"""With this order, the comparisons find every fault that the tests plant in trees of the engine."""


def in_turn(entries: Iterable[Entry]) -> Iterator[tuple[Entry, Semantics]]:
    """Yield each tree with one semantics, in turn: the comparisons of a run without arguments.

    >>> [str(semantics) for _, semantics in islice(in_turn(catalogue()), 5)]
    ['projected', 'consecutive', 'scattered', 'strict', 'projected']
    """
    return zip(entries, cycle(_TURNS), strict=False)


_WRITTEN: Final = {
    "a guard that decides relevance": "r sand b c; b on read(V) when V > 2;",
    "an `ignore` with a guard": "ignore read(X) when X <= 2; r sand a c b; a on read(V); b on read(W);",
    "a variable bound twice": "r sand a b; a on at(P, S); b on read(P);",
    **{  # bounds so that 1, 1.0 and true meet
        f"{gate}, a variable bound twice": f"r {gate} a b; a on seen(V); b on read(V) when V >= 0 and V <= 1;"
        for gate in ("sand", "sand_rl", "and")
    },
    # variables prevent a proof, so these are tested
    "literals of several types": """
        r or p q; p sand a b c d; a on read(1); b on read(1.0); c on read("1"); d on read(true);
        q sand v w; v on at(P, S); w on at(P, T);
    """,
}
_WRITTEN_LATE: Final = {
    "a guard on a gate": "r sand a b c when T > S + 2; a on at(P, S); b on at(Q, T);",
    "guards on choices": "r sand a o; a on at(P, S); o or p q; p and h c; q and l d; h when S >= 3; l when S < 3;",
    # too many orders to list
    "2of4 over a sequence": "r sand v z; v 2of4 ab c d e; ab sand a b;",
}

_IN_PRACTICE: Final = {
    # counted leaves
    "times 3 in a sequence": "r sand a b c; b times 3;",
    "times 2 beside others": "r and a b c; a times 2;",
    "times 2 with a variable": "r sand a b; a on read(V) times 2; b on seen(V);",
    "times 2 with a guard": "r sand a b; a on read(V) when V > 2 times 2;",
    # ends
    "pand over counted leaves": "r pand p q; p and a b; q and c d; a times 2;",
    "pand over sequences": "r pand p q; p sand a b; q sand c d;",
    "pand over parts that begin with each other's events": "r pand p q; p and a s; q and s b;",
    "times 2 of different values": "r sand a b; a on read(V) times 2 distinct V; b;",
    "times 3 of different values, in a window": "time t as s; r and a within 5 s; a on read(V) times 3 distinct V;",
    "times 2 with values of their own": "r sand a b; a on read(V) when V > 2 times 2 each V; b;",
    # absent events
    "without, between, without a guard": 'r sand a b without seen("c");',
    "without, between": "r sand a b without read(V) when V > 2;",
    "without, before": 'r sand a b; b without seen("c") before;',
    "without, a time before": 'time t as s; r sand a b; b without seen("c") for 2 s before;',
    "without, a time after": 'time t as s; r sand a b; b without seen("c") for 2 s after;',
    "without, of the same value": "r sand a b; a on read(V); b without seen(V) before;",
    # windows
    "within, a sequence": "time t as s; r sand a b c within 5 s;",
    "within 0 s": "time t as ns; r and a b within 0 s;",
    "within, a vote": "time t as ms; r sand v d; v 2of3 a b c within 5 s;",
    "within, two over a shared node": "time t as s; r and p q; p and a s within 5 s; q and s b within 3 s;",
    "within, a counted leaf": "time t as us; r sand b d; b sand a c within 1 s; a times 3;",
    "within, around a shorter one": "time t as s; r or p within 5 s; p and a b within 1 s;",
    "within, around ways with one": "time t as s; r or p c within 5 s; p sand a b within 1 s;",
    "within, a choice": "time t as s; r and a o within 5 s; o or b c;",
    # time points, in every format
    "at, seconds": "time t as s; r sand a b c g; g when at(c) - at(b) >= 2 s;",
    "at, strictly, ISO 8601": "time t as iso8601; r and a b g; g when at(b) - at(a) > 2 s;",
    "at, two that are equal, ROS": "time header.stamp as ros; r and a b g; g when at(a) == at(b);",
    "at, a negation, milliseconds": "time t as ms; r sand a b g; g when not at(b) <= at(a) + 1500 ms;",
    "start and end, microseconds": "time t as us; r and p q g; p and a b; q and c d; g when end(p) <= start(q) + 1 s;",
    "start of a later part, nanoseconds": (
        "time t as ns; r and p q g; p and a b; q and c d; g when start(q) > start(p);"
    ),
    "end of a counted leaf": "time t as s; r sand a b g; a times 3; g when end(a) - start(a) <= 2 s;",
    # late events
    "late 2 s": "time t as s late 2 s; r sand a b c;",
    "late 0 s, and a window": "time t as iso8601 late 0 s; r and a b within 4 s;",
    # functions
    "a guard with in": 'r sand a b; a on read(V) when V in (1, "x", true); b on read(W) when not W in (1, 2);',
    "guards with startswith": """
        r sand a b; a on read(V) when startswith(V, "ab");
        b on read(W) when contains(W, "b") and not startswith(W, "b");
    """,
    "guards with endswith and contains": (
        'r sand a b; a on read(V) when endswith(V, "b"); b on read(W) when contains(W, "b");'
    ),
    "guards with like": """
        r sand a b; a on read(V) when like(V, "a*b?"); b on read(W) when like(W, "a*") and not like(W, "a?");
    """,
    "guards with lower and number": 'r sand a b; a on read(V) when lower(V) == "ab"; b on read(W) when number(W) >= 2;',
    "guards with abs, min and max": "r sand a b; a on read(V) when abs(V) > V; b on at(P, S) when max(S, 1) > min(3, "
    "S);",
}
"""Constructs for real logs; trees with times or several values are tested, not proved."""


def parts_of_language(tree: RVAFT) -> Iterator[str]:
    """Yield the constructs of a tree that not every language has."""
    nodes = [*tree.top_down()]
    operators = [part.operator for node in nodes for part in guard_walk(node.when) if isinstance(part, Operation)]
    found = {
        "pand": any(node.gate == "pand" for node in nodes),
        "times": any(node.times > 1 for node in nodes),
        "within": any(node.within is not None for node in nodes),
        "without": bool(tree.absences),
        "at, start, end": any(time_points(node.when) for node in nodes),
        "late": tree.time is not None and tree.time.late is not None,
        "functions": any(operator in FUNCTIONS | {Operator.IN} for operator in operators),
    }
    return (part for part, there in found.items() if there)


def _entry(name: str, text: str) -> Entry:
    used = "".join(f"{line}\n" for line in EVENTS.splitlines() if f" {line[6:].partition('(')[0]}(" in text)
    return Entry(name, loads(used + text))


def _single(*counts: int) -> Iterator[Entry]:
    for count in counts:
        leaves = " ".join("abcd"[:count])
        for gate in gates(count):
            name = gate if "of" in gate else f"{gate}/{count}"
            yield _entry(name, f"r {gate} {leaves};")
            for causality in Causality:
                # below another gate, so that predecessors and successors of the gate's event matter
                text = f'causality {causality}; toplevel t; t sand r z; r {gate} {leaves} on seen("r");'
                yield _entry(f"{name} with its own event, {causality}", text)


MAX_NODES: Final = 9
_PARTS: Final = 0.2
"""Probability that one branch is compared instead of the whole tree."""


def campaign(number: int, seed: int, max_nodes: int = MAX_NODES) -> Iterator[Entry]:
    """Yield random trees; the i-th depends only on the seed, the size and i."""
    for index in range(1, number + 1):
        random = Random(f"{seed} {max_nodes} {index}")  # noqa: S311 (no secret)
        tree, branch = random_tree(random, Shape(max_nodes=max_nodes)), None
        if random.random() < _PARTS:
            drawn = random.randint(1, sum(1 for _ in branches(tree)))
            with suppress(TreeError):  # some branches cannot be monitored separately
                require_valid(restrict(tree, branch=drawn))
                branch = drawn
        yield Entry(f"random {index} of seed {seed}", tree, branch)


# Many comparisons, sequential or in processes, reported in the given order.


@dataclass(frozen=True, slots=True)
class Task:
    """One comparison."""

    tree: RVAFT
    job: Job
    roster: Roster
    effort: Effort

    def run(self) -> list[Result]:
        """Return the results, also for errors of the tree."""
        try:
            return Comparison(self.tree, self.job, self.effort).run(self.roster.candidates(self.tree, self.job))
        except Exception as error:  # noqa: BLE001 (whatever it is, the other comparisons go on)
            return [Result(self.job, "tree", Status.COULD_NOT_RUN, why=str(raised(error)))]


def run(tasks: Iterable[Task], *, jobs: int = 1, together: int = 1) -> Generator[tuple[Task, list[Result]], None, None]:
    """Yield the results of each task, in order; close the generator to stop early.

    `together` consecutive tasks run in one process: comparisons of one tree share caches.
    """
    if jobs == 1:
        yield from ((task, task.run()) for task in tasks)
        return
    gc.freeze()  # exclude imported objects from collections in each process
    threshold = gc.get_threshold()
    gc.set_threshold(1_000, 10, 200)  # most objects are long-lived caches
    rest = iter(tasks)
    batches = iter(lambda: [*islice(rest, together)], [])
    try:
        with closing(in_processes(lambda some: [task.run() for task in some], batches, jobs=jobs)) as running:
            for some, found in running:
                for number, task in enumerate(some):
                    killed = Result(task.job, "tree", Status.COULD_NOT_RUN, why="a process that compares was killed")
                    yield task, [killed] if isinstance(found, Killed) else found[number]
    finally:  # restore the caller's settings
        gc.set_threshold(*threshold)
        gc.unfreeze()
