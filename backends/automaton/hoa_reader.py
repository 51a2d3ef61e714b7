"""A monitor for HOA texts, in slices (`backends.slices`), and the patterns that a text uses.

Spot parses the text. The automaton becomes a deterministic table over finite words. The verdict of
a state depends on the automaton alone, over all letters: ⊤ if the word and all extensions are
accepted, ⊥ if neither the word nor any extension is.

With a proposition `alive` (the encoding of Spot's `from_ltlf`), a word is accepted if its infinite
continuation without any proposition is. Without `alive` the automaton reads finite words: it
accepts if a run can end in an accepting state or, with marks on edges, with an accepting edge.
"""

import re
import warnings
from collections.abc import Hashable, Iterator, Mapping, Sequence
from functools import cache, lru_cache, partial
from typing import Any, Final, TypeAlias

from backends import slices
from backends.automaton.hoa_writer import ALIVE, checksum
from rvaft.backend import Observed
from rvaft.core.pattern_index import Decided, PatternIndex
from rvaft.core.times import timed
from rvaft.errors import LanguageError, NotExpressible, TooLarge, ToolMissing, error_at, installed, unwritten
from rvaft.export.event_conditions import EventConditions
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
    rigid_variables,
    rigid_ways,
    ways,
)
from rvaft.model.values import Json
from rvaft.model.verdict import Verdict
from rvaft.monitors import Monitor
from rvaft.support.bits import bits, mask_of

_UNKNOWN: Final = Verdict.UNKNOWN  # a global lookup per event is slow
RELEVANT: Final = -1
"""The pseudo-number of the propositions for relevant events."""
LIMIT: Final = 100_000
"""Maximum number of states after determinisation."""


_error: Final = partial(error_at, file="<hoa>")

# The table: the automaton that Spot parsed, determinised.

Edges: TypeAlias = list[list[tuple[Any, int]]]

_PLACE: Final = re.compile(r"^<hoa>:(\d+)\.(\d+)[-.\d]*: (.*)$", re.MULTILINE)
_STATE: Final = re.compile(
    r'"(?:\\.|[^"\\])*"|/\*.*?\*/'
    r'|State:\s*(?:\[[^\]]*\]\s*)?(?P<state>\d+)\s*(?:"(?:\\.|[^"\\])*"\s*)?(?:\{(?P<marks>[^}]*)\})?',
    re.DOTALL,
)


class HoaTable:
    """A deterministic, complete automaton with initial state 0; `names` lists the propositions."""

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
        self.dependencies = cache(self._dependencies)

    def _accepting_silence(self, spot: Any, automaton: Any) -> list[bool]:
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

    def _dependencies(self) -> list[int]:
        return self._ahead([mask_of(self.seen(state)) for state in range(len(self._edges))])

    def _ahead(self, own: Sequence[int]) -> list[int]:
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
        found, support = [], self._buddy.bddtrue
        for label, _ in self._edges[state]:
            support &= self._buddy.bdd_support(label)
        while support != self._buddy.bddtrue:
            found.append(self._variables.index(self._buddy.bdd_var(support)))
            support = self._buddy.bdd_high(support)
        return tuple(sorted(found))

    def _next(self, state: int, letter: tuple[bool, ...]) -> int:
        values = self._buddy.bddtrue
        for number, true in zip(self.seen(state), letter, strict=True):
            variable = self._variables[number]
            values &= self._buddy.bdd_ithvar(variable) if true else self._buddy.bdd_nithvar(variable)
        targets = (to for label, to in self._edges[state] if label & values != self._buddy.bddfalse)
        return next(targets)  # the table is complete


def _tools() -> tuple[Any, Any]:
    remedy = "pip install spottl (Linux x86-64, Python below 3.14), or build Spot with its Python bindings"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        spot, buddy = (
            installed(name, "Spot", remedy) for name in ("spot", "buddy")
        )  # buddy becomes importable with Spot
    if not hasattr(spot, "automaton_stream_parser"):
        raise ToolMissing("Spot (the module named spot is another program)", remedy=remedy)
    return spot, buddy


def _parsed(spot: Any, text: str) -> Any:
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
    """Return the edges of an automaton over finite words, and per state whether a word may end
    there.

    If edges have marks, states are split by the marks of the last edge.
    """
    states, acceptance = range(automaton.num_states()), automaton.acc()
    found = [one for one in _STATE.finditer(text.partition("--BODY--")[2]) if one["state"] is not None]
    if any(one["marks"] is not None for one in found):  # the marks are on states
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
    """Return the subset construction over letters that satisfy `when`.

    A missing edge leads to the empty subset.
    """
    number: dict[tuple[int, ...], int] = {(start,): 0}
    order = [*number]
    edges: Edges = []
    for subset in order:
        classes: dict[frozenset[int], Any] = {frozenset(): when}  # disjoint labels, by the states that they lead to
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


# The program: the table, and the lower-case header lines that `hoa_writer` writes.

_HEADER: Final = re.compile(
    r'(?P<string>"(?:\\.|[^"\\])*")|(?P<comment>/\*.*?\*/)|(?P<name>[A-Za-z_][\w-]*:)'
    r'|(?P<end>--BODY--)|(?P<word>[^\s"]+)',
    re.DOTALL,
)
_TOOL: Final = re.compile(r'^tool: "rvaft" "([0-9a-f]+)"\n', re.MULTILINE)
_EXPECTED: Final = {
    "event:": ((2, 3), "a number, a pattern in quotes, and the variable of the time in quotes where there is one"),
    "guard:": ((2,), "a number and a guard in quotes"),
    "time:": ((1,), "a field and its format in quotes"),
    "relevant:": ((1,), "a number"),
    "alphabet:": ((1, 2), "a pattern in quotes, and a guard in quotes where there is one"),
    "ignore:": ((1, 2), "a pattern in quotes, and a guard in quotes where there is one"),
}
"""For each header line, the allowed numbers of values, and their description."""


class HoaProgram:
    """A parsed HOA text, shared by its monitors; `atoms` as for `Backend.read`.

    `events` maps propositions to patterns with their shared variables, `guards` to guards.
    `relevant` holds the propositions that `alphabet` and `ignored` define.
    """

    def __init__(self, text: str, atoms: Mapping[str, Pattern]) -> None:
        """Raises `LanguageError`, `ToolMissing`, `TooLarge`."""
        self.time: EventTime | None = None
        self.guards: dict[int, Guard] = {}
        self.relevant: set[int] = set()
        self._patterns: dict[int, Pattern] = {}
        self.alphabet: list[Observed] = []
        self.ignored: list[Observed] = []
        lines: list[tuple[re.Match[str], list[str]]] = []
        for token in _HEADER.finditer(text):
            if token.lastgroup == "end":
                break
            if token.lastgroup == "name":
                lines.append((token, []))
            elif token.lastgroup != "comment" and lines:
                lines[-1][1].append(token.group())
        tool = _TOOL.search(text)
        self.binds_late = tool is not None and tool[1] == checksum(text[tool.end() :])
        """Whether slices bind the events that their state reads; this suffices in unchanged texts of trees."""
        for start, values in lines:
            if start.group() in _EXPECTED:  # other header lines belong to the format or to other tools
                try:
                    self._take(start.group(), values)
                except LanguageError as error:
                    raise _error(error.message, text, start.start()) from None
        self.table = HoaTable(text)
        explained = dict.fromkeys((*self._patterns, *self.guards, *self.relevant))
        for number in explained:
            if number >= len(self.table.names):
                raise _error(f"the text has no proposition {number}, but a header line defines it", text, 0)
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
        """Whether the successor depends on the current event alone."""
        patterns = (*self._patterns.values(), *(line.pattern for line in (*self.alphabet, *self.ignored)))
        self.of_shape = PatternIndex(patterns, self._decided).of
        self.move = lru_cache(maxsize=LIMIT)(self._move)

    def _decided(self, decided: Decided) -> frozenset[int] | None:
        first, last = len(self._patterns), len(self._patterns) + len(self.alphabet)
        guards = [line.when for line in (*self.alphabet, *self.ignored)]
        if decided.open or any(place >= first and guards[place - first] is not None for place in decided.fits):
            return None
        events = frozenset(number for place, number in enumerate(self._patterns) if place in decided.fits)
        relevant = any(first <= place < last for place in decided.fits) and decided.fits[-1] < last
        return events | {RELEVANT} if relevant and self.relevant else events

    def holding(self, event: Mapping[str, Json]) -> frozenset[int]:
        """Return the propositions of an event, including `RELEVANT`, if no variables are shared."""
        found = self.of_shape(event)
        if found is None:
            events = (number for number, pattern in self._patterns.items() if match(pattern, event, {}) is not None)
            found = frozenset((*events, *([RELEVANT] if self.relevant and self.is_relevant(event) else ())))
        return found

    def _move(self, state: int, holding: frozenset[int]) -> tuple[Verdict, int]:
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
            (self.alphabet if name == "alphabet:" else self.ignored).append(fit)

    def is_relevant(self, event: Json) -> bool:
        """Return whether an event fits an `alphabet` line and no `ignore` line, for some variable
        values.
        """
        return any(line.fits(event) for line in self.alphabet) and not any(line.fits(event) for line in self.ignored)

    def _matter(self, state: int) -> frozenset[str]:
        propositions = [*bits(self.table.dependencies()[state])]
        shared = [self.events[number][1] for number in propositions if number in self.events]
        guards = [self.guards[number] for number in propositions if number in self.guards]
        return frozenset().union(*shared, *map(guard_variables, guards))

    def questions(self) -> Iterator[Observed]:
        """Yield the patterns and guards of the propositions, and those that define relevance."""
        for pattern, shared in self.events.values():
            yield Observed(pattern)
            for guard in self.guards.values():  # a guard is a proposition about values that an event binds
                if not shared.isdisjoint(guard_variables(guard)):
                    yield Observed(pattern, guard)
        for fit in (*self.alphabet, *self.ignored) if self.relevant else ():
            yield fit.untied(rigid_variables(fit.pattern))  # any values suffice


@lru_cache(maxsize=8)
def _program(text: str) -> HoaProgram:
    return HoaProgram(text, {})


def program(text: str, atoms: Mapping[str, Pattern] | None, *, believed: bool = True) -> HoaProgram:
    """Return the cached program of a text, whose checksum is `believed`.

    Raises `LanguageError`, `ToolMissing`, `TooLarge`.
    """
    if atoms is None and believed:
        return _program(text)
    found = HoaProgram(text, atoms or {})  # `atoms` may reject a name by raising, so it is not cached
    found.binds_late = found.binds_late and believed
    return found


def formal(text: str) -> dict[str, Any]:
    """Return a Büchi automaton with marked states; raises `NotExpressible` and `LanguageError`."""
    known = program(text, None)
    spot, buddy = _tools()
    automaton, events = _parsed(spot, text), EventConditions(known.time)
    if not automaton.is_existential() or not automaton.prop_state_acc() or not automaton.acc().is_buchi():
        raise NotExpressible(unwritten("the text is no Büchi automaton with marks on states"))
    if ALIVE not in known.table.names:
        raise NotExpressible(unwritten(f"the text has no proposition {ALIVE}"))
    tests: dict[int, Json] = {}
    for number, name in enumerate(known.table.names):
        variable = automaton.register_ap(name)
        if name == ALIVE:  # whatever a header line says of it
            tests[variable] = ["alive"]
        elif number in known.events:
            tests[variable] = events.atom(known.events[number][0])
        elif number in known.guards:
            tests[variable] = events.atom(Anything(), [known.guards[number]])
        else:  # nothing is relevant after the end, also where every event is
            tests[variable] = ["and", ["alive"], events.relevance(known.alphabet, known.ignored)]

    @cache
    def label(condition: Any) -> Json:
        if condition in (buddy.bddtrue, buddy.bddfalse):
            return ["and"] if condition == buddy.bddtrue else ["or"]
        test, low = tests[buddy.bdd_var(condition)], label(buddy.bdd_low(condition))
        return ["or", ["and", test, label(buddy.bdd_high(condition))], ["and", ["not", test], low]]

    def state(number: int) -> Json:
        edges = [[label(edge.cond), edge.dst] for edge in automaton.out(number)]
        return {"marked": bool(automaton.state_is_accepting(number)), "edges": edges}

    states = list(map(state, range(automaton.num_states())))
    return events.text("automaton", {"start": automaton.get_init_state_number(), "states": states})


class HoaMonitor(Monitor):
    """Runs one program in slices; raises `TooLarge` beyond their limit."""

    def __init__(self, program: HoaProgram) -> None:
        super().__init__()
        self._program = program
        self._slices = slices.start(0)
        self._at = 0
        """The state if no variables are shared: there is one slice."""
        self._plain = program.ties_nothing

    @property
    def state(self) -> Hashable:
        """The slices, or the verdict once it is final."""
        if self._verdict.final:
            return self._verdict
        return frozenset(slices.start(self._at) if self._plain else self._slices)

    def step(self, event: Json) -> Verdict:
        """Read one event and return the verdict; raises `TraceError` if it is not a JSON object."""
        if not self._plain or type(event) is not dict or self._verdict is not _UNKNOWN:
            return super().step(event)
        self._read += 1  # fast path
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
            needed = program.matter(state) - bound.keys()
            for number in run.seen(state) if program.binds_late else events:
                if number in events and not needed.isdisjoint(events[number][1]):
                    yield from rigid_ways(ways(events[number][0], event, bound))

        def is_true(number: int, bound: Binding, before: Binding) -> bool:
            if number in events:
                pattern, shared = events[number]
                return shared <= bound.keys() and slices.fits(partial(ways, pattern, event), bound, before)
            return slices.passes(program.guards[number], bound) if number in program.guards else relevant

        def step(state: int, bound: Binding, before: Binding) -> tuple[Verdict, int]:
            to = run.next(state, tuple([is_true(number, bound, before) for number in run.seen(state)]))
            return run.verdicts[to], to

        followed = slices.advance(
            self._slices, extensions, step, matter=program.matter, keep_all=not program.binds_late
        )
        if followed is None:
            return Verdict.TRUE
        self._slices = followed
        return Verdict.UNKNOWN if followed else Verdict.FALSE
