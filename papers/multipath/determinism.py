"""Whether the verdict of a tree is a function of the events that an observer sees.

A tree is *observationally deterministic* for a set of hidden event types if traces that are equal
without the hidden events have equal verdicts. A trace may also idle, so that traces of different
lengths are compared step by step. The verdict is that of the tree's automaton, in which guards are
free inputs: values that several events share restrict nothing here.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Final, NamedTuple

from backends.automaton.hoa_reader import HoaProgram, program
from backends.automaton.letters import FeasibleLetters
from rvaft import RVAFT, NotExpressible, Semantics, Verdict, translate
from rvaft.errors import unwritten
from rvaft.model.expressions import guard_text
from rvaft.support.bits import bits

OTHER: Final = "any other event"
IDLE: Final = "nothing"


class EventLetter(NamedTuple):
    """What an event is for the automaton: its types, and the guards that hold."""

    types: frozenset[str]
    guards: tuple[str, ...]

    def __str__(self) -> str:
        held = f" with {' and '.join(self.guards)}" if self.guards else ""
        return f"{' or '.join(sorted(self.types))}{held}"


@dataclass(frozen=True)
class Machine:
    """A minimal automaton with output: state 0 is initial, `next[state][letter]` the successor."""

    letters: Sequence[EventLetter]
    next: Sequence[Sequence[int]]
    verdicts: Sequence[Verdict]

    @cached_property
    def types(self) -> tuple[str, ...]:
        """The event types of the letters, except that of irrelevant events."""
        return tuple(dict.fromkeys(name for one in self.letters for name in sorted(one.types) if name != OTHER))

    def is_hidden(self, letter: EventLetter, hidden: Collection[str]) -> bool:
        """Whether an observer of the other types does not see a letter."""
        return letter.types <= {*hidden}

    def loops(self, name: str) -> bool:
        """Whether a type leads from each state to itself."""
        numbers = [number for number, letter in enumerate(self.letters) if letter.types == {name}]
        return all(row[number] == state for state, row in enumerate(self.next) for number in numbers)


def machine(tree: RVAFT, semantics: Semantics) -> Machine:
    """Return the minimal automaton of a tree; raises `NotExpressible` and `TooLarge`."""
    if tree.ignores:
        raise NotExpressible(unwritten("`ignore` is not covered here"))
    read = program(translate(tree, "automaton", semantics=semantics).text, None)
    letters = [*_letters(tree, read)]
    numbers, rows = {0: 0}, list[list[int]]()
    for state in (todo := [0]):
        row = []
        for holding, _ in letters:
            seen = read.table.seen(state)
            to = read.table.next(state, tuple(one in holding for one in seen))
            if to not in numbers:
                numbers[to] = len(numbers)
                todo.append(to)
            row.append(numbers[to])
        rows.append(row)
    verdicts = [read.table.verdicts[state] for state in numbers]
    return _minimal(Machine([letter for _, letter in letters], rows, verdicts))


def _letters(tree: RVAFT, read: HoaProgram) -> Iterator[tuple[frozenset[int], EventLetter]]:
    """Yield each letter with the propositions that hold, the irrelevant event first."""
    known = {tree.pattern(node.name): node.name if node.on is None else node.on.event for node in tree.top_down()}
    if not all(pattern in known for pattern, _ in read.events.values()):
        raise NotExpressible(unwritten("a proposition of the automaton is no event of a node"))
    places = [*read.events]
    guards = [*read.guards]
    for letter in FeasibleLetters([read.events[place][0] for place in places]).over((1 << len(places)) - 1):
        events = [places[bit] for bit in bits(letter)]
        types = frozenset(known[read.events[place][0]] for place in events) or frozenset({OTHER})
        for held in product((False, True), repeat=len(guards) if events else 0):
            true = [guard for guard, holds in zip(guards, held, strict=bool(events)) if holds]
            relevant = read.relevant if events else ()
            texts = tuple(guard_text(read.guards[one]) for one in true)
            yield frozenset((*events, *true, *relevant)), EventLetter(types, texts)
    used = {known[pattern] for pattern, _ in read.events.values()}
    for name in dict.fromkeys(name for pattern, name in known.items() if pattern is not None and name not in used):
        yield frozenset(read.relevant), EventLetter(frozenset({name}), ())


def _minimal(full: Machine) -> Machine:
    """Merge states that no word distinguishes, and letters that no state distinguishes."""
    blocks: list[object] = list(full.verdicts)
    while True:
        keys = [(block, tuple(blocks[to] for to in row)) for block, row in zip(blocks, full.next, strict=True)]
        numbers = {key: number for number, key in enumerate(dict.fromkeys(keys))}
        new: list[object] = [numbers[key] for key in keys]
        if len(numbers) == len(set(blocks)):
            break
        blocks = new
    first = {block: state for state, block in reversed([*enumerate(new)])}
    order = {block: number for number, block in enumerate(sorted(first, key=first.__getitem__))}
    rows = [[order[new[to]] for to in full.next[first[block]]] for block in order]
    columns: dict[object, int] = {}
    for number, letter in enumerate(full.letters):
        columns.setdefault((letter.types, tuple(row[number] for row in rows)), number)
    kept = [*columns.values()]
    return Machine(
        [full.letters[number] for number in kept],
        [[row[number] for number in kept] for row in rows],
        [full.verdicts[first[block]] for block in order],
    )


def difference(of: Machine, hidden: Collection[str]) -> list[tuple[EventLetter | None, EventLetter | None]] | None:
    """Return the steps of a shortest pair of traces that look equal and have different verdicts, if any.

    In a step, both traces have one letter that is seen, or one has a hidden letter and the other idles
    (None): two hidden letters are two steps.
    """
    unseen = [number for number, letter in enumerate(of.letters) if of.is_hidden(letter, hidden)]
    seen = [number for number in range(len(of.letters)) if number not in unseen]
    moves: list[tuple[int | None, int | None]] = [(number, number) for number in seen]
    moves += [move for number in unseen for move in ((number, None), (None, number))]
    before: dict[tuple[int, int], tuple[tuple[int, int], tuple[int | None, int | None]] | None] = {(0, 0): None}
    for pair in (todo := [(0, 0)]):
        if of.verdicts[pair[0]] is not of.verdicts[pair[1]]:
            steps, back = list[tuple[EventLetter | None, EventLetter | None]](), before[pair]
            while back is not None:
                earlier, (one, other) = back
                steps.append((_letter(of, one), _letter(of, other)))
                back = before[earlier]
            return steps[::-1]
        for move in moves:
            to = _after(of, pair[0], move[0]), _after(of, pair[1], move[1])
            if to not in before:
                before[to] = pair, move
                todo.append(to)
    return None


def _letter(of: Machine, number: int | None) -> EventLetter | None:
    return None if number is None else of.letters[number]


def _after(of: Machine, state: int, letter: int | None) -> int:
    return state if letter is None else of.next[state][letter]


# The texts for published tools.


def hyperltl(of: Machine, hidden: Collection[str]) -> Mapping[str, str]:
    """Return the property in the syntax of RVHyper and in that of MCHyper.

    `o0`, `o1`, … are the code of the letter that is seen, 0 for none; `detected` and `over` the verdict.
    """
    same = ["detected", "over"]
    code = [f"o{number}" for number in range(_width(len(_codes(of, hidden))))]

    def rv(names: Sequence[str]) -> str:
        return " & ".join(f"({name}_x <-> {name}_y)" for name in names) or "true"

    def mc(names: Sequence[str]) -> str:
        first, *rest = [f'(Eq (AP "{name}" 0) (AP "{name}" 1))' for name in names] or ["(Const True)"]
        return first if not rest else f"(And {first} {mc(names[1:])})"

    return {
        "rvhyper": f"forall x. forall y. ({rv(same)}) W ~({rv(code)})",
        "mchyper": f"Forall (Forall (WUntil {mc(same)} (Neg {mc(code)})))",
    }


def _codes(of: Machine, hidden: Collection[str]) -> dict[int, int]:
    seen = [number for number, letter in enumerate(of.letters) if not of.is_hidden(letter, hidden)]
    return {number: code for code, number in enumerate(seen, 1)}


def _width(most: int) -> int:
    return most.bit_length()


def aiger(of: Machine, hidden: Collection[str]) -> str:
    """Return the automaton as a circuit in the ASCII format of AIGER.

    The inputs are the code of a letter; other codes idle. The outputs are those of `hyperltl`, after the step.
    """
    inputs, latches = _width(len(of.letters)), max(1, _width(len(of.next) - 1))
    gates: dict[tuple[int, int], int] = {}

    def conjunction(one: int, other: int) -> int:
        one, other = sorted((one, other), reverse=True)
        if other < 2 or one == other:
            return one * other if other < 2 else one
        if one ^ other == 1:
            return 0
        return gates.setdefault((one, other), 2 * (inputs + latches + len(gates) + 1))

    def equals(first: int, width: int, number: int) -> int:
        made = 1
        for bit in range(width):
            made = conjunction(made, 2 * (first + bit) ^ (number >> bit & 1 ^ 1))
        return made

    def either(terms: Sequence[int]) -> int:
        made = 1
        for term in terms:
            made = conjunction(made, term ^ 1)
        return made ^ 1

    letter = [equals(1, inputs, code) for code in range(1, len(of.letters) + 1)]
    state = [equals(inputs + 1, latches, number) for number in range(len(of.next))]
    idle = either(letter) ^ 1
    into: list[list[int]] = [[conjunction(idle, state[number])] for number in range(len(of.next))]
    for number, row in enumerate(of.next):
        for place, to in enumerate(row):
            into[to].append(conjunction(letter[place], state[number]))
    reached = [either(terms) for terms in into]
    after = [either([reached[n] for n in range(len(of.next)) if n >> bit & 1]) for bit in range(latches)]
    codes = _codes(of, hidden)
    outputs = {
        "detected": either([reached[n] for n, verdict in enumerate(of.verdicts) if verdict is Verdict.TRUE]),
        "over": either([reached[n] for n, verdict in enumerate(of.verdicts) if verdict is Verdict.FALSE]),
    }
    for bit in range(_width(len(codes))):
        outputs[f"o{bit}"] = either([letter[place] for place, code in codes.items() if code >> bit & 1])
    most = inputs + latches + len(gates)
    lines = [f"aag {most} {inputs} {latches} {len(outputs)} {len(gates)}"]
    lines += [str(2 * number) for number in range(1, inputs + 1)]
    lines += [f"{2 * (inputs + 1 + bit)} {to}" for bit, to in enumerate(after)]
    lines += [str(made) for made in outputs.values()]
    lines += [f"{made} {one} {other}" for (one, other), made in gates.items()]
    lines += [f"i{number} letter{number}" for number in range(inputs)]
    lines += [f"o{number} {name}" for number, name in enumerate(outputs)]
    return "\n".join(lines) + "\n"
