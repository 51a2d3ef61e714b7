"""Hand-written cases: a tree, a trace, the verdict after every prefix, and the clause of the definition it shows.

Words stand for default events (`"a b"` is `[{"event": "a"}, {"event": "b"}]`); verdicts are `?`, `T` and `F`, one per event.
The table feeds the reference, the engine and every backend.
"""

from dataclasses import dataclass
from typing import Any

Trace = str | list[dict[str, Any]]


@dataclass(frozen=True)
class Case:
    """One row."""

    name: str
    tree: str
    semantics: str
    trace: Trace
    verdicts: str
    branch: int | None = None
    kind: str | None = None

    @property
    def events(self) -> list[dict[str, Any]]:
        """The trace as events."""
        return [{"event": word} for word in self.trace.split()] if isinstance(self.trace, str) else self.trace


def v(*values: Any) -> list[dict[str, Any]]:
    """Events `{"v": value}`."""
    return [{"v": value} for value in values]


OR = "top or a b c;"
AND = "top and a b c;"
SAND = "top sand a b c;"
SAND_RL = "top sand_rl a b c;"
VOT = "top 2of3 a b c;"
N_SHAPE = "top and s t; s sand a c; t sand b m; m and c d;"
GATE_EVENT = 'event e(n) = { event: n }; top and g; g and a b on e("g");'
LOUD = 'event e(n) = { event: n }; top sand g d; g 2of3 a b c on e("g");'
SHARED = "top and x y; x and a s; y and b s;"
SHARED_SAND = "top and x y; x sand a s; y sand s b;"
OVERLAP = "event p(x) = { x: x }; event q(y) = { y: y }; top and m n; m on p(1); n on q(1);"
ONE = "event n(v) = { v: v }; "
CHOICE = "event n(v) = { v: v }; event w(x) = { w: x }; top sand a b; a on n(X); b or late next; late when X >= 10; next on w(X);"

CASES = [
    Case(
        "equal values that arithmetic tells apart are two assignments: integers are exact, the rest IEEE doubles",
        'event e(n, v) = { n: n, v: v }; top sand a b late; a on e("a", T1); b on e("b", T2); late when T2 >= T1 + 11;',
        "scattered",
        [{"n": "a", "v": 2.0**53}, {"n": "a", "v": 2**53}, {"n": "b", "v": 2**53 + 11}],
        "??T",
    ),
    # -- gates ---------------------------------------------------------------------------------------------------
    Case("or takes exactly one child", OR, "strict", "b", "T"),
    Case("or: another word ends it under strict", OR, "strict", "z b", "FF"),
    Case("and in any order", AND, "strict", "c a b", "??T"),
    Case("and needs all", AND, "strict", "c a c", "??F"),
    Case("sand keeps the order", SAND, "strict", "a b c", "??T"),
    Case("sand refuses another order", SAND, "strict", "a c", "?F"),
    Case("sand_rl is right to left", SAND_RL, "strict", "c b a", "??T"),
    Case("sand_rl refuses left to right", SAND_RL, "strict", "a", "F"),
    Case("vot needs K", VOT, "strict", "c a", "?T"),
    Case("vot: one event does not count twice", VOT, "strict", "c c", "?F"),
    Case("vot over compound children interleaves", "top 2of3 s b c; s sand a d;", "strict", "a b d", "??T"),
    Case("at least K: K, then what follows", "top sand v d; v 2of3 a b c;", "strict", "a b d", "??T"),
    Case("at least K: K+1, then what follows", "top sand v d; v 2of3 a b c;", "strict", "a b c d", "???T"),
    Case("at least K: what follows ends the gate", "top sand v d e; v 2of3 a b c;", "strict", "a b d c", "???F"),
    Case("one child suffices for any gate", "top 1of1 g; g and h; h or a;", "strict", "a", "T"),
    # -- semantics -----------------------------------------------------------------------------------------------
    Case("strict uses the first positions", AND, "strict", "a z b c", "?FFF"),
    Case("projected skips what is irrelevant", AND, "projected", "z a z b z c", "?????T"),
    Case("projected: a repeated relevant event ends it", AND, "projected", "a b a c", "??FF"),
    Case("scattered may use any positions", AND, "scattered", "a a b z b c", "?????T"),
    Case("scattered is never false", SAND, "scattered", "c b z c b", "?????"),
    Case("scattered finds an order later", SAND, "scattered", "c b a c b c", "?????T"),
    Case("the empty trace is unknown", AND, "strict", [], ""),
    Case("verdicts never change again", OR, "projected", "a b c z", "TTTT"),
    Case("a final false stays", SAND, "projected", "b a b c", "FFFF"),
    Case(
        "projected: an event of another branch is relevant",
        "top or x y; x sand a b; y sand c d;",
        "projected",
        "a c b",
        "?FF",
    ),
    # -- events on gates, causality ------------------------------------------------------------------------------
    Case("causality top_down: gate first", GATE_EVENT, "strict", "g b a", "??T"),
    Case("causality top_down refuses the child first", GATE_EVENT, "strict", "a g b", "FFF"),
    Case("causality bottom_up: gate last", "causality bottom_up; " + GATE_EVENT, "strict", "b a g", "??T"),
    Case("causality bottom_up refuses the gate first", "causality bottom_up; " + GATE_EVENT, "strict", "g", "F"),
    Case("gate event and K+1 before what follows", LOUD, "strict", "g c a b d", "????T"),
    Case(
        "causality reaches through silent gates",
        'event e(n) = { event: n }; top and g on e("t"); g or h; h and a b;',
        "strict",
        "t b a",
        "??T",
    ),
    Case(
        "bottom_up with vot K+1 before the gate",
        'causality bottom_up; event e(n) = { event: n }; top 1of2 a b on e("t");',
        "strict",
        "a b t",
        "??T",
    ),
    Case(
        "an event on the root counts like any other",
        'event e(n) = { event: n }; top or a b on e("t");',
        "projected",
        "a",
        "F",
    ),
    # -- shared nodes --------------------------------------------------------------------------------------------
    Case("a shared node is one occurrence", SHARED, "strict", "a s b", "??T"),
    Case("a shared node is not asked for twice", SHARED, "strict", "a s s b", "??FF"),
    Case("a shared node between two orders", SHARED_SAND, "strict", "a s b", "??T"),
    Case("a shared node orders what stands around it", SHARED_SAND, "strict", "s a b", "FFF"),
    Case("a shared gate is resolved once", "top and x y; x and a s; y and b s; s or c d;", "strict", "a c b", "??T"),
    Case(
        "a shared gate is not resolved twice", "top and x y; x and a s; y and b s; s or c d;", "strict", "c a d", "??F"
    ),
    Case("N-shaped precedence holds", N_SHAPE, "strict", "b d a c", "???T"),
    Case("N-shaped precedence: d waits for b only", N_SHAPE, "strict", "b a d c", "???T"),
    Case("N-shaped precedence: c waits for a and b", N_SHAPE, "strict", "a c", "?F"),
    Case(
        "a silent shared node orders nothing",
        "top and x y; x sand a s; y sand s b; s when 1 < 2;",
        "strict",
        "b a",
        "?T",
    ),
    # -- infeasible scenarios ------------------------------------------------------------------------------------
    Case("a cyclic scenario is dropped", "top or bad c; bad sand x y; x and a s; y and s b;", "strict", "a", "F"),
    Case("the other scenarios stay", "top or bad c; bad sand x y; x and a s; y and s b;", "strict", "c", "T"),
    Case("a crossed order is infeasible", "top or bad c; bad and x y; x sand a b; y sand b a;", "strict", "a", "F"),
    Case(
        "a constant guard that fails drops its scenarios",
        'top or g b; g and a on e() when 1 > 2; event e() = { event: "g" };',
        "strict",
        "g",
        "F",
    ),
    Case("K children that are left suffice", "top 2of3 a n c; n and b when 2 < 1;", "strict", "c a", "?T"),
    # -- two occurrences, one event ------------------------------------------------------------------------------
    Case("one event serves one occurrence", OVERLAP, "strict", [{"x": 1, "y": 1}], "?"),
    Case("two events serve two", OVERLAP, "strict", [{"x": 1, "y": 1}, {"y": 1}], "?T"),
    Case("either way round", OVERLAP, "strict", [{"x": 1, "y": 1}, {"x": 1}], "?T"),
    Case("not the same one twice", OVERLAP, "strict", [{"x": 1}, {"x": 1}], "?F"),
    Case(
        "scattered: one event still serves one",
        OVERLAP,
        "scattered",
        [{"x": 1, "y": 1}, {"z": 1}, {"x": 1, "y": 1}],
        "??T",
    ),
    Case(
        "ordered occurrences of one event",
        'event e(n) = { event: n }; top sand m n; m on e("k"); n on e("k");',
        "strict",
        "k k",
        "?T",
    ),
    Case(
        "alternatives with a common start",
        'top or x y; x sand a b; y sand c d; a on e(); c on e(); event e() = { event: "k" };',
        "strict",
        "k d",
        "?T",
    ),
    # -- patterns and equality -----------------------------------------------------------------------------------
    Case("numbers are equal by value", ONE + "top and a; a on n(1);", "strict", v(1.0), "T"),
    Case("large integers are exact", ONE + "top and a; a on n(9007199254740993);", "strict", v(9007199254740992), "F"),
    Case("a boolean is no number", ONE + "top and a; a on n(1);", "strict", v(True), "F"),
    Case("null is a value", ONE + "top and a; a on n(null);", "strict", v(None), "T"),
    Case("a parameter matches null", ONE + "top and a; a on n(_);", "strict", v(None), "T"),
    Case("a parameter does not match an absent field", ONE + "top and a; a on n(_);", "strict", [{"w": 1}], "F"),
    Case("more fields are fine", ONE + "top and a; a on n(1);", "strict", [{"v": 1, "w": 2}], "T"),
    Case(
        "nested objects",
        "event n(v) = { a: { b: v, c: _ } }; top and x; x on n(1);",
        "strict",
        [{"a": {"b": 1, "c": [], "d": 0}}],
        "T",
    ),
    Case(
        "nested objects: missing field",
        "event n(v) = { a: { b: v, c: _ } }; top and x; x on n(1);",
        "strict",
        [{"a": {"b": 1}}],
        "F",
    ),
    Case(
        "lists have the same length",
        "event n(v) = { a: [_, v] }; top and x; x on n(1);",
        "strict",
        [{"a": [0, 1, 2]}],
        "F",
    ),
    Case("lists elementwise", "event n(v) = { a: [_, v] }; top and x; x on n(1);", "strict", [{"a": [None, 1]}], "T"),
    Case(
        "a parameter used twice demands equal values",
        "event n(v) = { a: v, b: v }; top and x; x on n(_);",
        "strict",
        [{"a": 1, "b": 2}],
        "F",
    ),
    Case(
        "a parameter used twice, equal by value",
        "event n(v) = { a: v, b: v }; top and x; x on n(_);",
        "strict",
        [{"a": [1], "b": [1.0]}],
        "T",
    ),
    Case(
        "deep equality of bound objects",
        ONE + "top sand a b; a on n(X); b on n(X);",
        "strict",
        v({"k": [1, {"l": 2}]}, {"k": [1.0, {"l": 2}]}),
        "?T",
    ),
    Case(
        "deep equality demands the same keys",
        ONE + "top sand a b; a on n(X); b on n(X);",
        "strict",
        v({"k": 1}, {"k": 1, "l": 2}),
        "?F",
    ),
    Case("strings by code points", ONE + 'top and a; a on n("é");', "strict", v("e\u0301"), "F"),
    Case("the default event", "top and a;", "strict", [{"event": "a", "more": 1}], "T"),
    Case("the default event of a quoted name", 'top and "A b";', "strict", [{"event": "A b"}], "T"),
    # -- variables -----------------------------------------------------------------------------------------------
    Case("variables are rigid", ONE + "top sand a b; a on n(X); b on n(X);", "strict", v(1, 1), "?T"),
    Case("another value does not match", ONE + "top sand a b; a on n(X); b on n(X);", "strict", v(1, 2), "?F"),
    Case(
        "another value is relevant all the same",
        ONE + "top sand a b; a on n(X); b on n(X);",
        "projected",
        v(1, 2, 1),
        "?FF",
    ),
    Case("scattered tries all values", ONE + "top sand a b; a on n(X); b on n(X);", "scattered", v(1, 2, 3, 2), "???T"),
    Case("each `_` is a fresh variable", ONE + "top sand a b; a on n(_); b on n(_);", "strict", v(1, 2), "?T"),
    Case(
        "a variable used twice in one `on`",
        "event m(a, b) = { a: a, b: b }; top and x; x on m(X, X);",
        "strict",
        [{"a": 1, "b": 2}],
        "F",
    ),
    # -- guards --------------------------------------------------------------------------------------------------
    Case("a guard on the event's own node", ONE + "top and a; a on n(X) when X > 5;", "strict", v(6), "T"),
    Case("a guard that fails", ONE + "top and a; a on n(X) when X > 5;", "strict", v(5), "F"),
    Case(
        "own `when` decides relevance",
        ONE + "top sand a b; a on n(X) when X > 5;",
        "projected",
        [{"v": 1}, {"v": 6}, {"v": 2}, {"event": "b"}],
        "???T",
    ),
    Case(
        "a guard as a node of its own does not",
        ONE + "top sand a h b; a on n(X); h when X > 5;",
        "projected",
        v(1, 6),
        "FF",
    ),
    Case(
        "a guard counts in every scenario with its node",
        ONE + "top sand a g; a on n(X); g and b when X > 5;",
        "strict",
        [{"v": 1}],
        "F",
    ),
    Case("a guard on a gate", ONE + "top and g; g sand a b when X < Y; a on n(X); b on n(Y);", "strict", v(1, 2), "?T"),
    Case(
        "a guard over two events fails at the second",
        ONE + "top and g; g sand a b c when X < Y; a on n(X); b on n(Y);",
        "strict",
        v(2, 1),
        "?F",
    ),
    Case("a guard-only leaf is a choice", CHOICE, "strict", [{"v": 10}], "T"),
    Case("or the other choice goes on", CHOICE, "strict", [{"v": 9}, {"w": 9}], "?T"),
    Case("the other choice may fail too", CHOICE, "strict", [{"v": 9}, {"w": 8}], "?F"),
    Case(
        "a guard-only leaf counts for K",
        ONE + "top and a v; a on n(X); v 2of3 g b c; g when X > 5;",
        "strict",
        [{"v": 6}, {"event": "c"}],
        "?T",
    ),
    Case(
        "and does not when it fails",
        ONE + "top and a v; a on n(X); v 2of3 g b c; g when X > 5;",
        "strict",
        [{"v": 5}, {"event": "c"}, {"event": "b"}],
        "??T",
    ),
    Case("undefined does not hold", ONE + "top and a; a on n(X) when X > 5;", "strict", v("6"), "F"),
    Case("nor does its negation", ONE + "top and a; a on n(X) when not (X > 5);", "strict", v("6"), "F"),
    Case("a boolean is not compared with a number", ONE + "top and a; a on n(X) when X >= 0;", "strict", v(True), "F"),
    Case("division by zero is undefined", ONE + "top and a; a on n(X) when 1 / X != 2;", "strict", v(0), "F"),
    Case("overflow is undefined", ONE + "top and a; a on n(X) when X * X > 0;", "strict", v(1e200), "F"),
    Case("integers do not overflow", ONE + "top and a; a on n(X) when X * X > 0;", "strict", v(10**200), "T"),
    Case(
        "or does not look right when the left decides",
        ONE + "top and a; a on n(X) when X == 0 or 1 / X > 0;",
        "strict",
        v(0),
        "T",
    ),
    Case("and does not either", ONE + "top and a; a on n(X) when not (X != 0 and 1 / X > 0);", "strict", v(0), "T"),
    Case("the left is always looked at", ONE + "top and a; a on n(X) when 1 / X > 0 or X == 0;", "strict", v(0), "F"),
    Case("a number is no truth value", ONE + "top and a; a on n(X) when X and true;", "strict", v(1), "F"),
    Case("strings compare by code points", ONE + 'top and a; a on n(X) when X < "a";', "strict", v("B"), "T"),
    Case("different types are unequal", ONE + 'top and a; a on n(X) when X != "1";', "strict", v(1), "T"),
    Case(
        "guards compare deeply",
        ONE + "top and g; g sand a b when X == Y; a on n(X); b on n(Y);",
        "strict",
        v([1, {"a": 2}], [1.0, {"a": 2.0}]),
        "?T",
    ),
    Case("0.1 + 0.2 is not 0.3", ONE + "top and a; a on n(X) when X + 0.2 <= 0.3;", "strict", v(0.1), "F"),
    Case(
        "whether the rest could agree is not looked at",
        ONE + "top and g; g sand a b when X > 5 and Y > X and Y < 3; a on n(X); b on n(Y);",
        "strict",
        v(6),
        "?",
    ),
    # -- ignore --------------------------------------------------------------------------------------------------
    Case(
        "ignored events are irrelevant",
        ONE + "ignore n(V) when V < 5; top sand a b; a on n(X);",
        "projected",
        [{"v": 1}, {"v": 6}, {"v": 2}, {"event": "b"}],
        "???T",
    ),
    Case(
        "ignore counts under projected alone",
        ONE + "ignore n(V) when V < 5; top sand a b; a on n(X);",
        "strict",
        [{"v": 1}, {"event": "b"}],
        "?T",
    ),
    Case(
        "an ignored event can never be used",
        ONE + "ignore n(_); top or a b; a on n(X);",
        "projected",
        [{"v": 1}, {"event": "b"}],
        "?T",
    ),
    Case("scattered knows no ignore", ONE + "ignore n(_); top or a b; a on n(X);", "scattered", v(1), "T"),
    Case(
        "an undefined guard does not ignore",
        ONE + "ignore n(V) when V < 5; top sand a b; a on n(X);",
        "projected",
        [{"v": "x"}, {"event": "b"}],
        "?T",
    ),
    # -- branches and kinds --------------------------------------------------------------------------------------
    Case("a branch has its scenarios", "top or x y; x sand a b; y sand c d;", "strict", "c d", "?T", branch=2),
    Case("a branch has no others", "top or x y; x sand a b; y sand c d;", "strict", "a b", "FF", branch=2),
    Case(
        "the alphabet is that of the whole tree",
        "top or x y; x sand a b; y sand c d;",
        "projected",
        "z c a d",
        "??FF",
        branch=2,
    ),
    Case("the or nearest the root varies fastest", "top or p q; p or a b; q and c;", "strict", "c", "T", branch=2),
    Case("and then the next", "top or p q; p or a b; q and c;", "strict", "b", "T", branch=3),
    Case("a kind has the branches that have it", "top or f x; f fault; x attack;", "strict", "f", "T", kind="fault"),
    Case("and no others", "top or f x; f fault; x attack;", "strict", "x", "F", kind="fault"),
    Case(
        "a kind below one of two choices",
        "top and p q; p or f a; q or x b; f fault; x fault;",
        "strict",
        "a b",
        "?F",
        kind="fault",
    ),
    Case(
        "either choice gives the kind",
        "top and p q; p or f a; q or x b; f fault; x fault;",
        "strict",
        "a x",
        "?T",
        kind="fault",
    ),
    Case("the kind of a child that K did not choose", "top 1of2 f a; f fault;", "strict", "a", "T", kind="fault"),
]

SAME = 'event x() = { event: "e", x: 1 }; event y() = { event: "e", y: 1 }; '
OWN_CHILD = "causality bottom_up; event x(p) = { x: p }; event y(p) = { y: p }; top 1of2 a b on x(1); a; b on y(1);"
ORDERED = "event n(v) = { v: v }; top and g; g sand a b when X < Y; a on n(X); b on n(Y);"

CASES += [
    # -- what of a child counts for a threshold ----------------------------------------------------------------------
    Case("vot: of an AND one event is counted", "top 2of3 n c d; n and a b;", "strict", "a b c", "??T"),
    Case("vot: of an OR one event of each child", "top 2of3 n c d; n or m e; m and a b;", "strict", "b a c", "??T"),
    Case("vot: of a SAND one event", "top 2of3 n c d; n sand a b;", "strict", "a c b", "??T"),
    Case("vot: a VOT in a VOT", "top 2of3 n e f; n 2of3 a b c;", "strict", "a b e", "??T"),
    Case("vot: one more than K may be needed in between", "top 2of3 n e f; n sand a b;", "strict", "a e b", "??T"),
    Case("vot: beside others it is not over with K events", "top and n d; n 1of2 a b;", "strict", "a b d", "??T"),
    Case("vot: nor where something follows", "top sand n d; n 1of2 a b;", "strict", "a b d", "??T"),
    Case("vot: exactly K at the end", "top 2of3 a b c;", "strict", "a b b", "?TT"),
    Case("vot: exactly K at the end of a SAND", "top sand d n; n 2of3 a b c;", "strict", "d a a", "??F"),
    Case("vot: an event of a child and of the gate", OWN_CHILD, "strict", [{"event": "a"}, {"x": 1, "y": 1}], "?T"),
    Case("vot: an event of a child and of what follows", SAME + "top sand v d; v 1of3 a b c; c on x(); d on y();", "strict", [{"event": "a"}, {"event": "e", "x": 1, "y": 1}], "?T"),
    Case("vot: an event of a child twice", SAME + "top 2of3 n c d; n sand a b; a on x(); b on y();", "strict", [{"event": "e", "x": 1}, {"event": "e", "x": 1, "y": 1}, {"event": "c"}], "??T"),
    # -- two variables are ordered as numbers or as strings ----------------------------------------------------------
    Case("two strings in order", ORDERED, "strict", v("a", "b"), "?T"),
    Case("two strings out of order", ORDERED, "strict", v("b", "a"), "?F"),
    Case("two numbers in order", ORDERED, "strict", v(1, 2), "?T"),
    Case("a number and a string have no order", ORDERED, "strict", v(1, "a"), "?F"),
]  # fmt: skip
