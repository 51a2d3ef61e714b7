"""The trees of the conformance suite, each with the events that matter to it.

Every gate at one to three children, with and without its own event, under both causalities; every gate in every other; nodes
shared in all ways; events that several nodes fit; guards, variables, `ignore`, and parts that keep the whole tree's alphabet.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import Any

from rvaft.language import loads
from rvaft.restrict import restrict
from rvaft.tree import RVAFT
from rvaft.values import Json


@dataclass(frozen=True, slots=True)
class Example:
    """A tree, and events that fit its nodes.

    `determinate`: whenever two occurrences may be next after the same events, no event fits both, so that there is
    never more than one assignment of the variables to follow.
    """

    name: str
    tree: RVAFT
    events: tuple[Json, ...]
    determinate: bool = False


GATES = ("or", "and", "sand", "sand_rl", "1of{n}", "2of{n}", "3of{n}")
EVENTS = "event at(k) = { k: k }; event px(p) = { x: p }; event py(p) = { y: p }; event pxy(p, q) = { x: p, y: q }; "

SHARED = {
    "a leaf under two and gates": "r and p q; p and a s; q and b s;",
    "a leaf under two or gates": "r and p q; p or a s; q or b s;",
    "a leaf that ends two sequences": "r and p q; p sand a s; q sand b s;",
    "a leaf that starts two sequences": "r and p q; p sand s a; q sand s b;",
    "a leaf that ends one sequence and starts another": "r and p q; p sand a s; q sand s b;",
    "a leaf in a vote and outside": "r and v s; v 2of3 a b s;",
    "a leaf in two votes": "r sand v w; v 2of3 a b s; w 1of2 s c;",
    "a leaf in an alternative and a sequence": "r and p q; p or a s; q sand s b;",
    "a sequence that only one alternative asks for": "r and p q t; p or s a; q or b c; t or u a; u sand b s;",
    "a choice below two gates": "r and p q; p and c a; q and c b; c or d e;",
    "a gate with an event below two gates": "r and p q; p sand a g; q sand b g; g and c on at(1);",
    "a gate with an event below two alternatives": "r or p q; p sand a g; q sand g b; g and c on at(1);",
    "an infeasible alternative": "r and s t; s or p a; p sand b c; t sand c b;",
    "an infeasible sequence in a choice": "r or a p; p sand q t; q and b c; t and c a;",
    "a shared choice in a sequence": "r sand p q; p or a c; q or c b;",
}

PLAIN = {
    "a vote before an event": "r sand v d; v 2of3 a b c;",
    "a vote after an event": "r sand d v; v 2of3 a b c;",
    "a vote over a sequence": "r 2of3 s b c; s sand a d;",
    "a vote over votes": "r 2of2 v w; v 1of2 a b; w 2of3 c d e;",
    "alternatives with a common start": "r or p q; p sand a b; q sand a c;",
    "alternatives of different length": "r sand p c; p or a q; q sand a b;",
    "an event that returns": "r sand p q t; p and a on at(1); q and b on at(2); t and c on at(1);",
    "an N": "r and s t; s sand a c; t sand b m; m and c d;",
    "an event on a gate of alternatives": "r sand g c; g or a b on at(1);",
    "an event on a vote": "r sand g d; g 2of3 a b c on at(1);",
    "an event on the root": "r and a b on at(1);",
    "a constant guard": "r or p b; p and a z; z when 1 > 2;",
    "a guard that always holds": "r and a z; z when 1 < 2;",
    "deep": "r sand a p; p or q t; q and b s; s sand c d; t sand_rl e u; u and b c;",
}

OVERLAPPING = {
    "one event for two": "r and a b; a on px(1); b on py(1);",
    "one event for two in sequence": "r sand a b; a on px(1); b on py(1);",
    "one event for two alternatives": "r or p q; p sand a c; q sand b d; a on px(1); b on py(1);",
    "two nodes with the same event": "r and a b c; a on at(1); b on at(1); c on at(2);",
    "a general and a special event": "r sand p c; p and a b; a on px(_); b on px(1); c on py(_);",
    "a vote over overlapping events": "r 2of3 a b c; a on px(1); b on py(1); c on pxy(_, _);",
    "relevant by another node only": "r or p b; p sand a c; a on px(1); b on px(_); c on py(2);",
    "same event along a sequence": "r sand a b c; a on at(1); b on at(1); c on at(1);",
}

IGNORING = {
    "ignored by a guard": "ignore px(V) when V > 1; r sand a b; a on px(_); b on py(_);",
    "ignored by the order of strings": 'ignore px(V) when V > "1"; r sand a b; a on px(_); b on py(_);',
    "ignored outright": "ignore pxy(_, _); r and a b; a on px(1); b on py(1);",
    "a node that waits for what is ignored": "ignore py(_); r sand a b; a on px(1); b on py(1);",
}

VARIABLES = {
    "one value twice": ("r sand a b; a on px(X); b on py(X);", True),
    "one value in any order": ("r and a b; a on px(X); b on py(X);", False),
    "two values": ("r and a b; a on px(X); b on py(Y);", False),
    "two values that must differ": ("r sand a b z; a on px(X); b on py(Y); z when X != Y;", True),
    "two bindings at once": ("r sand p c; p and a b; a on px(X); b on px(Y); c on pxy(X, Y);", False),
    "a value given up": (
        "r or p q; p sand a b; q sand c d; a on px(X); b on py(X); c on px(Y); d on pxy(Y, 1);",
        False,
    ),
    "a guard on an event": ("r sand a b; a on px(X) when X > 1; b on py(_);", True),
    "a guard on a later event": ("r sand a b; a on px(X); b on py(Y) when Y > X;", True),
    "a guard on a gate": ("r sand g c; g and a b when X == Y; a on px(X); b on py(Y); c on at(1);", False),
    "guards as alternatives": ("r sand a c; a on px(X); c or low high; low when X < 2; high when X > 2;", True),
    "a guard or an event": (
        "r sand a c b; a on px(X); c or big next; big when X > 2; next on at(1); b on py(_);",
        False,
    ),
    "a guard in a vote": ("r and a v; a on px(X); v 2of3 big b c; big when X > 1; b on at(1); c on at(2);", False),
    "guards of a vote": ("r and a v; a on px(X); v 2of3 s t u; s when X > 0; t when X > 1; u when X < 2;", False),
    "a guard on a shared node": (
        "r and p q; p and s a; q and s b; s on px(X) when X > 1; a on at(1); b on py(X);",
        False,
    ),
    "a value inside one event": ("r sand a b; a on pxy(X, X); b on px(X);", False),
    "a guard of three variables": (
        "r and a b c z; a on px(X); b on py(Y); c on at(Z); z when X + Y == Z;",
        False,
    ),
    "bound by alternatives": ("r sand p c; p or a b; a on px(X); b on py(X); c on at(X);", False),
    "ignored by values": ("ignore px(V) when V < 1; r sand a b; a on px(X); b on pxy(_, X);", False),
    "undefined guards": ("r sand a b; a on px(X); b or y z; y when X > 1; z when not (X > 1);", True),
}

VALUES: tuple[Any, ...] = (0, 1, 2, 3)


def examples() -> Iterator[Example]:
    """All of them, in a stable order."""
    yield from _gates()
    yield from _nested()
    for name, text in (*PLAIN.items(), *SHARED.items()):
        yield _default(name, text)
        yield _default(f"{name}, bottom up", f"causality bottom_up; {text}")
    values = [{"x": 1}, {"y": 1}, {"x": 1, "y": 1}, {"x": 2}, {"y": 2}, {"k": 1}, {"k": 2}]
    for name, text in OVERLAPPING.items():
        yield Example(name, _tree(text), tuple(values))
    for name, text in IGNORING.items():
        yield Example(name, _tree(text), tuple(values))
    for name, (text, determinate) in VARIABLES.items():
        yield Example(name, _tree(text), _valued(text), determinate)
    yield from _restricted()


def _gates() -> Iterator[Example]:
    leaves = ("a", "b", "c")
    for size, gate in product((1, 2, 3), GATES):
        if gate[0].isdigit() and int(gate[0]) > size:
            continue
        text = f"r {gate.format(n=size)} {' '.join(leaves[:size])};"
        yield _default(text, text)
        for causality in ("top_down", "bottom_up"):
            own = f"causality {causality}; t sand r z; {text.removesuffix(';')} on at(1);"
            yield _default(f"{text} with an event, {causality}", own)


def _nested() -> Iterator[Example]:
    for outer, inner in product(("or", "and", "sand", "sand_rl", "2of3"), repeat=2):
        third = " d" if outer == "2of3" else ""
        below = " e" if inner == "2of3" else ""
        text = f"r {outer} a g{third}; g {inner} b c{below};"
        yield _default(text, text)


def _restricted() -> Iterator[Example]:
    text = "r or p q; p sand a b; q sand a t; t or c d; c fault; d attack;"
    whole = _default("the whole", text)
    for number in (1, 2, 3):
        yield Example(f"branch {number}", restrict(whole.tree, branch=number), whole.events)
    for kind in ("fault", "attack"):
        yield Example(f"the {kind}s", restrict(whole.tree, kind=kind), whole.events)


def _tree(text: str) -> RVAFT:
    return loads(f"{EVENTS} toplevel {'t' if ' t sand r z' in text else 'r'}; {text}")


def _default(name: str, text: str) -> Example:
    """A tree over default events and `at`."""
    tree = _tree(text)
    words = [n.name for n in tree.top_down() if n.has_event and n.on is None]
    numbers = [{"k": number} for number in (1, 2) if f"at({number})" in text]
    return Example(name, tree, (*({"event": word} for word in sorted(words)), *numbers))


def _valued(text: str) -> tuple[Json, ...]:
    """Events with values that meet and miss, of a wrong type too."""
    events: list[Json] = [{"x": value} for value in VALUES] + [{"y": value} for value in VALUES[1:]]
    events += [{"k": value} for value in (1, 2, 3) if "at(" in text]
    events += [{"x": x, "y": y} for x, y in ((1, 1), (1, 2), (2, 1)) if "pxy" in text]
    return (*events, {"x": "1"}, {"x": 1.0})
