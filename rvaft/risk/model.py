"""The form of a tree that analyses of risk read: leaves with numbers, gates, dependencies and restrictions.

Galileo's dynamic gates keep their own meaning here, which depends on times that a monitor does not
observe; `rvaft.language.galileo` translates them for monitors.
"""

import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from types import MappingProxyType
from typing import Final, assert_never

from rvaft.errors import RvaftError
from rvaft.language.draft import Draft, GateUse
from rvaft.language.galileo import ATTACK_TREES, is_galileo
from rvaft.language.parser import parse_file_as_written
from rvaft.model.guards import time_points, variables
from rvaft.model.nodes import Causality, Gate, Kind, Node
from rvaft.model.quantities import Quantities, WrongQuantity, quantities
from rvaft.model.tree import RVAFT, find_cycle, reachable
from rvaft.rules.validity import valid_tree
from rvaft.support.wording import did_you_mean

PACKAGES: Final = "pip install 'rvaft[risk]'"
"""How to install what the analyses need."""


class RiskError(RvaftError, ValueError):
    """A tree, or a part of one, that an analysis of risk refuses; the message has the reason."""


class Op(Enum):
    """How the children of a gate bring it about.

    `SEQUENCE`: the clocks of a child's leaves start when the children before it are complete.
    `PRIORITY`: all clocks run, and another order than from left to right is final. `FIRST` is
    Galileo's `por`. `SPARE`: the first child is in use, and then the next one that is free.
    """

    OR = "or"
    AND = "and"
    AT_LEAST = "at least"
    SEQUENCE = "sequence"
    PRIORITY = "priority and"
    FIRST = "priority or"
    SPARE = "spare"

    @property
    def static(self) -> bool:
        """Whether the order in which the children happen does not matter."""
        return self in (Op.OR, Op.AND, Op.AT_LEAST)


@dataclass(frozen=True, slots=True)
class Leaf:
    """A basic event of the analysis; `node` is the tree's node whose event, failure or guard it is.

    `times` such events are needed, one after the other. `once` tells a failure from an event that
    recurs.
    """

    name: str
    node: str
    numbers: Quantities
    once: bool
    times: int = 1
    kind: Kind | None = None
    label: str | None = None
    guard: bool = False
    """Whether it stands for a guard that holds, not for something that happens."""


@dataclass(frozen=True, slots=True)
class RiskGate:
    """A gate of the analysis; `need` is the number of children of `AT_LEAST`."""

    name: str
    op: Op
    children: tuple[str, ...]
    need: int = 0
    kind: Kind | None = None
    label: str | None = None
    numbers: Quantities = field(default_factory=Quantities)


@dataclass(frozen=True, slots=True)
class Dependency:
    """`fdep` and `pdep`: the failure of the trigger fails the dependents.

    For `pdep`, it does if the leaf `coin` happens, which has the probability and stands nowhere else.
    """

    name: str
    trigger: str
    dependents: tuple[str, ...]
    coin: str | None = None


@dataclass(frozen=True, slots=True)
class Restriction:
    """`seq` and `mutex` over leaves: they can fail in this order only, or only one of them."""

    name: str
    exclusive: bool
    children: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class RiskTree:
    """A tree for analyses of risk.

    `assumed` are the guards that are taken to hold, which makes a probability an upper bound.
    `timed` is what an analysis cannot compute and a simulation can: the nodes with windows, absent
    events and guards over times. `tree` is where it comes from, if that is no draft of Galileo.
    """

    root: str
    leaves: Mapping[str, Leaf]
    gates: Mapping[str, RiskGate]
    dependencies: tuple[Dependency, ...] = ()
    restrictions: tuple[Restriction, ...] = ()
    assumed: tuple[str, ...] = ()
    timed: tuple[str, ...] = ()
    tree: RVAFT | None = None

    def children(self, name: str) -> tuple[str, ...]:
        """Return the children of a gate; a leaf has none."""
        return self.gates[name].children if name in self.gates else ()

    def causes(self) -> dict[str, list[tuple[str, str | None]]]:
        """Return the triggers of each dependent, each with the leaf that has its probability, if any."""
        found: dict[str, list[tuple[str, str | None]]] = {}
        for one in self.dependencies:
            for name in one.dependents:
                found.setdefault(name, []).append((one.trigger, one.coin))
        return found

    def needed(self, root: str) -> Iterator[str]:
        """Iterate over what an element depends on, itself first, also through others."""
        return reachable(root, self.needs)

    def needs(self, name: str) -> list[str]:
        """Return what an element depends on: children, triggers, and what restricts it."""
        found = [*self.children(name)]
        for one in self.dependencies:
            if name in one.dependents:
                found += [one.trigger, *([] if one.coin is None else [one.coin])]
        for restriction in self.restrictions:
            if name in restriction.children:
                found += [other for other in restriction.children if other != name]
        return found

    def order(self) -> list[str]:
        """Return the elements below the root, each after its children, from left to right.

        >>> import rvaft
        >>> of_tree(rvaft.loads("top and a g; g or b c;")).order()
        ['a', 'b', 'c', 'g', 'top']
        """
        return below(self, [self.root])

    @property
    def unit(self) -> str | None:
        """`s` if the rates have units, the empty text if they have none, None without rates.

        Raises `RiskError` if some have and others have none.
        """
        rates = [leaf for name in self.order() if (leaf := self.leaves.get(name)) and leaf.numbers.rate]
        timed = [leaf for leaf in rates if leaf.numbers.timed]
        if timed and len(timed) < len(rates):
            bare = next(leaf for leaf in rates if not leaf.numbers.timed)
            raise RiskError(
                f"the rate of {timed[0].node} has a unit and that of {bare.node} has none: write all rates per unit "
                "of time (0.002/h), or none"
            )
        return None if not rates else "s" if timed else ""

    def require_numbers(self) -> None:
        """Raise `RiskError` if a leaf has neither a probability nor a rate."""
        missing = [
            leaf.node for name in self.order() if (leaf := self.leaves.get(name)) and not leaf.numbers.has_chance
        ]
        if missing:
            some = ", ".join(missing[:_SHOWN]) + (f" and {len(missing) - _SHOWN} more" if len(missing) > _SHOWN else "")
            raise RiskError(
                f"no probability and no rate at {some}: write prob=0.01 or lambda=0.002/h at each leaf, or let "
                "`rvaft rates` estimate rates from logs"
            )


_SHOWN: Final = 5


def below(tree: RiskTree, roots: Iterable[str]) -> list[str]:
    """Return the elements reachable from some, each after its children, from left to right."""
    found: dict[str, None] = {}
    waiting = [(root, False) for root in reversed(list(roots))]
    while waiting:
        name, done = waiting.pop()
        if done:
            found[name] = None
        elif name not in found:
            waiting.append((name, True))
            waiting.extend((child, False) for child in reversed(tree.children(name)) if child not in found)
    return list(found)


def without(tree: RiskTree, name: str) -> RiskTree:
    """Return the tree with an element that never happens; raises `RiskError` for an unknown or unused one.

    >>> import rvaft
    >>> form = of_tree(rvaft.loads("t or a b; a prob=.1; b prob=.2;"))
    >>> without(form, "a").leaves["a"].numbers.chance
    0.0
    """
    known = tree.order()
    if name not in known:
        raise RiskError(f"there is no node {name or repr('')} below the root{did_you_mean(name, known)}")
    gate, leaf = tree.gates.get(name), tree.leaves.get(name)
    gone = replace(leaf or Leaf(name, name, Quantities(), once=True), numbers=Quantities(chance=0.0), times=1)
    gates = {other: one for other, one in tree.gates.items() if other != name or gate is None}
    return _reached(replace(tree, leaves={**tree.leaves, name: gone}, gates=gates))


def of_tree(tree: RVAFT) -> RiskTree:
    """Return the form of a tree; raises `RiskError` for numbers without a meaning.

    >>> import rvaft
    >>> form = of_tree(rvaft.loads("event e() = {e: 1}; top on e() lambda=1; top and a b; a prob=0.5;"))
    >>> form.gates["top"].op.value, form.gates["top"].children
    ('sequence', ('event of top', 'parts of top'))
    """
    if tree.translated:
        raise RiskError(
            "dynamic gates of Galileo were translated for monitors, and a number needs them as they are written: "
            "analyse the file itself"
        )
    return _Building(tree.root, tree.nodes, tree.causality, words={}, tree=tree).made()


def of_file(path: "str | os.PathLike[str]") -> RiskTree:
    """Return the form of the tree in a file, in which dynamic gates of Galileo keep their own meaning.

    Raises `OSError`, `LanguageError`, `TreeError` and `RiskError`.

    >>> of_file("trees/gates/and.rvaft").gates["top"].op
    <Op.AND: 'and'>
    """
    return of_draft(parse_file_as_written(path))


def of_draft(draft: Draft) -> RiskTree:
    """Return the form of a draft that has kept its dynamic gates.

    Raises `TreeError` if it is no valid tree, and `RiskError` for what no analysis reads.
    """
    if not any(use.dynamic for node in draft.nodes.values() for use, _ in node.gates):
        return of_tree(valid_tree(draft))
    if draft.root is None:
        raise RiskError(f"{draft.file}: the tree has no root: declare it with `toplevel NAME;`")
    words: dict[str, GateUse] = {}
    nodes = {name: node.build() for name, node in draft.nodes.items()}
    for name, node in draft.nodes.items():
        if len(node.gates) > 1:
            raise RiskError(f"{node.gates[1].place}: {name} has two gates; `rvaft check` says more")
        for use, place in node.gates:
            if use.dynamic == "sor" and not place.file.lower().endswith(ATTACK_TREES):
                raise RiskError(f"{place}: the gate `sor` of {name} is read in {ATTACK_TREES} files only")
            if use.dynamic and (use.dynamic != "pand" or is_galileo(place.file)):
                words[name] = use
    for undeclared in draft.undeclared():
        nodes[undeclared.value] = Node(undeclared.value, declared=False, places={"name": undeclared.place})
    causality = draft.causalities[0].value if draft.causalities else Causality.TOP_DOWN
    return _Building(draft.root, nodes, causality, words=words, galileo=is_galileo(draft.file)).made()


class _Building:
    """Builds the form from nodes; `words` are the dynamic gates of Galileo, by node."""

    def __init__(
        self,
        root: str,
        nodes: Mapping[str, Node],
        causality: Causality,
        *,
        words: Mapping[str, GateUse],
        tree: RVAFT | None = None,
        galileo: bool = False,
    ) -> None:
        self._root, self._nodes, self._words, self._tree = root, dict(nodes), words, tree
        self._bottom_up, self._galileo = causality is Causality.BOTTOM_UP, galileo
        self._leaves: dict[str, Leaf] = {}
        self._gates: dict[str, RiskGate] = {}
        self._dependencies: list[Dependency] = []
        self._restrictions: list[Restriction] = []
        self._assumed: list[str] = []
        self._timed: list[str] = []
        self._persistent: set[str] = set()
        """The nodes below dynamic gates of Galileo: these are failures, which happen once."""

    def made(self) -> RiskTree:
        kinds = {name: use.dynamic.partition("=")[0].strip() for name, use in self._words.items()}
        dependencies = {name for name, kind in kinds.items() if kind in ("fdep", "pdep")}
        if self._root in dependencies:
            raise RiskError(f"the root {self._root} is a dependency, which never fails")
        for name, node in self._nodes.items():
            if any(child in dependencies for child in node.children) and name not in dependencies:
                left = tuple(child for child in node.children if child not in dependencies)
                if not left or node.threshold is not None:
                    raise RiskError(f"{name} has a child that is a dependency, which never fails")
                self._nodes[name] = Node(name, node.gate, left, attributes=node.attributes, kind=node.kind)
        children = {name: node.children for name, node in self._nodes.items() if name not in dependencies}
        if circle := find_cycle(children):
            raise RiskError(f"the tree has a cycle: {' -> '.join([*circle, circle[0]])}")
        self._persist(kinds)
        used = {child for name, some in children.items() for child in some}
        for name in dependencies:
            self._depend(name, kinds[name])
        for name, node in self._nodes.items():
            if name in dependencies:
                continue
            if kinds.get(name) in ("seq", "mutex") and self._restrict(name, kinds[name], idle=name not in used):
                continue
            self._element(node, kinds.get(name))
        self._through_gates()
        self._read_native_pands(kinds)
        form = RiskTree(
            self._root,
            MappingProxyType(self._leaves),
            MappingProxyType(self._gates),
            tuple(self._dependencies),
            tuple(self._restrictions),
            tuple(self._assumed),
            tuple(self._timed),
            self._tree,
        )
        if self._root not in self._leaves and self._root not in self._gates:
            raise RiskError(f"the root {self._root} restricts failures and never fails itself")
        return _reached(form)

    def _persist(self, kinds: Mapping[str, str]) -> None:
        waiting = [child for name in kinds for child in self._nodes[name].children]
        while waiting:
            name = waiting.pop()
            if name not in self._persistent:
                self._persistent.add(name)
                waiting.extend(self._nodes[name].children)

    def _depend(self, name: str, kind: str) -> None:
        trigger, *dependents = self._nodes[name].children
        text = self._words[name].dynamic.partition("=")[2].strip()
        chance = float(text) if kind == "pdep" else 1.0
        if not 0 <= chance <= 1:
            raise RiskError(f"`pdep={text}` of {name} is not a probability: write a number from 0 to 1")
        if not dependents:
            raise RiskError(f"`{kind}` of {name} needs a trigger, followed by at least one dependent")
        coin = None if chance == 1 else f"chance of {name}"
        if coin is not None:
            self._leaves[coin] = Leaf(coin, name, Quantities(chance=chance), once=True)
        self._dependencies.append(Dependency(name, trigger, tuple(dependents), coin))

    def _restrict(self, name: str, kind: str, *, idle: bool) -> bool:
        """Record a restriction; return whether the node is nothing else."""
        node = self._nodes[name]
        children = node.children
        plain = all(self._nodes[child].leaf for child in children)
        if kind == "mutex" and not (idle and plain):
            why = "it is no gate that fails" if not idle else "its children are gates"
            raise RiskError(f"`mutex` of {name} is not analysed: {why}; write it over leaves, without a parent")
        if plain:
            self._restrictions.append(Restriction(name, kind == "mutex", children))
            if name != self._root and idle:
                return True
            self._gates[name] = RiskGate(name, Op.AND, children, kind=node.kind, label=node.label)
            return True
        if idle and name != self._root:
            raise RiskError(f"`seq` of {name} restricts gates, which is not analysed: write it over leaves")
        return False

    def _numbers(self, node: Node) -> Quantities:
        try:
            return quantities(node)
        except WrongQuantity as wrong:
            raise RiskError(f"{node.place()}: {wrong}" if node.places else str(wrong)) from None

    def _element(self, node: Node, kind: str | None) -> None:
        numbers = self._numbers(node)
        if node.without or node.within is not None or node.own_values:
            self._timed.append(node.name)
        if node.leaf:
            self._leaves[node.name] = self._leaf(node, node.name, numbers)
            return
        name, parts = node.name, list(self._ordered(node))
        gate = RiskGate(name, _op(node, kind), tuple(parts), node.threshold or 0, node.kind, node.label, numbers)
        if node.on is None and node.when is None:
            self._gates[name] = gate
            return
        own = f"{'event' if node.on is not None else 'guard'} of {name}"
        inner = f"parts of {name}"
        self._gates[inner] = RiskGate(inner, gate.op, gate.children, gate.need)
        self._leaves[own] = self._leaf(node, own, numbers)
        if node.on is None:
            self._gates[name] = RiskGate(name, Op.AND, (inner, own), 0, node.kind, node.label, numbers)
        else:
            order = (inner, own) if self._bottom_up else (own, inner)
            self._gates[name] = RiskGate(name, Op.SEQUENCE, order, 0, node.kind, node.label, numbers)

    def _ordered(self, node: Node) -> Iterable[str]:
        return reversed(node.children) if node.gate is Gate.SAND_RL else node.children

    def _leaf(self, node: Node, name: str, numbers: Quantities) -> Leaf:
        guard = node.on is None and node.when is not None
        if guard and numbers.rate is not None:
            raise RiskError(f"{node.name} is a guard, which holds or not, and has a rate: write prob=P")
        if guard and numbers.chance is None:
            self._assumed.append(node.name)
            numbers = Quantities(chance=1.0)
        if node.on is not None and node.when is not None:
            if time_points(node.when):
                self._timed.append(node.name)
            elif not set(variables(node.when)) <= set(node.on.variables):
                self._assumed.append(node.name)
        fails = node.on is None or self._galileo or node.name in self._persistent
        once = fails if numbers.once is None else numbers.once
        return Leaf(name, node.name, numbers, once or guard, node.times, node.kind, node.label, guard)

    def _through_gates(self) -> None:
        """Let dependents that are gates fail by an own leaf, which nothing but the trigger brings about."""
        new: dict[str, str] = {}
        for place, dependency in enumerate(self._dependencies):
            for gate in [name for name in dependency.dependents if name in self._gates]:
                if gate in new:
                    continue
                new[gate] = f"dependence of {gate}"
                self._leaves[new[gate]] = Leaf(new[gate], gate, Quantities(rate=0.0), once=True)
                old = self._gates[gate]
                inner = f"parts of {gate}"
                self._gates[inner] = RiskGate(inner, old.op, old.children, old.need)
                self._gates[gate] = replace(old, op=Op.OR, children=(inner, new[gate]), need=0)
            for name in dependency.dependents:
                if name not in self._gates and name not in self._leaves:
                    raise RiskError(f"{name}, a dependent of {dependency.name}, never fails")
            dependents = tuple(new.get(name, name) for name in dependency.dependents)
            self._dependencies[place] = replace(dependency, dependents=dependents)

    def _read_native_pands(self, kinds: Mapping[str, str]) -> None:
        """Read `pand` over events that recur as a sequence, which it is over single events."""
        for name, gate in self._gates.items():
            if gate.op is not Op.PRIORITY or name.removeprefix("parts of ") in kinds:
                continue
            form = RiskTree(name, self._leaves, self._gates)
            leaves = [self._leaves[one] for one in form.order() if one in self._leaves]
            if all(leaf.once for leaf in leaves):
                continue
            if not all(child in self._leaves and self._leaves[child].times == 1 for child in gate.children):
                self._timed.append(name.removeprefix("parts of "))
            self._gates[name] = replace(gate, op=Op.SEQUENCE)


def _op(node: Node, kind: str | None) -> Op:
    match kind:
        case None:
            pass
        case "wsp" | "csp" | "hsp" | "spare":
            return Op.SPARE
        case "pand":
            return Op.PRIORITY
        case "por":
            return Op.FIRST
        case "seq":
            return Op.SEQUENCE
        case "sor":
            return Op.OR
        case _:
            raise RiskError(f"the gate `{kind}` of {node.name} is not analysed")
    assert node.gate is not None
    match node.gate:
        case Gate.OR:
            return Op.OR
        case Gate.AND:
            return Op.AND
        case Gate.VOT:
            return Op.AT_LEAST
        case Gate.SAND | Gate.SAND_RL:
            return Op.SEQUENCE
        case Gate.PAND:
            return Op.PRIORITY
        case _:
            assert_never(node.gate)


def _reached(form: RiskTree) -> RiskTree:
    """Return the form without what the root does not depend on, checked for what cannot be analysed."""
    kept = set(form.needed(form.root))
    return replace(
        form,
        leaves=MappingProxyType({name: leaf for name, leaf in form.leaves.items() if name in kept}),
        gates=MappingProxyType({name: gate for name, gate in form.gates.items() if name in kept}),
        dependencies=tuple(
            replace(one, dependents=tuple(name for name in one.dependents if name in kept))
            for one in form.dependencies
            if any(name in kept for name in one.dependents)
        ),
        restrictions=tuple(one for one in form.restrictions if any(child in kept for child in one.children)),
        assumed=tuple(name for name in form.assumed if name in kept or f"guard of {name}" in kept),
        timed=tuple(name for name in form.timed if name in kept),
    )


def later_leaves(form: RiskTree) -> set[str]:
    """Return the leaves whose clock starts with a later part of a sequence."""
    return {
        name
        for gate in form.gates.values()
        if gate.op is Op.SEQUENCE
        for child in gate.children[1:]
        for name in below(form, [child])
    }
