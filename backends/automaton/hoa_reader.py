"""A HOA text as a deterministic table over finite words, made with Spot, and what its header says of its propositions.

The verdict of a state is that of the automaton alone, over all letters: ⊤ when the word and every extension are accepted, ⊥ when
neither the word nor any extension is. Two readings say when a word is accepted. With a proposition `alive` (the encoding of Spot's
`from_ltlf`) it is when it goes on for ever without `alive` and without any other proposition. Without `alive` the automaton is one over
finite words: it accepts where its run may end in an accepting state or, if acceptance is on the edges, with an accepting edge, its marks
being seen for ever.
"""

import re
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from importlib import import_module
from typing import Any, Final, NamedTuple, TypeAlias, TypeVar

from backends.automaton.hoa_writer import ALIVE
from rvaft.errors import LanguageError, TooLarge, ToolMissing
from rvaft.language.parser import parse_guard, parse_pattern
from rvaft.model.guards import Guard, holds, variables
from rvaft.model.patterns import Anything, ObjectPattern, Pattern, match
from rvaft.model.values import Json
from rvaft.model.verdict import Verdict

T = TypeVar("T")

# The lower-case header lines, as `hoa_writer` writes them.

_TOKEN: Final = re.compile(
    r'(?P<string>"(?:\\.|[^"\\])*")|(?P<comment>/\*.*?\*/)|(?P<name>[A-Za-z_][\w-]*:)|(?P<end>--BODY--)|(?P<word>[^\s"]+)',
    re.DOTALL,
)


class Fit(NamedTuple):
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


def meaning(text: str) -> Meaning:
    """The meaning that a text gives to its propositions; raises `LanguageError`.

    >>> meaning('HOA: v1 AP: 1 "a" event: 0 "{ a: 1 }" --BODY-- --END--').events
    {0: ObjectPattern(fields=(('a', Literal(value=1)),))}
    """
    found = Meaning()
    for line in _header(text):
        match line.name:
            case "event:":
                line.expect(2, "a number and a pattern in quotes")
                found.events.update({line.number(): line.pattern(1)})
            case "guard:":
                line.expect(2, "a number and a guard in quotes")
                found.guards.update({line.number(): line.guard()})
            case "relevant:":
                line.expect(1, "a number")
                found.relevant.add(line.number())
            case "alphabet:" | "ignore:":
                if len(line.values) != 1:
                    line.expect(2, "a pattern in quotes, and a guard in quotes where there is one")
                fit = Fit(line.pattern(0), line.guard() if len(line.values) == 2 else None)
                (found.alphabet if line.name == "alphabet:" else found.ignored).append(fit)
            case _:  # a line of the format itself, or of somebody else
                pass
    return found


def _header(text: str) -> "Iterator[_HeaderLine]":
    """The header lines, comments left out."""
    line = None
    for token in _TOKEN.finditer(text):
        if token.lastgroup == "end":
            break
        if token.lastgroup == "name":
            if line is not None:
                yield line
            line = _HeaderLine(text, token.group(), token.start(), [])
        elif token.lastgroup != "comment" and line is not None:
            line.values.append(token.group())
    if line is not None:
        yield line


class _HeaderLine(NamedTuple):
    """A line of a text: its name, where it stands, its values."""

    text: str
    name: str
    position: int
    values: list[str]

    def error(self, message: str) -> LanguageError:
        return error_at(self.text, self.position, message)

    def expect(self, many: int, what: str) -> None:
        if len(self.values) != many:
            raise self.error(f"{self.name} expects {what}")

    def number(self) -> int:
        value = self.values[0]
        if not (value.isascii() and value.isdigit()):
            raise self.error(f"{self.name} expects the number of a proposition, not {value}")
        return int(value)

    def pattern(self, place: int) -> Pattern:
        pattern = self._parsed(parse_pattern, place)
        if not isinstance(pattern, ObjectPattern | Anything):
            raise self.error("an event is an object: expected a pattern such as { field: 1 }, or _")
        return pattern

    def guard(self) -> Guard:
        return self._parsed(parse_guard, 1)

    def _parsed(self, parse: Callable[[str], T], place: int) -> T:
        value = self.values[place]
        if not value.startswith('"'):
            raise self.error(f"{self.name} expects quotes around {value}")
        try:
            return parse(re.sub(r"\\(.)", r"\1", value[1:-1], flags=re.DOTALL))
        except LanguageError as error:
            raise self.error(error.message) from None


def error_at(text: str, position: int, message: str) -> LanguageError:
    """The error for a place in a HOA text."""
    before = text[:position]
    number = before.count("\n") + 1
    column = position - (before.rfind("\n") + 1) + 1
    source = text.split("\n")[number - 1].rstrip("\r")
    return LanguageError(message, file="<hoa>", line=number, column=column, source=source)


# The table: what Spot has read, determinised.

Edges: TypeAlias = list[list[tuple[Any, int]]]
"""For each state the edges that leave it: label (a diagram of BuDDy) and target."""

LIMIT: Final = 100_000
"""The most states that a nondeterministic text may turn into."""

_PLACE: Final = re.compile(r"^<hoa>:(\d+)\.(\d+)[-.\d]*: (.*)$", re.MULTILINE)

_STATE: Final = re.compile(
    r'"(?:\\.|[^"\\])*"|/\*.*?\*/|State:\s*(?:\[[^\]]*\]\s*)?(?P<state>\d+)\s*(?:"(?:\\.|[^"\\])*"\s*)?(?:\{(?P<marks>[^}]*)\})?',
    re.DOTALL,
)


@dataclass
class HoaTable:
    """Deterministic and complete, the start being state 0; `names` are the propositions by number, `alive` left out of letters."""

    names: tuple[str, ...]
    verdicts: list[Verdict]
    _edges: Edges
    _variables: tuple[int, ...]
    _buddy: Any
    _seen: dict[int, tuple[int, ...]] = field(default_factory=dict)
    _next: dict[tuple[int, tuple[bool, ...]], int] = field(default_factory=dict)

    @cached_property
    def ahead(self) -> list[frozenset[int]]:
        """For each state the numbers of the propositions on which it or a state that can follow depends."""
        found = [frozenset(self.seen(state)) for state in range(len(self._edges))]
        before = _backwards(self._edges)
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
            constants = {self._buddy.bddtrue, self._buddy.bddfalse}
            found = set()
            for label, _ in self._edges[state]:
                support = self._buddy.bdd_support(label)
                while support not in constants:
                    found.add(self._variables.index(self._buddy.bdd_var(support)))
                    support = self._buddy.bdd_high(support)
            self._seen[state] = tuple(sorted(found))
        return self._seen[state]

    def next(self, state: int, letter: tuple[bool, ...]) -> int:
        """The state after a letter, given as the values of the propositions `seen`."""
        if (state, letter) not in self._next:
            buddy = self._buddy
            values = buddy.bddtrue
            for number, true in zip(self.seen(state), letter, strict=True):
                variable = self._variables[number]
                values &= buddy.bdd_ithvar(variable) if true else buddy.bdd_nithvar(variable)
            targets = (to for label, to in self._edges[state] if label & values != buddy.bddfalse)
            self._next[state, letter] = next(targets)  # there is one, as the table is complete
        return self._next[state, letter]


def table(text: str) -> HoaTable:
    """The table of a text; raises `LanguageError`, `ToolMissing`, `TooLarge`."""
    spot, buddy = _tools()
    automaton = _parsed(spot, text)
    if not automaton.is_existential():
        automaton = spot.remove_alternation(automaton)
    names = tuple(str(proposition.ap_name()) for proposition in automaton.ap())
    variables = tuple(automaton.register_ap(name) for name in names)
    alive = buddy.bddtrue
    if ALIVE in names:
        alive = buddy.bdd_ithvar(variables[names.index(ALIVE)])
        moves = [[(edge.cond, edge.dst) for edge in automaton.out(state)] for state in range(automaton.num_states())]
        accepting = _after_the_end(spot, buddy, automaton, variables)
    else:
        moves, accepting = _over_finite_words(spot, automaton, text)
    subsets, edges = _determinised(buddy, alive, moves, automaton.get_init_state_number())
    accepted = [any(accepting[state] for state in subset) for subset in subsets]
    return HoaTable(names, _verdicts(edges, accepted), edges, variables, buddy)


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


def _after_the_end(spot: Any, buddy: Any, automaton: Any, variables: Sequence[int]) -> list[bool]:
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


def _over_finite_words(spot: Any, automaton: Any, text: str) -> tuple[Edges, list[bool]]:
    """The edges of an automaton over finite words, and for each state whether a word may end there.

    Where edges have marks, a state is split by the marks of the last edge.
    """
    states, acceptance = range(automaton.num_states()), automaton.acc()
    if (marks := _state_marks(text)) is not None:
        ends = [bool(acceptance.accepting(spot.mark_t(marks.get(state, [])))) for state in states]
        return [[(edge.cond, edge.dst) for edge in automaton.out(state)] for state in states], ends
    splits: dict[tuple[int, str], int] = {}
    ends = [False] * len(states)
    for edge in automaton.edges():
        if (edge.dst, str(edge.acc)) not in splits:
            splits[edge.dst, str(edge.acc)] = len(ends)
            ends.append(bool(acceptance.accepting(edge.acc)))
    edges = [[(edge.cond, splits[edge.dst, str(edge.acc)]) for edge in automaton.out(state)] for state in states]
    return [*edges, *(edges[state] for state, _ in splits)], ends


def _state_marks(text: str) -> dict[int, list[int]] | None:
    """The marks that a text puts on states, or None where it puts them on edges."""
    body = text.partition("--BODY--")[2]
    found = [token for token in _STATE.finditer(body) if token["state"] is not None]
    if not any(token["marks"] is not None for token in found):
        return None
    return {int(token["state"]): [int(mark) for mark in (token["marks"] or "").split()] for token in found}


def _determinised(buddy: Any, when: Any, moves: Edges, start: int) -> tuple[list[tuple[int, ...]], Edges]:
    """The subset construction over the letters that satisfy `when`; a missing edge leads to the empty subset."""
    number: dict[tuple[int, ...], int] = {(start,): 0}
    order = [*number]
    edges: Edges = []
    for subset in order:
        classes: dict[frozenset[int], Any] = {frozenset(): when}  # disjoint, by where their letters lead
        for state in subset:
            for label, to in moves[state]:
                refined: dict[frozenset[int], Any] = {}
                for states, known in classes.items():
                    both = known & label
                    for part, reached in ((both, states | {to}), (known - both, states)):
                        if part != buddy.bddfalse:
                            refined[reached] = refined[reached] | part if reached in refined else part
                classes = refined
        edges.append([])
        for states, label in classes.items():
            key = tuple(sorted(states))
            if key not in number:
                if len(order) >= LIMIT:
                    raise TooLarge("states of the determinised text", limit=LIMIT)
                number[key] = len(order)
                order.append(key)
            edges[-1].append((buddy.bdd_restrict(label, when), number[key]))
    return order, edges


def _backwards(edges: Edges) -> list[list[int]]:
    """For each state those with an edge to it."""
    before: list[list[int]] = [[] for _ in edges]
    for state, leaving in enumerate(edges):
        for _, to in leaving:
            before[to].append(state)
    return before


def _verdicts(edges: Edges, accepted: list[bool]) -> list[Verdict]:
    before = _backwards(edges)

    def can_come_to(accepting: bool) -> set[int]:
        todo = [state for state, accepts in enumerate(accepted) if accepts is accepting]
        reached = set(todo)
        while todo:
            new = [state for state in before[todo.pop()] if state not in reached]
            reached.update(new)
            todo += new
        return reached

    hopeful, doubtful = can_come_to(accepting=True), can_come_to(accepting=False)
    return [
        Verdict.FALSE if state not in hopeful else Verdict.TRUE if state not in doubtful else Verdict.UNKNOWN
        for state in range(len(edges))
    ]
