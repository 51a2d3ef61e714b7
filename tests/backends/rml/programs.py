"""RML programs with traces: the table `cases.txt` with the verdicts of the published tools, and random ones over the letters a, b and c."""

import json
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
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
_PLAIN: Final = ("a", "b", "c", "a", "b", "c", "ab", "nota", "a2", "any", "none")
_UNARY: Final = ("av", "bv", "cv", "nav", "abv", "ac", "big", "abx", "either", "lw")
_SUFFIXES: Final = ("*", "+", "?", "!", "{0}", "{1}", "{2}", "{3}")
_JOINS: Final = ((" ", 4), (" /\\ ", 3), (" \\/ ", 2), (" | ", 1))


class Programs:
    """Programs from one source of randomness."""

    def __init__(self, random: Random) -> None:
        self._random = random
        self._variables: list[str] = []
        self._parameter = ""
        self._used: set[str] = set()

    def text(self) -> str:
        """A program with every operator, several equations, generics, and blocks that bind."""
        self._used = set()
        first = "" if self._random.random() < 0.3 else f"({self._type()}) "
        lines = [f"Main = {first}({self._expression(self._random.randint(2, 4))});"]
        done: set[str] = set()
        while rest := sorted(self._used - done):
            done.add(rest[0])
            lines.append(self._equation(rest[0]))
        return HEAD + "\n".join(lines) + "\n"

    def _equation(self, name: str) -> str:
        first = f"({self._type()}) "
        if name in "AB":
            return f"{name} = {first}({self._expression(2)});"
        self._parameter = self._random.choice("nx")
        text = f"{name}<{self._parameter}> = {first}({self._expression(2)});"
        self._parameter = ""
        return text

    def _type(self) -> str:
        kind = self._random.random()
        if kind < 0.55:
            return self._random.choice(_PLAIN)
        if kind < 0.95:
            return f"{self._random.choice(_UNARY)}({self._argument()})"
        return f"two({self._argument()},{self._argument()})"

    def _argument(self) -> str:
        kind = self._random.random()
        if self._variables and kind < 0.7:
            return self._random.choice(self._variables)
        return self._random.choice("xyz") if kind < 0.85 else str(self._random.randint(0, 3))

    def _expression(self, depth: int) -> str:
        if depth <= 0:
            return self._leaf()
        kind = self._random.randint(0, 15)
        if kind <= 8:
            join = self._random.choices([j for j, _ in _JOINS], [w for _, w in _JOINS])[0]
            parts = [self._below(depth) for _ in range(self._random.randint(2, 3))]
            return f"({join.join(parts)})"
        match kind:
            case 9:
                return f"{self._below(depth)}{self._random.choice(_SUFFIXES)}"
            case 10:
                outside = f" : {self._below(depth)}" if self._random.random() < 0.5 else ""
                return f"({self._type()} >> {self._below(depth)}{outside})"
            case 11 | 12:
                with self._variable() as name:
                    return f"{{let {name}; {self._below(depth)}}}"
            case 13 if self._parameter:
                condition = f"{self._parameter} {self._random.choice(['<', '>', '==', '!=', '<=', '>='])} 2"
                return f"(if ({condition}) {self._below(depth)} else {self._below(depth)})"
            case 14:
                return self._reference()
            case _:
                return self._type()

    def _below(self, depth: int) -> str:
        return f"({self._expression(depth - 1 - self._random.randint(0, 1))})"

    @contextmanager
    def _variable(self) -> Iterator[str]:
        self._variables.append(self._random.choice("xyz"))
        yield self._variables[-1]
        self._variables.pop()

    def _leaf(self) -> str:
        kind = self._random.random()
        if kind < 0.8:
            return self._type()
        return "empty" if kind < 0.87 else "all" if kind < 0.94 else self._reference()

    def _reference(self) -> str:
        name = self._random.choice("ABGH")
        self._used.add(name)
        if name in "AB":
            return name
        value = self._parameter if self._parameter and self._random.random() < 0.7 else self._random.choice("12")
        return f"{name}<{value}{self._random.choice(['', '', '-1', '+1'])}>"


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
