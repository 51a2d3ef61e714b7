"""Runs a HOA text on events, in slices (`backends.slices`), and says what the text asks of events.

Spot reads the text, which becomes a deterministic table over finite words. The verdict of a state
is that of the automaton alone, over all letters: ⊤ when the word and every extension are accepted,
⊥ when neither the word nor any extension is. Two readings say when a word is accepted. With a
proposition `alive` (the encoding of Spot's `from_ltlf`) it is when it goes on for ever without
`alive` and without any other proposition. Without `alive` the automaton is one over finite words:
it accepts where its run may end in an accepting state or, if acceptance is on the edges, with an
accepting edge, its marks being seen for ever.
"""

import re
import warnings
from collections.abc import Hashable, Iterator, Mapping, Sequence
from functools import cache, lru_cache, partial
from typing import Any, Final, TypeAlias

from backends import slices
from backends.automaton.hoa_writer import ALIVE
from rvaft.backend import Observed
from rvaft.core.classifier import Decided, PatternIndex
from rvaft.core.times import timed
from rvaft.errors import LanguageError, TooLarge, ToolMissing, installed
from rvaft.language.diagnostics import error_at
from rvaft.language.parser import parse_guard, parse_pattern, parse_time
from rvaft.model.event_time import EventTime
from rvaft.model.guards import Guard
from rvaft.model.guards import variables as guard_variables
from rvaft.model.patterns import (
    Anything,
    Binding,
    Literal,
    ObjectPattern,
    Pattern,
    match,
    rigid,
    rigid_variables,
)
from rvaft.model.values import Json
from rvaft.model.verdict import Verdict
from rvaft.monitors import Monitor
from rvaft.support.bits import bits, mask_of

_UNKNOWN: Final = Verdict.UNKNOWN  # looked up for every event
RELEVANT: Final = -1
"""Stands among the numbers of events for the propositions that say an event is relevant."""
LIMIT: Final = 100_000
"""The most states that a nondeterministic text may turn into."""


_error: Final = partial(error_at, file="<hoa>")

# The table: what Spot has read, determinised.

Edges: TypeAlias = list[list[tuple[Any, int]]]
"""For each state the edges that leave it: label (a diagram of BuDDy) and target."""

_PLACE: Final = re.compile(r"^<hoa>:(\d+)\.(\d+)[-.\d]*: (.*)$", re.MULTILINE)
_STATE: Final = re.compile(
    r'"(?:\\.|[^"\\])*"|/\*.*?\*/'
    r'|State:\s*(?:\[[^\]]*\]\s*)?(?P<state>\d+)\s*(?:"(?:\\.|[^"\\])*"\s*)?(?:\{(?P<marks>[^}]*)\})?',
    re.DOTALL,
)


class HoaTable:
    """A text made deterministic and complete, the start being state 0; `names` are the propositions by number."""

    def __init__(self, text: str) -> None:
        """Raises `LanguageError`, `ToolMissing`, `TooLarge`."""
        spot, self._buddy = _tools()
        automaton = _parsed(spot, text)
        if not automaton.is_existential():
            automaton = spot.remove_alternation(automaton)
        self.names = tuple(str(proposition.ap_name()) for proposition in automaton.ap())
        self._variables = tuple(automaton.register_ap(name) for name in self.names)
        alive = self._buddy.bddtrue
        if ALIVE in self.names:
            alive = self._buddy.bdd_ithvar(self._variables[self.names.index(ALIVE)])
            moves, accepting = _labelled(automaton), self._accepting_silence(spot, automaton)
        else:
            moves, accepting = _over_finite_words(spot, automaton, text)
        subsets, self._edges = _determinised(self._buddy, alive, moves, automaton.get_init_state_number())
        ends = self._ahead([1 if any(accepting[state] for state in subset) else 2 for subset in subsets])
        self.verdicts = [(Verdict.TRUE, Verdict.FALSE, Verdict.UNKNOWN)[some - 1] for some in ends]
        self.seen = cache(self._seen)
        self.next = cache(self._next)
        self.asked = cache(self._asked)

    def _accepting_silence(self, spot: Any, automaton: Any) -> list[bool]:
        """For each state whether the word that goes on with no proposition at all is accepted from there."""
        silence = always = self._buddy.bddtrue
        for variable in self._variables:
            silence &= self._buddy.bdd_nithvar(variable)
        after = spot.make_twa_graph(automaton.get_dict())
        after.copy_acceptance_of(automaton)
        states = automaton.num_states()
        after.new_states(states + 1)
        after.set_init_state(states)
        for state in range(states):
            after.new_edge(states, state, always)
            for edge in automaton.out(state):
                if edge.cond & silence != self._buddy.bddfalse:
                    after.new_edge(state, edge.dst, always, edge.acc)
        components = spot.scc_info_with_options(after, spot.scc_info_options_ALL)
        components.determine_unknown_acceptance()
        return [bool(components.is_useful_scc(components.scc_of(state))) for state in range(states)]

    def _asked(self) -> list[int]:
        """For each state the propositions, as bits, on which it or a state that can follow depends."""
        return self._ahead([mask_of(self.seen(state)) for state in range(len(self._edges))])

    def _ahead(self, own: Sequence[int]) -> list[int]:
        """For each state the union of its own bit set and those of all states that can follow."""
        before: list[list[int]] = [[] for _ in self._edges]
        for state, leaving in enumerate(self._edges):
            for _, to in leaving:
                before[to].append(state)
        found = list(own)
        changed = list(range(len(found)))
        while changed:
            state = changed.pop()
            for earlier in before[state]:
                if found[state] & ~found[earlier]:
                    found[earlier] |= found[state]
                    changed.append(earlier)
        return found

    def _seen(self, state: int) -> tuple[int, ...]:
        """The numbers of the propositions on which the next state depends."""
        found, support = [], self._buddy.bddtrue
        for label, _ in self._edges[state]:
            support &= self._buddy.bdd_support(label)
        while support != self._buddy.bddtrue:
            found.append(self._variables.index(self._buddy.bdd_var(support)))
            support = self._buddy.bdd_high(support)
        return tuple(sorted(found))

    def _next(self, state: int, letter: tuple[bool, ...]) -> int:
        """The state after a letter, given as the values of the propositions `seen`."""
        values = self._buddy.bddtrue
        for number, true in zip(self.seen(state), letter, strict=True):
            variable = self._variables[number]
            values &= self._buddy.bdd_ithvar(variable) if true else self._buddy.bdd_nithvar(variable)
        targets = (to for label, to in self._edges[state] if label & values != self._buddy.bddfalse)
        return next(targets)  # there is one, as the table is complete


def _tools() -> tuple[Any, Any]:
    remedy = "pip install spottl (Linux x86-64, Python below 3.14), or build Spot with its Python bindings"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        spot, buddy = (installed(name, "Spot", remedy) for name in ("spot", "buddy"))  # which becomes visible with Spot
    if not hasattr(spot, "automaton_stream_parser"):
        raise ToolMissing("Spot (the module named spot is another one)", remedy=remedy)
    return spot, buddy


def _parsed(spot: Any, text: str) -> Any:
    """The one automaton of a text."""
    start = re.match(r"(?:\s|/\*.*?\*/)*", text, re.DOTALL)
    position = start.end() if start else 0
    if not text.startswith("HOA:", position):
        raise _error("a HOA text begins with HOA: v1", text, position)
    if "\0" in text:
        raise _error("binary data (a zero byte), not a text", text, text.index("\0"))
    options = spot.automaton_parser_options()
    options.trust_hoa = False
    options.raise_errors = True
    parser = spot.automaton_stream_parser(text + "\n", "<hoa>", options)
    try:
        first = parser.parse(spot._bdd_dict)  # noqa: SLF001 -- the dictionary that Spot's own functions share
        second = parser.parse(spot._bdd_dict)  # noqa: SLF001
    except (SyntaxError, RuntimeError) as error:
        place = _PLACE.search(str(error))
        if place is None:
            raise LanguageError(" ".join(str(error).split()) or "not a HOA text", file="<hoa>") from None
        line, column, what = int(place[1]), int(place[2]), place[3].removeprefix("syntax error, ")
        source = [*text.split("\n"), ""][line - 1].rstrip("\r")
        raise LanguageError(what, file="<hoa>", line=line, column=column, source=source) from None
    if first.aut is None or first.aborted:
        raise _error("the text has no complete automaton", text, position)
    if second.aut is not None:
        raise _error("the text has more than one automaton", text, position)
    return first.aut


def _labelled(automaton: Any) -> Edges:
    return [[(edge.cond, edge.dst) for edge in automaton.out(state)] for state in range(automaton.num_states())]


def _over_finite_words(spot: Any, automaton: Any, text: str) -> tuple[Edges, list[bool]]:
    """The edges of an automaton over finite words, and for each state whether a word may end there.

    Where edges have marks, a state is split by the marks of the last edge.
    """
    states, acceptance = range(automaton.num_states()), automaton.acc()
    found = [one for one in _STATE.finditer(text.partition("--BODY--")[2]) if one["state"] is not None]
    if any(one["marks"] is not None for one in found):  # the text puts them on states
        marks = {int(one["state"]): [int(mark) for mark in (one["marks"] or "").split()] for one in found}
        ends = [bool(acceptance.accepting(spot.mark_t(marks.get(state, [])))) for state in states]
        return _labelled(automaton), ends
    splits: dict[tuple[int, str], int] = {}
    ends = [False] * len(states)
    for edge in automaton.edges():
        if (edge.dst, str(edge.acc)) not in splits:
            splits[edge.dst, str(edge.acc)] = len(ends)
            ends.append(bool(acceptance.accepting(edge.acc)))
    edges = [[(edge.cond, splits[edge.dst, str(edge.acc)]) for edge in automaton.out(state)] for state in states]
    return [*edges, *(edges[state] for state, _ in splits)], ends


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


# The program: the table, and what the lower-case header lines say, as `hoa_writer` writes them.

_HEADER: Final = re.compile(
    r'(?P<string>"(?:\\.|[^"\\])*")|(?P<comment>/\*.*?\*/)|(?P<name>[A-Za-z_][\w-]*:)'
    r'|(?P<end>--BODY--)|(?P<word>[^\s"]+)',
    re.DOTALL,
)
_EXPECTED: Final = {
    "event:": ((2, 3), "a number, a pattern in quotes, and the variable of the time in quotes where there is one"),
    "guard:": ((2,), "a number and a guard in quotes"),
    "time:": ((1,), "a field and its format in quotes"),
    "relevant:": ((1,), "a number"),
    "alphabet:": ((1, 2), "a pattern in quotes, and a guard in quotes where there is one"),
    "ignore:": ((1, 2), "a pattern in quotes, and a guard in quotes where there is one"),
}
"""Of each line how many values it has, and which."""


class HoaProgram:
    """A text made ready to run; monitors share it.

    Of its propositions `events` has the patterns with the variables that they share with others,
    `guards` the guards, `relevant` those that `alphabet` and `ignored` define. `atoms` gives the
    events of those that the text does not define.
    """

    def __init__(self, text: str, atoms: Mapping[str, Pattern]) -> None:
        """Raises `LanguageError`, `ToolMissing`, `TooLarge`."""
        self.time: EventTime | None = None
        self.guards: dict[int, Guard] = {}
        self.relevant: set[int] = set()
        self._patterns: dict[int, Pattern] = {}
        self._alphabet: list[Observed] = []
        self._ignored: list[Observed] = []
        lines: list[tuple[re.Match[str], list[str]]] = []
        for token in _HEADER.finditer(text):
            if token.lastgroup == "end":
                break
            if token.lastgroup == "name":
                lines.append((token, []))
            elif token.lastgroup != "comment" and lines:
                lines[-1][1].append(token.group())
        for start, values in lines:
            if start.group() in _EXPECTED:  # any other is a line of the format itself, or of somebody else
                try:
                    self._take(start.group(), values)
                except LanguageError as error:
                    raise _error(error.message, text, start.start()) from None
        self.table = HoaTable(text)
        explained = dict.fromkeys((*self._patterns, *self.guards, *self.relevant))
        for number in explained:
            if number >= len(self.table.names):
                raise _error(f"the text has no proposition {number}, but says what it means", text, 0)
        for number, name in enumerate(self.table.names):
            if number not in explained and name != ALIVE:
                self._patterns[number] = atoms.get(name, ObjectPattern((("event", Literal(name)),)))
        self.events = {
            number: (pattern, frozenset(rigid_variables(pattern))) for number, pattern in self._patterns.items()
        }
        self.matter = cache(self._matter)
        self.ties_nothing = (
            self.time is None and not self.guards and not any(shared for _, shared in self.events.values())
        )
        """Whether what holds of an event alone says where it leads: then the text is a table over that."""
        asked = (*self._patterns.values(), *(line.pattern for line in (*self._alphabet, *self._ignored)))
        self.of_shape = PatternIndex(asked, self._decided).of
        """As `holding`, or None where the shape of an event does not say it."""
        self.move = lru_cache(maxsize=LIMIT)(self._move)

    def _decided(self, decided: Decided) -> frozenset[int] | None:
        """As `holding`, of all events of a shape, or None where that does not say it."""
        first, last = len(self._patterns), len(self._patterns) + len(self._alphabet)
        guards = [line.when for line in (*self._alphabet, *self._ignored)]
        if decided.open or any(place >= first and guards[place - first] is not None for place in decided.fits):
            return None
        events = frozenset(number for place, number in enumerate(self._patterns) if place in decided.fits)
        relevant = any(first <= place < last for place in decided.fits) and decided.fits[-1] < last
        return events | {RELEVANT} if relevant and self.relevant else events

    def holding(self, event: Mapping[str, Json]) -> frozenset[int]:
        """The events that one is, where no variables are shared, and `RELEVANT` where it is that."""
        found = self.of_shape(event)
        if found is None:
            events = (number for number, pattern in self._patterns.items() if match(pattern, event, {}) is not None)
            found = frozenset((*events, *([RELEVANT] if self.relevant and self.is_relevant(event) else ())))
        return found

    def _move(self, state: int, holding: frozenset[int]) -> tuple[Verdict, int]:
        """What an event means in a state, where no variables are shared, and the state after it."""
        read = ((number if number in self.events else RELEVANT) in holding for number in self.table.seen(state))
        to = self.table.next(state, tuple(read))
        return self.table.verdicts[to], to

    def _take(self, name: str, values: list[str]) -> None:
        many, what = _EXPECTED[name]
        if len(values) not in many:
            raise LanguageError(f"{name} expects {what}")
        numbers = [] if name in ("alphabet:", "ignore:", "time:") else values[:1]
        for value in numbers:
            if not (value.isascii() and value.isdigit()):
                raise LanguageError(f"{name} expects the number of a proposition, not {value}")
        quoted = values[len(numbers) :]
        for value in quoted:
            if not value.startswith('"'):
                raise LanguageError(f"{name} expects quotes around {value}")
        texts = [re.sub(r"\\(.)", r"\1", value[1:-1], flags=re.DOTALL) for value in quoted]
        if name == "relevant:":
            self.relevant.add(int(values[0]))
        elif name == "time:":
            self.time = parse_time(f"time {texts[0]}")
        elif name == "guard:":
            self.guards[int(values[0])] = parse_guard(texts[0])
        elif not isinstance(pattern := parse_pattern(texts[0]), ObjectPattern | Anything):
            raise LanguageError("an event is an object: expected a pattern such as { field: 1 }, or _")
        elif name == "event:":
            if len(texts) == 2 and not texts[1].isidentifier():
                raise LanguageError(f"event: expects the name of a variable, not {texts[1]}")
            self._patterns[int(values[0])] = timed(pattern, texts[1]) if len(texts) == 2 else pattern
        else:
            fit = Observed(pattern, parse_guard(texts[1]) if len(texts) == 2 else None)
            (self._alphabet if name == "alphabet:" else self._ignored).append(fit)

    def is_relevant(self, event: Json) -> bool:
        """Whether an event fits a line of the alphabet and none to ignore, for some values of their variables."""
        return any(line.fits(event) for line in self._alphabet) and not any(line.fits(event) for line in self._ignored)

    def _matter(self, state: int) -> frozenset[str]:
        """The variables that the text may still ask for from a state on."""
        asked = [*bits(self.table.asked()[state])]
        shared = [self.events[number][1] for number in asked if number in self.events]
        guards = [self.guards[number] for number in asked if number in self.guards]
        return frozenset().union(*shared, *map(guard_variables, guards))

    def questions(self) -> Iterator[Observed]:
        """What the text asks of events: that they match its propositions, and what says whether they are relevant."""
        for pattern, shared in self.events.values():
            yield Observed(pattern)
            for guard in self.guards.values():  # a proposition of its own, about values that an event gives
                if not shared.isdisjoint(guard_variables(guard)):
                    yield Observed(pattern, guard)
        for fit in (*self._alphabet, *self._ignored) if self.relevant else ():
            yield fit.untied(rigid_variables(fit.pattern))  # some values will do


@lru_cache(maxsize=8)
def _program(text: str) -> HoaProgram:
    return HoaProgram(text, {})


def program(text: str, atoms: Mapping[str, Pattern] | None) -> HoaProgram:
    """The program of a text, kept for its other monitors; raises `LanguageError`, `ToolMissing`, `TooLarge`."""
    return _program(text) if atoms is None else HoaProgram(text, atoms)  # atoms may refuse a name, which no copy does


class HoaMonitor(Monitor):
    """Runs one program in slices; `TooLarge` beyond so many of them."""

    def __init__(self, program: HoaProgram) -> None:
        super().__init__()
        self._program = program
        self._slices = slices.start(0)
        self._at = 0
        """The state, where no variables are shared: then there is one slice."""
        self._plain = program.ties_nothing

    @property
    def state(self) -> Hashable:
        """The slices; after a final verdict only that."""
        if self._verdict.final:
            return self._verdict
        return frozenset(slices.start(self._at) if self._plain else self._slices)

    def step(self, event: Json) -> Verdict:
        """Read one event and return the verdict after it; raises `TraceError` for what is no JSON object."""
        if not self._plain or type(event) is not dict or self._verdict is not _UNKNOWN:
            return super().step(event)
        self._read += 1  # what follows is for very many events
        program = self._program
        holding = program.of_shape(event)
        self._verdict, self._at = program.move(self._at, program.holding(event) if holding is None else holding)
        return self._verdict

    def _advance(self, event: Json) -> Verdict:
        program, run, events = self._program, self._program.table, self._program.events
        if self._plain:
            verdict, self._at = program.move(self._at, program.holding(event))
            return verdict
        event = event if program.time is None else program.time.stamped(event)
        relevant = bool(program.relevant) and program.is_relevant(event)

        def extensions(state: int, bound: Binding) -> Iterator[Binding]:
            for number in run.seen(state):
                if number in events and not events[number][1] <= bound.keys():
                    found = match(events[number][0], event, bound)
                    if found is not None:
                        yield rigid(found)

        def is_true(number: int, bound: Binding, before: Binding) -> bool:
            if number in events:
                pattern, shared = events[number]
                return shared <= bound.keys() and slices.fits(partial(match, pattern, event), bound, before)
            return slices.passes(program.guards[number], bound) if number in program.guards else relevant

        def step(state: int, bound: Binding, before: Binding) -> tuple[Verdict, int]:
            to = run.next(state, tuple([is_true(number, bound, before) for number in run.seen(state)]))
            return run.verdicts[to], to

        followed = slices.advance(self._slices, extensions, step, matter=program.matter)
        if followed is None:
            return Verdict.TRUE
        self._slices = followed
        return Verdict.UNKNOWN if followed else Verdict.FALSE
