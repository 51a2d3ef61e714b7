"""Galileo's `pand`, translated exactly for observed failures.

In Galileo a gate fails *once*, at the first time at which its condition holds, and `pand` asks that
its inputs fail from left to right. This language's own `pand` asks the same of some match, and a
later input with several ways to fail has matches that end after its first failure. So the absent
events of `without` say that this input had not failed before the earlier ones.

A set of basic events without which a gate cannot fail is a *cut*. A gate has not failed yet if and
only if all basic events of some cut have not failed yet. Of two inputs X and Y of a `pand`, X fails first if

- every match of Y ends at its failure (Y is *fixed*), and a match of X ends before it; or
- no basic event of a cut of Y fails before the end of a match of X, and Y fails: those of the cut
  that its match uses fail after X, and the others are absent.

They fail at the same time if one basic event, which both share, is the last that both need.
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import combinations, pairwise, product
from typing import Final, NamedTuple, TypeAlias

from rvaft.errors import LanguageError
from rvaft.language.draft import Draft, DraftNode, GateUse, Located, Reading
from rvaft.model.guards import renamed, time_points, variables
from rvaft.model.nodes import EventType, Gate, On, Place, Side, Without
from rvaft.model.patterns import Literal, ObjectPattern, Variable
from rvaft.model.tree import find_cycle

Events: TypeAlias = frozenset[str]
_SHOWN: Final = 3
"""The maximum number of names in the name of a new node."""
_MOST_EVENTS: Final = 200_000
"""The maximum number of pairs of a gate and a basic event below it."""
_MOST_CUTS: Final = 64
"""The maximum number of cuts of an input."""
_MOST_NODES: Final = 5_000
"""The maximum number of new nodes, and of steps to find the cuts of a gate."""
_DEEPEST: Final = 100
"""The maximum depth of an input that is translated."""
_LONGEST: Final = 60
"""The maximum length of the name of a new node, before it is cut."""
NOTHING: Final = ""
"""The condition that always holds, in place of the name of a node."""
FIXED: Final = "is read as `pand`: its inputs fail from left to right"
EXACT: Final = "is read with `without`: each input fails, at the first time, no later than the next one"


class FaultGate(NamedTuple):
    """A gate of the fault tree with its children."""

    gate: Gate
    children: tuple[str, ...]
    threshold: int | None = None


class Facts(NamedTuple):
    """What is known of a node: the basic events below it, those that every failure of it needs, and
    those that can be the last; whether all its matches end at its failure; and how deep it is.
    """

    events: Events
    needed: Events
    last: Events
    fixed: bool
    depth: int = 0


def read_priority_gates(draft: Draft, gates: list[tuple[str, Place]], sharing: Events = frozenset()) -> None:
    """Translate the `pand` gates with these names and places, and record them in `dynamic_gates`.

    `sharing` are the gates that share spares, for which cuts do not say when they have not failed.
    Raises `LanguageError` for gates that are not fixed and have no exact translation.
    """
    reading = FaultTree(draft, dict(gates), sharing)
    if gates and reading.valid():
        reading.translate()
    for name, place in gates:
        how = EXACT if name in reading.changed else FIXED
        draft.dynamic_gates.append(Reading(place, f"`pand` of {name} {how}", (name,)))


def unordered(draft: Draft, names: Iterable[str], dependents: Iterable[str]) -> list[str]:
    """Return which of these gates have two children that share a basic event, or later ones with dependent events."""
    reading = FaultTree(draft, {})
    if not reading.valid():
        return []

    names = [name for name in names if name in reading.shapes]
    found = []
    for name in names:
        below = [reading.facts(child).events for child in reading.shapes[name].children]
        if sum(map(len, below)) > len(frozenset[str]().union(*below)):
            found.append(name)
    dependent = reading.above(set(dependents))
    return found + [name for name in names if not dependent.isdisjoint(reading.shapes[name].children[1:])]


def _error(message: str, place: Place) -> LanguageError:
    return LanguageError(message, file=place.file, line=place.line, column=place.column)


class Form(NamedTuple):
    """One translation: a gate with the title of its node, and the basic events that do not fail before its end."""

    title: str
    shape: FaultGate
    absent: Events = frozenset()


class FaultTree:
    """The gates of a fault tree (`shapes`), in which a `pand` has Galileo's meaning until it is translated."""

    def __init__(self, draft: Draft, places: dict[str, Place], sharing: Events = frozenset()) -> None:
        self.draft = draft
        self.places = places
        self.sharing = sharing
        self.changed: set[str] = set()
        self.shapes: dict[str, FaultGate] = {}
        self.origin: dict[str, str] = {}
        """The gate for which a node was made."""
        self.source: dict[str, str] = {}
        """The node of which a node is a copy under a condition."""
        self.waiting: list[str] = []
        self._facts: dict[str, Facts] = {}
        self._made: dict[object, str] = {}
        self._new: set[str] = set()
        self._failures: dict[str, On] = {}
        self._dominated: dict[str, Events] = {}
        self._size = 0
        self.leaves = {child.value for node in draft.nodes.values() for child in node.children()}
        for node in draft.nodes.values():
            if node.gates:
                use = node.gates[0].value
                gate = Gate.OR if use.gate is Gate.PAND and len(use.children) == 1 else use.gate
                self.shapes[node.name] = FaultGate(gate, tuple([child.value for child in use.children]), use.threshold)

    def valid(self) -> bool:
        """Whether the gates form a graph that a tree can have; other errors are reported later."""
        for name, shape in self.shapes.items():
            out_of_range = shape.gate.counts and not 1 <= (shape.threshold or 0) <= len(shape.children)
            if len(self.draft.nodes[name].gates) > 1 or len(set(shape.children)) < len(shape.children) or out_of_range:
                return False
        below = {name: [c for c in shape.children if c in self.shapes] for name, shape in self.shapes.items()}
        return not find_cycle(below)

    def translate(self) -> None:
        """Translate each gate that is not exact as it is, and drop the nodes that it replaces."""
        before = self._reached()
        self.waiting = [name for name in self.places if not self._is_exact(name)]
        for name in self.waiting:
            self._pair(name)
        for name in self.waiting:
            self._merge(name)
        self.waiting = [name for name in self.waiting if self.shapes[name].gate is Gate.PAND]
        self._dominated = {name: self._only_below(name) for name in self.waiting}
        while self.waiting:
            self._translate(self.waiting.pop())
        for name in (before | self._new) - self._reached():
            self.draft.nodes.pop(name, None)

    # What is known of nodes

    def facts(self, name: str) -> Facts:
        """Return the facts of a node; raises `LanguageError` if it is too large."""
        todo = [name]
        while todo:
            node = todo[-1]
            waiting = [child for child in self._below(node) if child not in self._facts]
            if waiting:
                todo += waiting
                continue
            todo.pop()
            if node not in self._facts:
                self._facts[node] = found = self._combined(node)
                self._size += len(found.events)
                if self._size > _MOST_EVENTS:
                    raise self._refusal(node, f"it has more than {_MOST_EVENTS:,} pairs of a gate and an event below")
        return self._facts[name]

    def above(self, names: set[str]) -> set[str]:
        """Return these nodes and those above them, of the nodes whose facts are known."""
        found: set[str] = set()
        for node in self._facts:  # children come first
            if node in names or not found.isdisjoint(self._below(node)):
                found.add(node)
        return found

    def _below(self, name: str) -> tuple[str, ...]:
        shape = self.shapes.get(name)
        return shape.children if shape else ()

    def _combined(self, name: str) -> Facts:
        if name not in self.shapes:
            own = frozenset([name])
            return Facts(own, own, own, fixed=True)
        shape = self.shapes[name]
        below = [self._facts[child] for child in shape.children]
        events = frozenset[str]().union(*[one.events for one in below])
        needed = [event for event in events if sum(event in one.needed for one in below) > self._spare(shape)]
        match shape.gate:
            case Gate.SAND | Gate.PAND:
                last = below[-1].last
            case Gate.SAND_RL:
                last = below[0].last
            case _:
                last = frozenset[str]().union(*[one.last for one in below])
        fixed = (
            below[-1].fixed if shape.gate is Gate.PAND else all(one.fixed for one in below) and not self._spare(shape)
        )
        return Facts(events, frozenset(needed), last, fixed, 1 + max(one.depth for one in below))

    @staticmethod
    def _spare(shape: FaultGate) -> int:
        """Return how many children a gate can do without."""
        match shape.gate:
            case Gate.OR:
                return len(shape.children) - 1
            case Gate.VOT:
                return len(shape.children) - (shape.threshold or 0)
            case _:
                return 0

    def _is_exact(self, name: str) -> bool:
        """Whether this language's `pand` means the same."""
        children = self.shapes[name].children
        return all(self.facts(y).fixed and not self.facts(x).last & self.facts(y).last for x, y in pairwise(children))

    def _refusal(self, name: str, why: str) -> LanguageError:
        places = [self.places.get(self.origin.get(name, name)), *self.places.values(), Place(self.draft.file)]
        place = next(place for place in places if place)
        return _error(f"a {'`pand`' if self.places else 'dynamic gate'} above {name} cannot be read: {why}", place)

    # From several inputs to two

    def _pair(self, name: str) -> None:
        """Give a `pand` two inputs, of which the first is a `pand` if it had more."""
        *first, last = self.shapes[name].children
        if len(first) > 1:
            inner = self._make(" then ".join(first), FaultGate(Gate.PAND, tuple(first)), name)
            self.shapes[name] = FaultGate(Gate.PAND, (inner, last))
            self._write(name, self.shapes[name])
            if not self._is_exact(inner):
                self.waiting.append(inner)

    def _merge(self, name: str) -> None:
        """Replace X before (Y before Z) by (X and Y) before Z, which is the same, unless Z is fixed."""
        while self.shapes[name].gate is Gate.PAND:
            x, inner = self.shapes[name].children
            shape = self.shapes.get(inner)
            if shape is None or shape.gate is not Gate.PAND or self.facts(inner).fixed:
                return
            self._check_plain(inner)
            y, z = shape.children
            alone = sum(inner in other.children for other in self.shapes.values()) == 1
            pair = FaultGate(
                Gate.PAND, (self._make(f"{x} and {y}", FaultGate(Gate.AND, tuple(dict.fromkeys((x, y)))), name), z)
            )
            self._facts.clear()
            if alone:  # the inner gate keeps its place in the tree
                self.shapes[name], self.shapes[inner] = FaultGate(Gate.OR, (inner,)), pair
                self._write(name, self.shapes[name])
                self._write(inner, pair)
                name = inner
            else:
                self.shapes[name] = pair
                self._write(name, pair)

    # The translation of one gate

    def _translate(self, name: str) -> None:
        x, y = self.shapes[name].children
        for one in (x, y):
            if self.facts(one).depth > _DEEPEST:
                raise self._refusal(one, f"it is nested more than {_DEEPEST} levels deep")
        found = [*self._strictly(name, x, y), *self._together(name, x, y)]
        if not found:
            raise self._refusal(name, "its inputs cannot fail in this order")
        forms = list(dict.fromkeys(found))
        shape = forms[0].shape
        if len(forms) > 1 or forms[0].absent:
            shape = FaultGate(Gate.OR, tuple([self._node(name, form) for form in forms]))
        self.changed.add(self.origin.get(name, name))
        self._write(name, shape)

    def _strictly(self, name: str, x: str, y: str) -> Iterator[Form]:
        """Yield the ways in which x fails before y."""
        if self.facts(y).fixed:
            yield Form(f"{y} after {x}", FaultGate(Gate.PAND, (x, y)))
            return
        for cut in self._cuts(y):
            first = self._never(x, cut)
            if first is None:
                continue
            absent = cut - self.facts(y).needed
            self._check_only_below(name, absent)
            if absent:
                first = self._node(name, Form(f"{x} before {y}", FaultGate(Gate.OR, (first,)), absent))
            yield self._after(name, x, first, y, cut)

    def _together(self, name: str, x: str, y: str) -> Iterator[Form]:
        """Yield the ways in which x and y fail at the same time."""
        for event in sorted(self.facts(x).last & self.facts(y).last):
            cuts = [frozenset([event])] if self.facts(y).fixed else [cut for cut in self._cuts(y) if event in cut]
            for cut in cuts:
                absent = cut - {event}
                others = [self._given(one, event, absent) for one in (x, y)]
                if None in others:
                    continue
                self._check_only_below(name, absent)
                before = list(dict.fromkeys(one for one in others if one))
                shape = FaultGate(Gate.OR, (event,))
                if before:
                    first = before[0]
                    if len(before) > 1:
                        first = self._make(" and ".join(before), FaultGate(Gate.AND, tuple(before)), name)
                    shape = FaultGate(Gate.SAND, (first, event))
                yield Form(f"{y} with {x}", shape, absent)

    def _after(self, name: str, x: str, first: str, y: str, cut: Events) -> Form:
        """Return the failure of y, of whose basic events those of a cut come after `first`, which is x."""
        title = f"{y} after {x}"
        if self.facts(y).events <= cut:
            return Form(title, FaultGate(Gate.SAND, (first, y)))
        if self.shapes[y].gate in (Gate.SAND, Gate.SAND_RL):
            return Form(title, FaultGate(Gate.AND, (y, *self._parts_after(name, x, first, y, cut))))
        below = []
        for child in self.shapes[y].children:
            touched = self.facts(child).events & cut
            below.append(self._node(name, self._after(name, x, first, child, cut)) if touched else child)
        return Form(title, self.shapes[y]._replace(children=tuple(below)))

    def _parts_after(self, name: str, x: str, first: str, y: str, cut: Events) -> Iterator[str]:
        """Yield the failures after `first` of those parts of a sequence y that have basic events of a cut.

        The sequence itself orders its parts, so what is before `first` need not be the part before.
        """
        for child in self.shapes[y].children:
            events = self.facts(child).events
            if not events & cut:
                continue
            if not (events <= cut or self.facts(child).fixed):
                raise self._refusal(y, f"its part {child} can fail in several ways, of which only some are after {x}")
            yield self._node(name, self._after(name, x, first, child, cut))

    def _check_only_below(self, name: str, absent: Events) -> None:
        """Raise `LanguageError` if an absent event can be used by another part of a match."""
        for event in sorted(absent - self._dominated[self.source.get(name, name)]):
            why = f"the absence of {event} from it cannot be asked for, because other gates use {event}, too"
            raise self._refusal(name, why)

    # Parts of the fault tree under a condition

    def _cuts(self, name: str) -> list[Events]:
        """Return the sets of basic events without which a node cannot fail."""
        if name not in self.shapes:
            return [frozenset([name])]
        self._check_plain(name)
        shape = self.shapes[name]
        if name in self.sharing:
            raise self._refusal(
                name, "it fails after another input, and the order of failures decides whether it has a spare"
            )
        if shape.gate is Gate.PAND:
            raise self._refusal(name, "it is an input of a gate with choices, which fails after another one")
        below = [self._cuts(child) for child in shape.children]
        found: set[Events] = set()
        steps = 0
        for some in combinations(below, self._spare(shape) + 1):
            for cuts in product(*some):
                steps += 1
                found.add(frozenset[str]().union(*cuts))
                if len(found) > _MOST_CUTS or steps > _MOST_NODES:
                    raise self._refusal(name, f"it can be kept from failing in more than {_MOST_CUTS} ways")
        return sorted((cut for cut in found if not any(other < cut for other in found)), key=sorted)

    def _never(self, name: str, events: Events) -> str | None:
        """Return a node without these basic events; None if it cannot fail without them."""
        events &= self.facts(name).events
        if not events:
            return name
        if name not in self.shapes:
            return None
        self._check_plain(name)
        shape = self.shapes[name]
        below = [self._never(child, events) for child in shape.children]
        return self._rest(f"{name} without {_listed(events)}", name, shape, below)

    def _given(self, name: str, event: str, absent: Events) -> str | None:
        """Return what else must have failed if a node fails with this basic event, which is the last."""
        if event not in self.facts(name).events:
            return self._never(name, absent)
        if name not in self.shapes:
            return NOTHING
        self._check_plain(name)
        shape = self.shapes[name]
        if event not in self.facts(name).last:  # it fails before this event, or not with it
            return self._never(name, absent | {event})
        if shape.gate is not Gate.PAND:
            below = [self._given(child, event, absent) for child in shape.children]
            return self._rest(f"{name} but {event}", name, shape, below)
        without = self._never(name, absent | {event})
        *first, last = shape.children
        if event not in self.facts(last).needed:
            raise self._refusal(name, f"it shares {event} with a later input")
        x = first[0] if len(first) == 1 else self._make(" then ".join(first), FaultGate(Gate.PAND, tuple(first)), name)
        both = FaultGate(Gate.AND, (x, last))
        found = self._rest(f"{name} but {event}", name, both, [self._given(one, event, absent) for one in (x, last)])
        if without is None or found == NOTHING or found is None:
            return without if found is None else found
        return self._make(f"{name} with {event}", FaultGate(Gate.OR, (without, found)), name)

    def _rest(self, title: str, name: str, shape: FaultGate, below: list[str | None]) -> str | None:
        """Return a gate over what remains of its children: None cannot fail, and NOTHING has failed."""
        need = len(below) - self._spare(shape) - below.count(NOTHING)
        left = tuple([one for one in below if one])
        if need <= 0:
            return NOTHING
        if len(left) < need:
            return None
        return self._make(title, shape._replace(children=left, threshold=shape.threshold and need), name, like=name)

    def _check_plain(self, name: str) -> None:
        node = self.draft.nodes[name]
        if self.shapes[name].gate is Gate.PAND and self.origin.get(name, name) not in self.places:
            raise self._refusal(name, f"{name} is a `pand` of this language, not of Galileo")
        if node.ons or node.whens or node.withins or node.withouts:
            raise self._refusal(name, f"{name} has an event, a guard, a window or an absent event of its own")

    # Nodes of the draft

    def _make(self, title: str, shape: FaultGate, name: str, like: str = "") -> str:
        """Return a gate of the fault tree, made for the gate `name`, with label and kind of another one."""
        key = shape, like
        if key not in self._made:
            made = self._made[key] = self._added(title, shape, name)
            self.shapes[made] = shape
            self.origin[made] = self.origin.get(name, name)
            if like:
                self.source[made] = self.source.get(like, like)
                copied = self.draft.nodes[like]
                self.draft.nodes[made].labels, self.draft.nodes[made].kinds = [*copied.labels], [*copied.kinds]
            if shape.gate is Gate.PAND and like and not self._is_exact(made):
                self.waiting.append(made)
        return self._made[key]

    def _node(self, name: str, form: Form) -> str:
        """Return a node of the translation of a gate."""
        title, shape, absent = form
        if shape.gate is Gate.OR and len(shape.children) == 1 and not absent:
            return shape.children[0]
        key = shape, absent
        if key not in self._made:
            made = self._made[key] = self._added(title, shape, name)
            sides = [Side.BEFORE] if self._is_single(shape) else [Side.BEFORE, Side.DURING]
            place = self.draft.nodes[made].place
            for event in sorted(absent):
                clauses = [replace(self._failure(event), side=side) for side in sides]
                self.draft.nodes[made].withouts += [Located(clause, place) for clause in clauses]
        return self._made[key]

    def _added(self, title: str, shape: FaultGate, name: str) -> str:
        """Add a node to the draft, at the place of a gate, and return its name."""
        short = title = title if len(title) <= _LONGEST else f"{title[:_LONGEST]}..."
        number = 1
        while title in self.draft.nodes or title in self.leaves:
            number += 1
            title = f"{short} ({number})"
        place = self.draft.nodes[self.origin.get(name, name)].place
        self.draft.nodes[title] = DraftNode(title, statements=[place], made=True)
        self._new.add(title)
        if len(self._new) > _MOST_NODES:
            raise self._refusal(name, f"its translation has more than {_MOST_NODES:,} nodes")
        self._write(title, shape)
        return title

    def _write(self, name: str, shape: FaultGate) -> None:
        node = self.draft.nodes[name]
        place = node.gates[0].place if node.gates else node.place
        children = tuple([Located(child, place) for child in shape.children])
        node.gates = [Located(GateUse(shape.gate, children, shape.threshold), place)]

    def _is_single(self, shape: FaultGate) -> bool:
        """Whether a gate has one event."""
        below = [self.shapes[child] for child in shape.children if child in self.shapes]
        return shape.gate is Gate.OR and all(map(self._is_single, below))

    def _failure(self, name: str) -> Without:
        """Return the absence of a basic event, of which the side is open."""
        node = self.draft.nodes.get(name) or DraftNode(name)
        guard = node.whens[0].value if node.whens else None
        if node.counts or node.withouts or time_points(guard) or (guard and not node.ons):
            raise self._refusal(name, "its event may come several times, or depends on others")
        if node.ons:
            on = node.ons[0].value
            own = self._own_names(name, {*on.variables, *variables(guard)})
            arguments = [
                Variable(own.get(one.name, one.name)) if isinstance(one, Variable) else one for one in on.arguments
            ]
            return Without(On(on.event, tuple(arguments)), guard and renamed(guard, own), Side.BEFORE)
        if name not in self._failures:
            event = name
            while any(event == one.name for one in self.draft.events):
                event += "'"
            pattern = ObjectPattern((("event", Literal(name)),))
            self.draft.events.append(EventType(event, (), pattern, node.place if node.statements else Place()))
            self._failures[name] = On(event, ())
        return Without(self._failures[name], None, Side.BEFORE)

    def _own_names(self, name: str, names: set[str]) -> dict[str, str]:
        """Return other names for the variables that only this leaf has: their absence is that of any value."""
        others = [node for node in self.draft.nodes.values() if node.name != name]
        used = {one for node in others for on in node.ons for one in on.value.variables}
        used.update(one for node in others for guard in node.whens for one in variables(guard.value))
        found: dict[str, str] = {}
        for one in sorted(names - used):
            found[one] = f"{one}_"
            while found[one] in used or found[one] in names:
                found[one] += "_"
        return found

    def _roots(self) -> list[str]:
        return [top.value for top in self.draft.toplevels] or [node.name for node in self.draft.parentless()]

    def _reached(self, but: str | None = None) -> set[str]:
        """Return the nodes below the root, reached without passing through one of them."""
        found: set[str] = set()
        todo = self._roots()
        while todo:
            name = todo.pop()
            if name in found or name == but:
                continue
            found.add(name)
            if name in self.draft.nodes:
                todo += [child.value for child in self.draft.nodes[name].children()]
        return found

    def _only_below(self, name: str) -> Events:
        """Return the basic events that no part of the tree uses but this gate."""
        return self.facts(name).events - self._reached(but=name)


def _listed(events: Iterable[str]) -> str:
    names = sorted(events)
    return ", ".join(names if len(names) <= _SHOWN else [*names[: _SHOWN - 1], f"{len(names) - _SHOWN + 1} more"])
