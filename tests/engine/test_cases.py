"""The engine against hand-written cases: the table of the semantics, and its own."""

from typing import Any

import pytest

import rvaft
from rvaft.analysis.branches import restrict
from rvaft.engine import Engine
from rvaft.model.verdict import Semantics, Verdict
from tests.engine.checking import compare
from tests.semantics.cases import CASES, Case, v
from tests.tables import rows

SIGNS = {"true": "T", "false": "F", "unknown": "?"}
E = "event e(n) = { event: n }; "
N = "event n(v) = { v: v }; event w(x) = { w: x }; "
NV = "event e(n, v) = { n: n, v: v }; event f(n, v, w) = { n: n, v: v, w: w }; "
BETWEEN = NV + 'top sand a b c g h; a on e("a", T1); b on e("b", T2); c on e("c", T3); g when T2 > T1; h when T3 < T1;'
SAME = NV + 'top sand a b c; a on e("a", X); b on e("b", X); c on e("c", X);'
SUM = NV + 'top sand a b g; a on e("a", X); b on f("b", X, Y); g when X + Y == 9007199254741003;'
USE = NV + 'top or x y; x sand a g b; y sand c a2 d; a on e("a", X); a2 on e("a", X); g when X > 5; b; c; d;'
LARGE = (2**53, 2.0**53)
PICK = "top and x y t; x or p q; p and p1 p2; p1 sand a s; q and a s q2; y and s r; "


def nv(**values: Any) -> list[dict[str, Any]]:
    """Events with a letter and its value."""
    return [{"n": letter, "v": value} for letter, value in values.items()]


OWN = [
    Case("a part is over two levels up", "top sand x d e; x and v; v 2of3 a b c;", "strict", "a b d c", "???F"),
    Case("a part is over that an open order is in", "top sand x d e; x sand v y; v 1of2 a b; y when 1 < 2;", "strict", "a d b", "??F"),
    Case("what is not itself crossed cannot begin either", "top or bad c; bad and x y z; x sand a b; y sand b a;", "strict", "z", "F"),
    Case("a longer crossing", "top and x y z o; o or t c; t sand z2 a; x sand a b; y sand b d; z sand d a2; a2 or a c2;", "strict", "z2", "?"),
    Case("a part over, its gate's event last", "causality bottom_up; " + E + 'top sand g d e; g 2of3 a b c on e("g");', "strict", "a b g c", "???F"),
    Case("K+1 within an ordered part that goes on", "top sand v e; v sand w d; w 1of2 a b;", "strict", "a b d e", "???T"),
    Case("an order broken where one choice does not ask for it", PICK, "strict", "s a r q2 t", "????T"),
    Case("a broken order stays broken", PICK, "strict", "s a p2", "??F"),
    Case("one order broken, the other kept later", PICK, "scattered", "s a s p2 t r", "?????T"),
    Case("an order kept leaves both choices", PICK, "strict", "a s p2 t r", "????T"),
    Case("a shared child cannot be both early and late", "top and o t; o sand x y; x or a s; y or b s;", "strict", "s t s", "??F"),
    Case("a shared child may be early", "top and o t; o sand x y; x or a s; y or b s;", "strict", "s b t", "??T"),
    Case("a shared child may be late", "top and o t; o sand x y; x or a s; y or b s;", "strict", "t a s", "??T"),
    Case("a shared gate counts for two thresholds", "top and x y; x 2of3 a s b; y 2of3 c s d; s and k l;", "strict", "k a l c", "???T"),
    Case("more than the thresholds ask for", "top and x y; x 1of2 a s; y 1of2 c s;", "projected", "a c", "?T"),
    Case("one shared child for two thresholds", "top and x y; x 1of2 a s; y 1of2 c s;", "strict", "s", "T"),
    Case("a silent child counts for a threshold", "top 2of3 a g b; g when 1 < 2;", "strict", "b", "T"),
    Case("a dead child does not", "top 2of3 a g b; g when 1 > 2;", "strict", "b a", "?T"),
    Case("a silent choice before an event", "top sand v s; v or b g; g when 1 < 2;", "strict", "b s", "?T"),
    Case("a guard decides between choices", N + "top sand a b; a on n(X); b or c d; c on w(_) when X > 1; d on w(2);", "strict", [*v(1), {"w": 1}], "?F"),
    Case("a guard of wrong type, and its negation", N + 'top sand a b; a on n(X); b or c d; c when X > "a"; d when not X > "a";', "projected", v(1), "F"),
    Case("a guard that failed for one value", N + "top sand a b; a on n(X); b on w(1) when X > 5;", "scattered", [*v(3, 6), {"w": 1}], "??T"),
    Case("a choice that a guard leaves open", N + "top sand a b; a on n(X); b or c d; c when X > 5; d on w(X);", "strict", [*v(3), {"w": 3}], "?T"),
    Case("values that differ only in type are one value", N + "top sand a b; a on n(X); b on w(X);", "projected", [*v(1), {"w": 1.0}], "?T"),
    Case("an ignored event still serves a scattered match", N + "top sand a b; a on n(_); ignore n(V) when V < 3;", "scattered", [*v(1), {"event": "b"}], "?T"),
    Case("but is not relevant", N + "top sand a b; a on n(_); ignore n(V) when V < 3;", "projected", [*v(1), {"event": "b"}], "?F"),
    Case("passing over an event that a later one needs", E + 'top and x k; x sand b s; b on e("b"); k sand k1 z; k1 on e("b");', "scattered", "b s z b z", "????T"),
    # What can be dropped because another partial match can replace it.
    *(Case(f"guards in two directions leave {one} and {other}, {high}", BETWEEN, "scattered", nv(a=one) + nv(a=other) + nv(b=high, c=low), "???T") for one, other in ((1, 5), (5, 1)) for low, high in ((0, 2), (4, 6))),
    *(Case(f"what once changed nothing may matter later, {end}", SAME, "scattered", [event for letter, value in zip("ababacbc", (1, 2, 3, 2, 2, 2, 2, 1), strict=True) for event in nv(**{letter: value})] + nv(c=end), "????????" + sign) for end, sign in ((2, "T"), (3, "?"))),
    *(Case(f"the value of a match is the one that came first, {one!r}", SUM, "scattered", [*nv(a=one), {"n": "b", "v": other, "w": 11}], sign) for one, other, sign in ((*LARGE, "?T"), (*LARGE[::-1], "??"))),
    Case("an event of no use may be of use to a later match", USE, "scattered", [*nv(a=3), {"event": "c"}, *nv(a=3), {"event": "d"}], "???T"),
]  # fmt: skip


def test_an_event_after_a_gate_and_a_silent_child_is_kept_for_the_explanation() -> None:
    """An `a` before the gate's own event must not stand for the one after it."""
    tree = rvaft.loads(E + 'top or g z; g sand h a d on e("b"); h when 1 < 2; a; d; z on e("d");')
    trace = [{"event": word} for word in ["a", "b", "a", "d"]]
    compare(tree, trace, "scattered")
    compare(tree, trace, "scattered", branch=1)


@pytest.mark.parametrize("case", [*CASES, *OWN], ids=lambda case: case.name)
def test_case(case: Case) -> None:
    """The verdicts written down, and under every semantics those of the reference, with the explanation."""
    tree = rvaft.loads(case.tree)
    monitor = Engine(restrict(tree, branch=case.branch, kind=case.kind), case.semantics)
    assert (monitor.verdict, monitor.explanation) == (Verdict.UNKNOWN, None)
    assert "".join(SIGNS[verdict.value] for verdict in monitor.run(case.events)) == case.verdicts
    for semantics in Semantics:
        compare(tree, case.events, semantics, branch=case.branch, kind=case.kind)


@pytest.mark.parametrize(("tree", "word", "branch", "matched"), rows(__file__, "lowest.txt"))
def test_the_explanation_is_of_the_lowest_branch(tree: str, word: str, branch: int, matched: dict[str, int]) -> None:
    loaded = rvaft.loads(tree)
    trace = [{"event": letter} for letter in word.split()]
    monitor = compare(loaded, trace, "scattered")
    assert monitor is not None
    assert monitor.explanation is not None
    assert monitor.explanation.branch == branch
    if matched.keys() <= set(monitor.explanation.matched):
        assert {name: monitor.explanation.matched[name] for name in matched} == matched


def test_states_remember_broken_orders_and_failed_guards() -> None:
    picks, again = Engine(rvaft.loads(PICK), "strict"), Engine(rvaft.loads(PICK), "strict")
    for one, other in zip("sa", "as", strict=True):
        picks.step({"event": one})
        again.step({"event": other})
    assert picks.state != again.state
    tree = rvaft.loads(N + "top sand a b; a on n(X); b or c d; c on w(1) when X > 5; d on w(2);")
    low, high = Engine(tree), Engine(tree)
    assert low.state == high.state
    low.step({"v": 3})
    high.step({"v": 6})
    assert low.state != high.state
    high = Engine(tree)
    high.step({"v": 4})
    assert low.state == high.state
