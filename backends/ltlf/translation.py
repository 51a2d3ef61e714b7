"""Properties to LTLf texts: a header that defines the atoms, and a formula in Spot's syntax."""

import re
from collections import Counter
from typing import Final, assert_never

from backends.absences import OpenClauses, breaking_event, require_unbroken
from backends.ltlf.composition import Composer
from backends.ltlf.formulas import FALSE, JUNCTIONS, TRUE, Connective, Formulas
from backends.ltlf.parts import Anatomy, GuardsOf, settled, simplified
from backends.ltlf.reader import Header, Observation
from rvaft.backend import Metrics
from rvaft.core.part_numbers import NumberedParts, numbered
from rvaft.core.precedence import Ready
from rvaft.core.property import Event, Property, WithoutEvent
from rvaft.core.scenarios import Scenario, scenarios
from rvaft.core.times import untimed
from rvaft.errors import TreeError
from rvaft.model.guards import Guard, variables
from rvaft.model.patterns import Pattern, rigid_variables
from rvaft.model.verdict import Semantics
from rvaft.support.budget import Call, Work, run

_RESERVED: Final = ("true", "false", "xor", "rvaft", "atom", "relevant", "ignored")
_ILLEGAL: Final = re.compile(r"[^a-z0-9_]+")
_TOKEN: Final = re.compile(r"X\[!\]|[A-Za-z0-9_]+|[^\s]")
_LEAVES: Final = frozenset({Connective.TRUE, Connective.FALSE, Connective.ATOM})
_PREFIX: Final = frozenset({Connective.NOT, Connective.NEXT, Connective.EVENTUALLY})


class Translation:
    """One translation.

    Raises `TooLarge` beyond `limit` distinct subformulas or a text of that size, `TreeError`
    without a feasible scenario.
    """

    def __init__(self, prop: Property, semantics: Semantics, limit: int) -> None:
        self._prop = prop
        self._semantics = semantics
        self._work = Work(limit, item="subformula", steps=200, characters=20)
        self._header = Header(time=prop.time)
        self._formulas = Formulas(limit)
        self._atoms: dict[Observation, int] = {}
        self._own: dict[Observation, int] = {}
        """The atoms of absent events whose guards are over variables of their own."""
        self._rank: dict[str, int] = {}
        self._place = {event: place for place, event in enumerate(prop.events)}
        nodes = Counter(event.source.node for event in prop.events)
        self._counted = {node for node, count in nodes.items() if count > 1}
        """Nodes with several events."""
        self._taken = set(_RESERVED)

    def text(self) -> tuple[str, Metrics]:
        """Return the text and its metrics."""
        formulas, header = self._formulas, self._header
        relevant = self._relevance() if self._semantics.projects else TRUE
        if self._prop.absences:
            some = [*scenarios(self._prop)] if self._prop.feasible else []
            require_unbroken(some)
            root = formulas.disjunction(self._of_scenario(one, relevant) for one in some)
        else:
            form, monotone = numbered(self._prop), self._semantics is Semantics.SCATTERED
            divisions = settled(form, monotone=monotone, work=self._work) if form.feasible else ()
            root = formulas.disjunction(self._formula(parts, guards, monotone, relevant) for parts, guards in divisions)
        if root == FALSE:
            root_node = self._prop.tree.root
            raise TreeError(f"no scenario of {root_node} is feasible", rule="no-scenario", nodes=[root_node])
        formula = self._written(root)
        used = set(formulas.atoms(root))
        in_order = sorted(header.atoms, key=self._rank.__getitem__)
        header.atoms = {name: header.atoms[name] for name in in_order if name in used}
        texts = [formula, *(f"{name} = {text}" for name, text in header.definitions.items())]
        written = f"{header}{formula}\n"
        self._work.size(len(written))
        symbols = sum(len(_TOKEN.findall(text)) for text in texts)
        return written, Metrics(symbols=symbols, subformulas=formulas.size(root))

    def _formula(self, form: NumberedParts, guards: GuardsOf, monotone: bool, relevant: int) -> int:
        anatomy = Anatomy(simplified(form, monotone=monotone))

        def event_of(part: int) -> int:
            event = anatomy.parts[part].event
            return self._event(event, guards.get(event, ()))

        return Composer(
            self._formulas, anatomy, event_of, semantics=self._semantics, relevant=relevant, work=self._work
        ).whole()

    def _event(self, event: Event, guards: tuple[Guard, ...]) -> int:
        """Return the atom of an event under guards."""
        node, number = event.source
        name = f"{node}_{number}" if untimed(event.pattern)[1] is not None and node in self._counted else node
        return self._atom(event.pattern, guards, name, self._place[event])

    def _atom(self, event: Pattern, guards: tuple[Guard, ...], name: str, rank: int) -> int:
        pattern, time = untimed(event)
        observation = Observation(pattern, guards, time)
        if observation not in self._atoms:
            name = self._fresh(name)
            self._header.atoms[name] = observation
            self._rank[name] = rank
            self._atoms[observation] = self._formulas.atom(name)
        return self._atoms[observation]

    def _absent(self, clause: WithoutEvent) -> int:
        """Return the atom of the events that break a clause."""
        name, rank = f"{clause.source.node}_absent", len(self._place)
        if clause.guard is None or clause.shared:
            breaking = breaking_event(clause)
            return self._atom(breaking.pattern, () if breaking.when is None else (breaking.when,), name, rank)
        observation = Observation(clause.pattern, (clause.guard,))
        if observation not in self._own:  # for some values of its variables, as relevant events are
            name = self._fresh(name)
            self._header.relevant[name] = [observation]
            self._own[observation] = self._formulas.atom(name)
        return self._own[observation]

    def _of_scenario(self, scenario: Scenario, relevant: int) -> int:
        """Return the formula of one scenario, over the sets of its events that are there.

        The events that break a clause are false from one event of its part to the next, or before its first one.
        """
        f, clauses, ready = self._formulas, OpenClauses.of(scenario), Ready(scenario.before)
        everything, known = (1 << len(scenario.events)) - 1, dict[int, int]()
        events = list[int]()
        for event in scenario.events:
            names = {*rigid_variables(event.pattern)}
            guards = (one.guard for one in scenario.conditions if names.intersection(variables(one.guard)))
            events.append(self._event(event, tuple(dict.fromkeys(guards))))

        def steps(done: int) -> Call[int]:
            ways = []
            for event in ready.after(done):
                if (after := done | 1 << event) not in known:
                    known[after] = TRUE if after == everything else f.next((yield begun(after)))
                ways.append(f.conjunction([events[event], known[after]]))
                self._work.step(10)
            return f.disjunction(ways)

        def begun(done: int) -> Call[int]:
            rest: int = yield steps(done)
            waiting = [f.negation(relevant)] if self._semantics.projects else []
            waiting += [f.negation(self._absent(clause)) for clause in clauses.after(done)]
            match self._semantics:
                case Semantics.STRICT:
                    return rest
                case Semantics.SCATTERED:
                    return f.until(f.conjunction(waiting), rest)
                case Semantics.PROJECTED:
                    return f.until(f.conjunction(waiting), f.conjunction([relevant, rest]))
                case Semantics.CONSECUTIVE:  # before its first event, relevant ones may come
                    waiting = waiting if done else waiting[1:]
                    return f.until(f.conjunction(waiting), f.conjunction([relevant, rest]))
                case _:
                    assert_never(self._semantics)

        whole: int = run(begun(0))
        return whole

    def _relevance(self) -> int:
        wanted = "rel"
        while wanted in self._prop.tree.nodes:  # node names take precedence
            wanted += "_"
        name = self._fresh(wanted)
        entries = [(entry.pattern, entry.when) for entry in self._prop.alphabet]
        ignored = [(one.pattern, one.when) for one in self._prop.ignored]
        for observed, pairs in ((self._header.relevant, entries), (self._header.ignored, ignored)):
            of_name = (Observation(pattern, () if when is None else (when,)) for pattern, when in pairs)
            if pairs:
                observed[name] = list(dict.fromkeys(of_name))
        return self._formulas.atom(name)

    def _fresh(self, wanted: str) -> str:
        name = _ILLEGAL.sub("_", wanted.lower()) or "_"
        name = f"_{name}" if name[0].isdigit() else name
        candidate, number = name, 1
        while candidate in self._taken:
            number += 1
            candidate = f"{name}_{number}"
        self._taken.add(candidate)
        return candidate

    def _written(self, root: int) -> str:
        rows = self._formulas.rows
        reachable = self._formulas.reachable(root)
        uses = Counter(operand for formula in reachable for operand in rows[formula].operands)
        defined: dict[int, str] = {}

        def pieces(formula: int) -> list[str | int]:
            op, operands, name = rows[formula]
            inner: list[list[str | int]] = []
            for operand in operands:
                below = rows[operand].op
                plain = operand in defined or below in _LEAVES | _PREFIX or (below is op and op in JUNCTIONS)
                inner.append([operand] if plain else ["(", operand, ")"])
            if op in _LEAVES:
                return [name or op.value]
            if op in _PREFIX:
                spaced = op is not Connective.NOT and len(inner[0]) == 1
                return [f"{op.value} " if spaced else op.value, *inner[0]]
            return [piece for operand in inner for piece in (f" {op.value} ", *operand)][1:]

        def text(formula: int) -> str:
            words: list[str] = []
            todo: list[str | int] = [formula]
            while todo:
                piece = todo.pop()
                if isinstance(piece, int) and piece not in defined:
                    todo.extend(reversed(pieces(piece)))
                else:
                    words.append(piece if isinstance(piece, str) else defined[piece])
            return "".join(words)

        for formula in reachable:
            literal = formula if rows[formula].op is not Connective.NOT else rows[formula].operands[0]
            if uses[formula] > 1 and rows[literal].op not in _LEAVES:
                written, name = text(formula), self._fresh(f"s{len(defined) + 1}")
                defined[formula] = name
                self._header.definitions[name] = written
        return text(root)
