"""The translation to RML as it was published, never repaired (Cardoso, Ferrando, Fisher, FMAS 2022, sections 3.2 and 4.2)."""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from itertools import combinations, product
from math import comb
from time import perf_counter
from typing import ClassVar, Final

from backends.rml.backend import HIGHLIGHTING
from backends.rml.writer.names import LARGEST, RESERVED, quoted
from rvaft.backend import Backend, Highlighting, Metrics, Observed, Specification
from rvaft.errors import NotExpressible, TooLarge
from rvaft.model.guards import Guard, Operation, Operator, holds
from rvaft.model.guards import variables as guard_variables
from rvaft.model.nodes import Causality, Gate, Node
from rvaft.model.patterns import Anything, ListPattern, Literal, ObjectPattern, Pattern, Variable, rigid_variables
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json, Scalar
from rvaft.model.verdict import Semantics
from rvaft.monitors import Monitor

# Event types as the paper writes them: a pattern, and the guards whose last variable the event binds behind `with`.
#
# `with` of RML knows numbers only; a comparison with a string, and one of two variables by `!=`, become event types of
# their own that stand beside the event: `(move(newWp) /\ not_move)`.

AND = " /\\ "
_WORDS = {Operator.AND: "&&", Operator.OR: "||"}
_FLIPPED = {
    Operator.LT: Operator.GE,
    Operator.GE: Operator.LT,
    Operator.GT: Operator.LE,
    Operator.LE: Operator.GT,
    Operator.EQ: Operator.NE,
    Operator.NE: Operator.EQ,
}


@dataclass
class Declarations:
    """The event types written so far; equal ones are written once."""

    semantics: str
    lines: list[str] = field(default_factory=list)
    _known: dict[str, str] = field(default_factory=dict)
    _variables: dict[str, str] = field(default_factory=dict)
    _taken: set[str] = field(default_factory=set)

    def refuse(self, reason: str, node: str) -> NotExpressible:
        """The error for something that RML cannot say."""
        return NotExpressible(reason, backend="rml-paper", semantics=self.semantics, nodes=[node])

    def variable(self, name: str) -> str:
        """A variable of the tree as RML writes it: lower case."""
        if name not in self._variables:
            self._variables[name] = self._fresh(name[:1].lower() + name[1:])
        return self._variables[name]

    def _fresh(self, wish: str) -> str:
        base = "".join(c if c.isascii() and (c.isalnum() or c == "_") else "_" for c in wish)
        base = base[:1].lower() + base[1:] if base[:1].isalpha() else f"e{base}"
        name, number = base, 1
        while name in self._taken or name in RESERVED:
            number += 1
            name = f"{base}_{number}"
        self._taken.add(name)
        return name

    def declare(self, wish: str, parameters: Iterable[str], matches: str) -> str:
        """An event type with that right-hand side; how it is called in an expression."""
        given = ", ".join(parameters)
        call = f"({given})" if given else ""
        key = f"{call} {matches}"
        if key not in self._known:
            self._known[key] = self._fresh(wish)
            self.lines.append(f"{self._known[key]}{call} {matches};")
        return f"{self._known[key]}{call}"

    # -- patterns ------------------------------------------------------------------------------------------------------

    def pattern(self, pattern: Pattern, node: str) -> str:
        """A pattern; its rigid variables are left as parameters."""
        match pattern:
            case Anything():
                return "_"
            case Variable(name):
                return self.variable(name if not name.startswith("_") else f"local{name}")
            case Literal(value):
                return self._literal(value, node)
            case ObjectPattern(fields):
                return "{" + ", ".join(f"{quoted(name)}: {self.pattern(p, node)}" for name, p in fields) + "}"
            case ListPattern(items):
                return "[" + ", ".join(self.pattern(item, node) for item in items) + "]"

    def _literal(self, value: Scalar, node: str) -> str:
        match value:
            case None:
                return "null"
            case bool():
                return "true" if value else "false"
            case str():
                return quoted(value)
            case _ if value < 0 or abs(value) > LARGEST:
                raise self.refuse(f"RML has no number {value} in a pattern", node)
            case _:
                return format(Decimal(repr(value)), "f")

    # -- guards --------------------------------------------------------------------------------------------------------

    def data(self, guard: Guard, node: str) -> str:
        """A guard over numbers as a data expression, every operation in parentheses."""
        match guard:
            case Variable(name):
                return self.variable(name)
            case Literal(value) if isinstance(value, (int, float)) and not isinstance(value, bool):
                digits = format(Decimal(repr(abs(value))), "f")
                return digits if value >= 0 else f"(-{digits})"
            case Operation(Operator.NEGATE, (operand,)):
                return f"(-{self.data(operand, node)})"
            case Operation(Operator.NOT, (Operation(operator, operands),)) if operator in _FLIPPED:
                return self.data(Operation(_FLIPPED[operator], operands), node)
            case Operation(operator, operands) if operator is not Operator.NOT:
                return f"({f' {_WORDS.get(operator, operator)} '.join(self.data(o, node) for o in operands)})"
            case _:
                raise self.refuse("a guard that is not a comparison of numbers", node)

    def event(self, wish: str, pattern: Pattern, guards: Iterable[Guard], node: str) -> str:
        """One event with the guards that are checked when it comes, as a term."""
        numeric: list[str] = []
        beside: list[str] = []
        for guard in (part for whole in guards for part in _conjuncts(whole)):
            other = self._beside(wish, pattern, guard, node)
            (beside if other else numeric).append(other or self.data(guard, node))
        names = dict.fromkeys((*_names(pattern), *(v for g in guards for v in guard_variables(g) if numeric)))
        parameters = [self.variable(name) for name in names]
        condition = f" with {' && '.join(numeric)}" if numeric else ""
        main = self.declare(wish, parameters, f"matches {self.pattern(pattern, node)}{condition}")
        return f"({AND.join([main, *beside])})" if beside else main

    def _beside(self, wish: str, pattern: Pattern, guard: Guard, node: str) -> str | None:
        """A comparison with a string, or an inequality of two variables, as an event type of its own."""
        filled: Pattern
        match guard:
            case Operation(Operator.EQ | Operator.NE as operator, (Variable(name), Literal(str() as text))):
                negated, filled, parameters = operator is Operator.NE, Literal(text), []
            case Operation(Operator.NE, (Variable(left), Variable(right))):
                name, other = (left, right) if left in _names(pattern) else (right, left)
                negated, filled, parameters = True, Variable(other), [self.variable(other)]
            case _:
                return None
        if name not in _names(pattern):
            raise self.refuse(f"{name} is not bound by the event that checks it", node)
        kept = _only(pattern, name, filled)
        matches = f"{'not ' if negated else ''}matches {self.pattern(kept, node)}"
        return self.declare(f"{'not_' if negated else 'is_'}{wish}", parameters, matches)


def _conjuncts(guard: Guard) -> list[Guard]:
    if isinstance(guard, Operation) and guard.operator is Operator.AND:
        return [part for operand in guard.operands for part in _conjuncts(operand)]
    return [guard]


def _names(pattern: Pattern) -> list[str]:
    match pattern:
        case Variable(name):
            return [] if name.startswith("_") else [name]
        case ObjectPattern(fields):
            return [name for _, inner in fields for name in _names(inner)]
        case ListPattern(items):
            return [name for inner in items for name in _names(inner)]
        case _:
            return []


def _only(pattern: Pattern, name: str, filled: Pattern) -> Pattern:
    """The pattern with one variable replaced and the others open."""
    match pattern:
        case Variable(other):
            return filled if other == name else Anything()
        case ObjectPattern(fields):
            return ObjectPattern(tuple((field_, _only(inner, name, filled)) for field_, inner in fields))
        case ListPattern(items):
            return ListPattern(tuple(_only(inner, name, filled) for inner in items))
        case _:
            return pattern


# The gates of section 3.2: from a branch to a term over its occurrences.
#
# OR   a \/ b \/ c                     (resolved before: the branches are joined by \/)
# VOT  (a T_bc) \/ (b T_ac) \/ (c T_ab)   with one equation for each set of children that is left
# AND  a | b | c
# SAND a b c, or c b a

OR = " \\/ "
Choices = dict[str, str]
SYMBOLS: Final = 10
"""How many symbols of unrolled VOT gates the limit allows for each term it allows: few terms may have very many options."""
_AROUND: Final = 4
"""The symbols of an option `(a T_bc) \\/` beside those of its child."""


@dataclass
class Writer:
    """Writes terms; `occurrence` names the event of a node in the branch at hand, `equations` are those of the VOT gates."""

    limit: int
    equations: dict[str, str] = field(default_factory=dict)
    written: int = 0
    symbols: int = 0

    def count(self, terms: int = 1, *, symbols: int = 0) -> None:
        """That many more terms, and symbols of VOT gates; raises `TooLarge` beyond the limit."""
        self.written += terms
        self.symbols += symbols
        if self.written > self.limit:
            raise TooLarge("terms of the paper's translation", limit=self.limit)
        if self.symbols > SYMBOLS * self.limit:
            raise TooLarge(f"symbols of the paper's VOT, {SYMBOLS} allowed for each term", limit=self.limit)

    def branch(self, tree: RVAFT, choices: Choices, occurrence: Callable[[str], str | None], prefix: str) -> str:
        """The term of a branch; the empty text for one without occurrences."""
        done: dict[str, str] = {}
        for node in tree.bottom_up():
            self.count()
            children = (choices[node.name],) if node.name in choices else node.children
            if all(child in done for child in children):
                event = occurrence(node.name)
                body = self._gate(node, [done[child] for child in children if done[child]], f"{prefix}{len(done)}")
                parts = [event or "", body]
                in_order = parts if tree.causality is Causality.TOP_DOWN else parts[::-1]
                done[node.name] = _sequence(part for part in in_order if part)
        return done[tree.root]

    def _gate(self, node: Node, parts: list[str], name: str) -> str:
        if len(parts) < 2 and node.gate is not Gate.VOT:
            return "".join(parts)
        match node.gate:
            case Gate.AND:
                return f"({' | '.join(parts)})"
            case Gate.SAND:
                return _sequence(parts)
            case Gate.SAND_RL:
                return _sequence(reversed(parts))
            case Gate.VOT:
                missing = len(node.children) - len(parts)  # children without occurrences count as observed
                return self._unrolled(parts, max((node.threshold or 0) - missing, 0), name)
            case Gate.OR | None:
                return OR.join(parts)

    def _unrolled(self, parts: list[str], k: int, name: str) -> str:
        """The hierarchy of terms that counts down from k: an equation for each set of children that is left, larger sets first."""
        if k == 0:
            return ""
        once = sum(_AROUND + len(part.split()) for part in parts)
        for gone in range(k):
            self.count(comb(len(parts), gone), symbols=comb(len(parts) - 1, gone) * once)

        def named(left: Sequence[int]) -> str:
            return f"{name}_{'_'.join(map(str, left))}"

        everything = range(len(parts))
        for gone in range(k):
            for removed in combinations(everything, gone):
                left = [i for i in everything if i not in removed]
                rest = {i: f" {named([j for j in left if j != i])}" if gone < k - 1 else "" for i in left}
                self.equations[named(left)] = OR.join(f"({parts[i]}{rest[i]})" for i in left)
        return named(everything)


def _sequence(parts: Iterable[str]) -> str:
    """The parts one after the other; a name before a parenthesis is set apart, since RML would read a call."""
    written = ""
    for part in parts:
        if written and part.startswith("(") and written[-1] != ")":
            written = f"({written})"
        written = f"{written} {part}".strip()
    return written


def branches(tree: RVAFT, limit: int) -> Iterator[Choices]:
    """The branches in the order of their numbers: the `or` nearest the root varies fastest."""
    ring, seen = [tree.root], {tree.root}
    for name in ring:
        fresh = [child for child in tree.nodes[name].children if child not in seen]
        seen.update(fresh)
        ring += fresh
    ors = [name for name in ring if tree.nodes[name].gate is Gate.OR]
    written: set[tuple[tuple[str, str], ...]] = set()
    options = [tree.nodes[name].children for name in reversed(ors)]
    for number, picked in enumerate(product(*options)):
        if number >= limit:
            raise TooLarge("branches of the paper's translation", limit=limit)
        choices = dict(zip(reversed(ors), picked, strict=True))
        reached = _reached(tree, choices)
        kept = {name: child for name, child in choices.items() if name in reached}
        key = tuple(sorted(kept.items()))
        if key not in written:
            written.add(key)
            yield kept


def _reached(tree: RVAFT, choices: Choices) -> set[str]:
    reached, todo = set[str](), [tree.root]
    while todo:
        name = todo.pop()
        if name not in reached:
            reached.add(name)
            todo.extend((choices[name],) if name in choices else tree.nodes[name].children)
    return reached


def reading_order(tree: RVAFT, choices: Choices) -> list[str]:
    """The occurrences of a branch in the order in which its term is written: the last one that binds a variable checks guards."""
    order: list[str] = []
    todo: list[tuple[str, bool]] = [(tree.root, False)]
    while todo:
        name, closing = todo.pop()
        node = tree.nodes[name]
        if closing:
            order.append(name)
            continue
        children = (choices[name],) if name in choices else node.children
        children = children[::-1] if node.gate is Gate.SAND_RL else children
        if tree.causality is Causality.TOP_DOWN:
            order.append(name)
        else:
            todo.append((name, True))
        todo.extend((child, False) for child in reversed(children))
    last = {name: index for index, name in enumerate(order)}
    return [name for index, name in enumerate(order) if last[name] == index and tree.nodes[name].has_event]


# The whole text: event types, equations of the VOT gates, and the union of the branches.

_TOKEN = re.compile(r"\w+|/\\|\\/|>>|[^\s\w]")


def specification(tree: RVAFT, semantics: Semantics, limit: int) -> tuple[str, int, int]:
    """The text, the number of tokens of its equations, and how many these are."""
    types = Declarations(semantics.value)
    writer = Writer(limit)
    terms = []
    for number, choices in enumerate(branches(tree, limit), 1):
        guards = _folded(tree, choices)
        if guards is not None:
            names = {name: _event(tree, types, name, guards[name]) for name in guards}
            terms.append(writer.branch(tree, choices, names.get, f"V{number}_"))
    terms = [term for term in terms if term]
    if not terms:
        reason = "as the paper unrolls the gates, every branch has a guard that never holds"
        raise NotExpressible(reason, backend="rml-paper", semantics=semantics, nodes=[tree.root])
    union = terms[0] if len(terms) == 1 else f"({OR.join(f'({term})' for term in terms)})"
    variables = sorted(types.variable(name) for name in tree.variables)
    main = f"{union} all" if len(terms) > 1 or not _loose(union) else f"({union}) all"
    if variables:
        main = f"{{let {', '.join(variables)}; {main}}}"
    if semantics is Semantics.PROJECTED:
        main = _filtered(tree, types, main)
    equations = [f"{name} = {body};" for name, body in writer.equations.items()]
    body = [f"Main = {main};", *equations]
    symbols = sum(len(_TOKEN.findall(line)) for line in body)
    return "\n".join([f"// {semantics}, as the paper translates it", *types.lines, *body, ""]), symbols, len(body)


def _loose(term: str) -> bool:
    """Whether a union stands outside all parentheses."""
    depth = 0
    for index, character in enumerate(term):
        depth += (character == "(") - (character == ")")
        if depth == 0 and term.startswith("\\/", index):
            return True
    return False


def _folded(tree: RVAFT, choices: Choices) -> dict[str, list[Guard]] | None:
    """For each occurrence of a branch the guards it checks: those whose last variable, in writing, it binds.

    None where a guard without variables does not hold.
    """
    order = reading_order(tree, choices)
    guards: dict[str, list[Guard]] = {name: [] for name in order}
    binders = [(name, set(rigid_variables(pattern))) for name in order if (pattern := tree.pattern(name)) is not None]
    for name in _nodes(tree, choices):
        guard = tree.nodes[name].when
        if guard is None:
            continue
        names = set(guard_variables(guard))
        if not names:
            if not holds(guard, {}):
                return None
            continue
        first = {v: next(n for n, bound in binders if v in bound) for v in names}
        guards[max(first.values(), key=order.index)].append(guard)
    return guards


def _nodes(tree: RVAFT, choices: Choices) -> list[str]:
    kept = {tree.root}
    for name in tree.order:
        if name in kept:
            kept.update((choices[name],) if name in choices else tree.nodes[name].children)
    return [name for name in tree.order if name in kept]


def _event(tree: RVAFT, types: Declarations, name: str, guards: list[Guard]) -> str:
    pattern = tree.pattern(name)
    assert pattern is not None
    on = tree.nodes[name].on
    return types.event(name if on is None else on.event, pattern, guards, name)


def _filtered(tree: RVAFT, types: Declarations, main: str) -> str:
    """`relevant >> …`, and around it a filter for each `ignore`."""
    parents = []
    for entry in tree.alphabet:
        term = types.event(f"seen_{entry.node}", entry.pattern, [] if entry.when is None else [entry.when], entry.node)
        if term.startswith("("):
            raise types.refuse("a guard that a filter cannot check", entry.node)
        parents.append(re.sub(r"\w+(?=[,)])", "_", term) if "(" in term else term)
    relevant = types.declare("relevant", [], f"matches {' | '.join(dict.fromkeys(parents))}")
    main = f"{relevant} >> ({main})"
    for ignore in tree.ignores:
        term = types.event(
            "ignored", tree.instantiate(ignore.on), [] if ignore.when is None else [ignore.when], "ignore"
        )
        if term.startswith("("):
            raise types.refuse("an `ignore` whose guard a filter cannot check", "ignore")
        call = re.sub(r"\w+(?=[,)])", "_", term) if "(" in term else term
        kept = types.declare("kept", [], f"not matches {call}")
        main = f"{kept} >> ({main})"
    return main


# The `rml-paper` backend: to the letter, defects included.


class RmlPaperBackend(Backend):
    """The paper's own translation: gates as printed, VOT unrolled, a union of the branches in their order, `all` behind.

    Not faithful: RML's union commits to its left operand, so a union of branches with a common start misses the later ones, and
    the unrolled VOT means exactly K and loses interleavings of compound children. `limit` counts the terms written,
    ten symbols of the unrolled VOT gates being allowed for each.
    """

    name: ClassVar[str] = "rml-paper"
    language: ClassVar[str] = "rml"
    suffix: ClassVar[str] = ".rml"
    highlighting: ClassVar[Highlighting] = HIGHLIGHTING
    faithful: ClassVar[bool] = False
    semantics: ClassVar[frozenset[Semantics]] = frozenset({Semantics.STRICT, Semantics.PROJECTED})
    default_limit: ClassVar[int] = 20_000

    def translate(self, tree: RVAFT, semantics: Semantics, *, limit: int | None = None) -> Specification:
        """The tree as an RML text; raises `NotExpressible` and `TooLarge`."""
        semantics = Semantics(semantics)
        if semantics not in self.semantics:
            raise NotExpressible("the paper does not say how", backend=self.name, semantics=semantics)
        start = perf_counter()
        text, symbols, equations = specification(tree, semantics, self.default_limit if limit is None else limit)
        metrics = Metrics(symbols=symbols, states=equations, seconds=perf_counter() - start)
        return Specification(text, self.language, metrics, self.read)

    def read(self, text: str, *, atoms: Mapping[str, Pattern] | None = None) -> Monitor:  # noqa: ARG002
        """A monitor that runs an RML text; its texts define their events, so `atoms` is not looked at."""
        from backends.rml.reader.monitor import read  # noqa: PLC0415 -- imported on use

        return read(text)

    def observed(self, text: str, *, atoms: Mapping[str, Pattern] | None = None) -> tuple[Observed, ...] | None:  # noqa: ARG002
        """What the event types that an RML text uses ask of events; None where patterns with guards cannot say it."""
        from backends.rml.reader.observations import observed  # noqa: PLC0415 -- imported on use

        return observed(text)

    def masked(self, text: str, trace: Sequence[Json]) -> tuple[str, ...]:
        """The titles of the rows in the table of deviations that the text touches on the trace."""
        from backends.rml.reader.deviations import touching  # noqa: PLC0415 -- imported on use

        return tuple(deviation.title for deviation in touching(text, trace))


__all__ = ["RmlPaperBackend"]
