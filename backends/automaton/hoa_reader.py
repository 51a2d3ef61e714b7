"""A HOA text as a deterministic table over finite words, made with Spot.

The verdict of a state is that of the automaton alone, over all letters: ⊤ when the word and every extension are accepted, ⊥ when
neither the word nor any extension is; `finite` says when a word is accepted.
"""

import re
import warnings
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from importlib import import_module
from typing import Any, Final, TypeAlias

from backends.automaton.determinise import DETECTED, HOPELESS, Automaton, Row
from backends.automaton.hoa_writer import ALIVE
from backends.automaton.letters import Atoms, bits
from backends.automaton.structure import Structure
from rvaft.errors import LanguageError, TooLarge, ToolMissing
from rvaft.language.parser import parse_guard, parse_pattern
from rvaft.model.guards import Guard, holds, variables
from rvaft.model.patterns import Anything, ObjectPattern, Pattern, match, rigid_variables
from rvaft.model.values import Json
from rvaft.model.verdict import Verdict

# What the propositions of a HOA text mean: its lower-case header lines (see `hoa`), read back.

_TOKEN: Final = re.compile(
    r'(?P<string>"(?:\\.|[^"\\])*")|(?P<comment>/\*.*?\*/)|(?P<name>[A-Za-z_][\w-]*:)|(?P<end>--BODY--)|(?P<word>[^\s"]+)',
    re.DOTALL,
)


@dataclass(frozen=True, slots=True)
class Fit:
    """A pattern and a guard on it, which an event fits or not for some values of the variables."""

    pattern: Pattern
    guard: Guard | None

    def fits(self, event: Json) -> bool:
        """Whether the event matches and the guard, if any, holds."""
        bound = match(self.pattern, event, {})
        if bound is None or self.guard is None:
            return bound is not None
        return bound.keys() >= set(variables(self.guard)) and holds(self.guard, bound)  # else it has no value


@dataclass(frozen=True, slots=True)
class Meaning:
    """What the header says: by number of a proposition its event or guard, and what makes an event relevant."""

    events: dict[int, Pattern] = field(default_factory=dict)
    guards: dict[int, Guard] = field(default_factory=dict)
    relevant: set[int] = field(default_factory=set)
    alphabet: list[Fit] = field(default_factory=list)
    ignored: list[Fit] = field(default_factory=list)

    def is_relevant(self, event: Json) -> bool:
        """Whether an event fits a line of the alphabet and none to ignore."""
        return any(fit.fits(event) for fit in self.alphabet) and not any(fit.fits(event) for fit in self.ignored)


@dataclass(frozen=True, slots=True)
class _Line:
    """A header line: its name, its values, where it stands in the text."""

    name: str
    values: list[str]
    position: int


def meaning(text: str) -> Meaning:
    """The meaning that a text gives to its propositions; raises `LanguageError`."""
    found = Meaning()
    for line in _lines(text):
        match line.name:
            case "event:":
                first, pattern = _values(text, line, "a number and a pattern in quotes", 2)
                number = _number(text, line, first)
                found.events[number] = _pattern(text, line, pattern)
            case "guard:":
                first, guard = _values(text, line, "a number and a guard in quotes", 2)
                number = _number(text, line, first)
                found.guards[number] = _guard(text, line, guard)
            case "relevant:":
                (first,) = _values(text, line, "a number", 1)
                found.relevant.add(_number(text, line, first))
            case "alphabet:":
                found.alphabet.append(_fit(text, line))
            case "ignore:":
                found.ignored.append(_fit(text, line))
            case _:
                pass
    return found


def _lines(text: str) -> Iterator[_Line]:
    """The header lines, comments left out."""
    line: _Line | None = None
    for token in _TOKEN.finditer(text):
        match token.lastgroup:
            case "end":
                break
            case "name":
                if line is not None:
                    yield line
                line = _Line(token.group(), [], token.start())
            case "string" | "word":
                if line is not None:
                    line.values.append(token.group())
            case _:
                pass
    if line is not None:
        yield line


def _fit(text: str, line: _Line) -> Fit:
    if len(line.values) == 1:
        return Fit(_pattern(text, line, line.values[0]), None)
    pattern, guard = _values(text, line, "a pattern in quotes, and a guard in quotes where there is one", 2)
    return Fit(_pattern(text, line, pattern), _guard(text, line, guard))


def _values(text: str, line: _Line, expected: str, many: int) -> list[str]:
    if len(line.values) != many:
        raise error_at(text, line.position, f"{line.name} expects {expected}")
    return line.values


def _number(text: str, line: _Line, value: str) -> int:
    if not (value.isascii() and value.isdigit()):
        raise error_at(text, line.position, f"{line.name} expects the number of a proposition, not {value}")
    return int(value)


def _string(text: str, line: _Line, value: str) -> str:
    if not value.startswith('"'):
        raise error_at(text, line.position, f"{line.name} expects quotes around {value}")
    return re.sub(r"\\(.)", r"\1", value[1:-1], flags=re.DOTALL)


def _pattern(text: str, line: _Line, value: str) -> Pattern:
    try:
        pattern = parse_pattern(_string(text, line, value))
    except LanguageError as error:
        raise error_at(text, line.position, error.message) from None
    if not isinstance(pattern, ObjectPattern | Anything):
        raise error_at(text, line.position, "an event is an object: expected a pattern such as { field: 1 }, or _")
    return pattern


def _guard(text: str, line: _Line, value: str) -> Guard:
    try:
        return parse_guard(_string(text, line, value))
    except LanguageError as error:
        raise error_at(text, line.position, error.message) from None


def error_at(text: str, position: int, message: str) -> LanguageError:
    """The error for a place in a HOA text."""
    before = text[:position]
    number = before.count("\n") + 1
    column = position - (before.rfind("\n") + 1) + 1
    source = text.split("\n")[number - 1].rstrip("\r")
    return LanguageError(message, file="<hoa>", line=number, column=column, source=source)


# When an automaton accepts a finite word: two readings of a text, both made with Spot.
#
# With a proposition `alive` (the encoding of Spot's `from_ltlf`) a word is accepted when it goes on for ever without `alive` and
# without any other proposition. Without `alive` the automaton is one over finite words: it accepts where its run may end in an
# accepting state or, if acceptance is on the edges, with an accepting edge, its marks being seen for ever.

Moves: TypeAlias = list[list[tuple[Any, int]]]
"""For each state the edges that leave it: label and target."""

_STATE: Final = re.compile(
    r'"(?:\\.|[^"\\])*"|/\*.*?\*/|State:\s*(?:\[[^\]]*\]\s*)?(?P<state>\d+)\s*(?:"(?:\\.|[^"\\])*"\s*)?(?:\{(?P<marks>[^}]*)\})?',
    re.DOTALL,
)


def moves(automaton: Any) -> Moves:
    """The edges by state."""
    return [[(edge.cond, edge.dst) for edge in automaton.out(state)] for state in range(automaton.num_states())]


def after_the_end(spot: Any, buddy: Any, automaton: Any, variables: Sequence[int]) -> list[bool]:
    """For each state whether the word that goes on with no proposition at all is accepted from there."""
    silence = buddy.bddtrue
    for variable in variables:
        silence &= buddy.bdd_nithvar(variable)
    after = spot.make_twa_graph(automaton.get_dict())
    after.copy_acceptance_of(automaton)
    states = automaton.num_states()
    after.new_states(states + 1)
    after.set_init_state(states)
    for state in range(states):
        after.new_edge(states, state, buddy.bddtrue)
        for edge in automaton.out(state):
            if edge.cond & silence != buddy.bddfalse:
                after.new_edge(state, edge.dst, buddy.bddtrue, edge.acc)
    components = spot.scc_info_with_options(after, spot.scc_info_options_ALL)
    components.determine_unknown_acceptance()
    return [bool(components.is_useful_scc(components.scc_of(state))) for state in range(states)]


def _state_marks(text: str) -> dict[int, list[int]] | None:
    """The marks that a text puts on states, or None where it puts them on edges."""
    body = text.partition("--BODY--")[2]
    found = [token for token in _STATE.finditer(body) if token["state"] is not None]
    if not any(token["marks"] is not None for token in found):
        return None
    return {int(token["state"]): [int(mark) for mark in (token["marks"] or "").split()] for token in found}


def marked_moves(automaton: Any, text: str) -> Moves:
    """The edges of an automaton over finite words; where edges have marks, a state is split by the marks of the last edge."""
    if _state_marks(text) is not None:
        return moves(automaton)
    number = _splits(automaton)
    split: Moves = [[] for _ in range(automaton.num_states() + len(number))]
    for state in range(automaton.num_states()):
        leaving = [(edge.cond, number[edge.dst, str(edge.acc)]) for edge in automaton.out(state)]
        split[state] = leaving
        for (to, _), index in number.items():
            if to == state:
                split[index] = leaving
    return split


def _splits(automaton: Any) -> dict[tuple[int, str], int]:
    splits: dict[tuple[int, str], int] = {}
    for edge in automaton.edges():
        splits.setdefault((edge.dst, str(edge.acc)), automaton.num_states() + len(splits))
    return splits


def ends(spot: Any, automaton: Any, text: str) -> list[bool]:
    """For each state of `_marked_moves` whether a word may end there."""
    acceptance = automaton.acc()
    marks = _state_marks(text)
    if marks is not None:
        return [_satisfied(spot, acceptance, marks.get(state, [])) for state in range(automaton.num_states())]
    by_text = {str(edge.acc): edge.acc for edge in automaton.edges()}
    ends = [bool(acceptance.accepting(by_text[mark])) for _, mark in _splits(automaton)]
    return [False] * automaton.num_states() + ends


def _satisfied(spot: Any, acceptance: Any, marks: Sequence[int]) -> bool:
    return bool(acceptance.accepting(spot.mark_t(list(marks))))


# What an automaton can do on events: a guard holds until its variables have values, and only events give values.
#
# A letter on which a guard fails although no events on the way there, and not its own, give a value to each variable of the guard
# never occurs. States that only such letters lead to are never reached.


def possible(automaton: Automaton, structure: Structure) -> Automaton:
    """The automaton with the same states, without letters that never occur and guards that never fail where they are asked."""
    return _Search(automaton, structure).result()


class _Search:
    """Finds for each state the variables that may have a value there, from the start on until nothing is added."""

    def __init__(self, automaton: Automaton, structure: Structure) -> None:
        self._automaton = automaton
        self._binds = [frozenset(rigid_variables(pattern)) for pattern in structure.patterns]
        self._needs: Sequence[frozenset[str]] = [frozenset(variables(guard)) for guard in structure.guards]
        self._valued: dict[int, frozenset[str]] = {automaton.start: frozenset()}

    def result(self) -> Automaton:
        todo = deque([self._automaton.start])
        while todo:
            state = todo.popleft()
            row = self._automaton.rows[state]
            for (atoms, holding), target in row.targets.items():
                valued = self._with(state, atoms)
                if self._never_fails(valued, row.guards[atoms]) & ~holding:
                    continue
                before = self._valued.get(target)
                if before is None or not valued <= before:
                    self._valued[target] = valued | (before or frozenset())
                    todo.append(target)
        rows = [self._reduced(state, row) for state, row in enumerate(self._automaton.rows)]
        return Automaton(self._automaton.start, rows)

    def _reduced(self, state: int, row: Row) -> Row:
        if state in (DETECTED, HOPELESS) or state not in self._valued:
            return row
        never = {atoms: self._never_fails(self._with(state, atoms), asked) for atoms, asked in row.guards.items()}
        targets = {
            (atoms, holding & ~never[atoms]): target
            for (atoms, holding), target in row.targets.items()
            if not never[atoms] & ~holding
        }
        return Row(row.sees, {atoms: asked & ~never[atoms] for atoms, asked in row.guards.items()}, targets)

    def _with(self, state: int, atoms: Atoms) -> frozenset[str]:
        return self._valued[state].union(*(self._binds[atom] for atom in bits(atoms)))

    def _never_fails(self, valued: frozenset[str], asked: int) -> int:
        """The guards among those asked for with a variable that has no value yet."""
        return sum(1 << guard for guard in bits(asked) if not self._needs[guard] <= valued)


LIMIT: Final = 100_000
"""The most states that a nondeterministic text may turn into."""

_PLACE: Final = re.compile(r"^<hoa>:(\d+)\.(\d+)[-.\d]*: (.*)$", re.MULTILINE)


@dataclass
class Table:
    """Deterministic and complete; `names` are the propositions by number, `alive` left out of letters."""

    names: tuple[str, ...]
    start: int
    verdicts: list[Verdict]
    _edges: Moves
    _variables: tuple[int, ...]
    _buddy: Any
    _seen: dict[int, tuple[int, ...]] = field(default_factory=dict)
    _next: dict[tuple[int, tuple[bool, ...]], int] = field(default_factory=dict)

    @cached_property
    def ahead(self) -> list[frozenset[int]]:
        """For each state the numbers of the propositions on which it or a state that can follow depends."""
        found = [frozenset(self.seen(state)) for state in range(len(self._edges))]
        before: list[list[int]] = [[] for _ in found]
        for state, edges in enumerate(self._edges):
            for _, to in edges:
                before[to].append(state)
        changed = list(range(len(found)))
        while changed:
            state = changed.pop()
            for earlier in before[state]:
                if not found[state] <= found[earlier]:
                    found[earlier] |= found[state]
                    changed.append(earlier)
        return found

    def seen(self, state: int) -> tuple[int, ...]:
        """The numbers of the propositions on which the next state depends."""
        if state not in self._seen:
            numbers = {variable: number for number, variable in enumerate(self._variables)}
            found: set[int] = set()
            for label, _ in self._edges[state]:
                found.update(numbers[variable] for variable in _support(self._buddy, label))
            self._seen[state] = tuple(sorted(found))
        return self._seen[state]

    def next(self, state: int, letter: tuple[bool, ...]) -> int:
        """The state after a letter, given as the values of the propositions `seen`."""
        if (state, letter) not in self._next:
            self._next[state, letter] = self._find(state, letter)
        return self._next[state, letter]

    def _find(self, state: int, letter: tuple[bool, ...]) -> int:
        buddy = self._buddy
        values = buddy.bddtrue
        for number, true in zip(self.seen(state), letter, strict=True):
            variable = self._variables[number]
            values &= buddy.bdd_ithvar(variable) if true else buddy.bdd_nithvar(variable)
        for label, to in self._edges[state]:
            if label & values != buddy.bddfalse:
                return to
        raise AssertionError("the table is complete")


def table(text: str) -> Table:
    """The table of a text; raises `LanguageError`, `ToolMissing`, `TooLarge`."""
    spot, buddy = _tools()
    automaton = _parsed(spot, text)
    if not automaton.is_existential():
        automaton = spot.remove_alternation(automaton)
    names = tuple(str(proposition.ap_name()) for proposition in automaton.ap())
    variables = tuple(automaton.register_ap(name) for name in names)
    if ALIVE in names:
        alive = buddy.bdd_ithvar(variables[names.index(ALIVE)])
        accepting = after_the_end(spot, buddy, automaton, variables)
        determinised = _Subsets(buddy, alive, moves(automaton), accepting)
    else:
        determinised = _Subsets(buddy, buddy.bddtrue, marked_moves(automaton, text), ends(spot, automaton, text))
    edges, accepted = determinised.build(automaton.get_init_state_number())
    return Table(names, 0, _verdicts(edges, accepted), edges, variables, buddy)


def _tools() -> tuple[Any, Any]:
    remedy = "pip install spottl (Linux x86-64, Python below 3.14), or build Spot with its Python bindings"
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            spot = import_module("spot")
            buddy = import_module("buddy")  # becomes visible with Spot
    except ImportError as error:
        raise ToolMissing("Spot", remedy=remedy) from error
    if not hasattr(spot, "automaton_stream_parser"):
        raise ToolMissing("Spot (the module named spot is another one)", remedy=remedy)
    return spot, buddy


def _parsed(spot: Any, text: str) -> Any:
    """The one automaton of a text."""
    start = re.match(r"(?:\s|/\*.*?\*/)*", text, re.DOTALL)
    position = start.end() if start else 0
    if not text.startswith("HOA:", position):
        raise error_at(text, position, "a HOA text begins with HOA: v1")
    if "\0" in text:
        raise error_at(text, text.index("\0"), "binary data (a zero byte), not a text")
    options = spot.automaton_parser_options()
    options.trust_hoa = False
    options.raise_errors = True
    parser = spot.automaton_stream_parser(text + "\n", "<hoa>", options)
    try:
        first = parser.parse(spot._bdd_dict)  # noqa: SLF001 -- the dictionary that Spot's own functions share
        second = parser.parse(spot._bdd_dict)  # noqa: SLF001
    except (SyntaxError, RuntimeError) as error:
        raise _complaint(text, str(error)) from None
    if first.aut is None or first.aborted:
        raise error_at(text, position, "the text has no complete automaton")
    if second.aut is not None:
        raise error_at(text, position, "the text has more than one automaton")
    return first.aut


def _complaint(text: str, message: str) -> LanguageError:
    place = _PLACE.search(message)
    if place is None:
        return LanguageError(" ".join(message.split()) or "not a HOA text", file="<hoa>")
    line, column, what = int(place[1]), int(place[2]), place[3]
    lines = text.split("\n")
    source = lines[line - 1].rstrip("\r") if line <= len(lines) else ""
    return LanguageError(what.removeprefix("syntax error, "), file="<hoa>", line=line, column=column, source=source)


class _Subsets:
    """The subset construction over the letters that satisfy `when`; a missing edge leads to the empty subset."""

    def __init__(self, buddy: Any, when: Any, moves: Moves, accepting: Sequence[bool]) -> None:
        self.none = buddy.bddfalse
        self.when = when
        self.moves = moves
        self.accepting = accepting
        self.restrict = buddy.bdd_restrict
        self.number: dict[tuple[int, ...], int] = {}
        self.order: list[tuple[int, ...]] = []

    def build(self, start: int) -> tuple[Moves, list[bool]]:
        self._subset((start,))
        edges: Moves = []
        while len(edges) < len(self.order):
            split = self._split(self.order[len(edges)])
            edges.append([(self.restrict(label, self.when), self._subset(to)) for label, to in split])
        return edges, [any(self.accepting[state] for state in subset) for subset in self.order]

    def _subset(self, states: tuple[int, ...]) -> int:
        if states not in self.number:
            if len(self.number) >= LIMIT:
                raise TooLarge("states of the determinised text", limit=LIMIT)
            self.number[states] = len(self.number)
            self.order.append(states)
        return self.number[states]

    def _split(self, subset: tuple[int, ...]) -> Iterator[tuple[Any, tuple[int, ...]]]:
        classes: list[tuple[Any, frozenset[int]]] = [(self.when, frozenset())]
        for state in subset:
            for label, to in self.moves[state]:
                classes = list(self._refined(classes, label, to))
        merged: dict[tuple[int, ...], Any] = {}
        for label, states in classes:
            key = tuple(sorted(states))
            merged[key] = merged[key] | label if key in merged else label
        for key, label in merged.items():
            yield label, key

    def _refined(
        self, classes: list[tuple[Any, frozenset[int]]], label: Any, to: int
    ) -> Iterator[tuple[Any, frozenset[int]]]:
        for known, states in classes:
            both = known & label
            if both == self.none:
                yield known, states
                continue
            yield both, states | {to}
            if (rest := known - both) != self.none:
                yield rest, states


def _verdicts(edges: Moves, accepted: list[bool]) -> list[Verdict]:
    into: list[list[int]] = [[] for _ in edges]
    for state, leaving in enumerate(edges):
        for _, to in leaving:
            into[to].append(state)
    hopeful = _reaching(into, [state for state, accepts in enumerate(accepted) if accepts])
    doubtful = _reaching(into, [state for state, accepts in enumerate(accepted) if not accepts])
    return [
        Verdict.FALSE if state not in hopeful else Verdict.TRUE if state not in doubtful else Verdict.UNKNOWN
        for state in range(len(edges))
    ]


def _reaching(into: list[list[int]], goals: list[int]) -> set[int]:
    reached = set(goals)
    todo = goals
    while todo:
        for state in into[todo.pop()]:
            if state not in reached:
                reached.add(state)
                todo.append(state)
    return reached


def _support(buddy: Any, label: Any) -> Iterator[int]:
    rest = buddy.bdd_support(label)
    while rest not in {buddy.bddtrue, buddy.bddfalse}:
        yield buddy.bdd_var(rest)
        rest = buddy.bdd_high(rest)
