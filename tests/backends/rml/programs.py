"""RML programs with traces: the table `cases.txt` with the verdicts of the published tools, and
random ones over the letters a, b and c.
"""

import json
import re
from collections.abc import Iterable
from pathlib import Path
from random import Random
from typing import Final, NamedTuple

from backends.rml import RmlBackend
from rvaft.errors import TooLarge
from rvaft.model.values import Json

SIGNS: Final = {"true": "T", "false": "F", "unknown": "?"}
LETTERS: Final = """\
a matches {e:'a'};
b matches {e:'b'};
c matches {e:'c'};
av(x) matches {e:'a', v:x};
bv(x) matches {e:'b', v:x};
"""
"""Event types that every text of the table may use: a letter, alone or with its field v."""


def letters(text: str, events: Iterable[Json]) -> str:
    """What this reader says: T, F or ? after each event, or that it is too large."""
    try:
        return "".join(SIGNS[verdict.value] for verdict in RmlBackend().read(text).run(events))
    except TooLarge as error:
        return str(error)


def events(trace: str) -> list[Json]:
    """`a` is {"e": "a"}, `a1` has v as well, `a1/2` has v and w; a trace in square brackets is JSON."""
    if trace.startswith("["):
        return list(json.loads(trace))
    words = [re.fullmatch(r"([a-z])(-?\d+)?(?:/(\d+))?", word) for word in trace.split()]
    values = [word.groups() for word in words if word]
    return [{"e": e, **{name: int(one) for name, one in (("v", v), ("w", w)) if one}} for e, v, w in values]


class Case(NamedTuple):
    """A text with the letters, and traces (see `events`) with their verdicts."""

    name: str
    text: str
    runs: dict[str, str]


def _case(block: str) -> Case:
    """A title behind `#`, the text, and lines of `=`, the verdicts and the trace."""
    title, *lines = block.strip().splitlines()
    runs = [line.removeprefix("= ").partition(" ") for line in lines if line.startswith("= ")]
    text = "\n".join(line for line in lines if not line.startswith("= "))
    return Case(title, LETTERS + text, {trace: verdicts for verdicts, _, trace in runs})


_TABLE: Final = Path(__file__).with_name("cases.txt").read_text(encoding="utf-8")
CASES: Final = tuple(map(_case, re.split(r"^# ", _TABLE, flags=re.MULTILINE)[1:]))

# -- random programs ---------------------------------------------------------------------------------------------------

HEAD: Final = (
    LETTERS
    + """\
cv(x) matches {e:'c', v:x};
ab matches a | b;
nota not matches a;
nav(x) not matches av(x);
abv(x) matches {e:'a'|'b', v:x};
ac(x) matches {e:'a', v:x} | {e:'c'};
big(x) matches {v:x} with x > 1;
a2 matches av(2);
abx(x) matches av(x) | bv(x);
two(x,y) matches {v:x, w:y};
either(x) matches {v:x|1, w:x};
lw(x) matches {w:x|2, v:x|3};
c matches {e:'c', v:1} | {e:'b', v:3};
"""
)
# What each part is made of, as often as the number says; a word in capital letters is a part, made in its turn.
_GRAMMAR: Final[dict[str, list[tuple[str, float]]]] = {
    "FIRST": [("", 3), ("(TYPE) ", 7)],
    "TYPE": [("PLAIN", 11), ("UNARY(ARGUMENT)", 8), ("two(ARGUMENT,ARGUMENT)", 1)],
    "PLAIN": [(word, 1) for word in ["a", "b", "c", "a", "b", "c", "ab", "nota", "a2", "any", "none"]],
    "UNARY": [(word, 1) for word in ["av", "bv", "cv", "nav", "abv", "ac", "big", "abx", "either", "lw"]],
    "ARGUMENT": [("BOUND", 14), ("NAME", 3), ("NUMBER", 3)],
    "NAME": [("x", 1), ("y", 1), ("z", 1)],
    "NUMBER": [(str(number), 1) for number in range(4)],
    "LEAF": [("TYPE", 80), ("empty", 7), ("all", 6), ("REFERENCE", 7)],
    "REFERENCE": [("A", 1), ("B", 1), ("G<VALUE MORE>", 1), ("H<VALUE MORE>", 1)],
    "VALUE": [("PARAMETER", 7), ("1", 1.5), ("2", 1.5)],
    "MORE": [("", 2), ("- 1", 1), ("+ 1", 1)],
    "BELOW": [("(EXPRESSION)", 1)],
    "EXPRESSION": [
        *((part, often) for join, often in ((" ", 4), (" /\\ ", 3), (" \\/ ", 2), (" | ", 1))
          for part in (f"(BELOW{join}BELOW)", f"(BELOW{join}BELOW{join}BELOW)")),
        *((f"BELOW{suffix}", 0.3) for suffix in ["*", "+", "?", "!", "{0}", "{1}", "{2}", "{3}"]),
        ("(TYPE >> BELOW)", 1), ("(TYPE >> BELOW : BELOW)", 1), ("LET", 4), ("IF", 2), ("REFERENCE", 2), ("TYPE", 2),
    ],
    "IF": [(f"(if (PARAMETER {sign} 2) BELOW else BELOW)", 1) for sign in ["<", ">", "==", "!=", "<=", ">="]],
}  # fmt: skip


class Programs:
    """Programs from one source of randomness."""

    def __init__(self, random: Random) -> None:
        self._random = random
        self._bound: list[str] = []
        self._parameter = ""

    def text(self) -> str:
        """A program with every operator, several equations, generics, and blocks that bind."""
        lines = [f"Main = {self._made('FIRST', 0)}({self._made('EXPRESSION', self._random.randint(2, 4))});"]
        done: set[str] = set()
        while rest := sorted(set(re.findall(r"\b[ABGH]\b", "\n".join(lines))) - done):
            done.add(rest[0])
            self._parameter = self._random.choice("nx") if rest[0] in "GH" else ""
            left = f"{rest[0]}<{self._parameter}>" if self._parameter else rest[0]
            lines.append(f"{left} = ({self._made('TYPE', 0)}) ({self._made('EXPRESSION', 2)});")
            self._parameter = ""
        return HEAD + "\n".join(lines) + "\n"

    def _made(self, part: str, depth: int) -> str:
        """The part, with expressions at most so deep."""
        if part == "LET":
            self._bound.append(self._random.choice("xyz"))
            found = f"{{let {self._bound[-1]}; {self._made('BELOW', depth)}}}"
            self._bound.pop()
            return found
        if part == "BOUND":
            return self._random.choice(self._bound) if self._bound else self._made("NAME", depth)
        if part == "PARAMETER":
            return self._parameter or self._random.choice("12")
        depth -= self._random.randint(1, 2) if part == "BELOW" else 0
        ways = _GRAMMAR["LEAF" if part == "EXPRESSION" and depth <= 0 else part]
        way = self._random.choices([text for text, _ in ways], [often for _, often in ways])[0]
        return re.sub("[A-Z]{2,}", lambda word: self._made(word[0], depth), way)


def event(random: Random) -> dict[str, Json]:
    """A letter, mostly with a field v, sometimes with a field w."""
    found: dict[str, Json] = {"e": random.choice("aabbc")}
    if random.random() < 0.85:
        found["v"] = random.randint(0, 3)
    if random.random() < 0.3:
        found["w"] = random.randint(0, 3)
    return found


def trace(random: Random, text: str) -> list[Json]:
    """A trace of up to nine events that stays undecided for as long as a few attempts find a way."""
    found: list[Json] = []
    for _ in range(random.randint(1, 9)):
        attempts = [event(random) for _ in range(6)]
        found.append(next((one for one in attempts if letters(text, [*found, one])[-1] == "?"), attempts[0]))
    return found
