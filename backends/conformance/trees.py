"""The trees of the conformance suite, each with its relevant events.

They are gates with one to three children, with and without an event, under both causalities; every
gate in every other; shared nodes; events that match several nodes; guards, variables, `ignore`; and
parts that keep the alphabet of the whole tree.
"""

import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files
from itertools import product
from typing import Any, Final, get_args

from rvaft.core.restriction import restrict
from rvaft.language.parser import parse
from rvaft.model.event_time import TimeFormat
from rvaft.model.expressions import CLAUSES, GATES
from rvaft.model.guards import POINTS, Operator
from rvaft.model.nodes import Causality, Gate, Kind, Side
from rvaft.model.patterns import Pattern
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics


@dataclass(frozen=True, slots=True)
class Example:
    """A tree with matching events, which are always tried in their order and in reverse.

    `determinate`: no event matches two occurrences that may come next. Under the semantics `shown`,
    the tree detects `detects` and not `misses`.
    """

    name: str
    tree: RVAFT
    events: tuple[Json, ...]
    determinate: bool = False
    detects: Sequence[Json] = ()
    misses: Sequence[Json] = ()
    shown: frozenset[Semantics] = frozenset(Semantics)


WRITTEN_GATES = (*GATES, "1of{n}", "2of{n}", "3of{n}")
EVENTS = "event at(k) = { k: k }; event px(p) = { x: p }; event py(p) = { y: p }; event pxy(p, q) = { x: p, y: q }; "
TYPED = 'event done() = { k: "d" }; ' + " ".join(
    f'event {name}(p: {type_}) = {{ k: "{name}", x: p }};'
    for name, type_ in (("ta", "text"), ("na", "number"), ("ia", "integer"), ("ba", "boolean"))
)
"""Event types of which each has a parameter of a declared type."""
GROUPS: dict[str, dict[str, Any]] = tomllib.loads(files("backends").joinpath("conformance.toml").read_text("utf-8"))
"""Trees by topic."""
CONSTRUCTS: Final = frozenset(
    {
        *Gate,
        *Causality,
        *POINTS,
        *(clause for clause in CLAUSES if clause not in (*Kind, "label", "without")),
        *(f"without, {side}" for side in Side),
        *(pattern.__name__ for pattern in get_args(Pattern)),
        *("ignore", "late", "shared", "a variable over two events", "a variable of some item", "when, on a gate"),
    }
)
"""All constructs of trees except operators of guards, and kinds and labels, which change no
verdict.
"""


assert set(GROUPS["operator"]) == set(Operator), set(GROUPS["operator"]) ^ set(Operator)


assert {*TimeFormat} <= set(GROUPS["format"]), set(GROUPS["format"]) ^ set(TimeFormat)


assert set(GROUPS["construct"]) == CONSTRUCTS, set(GROUPS["construct"]) ^ CONSTRUCTS


DETERMINATE = {
    "one value twice",
    "two values that must differ",
    "a guard on an event",
    "a guard on a later event",
    "guards as alternatives",
    "undefined guards",
}
VALUES: tuple[Json, ...] = tuple({name: value} for name in "xyk" for value in range(name != "x", 4))
PAIRS: tuple[Json, ...] = tuple({"x": x, "y": y} for x, y in ((1, 1), (1, 2), (2, 1)))
TIMES: Final = (0, "1.0", 2.5)
TEXTS: Final = ("ab", "Ab", "b", "1e0", "01", 1, -1.5, 2, None, [1])
AT_A: Final = "r sand a b; b on py(_); a on "
DECISIVE: dict[str, tuple[str, Json]] = {
    "at least, and equal": ("px(X) when X >= 2", 2),
    "more than, and equal": ("px(X) when X > 2", 2),
    "at most, and equal": ("px(X) when X <= 2", 2),
    "less than, and equal": ("px(X) when X < 2", 2),
    "one of two conditions": ("px(X) when X < 1 or X > 2", 3),
    "the other of two conditions": ("px(X) when X > 2 or X < 1", 3),
    "the first of both conditions": ("px(X) when X > 0 and X < 3", 3),
    "the second of both conditions": ("px(X) when X < 3 and X > 0", 0),
    "a condition that does not hold": ("px(X) when not (X == 1)", 1),
    "a text for a number": ("px(1)", "1"),
    "a number for a text": ('px("1")', 1),
    "a truth for a number": ("px(1)", True),
    "a number for a truth": ("px(true)", 1),
    "a number written otherwise": ("px(1)", 1.0),
    "nothing for a number": ("px(0)", None),
    "a text equal to a number": ("px(X) when X == 1", "1"),
    "a truth equal to a number": ("px(X) when X == 1", True),
    "a text unequal to a number": ("px(X) when X != 1", "1"),
    "a text more than a number": ("px(X) when X > 0", "1"),
    "a truth more than a number": ("px(X) when X > 0", True),
}
"""Per example: an event pattern, and a value that is easily confused with a matching one."""


def examples() -> Iterator[Example]:
    """Yield all examples in a stable order."""
    leaves = ("a", "b", "c")
    for size, gate in product((1, 2, 3), WRITTEN_GATES):
        if not gate[0].isdigit() or int(gate[0]) <= size:
            text = f"r {gate.format(n=size)} {' '.join(leaves[:size])};"
            yield _default(text, text)
            for causality in ("top_down", "bottom_up"):
                own = f"causality {causality}; t sand r z; {text.removesuffix(';')} on at(1);"
                yield _default(f"{text} with an event, {causality}", own)
    for outer, inner in product((*GATES, "2of3"), repeat=2):
        text = f"r {outer} a g{' d' * (outer == '2of3')}; g {inner} b c{' e' * (inner == '2of3')};"
        yield _default(text, text)
    for name, text in (GROUPS["plain"] | GROUPS["shared"]).items():
        yield _default(name, text)
        yield _default(f"{name}, bottom up", f"causality bottom_up; {text}")
    values: list[Json] = [{"x": 1}, {"y": 1}, {"x": 1, "y": 1}, {"x": 2}, {"y": 2}, {"k": 1}, {"k": 2}]
    for name, text in (GROUPS["overlapping"] | GROUPS["ignoring"]).items():
        yield Example(name, _tree(text), tuple(values))
    for name, text in GROUPS["variables"].items():
        events = [event for event in VALUES if "k" not in event or "at(" in text]
        events += [*(PAIRS if "pxy" in text else ()), {"x": "1"}, {"x": 1.0}]
        yield Example(name, _tree(text), tuple(events), name in DETERMINATE)
    for name, (event, value) in DECISIVE.items():
        yield Example(name, _tree(f"{AT_A}{event};"), ({"x": value}, {"y": 1}, {"x": 0}), determinate=True)
    for name, text in (GROUPS["counted"] | GROUPS["ending"]).items():
        one = _default(name, text)
        yield replace(one, events=(*one.events, *(event for event in VALUES if "k" not in event and "px" in text)))
    for name, text in GROUPS["timed"].items():
        one = _default(name, text)
        times: list[Json] = [*({"t": time} for time in TIMES), {}]
        yield replace(one, events=tuple({**event, **time} for event, time in product(one.events, times)))
    for name, text in GROUPS["text"].items():
        yield Example(name, _tree(text), tuple({field: value} for field in "xy" for value in TEXTS), determinate=True)
    for name, text in GROUPS["assuming"].items():
        kind = next((kind for kind in ("na", "ia", "ba") if f" {kind}(" in text), "ta")
        typed: list[Json] = [{"k": kind, "x": value} for value in (*TEXTS, True, False, "AB", "bc", 2**53)]
        others: list[Json] = [{"k": kind}, {"k": kind.upper(), "x": "ab"}, {"k": "d"}, {"k": "d"}]
        stamped: list[Json] = [{field: 1, "t": time} for field in "xy" for time in TIMES]
        yield Example(
            name, _tree(f"{TYPED}{text}"), tuple(stamped if "time" in text else [*typed, *others]), determinate=True
        )
    yield from rows()
    whole = _default("the whole", "r or p q; p sand a b; q sand a t; t or c d; c fault; d attack;")
    for number in (1, 2, 3):
        yield Example(f"branch {number}", restrict(whole.tree, branch=number), whole.events)
    for kind in ("fault", "attack"):
        yield Example(f"the {kind}s", restrict(whole.tree, kind=kind), whole.events)


def rows() -> Iterator[Example]:
    """Yield a tree per operator on one event and on two, and a tree per construct."""
    for name, row in GROUPS["operator"].items():
        guard, holding, failing = row["one"]
        text = f"r sand a b; a on px(X) when {guard}; b on py(_);"
        yield _row(
            f"operator `{name}`, one event", text, *([{"x": x}, {"y": 1}] for x in (holding, failing)), determinate=True
        )
        guard, *pairs = row["two"]
        text = f"r sand a b; a on px(X); b on py(Y) when {guard};"
        yield _row(f"operator `{name}`, two events", text, *([{"x": x}, {"y": y}] for x, y in pairs), determinate=True)
    for name, row in GROUPS["construct"].items():
        traces = (
            [{"event": one} if isinstance(one, str) else one for one in row[key]] for key in ("detects", "misses")
        )
        shown = frozenset(map(Semantics, row.get("semantics", Semantics)))
        yield replace(_row(f"construct `{name}`", row["tree"], *traces), shown=shown)
    for name, (first, near, far) in GROUPS["format"].items():
        found = ([{"event": "a", "t": first}, {"event": "b", "t": time}] for time in (near, far))
        yield _row(f"times as {name}", f"time t as {name}; r sand a b within 2 s;", *found)


def _row(name: str, text: str, detects: list[Json], misses: list[Json], *, determinate: bool = False) -> Example:
    events = {repr(event): event for event in (*detects, *misses)}
    return Example(name, _tree(text), tuple(events.values()), determinate, detects, misses)


def _tree(text: str) -> RVAFT:
    return parse(f"{EVENTS} toplevel {'t' if ' t sand r z' in text else 'r'}; {text}").build()


def _default(name: str, text: str) -> Example:
    tree = _tree(text)
    words = [n.name for n in tree.top_down() if n.has_event and n.on is None]
    numbers = [{"k": number} for number in (1, 2) if f"at({number})" in text]
    return Example(name, tree, (*({"event": word} for word in sorted(words)), *numbers))
