r"""The RML translation as published, without repairs (Cardoso, Ferrando, Fisher, FMAS 2022,
sections 3.2 and 4.2).

  OR   a \/ b \/ c                         (resolved before: the branches are joined by \/)
  VOT  (a T_bc) \/ (b T_ac) \/ (c T_ab)    with one equation per set of remaining children
  AND  a | b | c
  SAND a b c, or c b a

An event is an event type with a pattern; its `with` has the guards whose last variable the event
binds. `with` only supports numbers. A comparison with a string, or `!=` of two variables, becomes
an event type beside the event: `(move(newWp) /\ not_move)`.
"""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from itertools import combinations, product
from math import comb, prod
from typing import ClassVar, Final, assert_never

from backends.rml import RmlBackend
from backends.rml.writer.terms import LARGEST, RmlNames, applied, quoted, spellings
from rvaft.backend import Metrics, SpecificationText
from rvaft.capabilities import Capability, Feature
from rvaft.core.passes import Pass
from rvaft.core.property import EndInOrder, Part, Property, Times, Within, WithoutEvent
from rvaft.errors import NotExpressible, Reason, TooLarge, unwritten
from rvaft.model.guards import (
    ARITHMETIC,
    COMPARISONS,
    JUNCTIONS,
    OPERATORS,
    Guard,
    Operation,
    Operator,
    conjuncts,
    holds,
    time_points,
)
from rvaft.model.guards import variables as guard_variables
from rvaft.model.nodes import Assumption, Causality, Gate, Node
from rvaft.model.patterns import (
    Anything,
    ListPattern,
    Literal,
    ObjectPattern,
    Pattern,
    SomeItem,
    Variable,
    rigid_variables,
    substitute,
    variables,
)
from rvaft.model.tree import RVAFT, reachable
from rvaft.model.verdict import Semantics

SYMBOLS: Final = 10
"""Symbols of unrolled VOT gates per term of the limit: few terms may have many options."""
CHARACTERS: Final = 100
"""Characters of one term per term of the limit."""
_AROUND: Final = 4
r"""The symbols of an option `(a T_bc) \\/` without its child."""
_UNSAID: Final = unwritten("the paper does not define it")
_AND, _OR = " /\\ ", " \\/ "
_SIGNS: Final = {op: facts.sign for op, facts in OPERATORS.items()} | {Operator.AND: "&&", Operator.OR: "||"}
_TOKEN: Final = re.compile(r"\w+|/\\|\\/|>>|[^\s\w]")


def _refusal(reason: str, semantics: Semantics, node: str) -> NotExpressible:
    return NotExpressible(unwritten(reason), backend="rml-paper", semantics=semantics, nodes=[node])


@dataclass(frozen=True, slots=True)
class PaperBranch:
    """A numbered branch of a tree; `choices` holds the child that each `or` gate keeps."""

    tree: RVAFT
    number: int
    choices: Mapping[str, str]

    def children(self, name: str) -> tuple[str, ...]:
        """Return the children of a node that the branch keeps."""
        return (self.choices[name],) if name in self.choices else self.tree.nodes[name].children

    def kept(self) -> list[str]:
        """Return the nodes of the branch, parents before children."""
        return sorted(reachable(self.tree.root, self.children), key=self.tree.rank.__getitem__)


def or_gates(tree: RVAFT) -> list[str]:
    """Return the reachable `or` gates, breadth first."""
    order = dict.fromkeys([tree.root])
    todo = [tree.root]
    for name in todo:
        todo.extend(child for child in tree.nodes[name].children if child not in order)
        order.update(dict.fromkeys(tree.nodes[name].children))
    return [name for name in order if tree.nodes[name].gate is Gate.OR]


def paper_branches(tree: RVAFT) -> Iterator[PaperBranch]:
    """Yield all branches in the order of their numbers, by the definition.

    A branch is a choice per `or` gate; the first gate varies fastest. An unreachable gate keeps its
    first child.
    """
    gates, number = or_gates(tree), 0
    for digits in product(*(range(len(tree.nodes[name].children)) for name in reversed(gates))):
        chosen = dict(zip(gates, reversed(digits), strict=True))
        branch = PaperBranch(tree, 0, {name: tree.nodes[name].children[digit] for name, digit in chosen.items()})
        reached = set(reachable(tree.root, branch.children))
        if all(name in reached for name, digit in chosen.items() if digit):
            number += 1
            yield PaperBranch(tree, number, {name: kept for name, kept in branch.choices.items() if name in reached})


class PaperTypes:
    """The event types so far (`lines`), without duplicates."""

    def __init__(self, semantics: Semantics) -> None:
        self.lines: list[str] = []
        self._semantics = semantics
        self._known: dict[str, str] = {}
        self._variables: dict[str, str] = {}
        self._names = RmlNames()

    def variable(self, name: str) -> str:
        """Return an RML name for a variable: lower case."""
        if name not in self._variables:
            self._variables[name] = self._fresh(name[:1].lower() + name[1:])
        return self._variables[name]

    def _fresh(self, wish: str) -> str:
        base = "".join(c if c.isascii() and (c.isalnum() or c == "_") else "_" for c in wish)
        return self._names.distinct(base[:1].lower() + base[1:] if base[:1].isalpha() else f"e{base}")

    def declare(self, wish: str, parameters: Sequence[str], matches: str) -> str:
        """Add an event type with this right-hand side, and return its use."""
        key = applied(" ", parameters) + matches
        if key not in self._known:
            self._known[key] = applied(self._fresh(wish), parameters)
            self.lines.append(f"{self._known[key]} {matches};")
        return self._known[key]

    def event(self, wish: str, pattern: Pattern, guards: Sequence[Guard], node: str) -> str:
        """Return an event with the guards checked at it, as a term."""
        numeric: list[str] = []
        beside: list[str] = []
        for guard in (part for whole in guards for part in conjuncts(whole)):
            other = self._beside(wish, pattern, guard, node)
            (beside if other else numeric).append(other or self._data(guard, node))
        checked = [name for guard in guards for name in guard_variables(guard)] if numeric else []
        parameters = [self.variable(name) for name in dict.fromkeys((*rigid_variables(pattern), *checked))]
        condition = f" with {' && '.join(numeric)}" if numeric else ""
        main = self.declare(wish, parameters, f"matches {self._pattern(pattern, node)}{condition}")
        return f"({_AND.join([main, *beside])})" if beside else main

    def event_type(self, wish: str, pattern: Pattern, when: Guard | None, node: str, what: str) -> str:
        """Return an event for a filter, for any values."""
        term = self.event(wish, pattern, [] if when is None else [when], node)
        if term.startswith("("):
            raise _refusal(what, self._semantics, node)
        return re.sub(r"\w+(?=[,)])", "_", term) if "(" in term else term

    def _beside(self, wish: str, pattern: Pattern, guard: Guard, node: str) -> str | None:
        """Return a string comparison, or an inequality of variables, as a separate event type."""
        bound = rigid_variables(pattern)
        filled: Pattern
        match guard:
            case Operation(Operator.EQ | Operator.NE as operator, (Variable(name), Literal(str()) as filled)):
                negated, parameters = operator is Operator.NE, list[str]()
            case Operation(Operator.NE, (Variable(left), Variable(right))):
                name, other = (left, right) if left in bound else (right, left)
                negated, filled, parameters = True, Variable(other), [self.variable(other)]
            case _:
                return None
        if name not in bound:
            raise _refusal(f"{name} is not bound by the event that checks it", self._semantics, node)
        by: dict[str, Pattern] = {**dict.fromkeys(variables(pattern), Anything()), name: filled}
        matches = f"{'not ' if negated else ''}matches {self._pattern(substitute(pattern, by), node)}"
        return self.declare(f"{'not_' if negated else 'is_'}{wish}", parameters, matches)

    def _pattern(self, pattern: Pattern, node: str) -> str:
        match pattern:
            case Anything():
                return "_"
            case Variable(name):
                return self.variable(f"local{name}" if pattern.local else name)
            case Literal(str() | bool() | None as value):
                return "".join(spellings(value) or ())
            case Literal(int() | float() as value) if 0 <= value <= LARGEST:
                return format(Decimal(repr(value)), "f")
            case Literal(value):
                raise _refusal(f"RML has no number {value} in a pattern", self._semantics, node)
            case ObjectPattern(fields):
                return f"{{{', '.join(f'{quoted(name)}: {self._pattern(p, node)}' for name, p in fields)}}}"
            case ListPattern(items):
                return f"[{', '.join(self._pattern(item, node) for item in items)}]"
            case SomeItem():
                raise _refusal("RML has no pattern for some item of a list", self._semantics, node)

    def _data(self, guard: Guard, node: str) -> str:
        match guard:
            case Variable(name):
                return self.variable(name)
            case Literal(value) if isinstance(value, int | float) and not isinstance(value, bool):
                digits = format(Decimal(repr(abs(value))), "f")
                return digits if value >= 0 else f"(-{digits})"
            case Operation(Operator.NEGATE, (operand,)):
                return f"(-{self._data(operand, node)})"
            case Operation(Operator.NOT, (Operation(operator, operands),)) if negated := OPERATORS[operator].negated:
                return self._data(Operation(negated, operands), node)
            case Operation(operator, operands) if operator in ARITHMETIC | COMPARISONS | JUNCTIONS:
                return f"({f' {_SIGNS[operator]} '.join(self._data(operand, node) for operand in operands)})"
            case _:
                raise _refusal("a guard that is not a comparison of numbers", self._semantics, node)


class PaperTerms:
    """Writes the terms of branches; `equations` are those of VOT gates."""

    def __init__(self, limit: int) -> None:
        self.equations: dict[str, str] = {}
        self._limit = limit
        self._written = self._symbols = self._length = 0

    def _count(self, terms: int, *, symbols: int = 0) -> None:
        self._written += terms
        self._symbols += symbols
        if self._written > self._limit:
            raise TooLarge("terms of the paper's translation", limit=self._limit)
        if self._symbols > SYMBOLS * self._limit:
            raise TooLarge(f"symbols of the paper's VOT, {SYMBOLS} allowed for each term", limit=self._limit)

    def term(self, branch: PaperBranch, events: Mapping[str, str]) -> str:
        """Return the term of a branch over the events of its nodes; empty without occurrences."""
        done: dict[str, str] = {}
        last = len(branch.tree.order) - 1
        for node in [branch.tree.nodes[name] for name in reversed(branch.kept())]:
            self._count(1)
            children, place = branch.children(node.name), last - branch.tree.rank[node.name]
            below = self._joined(node, [done[c] for c in children if done[c]], f"V{branch.number}_{place}")
            parts = [events.get(node.name, ""), below]
            in_order = parts if branch.tree.causality is Causality.TOP_DOWN else parts[::-1]
            done[node.name] = term = _sequence(part for part in in_order if part)
            if len(term) > CHARACTERS * self._limit:  # shared nodes are repeated
                raise TooLarge(f"characters of the paper's terms, {CHARACTERS} allowed for each", limit=self._limit)
        return done[branch.tree.root]

    def _joined(self, node: Node, parts: list[str], name: str) -> str:
        match node.gate:
            case Gate.VOT:
                assert node.threshold is not None
                missing = len(node.children) - len(parts)  # children without occurrences count as observed
                return self._unrolled(parts, max(node.threshold - missing, 0), name)
            case Gate.AND if len(parts) > 1:
                return f"({' | '.join(parts)})"
            case Gate.SAND | Gate.SAND_RL:
                ordered = parts if node.gate is Gate.SAND else parts[::-1]
                return _sequence(ordered) if len(parts) > 1 else "".join(parts)
            case None | Gate.OR | Gate.AND:
                return _OR.join(parts)
            case Gate.PAND:
                raise AssertionError("the paper has no pand")
            case _:
                assert_never(node.gate)

    def _unrolled(self, parts: list[str], k: int, name: str) -> str:
        """Return the terms that count down from k: an equation per set of remaining children,
        larger sets first.
        """
        if k == 0:
            return ""
        once = sum(_AROUND + len(part.split()) for part in parts)
        for gone in range(k):
            self._count(comb(len(parts), gone), symbols=comb(len(parts) - 1, gone) * once)

        def named(left: Iterable[int]) -> str:
            return f"{name}_{'_'.join(map(str, left))}"

        everything = range(len(parts))
        for gone in range(k):
            for removed in combinations(everything, gone):
                left = [i for i in everything if i not in removed]
                rest = {i: f" {named(j for j in left if j != i)}" if gone < k - 1 else "" for i in left}
                self.equations[named(left)] = _OR.join(f"({parts[i]}{rest[i]})" for i in left)
        return named(everything)


def _sequence(parts: Iterable[str]) -> str:
    """Return a sequence; parentheses separate a name from a following one, which RML would read as
    a call.
    """
    written = ""
    for part in parts:
        if written and part.startswith("(") and written[-1] != ")":
            written = f"({written})"
        written = f"{written} {part}".strip()
    return written


def _folded(branch: PaperBranch) -> dict[str, list[Guard]] | None:
    """Return for each occurrence the guards that it checks: those whose last variable it binds.

    None if the branch is infeasible: a constant guard does not hold, or a variable is unbound.
    """
    tree, guards = branch.tree, dict[str, list[Guard]]()
    binder: dict[str, str] = {}
    for name in _reading_order(branch):
        pattern = tree.pattern(name)
        if pattern is not None:
            guards[name] = []
            for variable in rigid_variables(pattern):
                binder.setdefault(variable, name)
    place = {name: index for index, name in enumerate(guards)}
    for guard in (guard for name in branch.kept() if (guard := tree.nodes[name].when) is not None):
        names = guard_variables(guard)
        if (not names and not holds(guard, {})) or any(name not in binder for name in names):
            return None
        if names:
            guards[max((binder[name] for name in names), key=place.__getitem__)].append(guard)
    return guards


def _reading_order(branch: PaperBranch) -> list[str]:
    """Return the nodes of a branch in the order of its term; a shared node at its last position.

    The order is computed backwards from the end of the term.
    """
    order: dict[str, None] = {}
    todo: list[tuple[str, bool]] = [(branch.tree.root, False)]
    while todo:
        name, closing = todo.pop()
        if name in order:
            continue
        if closing or branch.tree.causality is not Causality.TOP_DOWN:
            order[name] = None
        else:
            todo.append((name, True))
        if not closing:
            reverse = branch.tree.nodes[name].gate is Gate.SAND_RL
            todo.extend((child, False) for child in branch.children(name)[:: -1 if reverse else 1])
    return list(order)[::-1]


def specification(tree: RVAFT, semantics: Semantics, limit: int) -> tuple[str, int, int]:
    """Return the text, the number of tokens of its equations, and the number of equations."""
    for node in tree.top_down():  # impossible parts may contain constructs that the capability check does not see
        if node.gate is Gate.PAND or node.times > 1 or node.within is not None or time_points(node.when):
            raise _refusal(_UNSAID.text, semantics, node.name)
    types, writer, terms = PaperTypes(semantics), PaperTerms(limit), list[str]()
    if prod(len(tree.nodes[name].children) for name in or_gates(tree)) > limit:
        raise TooLarge("branches of the paper's translation", limit=limit)
    for branch in paper_branches(tree):
        guards = _folded(branch)
        if guards is not None:
            events = {
                name: types.event(on.event if (on := tree.nodes[name].on) else name, pattern, checked, name)
                for name, checked in guards.items()
                if (pattern := tree.pattern(name)) is not None
            }
            terms.append(writer.term(branch, events))
    terms = [term for term in terms if term]
    if not terms:
        reason = "as the paper unrolls the gates, every branch has a guard that never holds"
        raise _refusal(reason, semantics, tree.root)
    union = terms[0] if len(terms) == 1 else f"({_OR.join(f'({term})' for term in terms)})"
    names = sorted(types.variable(name) for name in tree.variables)
    main = f"({union}) all" if len(terms) == 1 and _is_loose(union) else f"{union} all"
    if names:
        main = f"{{let {', '.join(names)}; {main}}}"
    if semantics is Semantics.PROJECTED:
        main = _filtered(tree, types, main)
    lines = [f"Main = {main};", *(f"{name} = {text};" for name, text in writer.equations.items())]
    symbols = sum(len(_TOKEN.findall(line)) for line in lines)
    return "\n".join([f"// {semantics}, as the paper translates it", *types.lines, *lines, ""]), symbols, len(lines)


def _is_loose(term: str) -> bool:
    depth = 0
    for index, character in enumerate(term):
        depth += (character == "(") - (character == ")")
        if depth == 0 and term.startswith("\\/", index):
            return True
    return False


def _filtered(tree: RVAFT, types: PaperTypes, main: str) -> str:
    refused = "a guard that a filter cannot check"
    parents = [types.event_type(f"seen_{e.node}", e.pattern, e.when, e.node, refused) for e in tree.alphabet]
    relevant = types.declare("relevant", [], f"matches {' | '.join(dict.fromkeys(parents))}")
    main = f"{relevant} >> ({main})"
    refused = "an `ignore` whose guard a filter cannot check"
    for ignore in tree.ignores:
        call = types.event_type("ignored", tree.instantiate(ignore.on), ignore.when, "ignore", refused)
        main = f"{types.declare('kept', [], f'not matches {call}')} >> ({main})"
    return main


class RmlPaperBackend(RmlBackend):
    """The paper's translation: gates as printed, VOT unrolled, a union of the branches in order,
    then `all`.

    It is not faithful. RML's union commits to its left operand, so a union of branches with a
    common start misses the later ones. The unrolled VOT means exactly K and loses interleavings of
    compound children. `limit` counts terms; each allows ten symbols of unrolled VOT gates and a
    hundred characters of one term.
    """

    name: ClassVar[str] = "rml-paper"
    faithful: ClassVar[bool] = False
    semantics: ClassVar[frozenset[Semantics]] = frozenset({Semantics.STRICT, Semantics.PROJECTED})
    says: ClassVar[frozenset[type[Part]]] = RmlBackend.says - {WithoutEvent}
    passes: ClassVar[tuple[Pass, ...]] = ()
    needs: ClassVar[Mapping[Capability, frozenset[Assumption]]] = {}
    reasons: ClassVar[Mapping[Capability, Reason]] = {
        **RmlBackend.reasons,
        **dict.fromkeys((Semantics, Times, EndInOrder, Within, WithoutEvent, Feature.TIME_POINTS), _UNSAID),
    }

    def write(self, prop: Property, semantics: Semantics, limit: int) -> SpecificationText:
        """Return the text of the paper's translation; raises `NotExpressible` and `TooLarge`."""
        text, symbols, equations = specification(prop.requested or prop.tree, semantics, limit)
        return SpecificationText(text, Metrics(symbols=symbols, states=equations))
