"""A tree in normal form: what has to be observed, and in which order, without gates and labels.

The gates of the language are one way to write six things: an *event*, a *condition*, *all* parts, *one* part, *at least* K parts,
parts in *sequence*. Here causality has become sequence (under `top_down` a node's event comes before its body), `sand_rl` is turned
round, guards without variables are gone, and so is what a false one makes impossible. A node that several parents share
stays one part: it is resolved and observed once.

`body` says the same of a single node, for what follows the nodes of a tree.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from enum import Enum, auto
from functools import cached_property, partial
from itertools import chain, combinations
from typing import Final, NamedTuple, TypeVar, assert_never

from rvaft.model.guards import Guard, holds, variables
from rvaft.model.nodes import Causality, Gate, Node
from rvaft.model.tree import RVAFT, reachable

Seen = TypeVar("Seen")


class Op(Enum):
    """What a part asks for: its event, its guard, or something of its parts."""

    EVENT = auto()
    CONDITION = auto()
    ALL = auto()
    SEQUENCE = auto()
    ONE = auto()
    AT_LEAST = auto()


class Body(NamedTuple):
    """How the children of a node are joined: `need` of them at least are kept, in the order of time where it is a SEQUENCE."""

    op: Op
    children: tuple[str, ...]
    need: int

    @property
    def chooses(self) -> bool:
        """Whether its gate chooses among the children (even where there is only one)."""
        return self.op is Op.ONE or self.op is Op.AT_LEAST


def body(node: Node) -> Body:
    """What is below a node, its gate resolved; ALL of nothing below a leaf.

    >>> body(Node("top", Gate.SAND_RL, ("a", "b")))
    Body(op=<Op.SEQUENCE: 4>, children=('b', 'a'), need=2)
    >>> body(Node("top", Gate.VOT, ("a", "b", "c"), threshold=2)).need
    2
    """
    match node.gate:
        case None | Gate.AND | Gate.PAND:  # `pand` is said in other words before (`plain_trees`)
            return Body(Op.ALL, node.children, len(node.children))
        case Gate.OR:
            return Body(Op.ONE, node.children, 1)
        case Gate.SAND:
            return Body(Op.SEQUENCE, node.children, len(node.children))
        case Gate.SAND_RL:
            return Body(Op.SEQUENCE, node.children[::-1], len(node.children))
        case Gate.VOT:
            assert node.threshold is not None
            return Body(Op.AT_LEAST, node.children, node.threshold)
        case _:
            assert_never(node.gate)


def is_constant(node: Node) -> bool:
    """Whether the node has a guard without variables."""
    return node.when is not None and not variables(node.when)


def is_impossible(node: Node) -> bool:
    """Whether the node has a guard without variables that does not hold."""
    return node.when is not None and not variables(node.when) and not holds(node.when, {})


@dataclass(frozen=True, slots=True)
class Part:
    """One part: `parts` are numbers of smaller parts, `need` how many of them are kept at least, `node` is where it comes from."""

    op: Op
    node: str = ""
    parts: tuple[int, ...] = ()
    need: int = 0
    guard: Guard | None = None

    @property
    def chooses(self) -> bool:
        """Whether scenarios differ in which of its parts they keep."""
        return (self.op is Op.ONE or self.op is Op.AT_LEAST) and self.need < len(self.parts)


EMPTY: Final = Part(Op.ALL)
"""Nothing to observe."""
IMPOSSIBLE: Final = Part(Op.ONE, need=1)
"""A choice without alternatives: what can never be observed."""


@dataclass(frozen=True)
class NormalForm:
    """The parts, each after the parts it is made of and the root last; `whole` is the part of each node with all that is below it."""

    parts: tuple[Part, ...]
    whole: Mapping[str, int]

    @property
    def root(self) -> int:
        """The number of the whole tree's part."""
        return len(self.parts) - 1

    @property
    def feasible(self) -> bool:
        """Whether guards without variables leave any scenario."""
        return self.parts[-1] != IMPOSSIBLE

    @cached_property
    def guards(self) -> tuple[tuple[int, Guard], ...]:
        """The guards over variables, parents before children, each with the number of its node's part."""
        found = ((self.whole[part.node], part.guard) for part in reversed(self.parts) if part.guard is not None)
        return tuple((number, guard) for number, guard in found if self.parts[number] != IMPOSSIBLE)

    def kept(self) -> list[int]:
        """The parts that the root reaches, parts before wholes."""
        seen = bytearray(len(self.parts))
        seen[self.root] = 1
        for number in range(self.root, -1, -1):
            if seen[number]:
                for part in self.parts[number].parts:
                    seen[part] = 1
        return [number for number in range(len(self.parts)) if seen[number]]

    def resolve(self, number: int, chosen: Iterable[int]) -> "NormalForm":
        """The same with one choice made: exactly the chosen parts of that part."""
        kept = tuple(chosen)
        made = replace(self.parts[number], op=Op.ALL, parts=kept, need=len(kept))
        return NormalForm((*self.parts[:number], made, *self.parts[number + 1 :]), self.whole)


def divided(
    form: NormalForm, look: Callable[[NormalForm], Seen | int], *, at_least: bool
) -> Iterator[tuple[NormalForm, Seen]]:
    """All scenarios, divided until `look` names no more part whose choice is to be made; with what it says then.

    `at_least` keeps the ways to choose more than K.
    """
    waiting = [iter([form])]
    while waiting:
        candidate = next(waiting[-1], None)
        if candidate is None:
            waiting.pop()
            continue
        found = look(candidate)
        if isinstance(found, int):
            part = candidate.parts[found]
            most = len(part.parts) if at_least and part.op is Op.AT_LEAST else part.need
            ways = chain.from_iterable(map(partial(combinations, part.parts), range(part.need, most + 1)))
            waiting.append(map(partial(candidate.resolve, found), ways))
        else:
            yield candidate, found


def normal_form(tree: RVAFT, choices: Mapping[str, str] | None = None, *, as_written: bool = False) -> NormalForm:
    """A tree in normal form; with `choices`, as in a branch, what remains where these `or` gates keep that child.

    `as_written` keeps the guards without variables, and what they make impossible.

    >>> tree = RVAFT("top", [Node("top", Gate.SAND_RL, ("a", "b")), Node("a"), Node("b")])
    >>> for part in normal_form(tree).parts: print(part.op.name, part.node, part.parts)
    EVENT b ()
    EVENT a ()
    SEQUENCE top (0, 1)
    """
    made = {} if choices is None else choices

    def kept(name: str) -> tuple[str, ...]:
        return (made[name],) if name in made else tree.nodes[name].children

    reached = set(reachable(tree.root, kept))
    parts: list[Part] = []
    whole: dict[str, int] = {}

    def add(part: Part) -> int:
        parts.append(part)
        return len(parts) - 1

    for node in tree.bottom_up():
        if node.name not in reached:
            continue
        own: list[int] = []
        below: list[int] = []
        if node.children:
            op, children, need = body(node)
            children = (made[node.name],) if node.name in made else children
            inner = tuple(whole[child] for child in children)
            if not as_written:
                inner = tuple(number for number in inner if parts[number] != IMPOSSIBLE)
                op = Op.ALL if op is Op.AT_LEAST and len(inner) == need else op
            lacking = not as_written and len(inner) < need
            below.append(add(IMPOSSIBLE if lacking else Part(op, node.name, inner, need)))
        if node.has_event:
            own.append(add(Part(Op.EVENT, node.name)))
        if node.when is not None and (as_written or not is_constant(node)):
            own.append(add(Part(Op.CONDITION, node.name, guard=node.when)))
        of_node = own + below if tree.causality is Causality.TOP_DOWN else below + own
        dead = not as_written and (is_impossible(node) or any(parts[number] == IMPOSSIBLE for number in of_node))
        if len(of_node) == 1 and not dead:
            whole[node.name] = of_node[0]
        elif of_node and not dead:
            whole[node.name] = add(Part(Op.SEQUENCE, node.name, tuple(of_node), len(of_node)))
        else:
            whole[node.name] = add(IMPOSSIBLE if dead else EMPTY)
    return NormalForm(tuple(parts), whole)
