"""A HOA text as a deterministic table over finite words, made with Spot.

The verdict of a state is that of the automaton alone, over all letters: ⊤ when the word and every extension are accepted, ⊥ when
neither the word nor any extension is; `finite` says when a word is accepted.
"""

import re
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any, Final

from backends.automaton.finite import Moves, after_the_end, ends, marked_moves, moves
from backends.automaton.header import error_at
from backends.automaton.names import ALIVE
from rvaft.errors import LanguageError, TooLarge, ToolMissing
from rvaft.verdict import Verdict

LIMIT: Final = 100_000
"""The most states that a nondeterministic text may turn into."""

_PLACE: Final = re.compile(r"^<hoa>:(\d+)\.(\d+)[-.\d]*: (.*)$", re.MULTILINE)


@dataclass(slots=True)
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
        for number, holds in zip(self.seen(state), letter, strict=True):
            variable = self._variables[number]
            values &= buddy.bdd_ithvar(variable) if holds else buddy.bdd_nithvar(variable)
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
