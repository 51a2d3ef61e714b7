"""Progression of formulas in canonical form, and satisfiability of the residuals.

A residual is a Boolean function. Its variables stand for "the rest is not empty and satisfies g",
numbered as g. One event yields whether the formula holds if the trace ends here, and the residual
if it continues. After Bacchus and Kabanza, Using temporal logics to express search control
knowledge for planning (Artificial Intelligence, 2000), with the strong next and the end of the
trace.
"""

from collections.abc import Iterable, Iterator, Mapping
from functools import cache, lru_cache
from typing import Final, NamedTuple, TypeAlias, assert_never

from backends.ltlf.formulas import FALSE, JUNCTIONS, TRUE, Connective, Formulas
from rvaft.errors import TooLarge
from rvaft.support.budget import Call, run

NODE_LIMIT: Final = 2_000_000
SEARCH_LIMIT: Final = 1_000_000
STEPS: Final = 3_000_000
"""Maximum number of elementary steps per event, and for reading the formula."""
_ATOM: Final = 5
"""Cost of evaluating one atom on an event, in steps."""
STEPS_KEPT: Final = 200_000
"""Size of the cache of progressions, for all residuals together."""

BOTTOM: Final = 0
TOP: Final = 1
_CONSTANT: Final = -1
"""The variable of constants: below all others."""


class Steps:
    """The elementary steps left for this event, about a microsecond each."""

    def __init__(self) -> None:
        self.left = STEPS

    def take(self, steps: int) -> None:
        """Subtract some steps; raises `TooLarge` when none are left."""
        self.left -= steps
        if self.left < 0:
            remedy = "run the tree by the engine or another backend, or put fewer events into one window"
            raise TooLarge("steps for one event of an LTLf formula", limit=STEPS, remedy=remedy)


class _Diagrams:
    """Reduced ordered binary decision diagrams (BDDs), with the largest variable on top.

    Loops replace recursion, for thousands of variables. Nodes are never freed. After Bryant,
    Graph-Based Algorithms for Boolean Function Manipulation (IEEE Transactions on Computers, 1986).
    """

    def __init__(self, steps: Steps) -> None:
        self._steps = steps
        self.nodes = [(_CONSTANT, BOTTOM, BOTTOM), (_CONSTANT, TOP, TOP)]
        self._index: dict[tuple[int, int, int], int] = {}
        self._choices: dict[tuple[int, int, int], int] = {}
        self.support = cache(lambda f: sorted({self.nodes[node][0] for node in self._below(f)}, reverse=True))
        """The variables of a function, topmost first."""

    def variable(self, number: int) -> int:
        return self._node(number, BOTTOM, TOP)

    def negation(self, f: int) -> int:
        return self.choice(f, BOTTOM, TOP)

    def implies(self, f: int, g: int) -> bool:
        return self.choice(f, g, TOP) == TOP

    def joined(self, op: Connective, parts: Iterable[int]) -> int:
        """Return the junction of functions, lowest first, so that each step works near the top."""
        found = TOP if op is Connective.AND else BOTTOM
        for part in sorted(set(parts), key=lambda f: self.nodes[f][0]):
            found = self.choice(part, found, BOTTOM) if op is Connective.AND else self.choice(part, TOP, found)
        return found

    def _node(self, variable: int, low: int, high: int) -> int:
        if low == high:
            return low
        key = (variable, low, high)
        found = self._index.setdefault(key, len(self.nodes))
        if found == len(self.nodes):
            if found > NODE_LIMIT:
                raise TooLarge("the residual formulas have more nodes", limit=NODE_LIMIT)
            self.nodes.append(key)
        return found

    def choice(self, f: int, g: int, h: int) -> int:
        nodes, known, steps = self.nodes, self._choices, self._steps
        todo: list[tuple[int, int, int, int]] = [(f, g, h, _CONSTANT)]
        done: list[int] = []
        while todo:
            f, g, h, variable = todo.pop()
            steps.left -= 1
            if steps.left < 0:
                steps.take(1)
            if variable != _CONSTANT:  # both branches are done
                high, low = done.pop(), done.pop()
                known[f, g, h] = self._node(variable, low, high)
                done.append(known[f, g, h])
            elif f <= TOP or g == h:
                done.append(h if f == BOTTOM else g)
            elif g == TOP and h == BOTTOM:
                done.append(f)
            elif (f, g, h) in known:
                done.append(known[f, g, h])
            else:
                variable = max(nodes[f][0], nodes[g][0], nodes[h][0])
                (f0, f1), (g0, g1), (h0, h1) = (
                    nodes[part][1:] if nodes[part][0] == variable else (part, part) for part in (f, g, h)
                )
                todo += [(f, g, h, variable), (f1, g1, h1, _CONSTANT), (f0, g0, h0, _CONSTANT)]
        return done.pop()

    def _below(self, f: int) -> list[int]:
        seen = {BOTTOM, TOP}
        todo = [f]
        while todo:
            node = todo.pop()
            if node not in seen:
                seen.add(node)
                todo.extend(self.nodes[node][1:])
        self._steps.take(len(seen))
        return sorted(seen)[2:]

    def compose(self, f: int, by: Mapping[int, int]) -> int:
        made = {BOTTOM: BOTTOM, TOP: TOP}
        for node in self._below(f):
            variable, low, high = self.nodes[node]
            low, high, new = made[low], made[high], by[variable]
            made[node] = self.choice(new, high, low)
        return made[f]


class Progression(NamedTuple):
    """Whether the formula holds if the trace ends after this event, and the residual otherwise."""

    accepted: bool
    residual: int


def _union(sets: Iterable[frozenset[str]]) -> frozenset[str]:
    return frozenset().union(*sets)


_CONSTANTS: Final = {TRUE: Progression(True, TOP), FALSE: Progression(False, BOTTOM)}


class Residuals:
    """The residuals of some formulas; `mentions` maps atoms to their variables."""

    def __init__(self, formulas: Formulas, mentions: Mapping[str, frozenset[str]]) -> None:
        self._formulas = formulas
        self._steps = Steps()
        self._diagrams = _Diagrams(self._steps)
        self._continuations = _Continuations(formulas, self._diagrams, self._steps)
        self._lifted: dict[int, int] = {TRUE: TOP, FALSE: BOTTOM}
        self._asks = cache(lambda formula: frozenset(formulas.atoms(formula, now=True)))
        self._after = lru_cache(STEPS_KEPT)(lambda one, letter: run(self._progress(one, letter, dict(_CONSTANTS))))
        self.step = lru_cache(STEPS_KEPT)(self._stepped)
        self.now = cache(lambda residual: _union(map(self._asks, self._diagrams.support(residual))))
        """The atoms that the next event decides."""
        self.variables = cache(
            lambda residual: _union(self._variables[one] for one in self._diagrams.support(residual))
        )
        """The variables that can still affect the residual."""
        self.is_satisfiable = self._continuations.satisfied
        """Whether a non-empty continuation satisfies a residual."""
        self._bare: list[bool] = []
        self._monotone: list[bool] = []
        """Per formula: whether it consists of `F`, `&` and `|`: if true later, it is true now."""
        self._variables: list[frozenset[str]] = []
        for op, operands, name in formulas.rows:
            bare = op in (Connective.NOT, *JUNCTIONS) and any(self._bare[operand] for operand in operands)
            monotone = op in JUNCTIONS and all(self._monotone[operand] for operand in operands)
            names = (self._variables[operand] for operand in operands)
            self._bare.append(bare or op is Connective.ATOM)
            self._monotone.append(monotone or op is Connective.EVENTUALLY)
            self._variables.append(mentions.get(name, frozenset()).union(*names))

    def begin(self) -> None:
        """Reset the steps for a new event."""
        self._steps.left = STEPS

    def ask(self, atoms: int) -> None:
        """Count evaluated atoms; raises `TooLarge`."""
        self._steps.take(_ATOM * atoms)

    def of(self, formula: int) -> int:
        """Return the residual of the formula itself."""
        return run(self._lift(formula))

    def is_valid(self, residual: int) -> bool:
        """Return whether every non-empty continuation satisfies the residual."""
        return not self.is_satisfiable(self._diagrams.negation(residual))

    def _stepped(self, residual: int, letter: frozenset[str]) -> Progression:
        """Return the residual after one event; `letter` holds the true atoms among `now`."""
        support = self._diagrams.support(residual)
        after = {formula: self._after(formula, letter & self._asks(formula)) for formula in support}
        end = self._diagrams.compose(
            residual, {formula: TOP if one.accepted else BOTTOM for formula, one in after.items()}
        )
        rest = self._diagrams.compose(residual, {formula: one.residual for formula, one in after.items()})
        return Progression(end == TOP, rest)

    def _lift(self, formula: int) -> Call[int]:
        """Split Boolean combinations of `F`, `U` and `X[!]`; other formulas become one variable."""
        if formula in self._lifted:
            return self._lifted[formula]
        op, operands, _ = self._formulas.rows[formula]
        if op is Connective.NOT:
            lifted = self._diagrams.negation((yield self._lift(operands[0])))
        elif op in JUNCTIONS and not self._bare[formula]:
            parts: list[int] = []
            for operand in operands:
                parts += [(yield self._lift(operand))]
            lifted = self._diagrams.joined(op, parts)
        else:
            lifted = self._diagrams.variable(formula)
        self._lifted[formula] = lifted
        return lifted

    def _progress(self, formula: int, letter: frozenset[str], known: dict[int, Progression]) -> Call[Progression]:
        if formula in known:
            return known[formula]
        diagrams = self._diagrams
        op, operands, name = self._formulas.rows[formula]
        self._steps.take(1 + len(operands))
        match op:
            case Connective.TRUE | Connective.FALSE:
                found = known[formula]
            case Connective.ATOM:
                found = known[TRUE if name in letter else FALSE]
            case Connective.NOT:
                inner = yield self._progress(operands[0], letter, known)
                found = Progression(not inner.accepted, diagrams.negation(inner.residual))
            case Connective.AND | Connective.OR:
                decided = known[FALSE if op is Connective.AND else TRUE]
                parts: list[Progression] = []
                while len(parts) < len(operands) and decided not in parts[-1:]:
                    parts += [(yield self._progress(operands[len(parts)], letter, known))]
                if parts[-1] == decided:
                    found = decided
                else:
                    accepted = (all if op is Connective.AND else any)(part.accepted for part in parts)
                    found = Progression(accepted, diagrams.joined(op, [part.residual for part in parts]))
            case Connective.NEXT:
                found = Progression(accepted=False, residual=(yield self._lift(operands[0])))
            case Connective.EVENTUALLY:
                found = yield self._progress(operands[0], letter, known)
                if found.residual == BOTTOM or not self._implies_again(operands[0]):
                    rests = [found.residual, diagrams.variable(formula)]
                    found = Progression(found.accepted, diagrams.joined(Connective.OR, rests))
            case Connective.UNTIL:
                found = yield self._progress(operands[1], letter, known)
                if found != known[TRUE]:
                    stay = yield self._progress(operands[0], letter, known)
                    later = diagrams.joined(Connective.AND, [stay.residual, diagrams.variable(formula)])
                    found = Progression(found.accepted, diagrams.joined(Connective.OR, [found.residual, later]))
            case _:
                assert_never(op)
        known[formula] = found
        return found

    def _implies_again(self, formula: int) -> bool:
        """Return whether the rest of a formula g, once begun, follows from `F g` on the rest of the
        trace.

        This holds for g = p & X[!] h with monotone h: if g holds later, h holds there later, hence
        at the beginning. Without it, the residuals of long sequences grow with each repetition.
        """
        row = self._formulas.rows[formula]
        operands = row.operands if row.op is Connective.AND else (formula,)
        rows = [self._formulas.rows[operand] for operand in operands]
        rests = [inner.operands[0] for inner in rows if inner.op is Connective.NEXT]
        atoms = sum(inner.op is Connective.ATOM for inner in rows)
        return len(rests) + atoms == len(rows) and len(rests) <= 1 and all(self._monotone[rest] for rest in rests)


_Obligations: TypeAlias = frozenset[int]
"""Formulas that the rest must satisfy; the complement ~f means "must not satisfy f"."""

_Item: TypeAlias = tuple[int, bool]
"""An obligation, and whether it concerns the next position, which must then exist."""

_Clause: TypeAlias = list[list[_Item]]
"""A disjunction of conjunctions of items."""


class _Continuations:
    """A lazy search for a continuation that satisfies a residual, without an automaton.

    The search runs over sets of obligations and tries the nearest fulfilment first. All letters
    count, including infeasible ones.
    """

    def __init__(self, formulas: Formulas, diagrams: _Diagrams, steps: Steps) -> None:
        self._steps = steps
        self._rows = formulas.rows
        self._diagrams = diagrams
        self.satisfied = cache(self._satisfied)
        self._clauses = cache(self._taken_apart)
        self._live: set[_Obligations] = set()
        self._dead: set[_Obligations] = set()

    def _satisfied(self, residual: int) -> bool:
        path: list[_Obligations] = []
        ways = [self._cubes(residual)]
        visited: set[_Obligations] = set()
        while ways:
            current = next(ways[-1], None)
            if current is None:
                ways.pop()
                del path[len(ways) - 1 :]
            elif current in self._live or (path and all(one < 0 for one in current)):  # the trace may end before it
                self._live.update(path)
                return True
            elif current not in visited and current not in self._dead:
                visited.add(current)
                self._steps.take(len(current))
                if len(visited) > SEARCH_LIMIT:
                    raise TooLarge("the search for a continuation meets more sets of obligations", limit=SEARCH_LIMIT)
                path.append(current)
                ways.append(self._continued(current))
        self._dead |= visited
        return False

    def _cubes(self, residual: int) -> Iterator[_Obligations]:
        """Yield alternative sets of obligations; a variable in which the function is monotone has
        one sign.
        """
        path: list[int] = []
        todo: list[tuple[int, int, tuple[int, ...]]] = [(residual, 0, ())]
        while todo:
            f, depth, sign = todo.pop()
            path[depth:] = sign
            if f == TOP:
                yield frozenset(path)
            elif f != BOTTOM:
                variable, low, high = self._diagrams.nodes[f]
                rising, falling = self._diagrams.implies(low, high), self._diagrams.implies(high, low)
                halves = [
                    (high, len(path), () if falling else (variable,)),
                    (low, len(path), () if rising else (~variable,)),
                ]
                todo += halves[::-1] if falling else halves

    def _continued(self, obligations: _Obligations) -> Iterator[_Obligations]:
        seen: set[_Obligations] = set()
        branches: list[tuple[list[_Clause], set[_Item]]] = [([[[(one, False)]] for one in sorted(obligations)], set())]
        while branches:
            clauses, taken = branches.pop()
            choices = self._settled(clauses, taken)
            if choices:
                first, *others = choices
                branches += [([[way], *others], set(taken)) for way in reversed(first)]
            elif choices is not None:
                found = frozenset(obligation for obligation, later in taken if later)
                if found not in seen:
                    seen.add(found)
                    yield found

    def _settled(self, clauses: list[_Clause], taken: set[_Item]) -> list[_Clause] | None:
        changed = True
        while changed:
            changed, todo, clauses = False, clauses[::-1], []
            self._steps.take(10 + 2 * len(todo))
            while todo:
                clause = todo.pop()
                possible = [way for way in clause if not any((~one, later) in taken for one, later in way)]
                if not possible:
                    return None
                if len(possible) > 1:
                    if not any(map(taken.issuperset, possible)):
                        clauses.append(possible)
                    continue
                for one, later in possible[0]:
                    if (one, later) not in taken:
                        changed = True
                        taken.add((one, later))
                        todo += [] if later else reversed(self._clauses(one))
        return clauses

    def _taken_apart(self, obligation: int) -> list[_Clause]:
        """Return the clauses of an obligation on this position and the next; none for an atom."""
        positive = obligation >= 0
        op, operands, _ = self._rows[obligation if positive else ~obligation]
        now = [(self._signed(operand, positive), False) for operand in operands]
        again = (obligation, True)
        match op:
            case Connective.TRUE | Connective.FALSE:
                return [] if positive is (op is Connective.TRUE) else [[]]
            case Connective.ATOM:
                return []
            case Connective.NEXT:
                return [
                    [[(operands[0] if positive else ~operands[0], True)]]
                ]  # a positive one requires a next position
            case Connective.NOT:
                return [[[(self._signed(operands[0], not positive), False)]]]
            case Connective.AND | Connective.OR if (op is Connective.AND) is positive:
                return [[[item]] for item in now]
            case Connective.AND | Connective.OR:
                return [[[item] for item in now]]
            case Connective.EVENTUALLY:
                return [[now, [again]]] if positive else [[[again]], [now]]
            case Connective.UNTIL if positive:
                return [[[now[1]], [now[0], again]]]
            case Connective.UNTIL:
                return [[[now[1]]], [[now[0]], [again]]]
            case _:
                assert_never(op)

    def _signed(self, formula: int, positive: bool) -> int:
        row = self._rows[formula]
        formula, positive = (row.operands[0], not positive) if row.op is Connective.NOT else (formula, positive)
        return formula if positive else ~formula
