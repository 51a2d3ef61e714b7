"""Emitted texts that the validator of the proofs certifies, and texts of other trees that it does not."""

import re
from collections import Counter
from dataclasses import replace
from importlib.util import find_spec
from itertools import islice, product
from pathlib import Path
from random import Random
from typing import Any

import pytest
from click.testing import CliRunner

from cross_check.generate.traces import random_trace
from cross_check.generate.trees import PLAIN, VARIABLE_FREE, Shape, random_tree
from rvaft import RVAFT, NotExpressible, Semantics, TooLarge, TreeError, loads, translate
from rvaft.backend import Metrics, Specification, backend
from rvaft.cli import main
from rvaft.export.certificates import CERTIFIED, IN_ORDER, certificate
from rvaft.model.nodes import Assumption, Kind
from rvaft.model.verdict import Verdict
from rvaft.semantics import Reference
from tests.faults.wrong_trees import MISTAKES
from tests.proofs.verified import PROGRAM, PROOFS, built
from tests.tables import sampled

NEEDS_SPOT = [pytest.mark.spot, pytest.mark.skipif(find_spec("spot") is None, reason="needs Spot")]
LANGUAGES = [pytest.param("rml"), *(pytest.param(one, marks=NEEDS_SPOT) for one in ("ltlf", "automaton"))]
TREES = PROOFS.parent / "trees"


def drops_late_events(tree: RVAFT) -> bool:
    """Whether a certificate is about traces without late events only."""
    return tree.time is not None and tree.time.late is not None


def certified(
    tree: RVAFT, text: str, language: str, semantics: Semantics, *, branch: int | None = None, kind: Kind | None = None
) -> tuple[int, str]:
    """The exit status of a certificate, and its message."""
    order = {Assumption.ORDER} if drops_late_events(tree) else set()
    specification = Specification(text, language, Metrics(0), assumes=frozenset(order))
    return certificate(tree, backend(language), specification, semantics, PROGRAM, branch=branch, kind=kind, timeout=60)


def emitted(tree: RVAFT, language: str, semantics: Semantics, **part: Any) -> str | None:
    """The text of a tree, or None where it breaks a rule or the backend does not express it."""
    try:
        return translate(tree, language, semantics=semantics, **part).text
    except (NotExpressible, TooLarge, TreeError):
        return None


SEVERAL = "an event may give several values to a variable"
SMALL = {
    "and": ((TREES / "gates/and.rvaft").read_text(), {}),
    "or": ((TREES / "gates/or.rvaft").read_text(), {}),
    "vot": ((TREES / "gates/vot.rvaft").read_text(), {}),
    "sand": ((TREES / "gates/sand.rvaft").read_text(), {}),
    "sand_rl": ((TREES / "gates/sand_rl.rvaft").read_text(), {}),
    "pand": ((TREES / "gates/pand.rvaft").read_text(), {}),
    "halt": ((TREES / "multiprocessor/halt.rvaft").read_text(), {}),
    "bottom up": ("causality bottom_up; top and m d; m or a b; d sand b c;", {}),
    "shared": ("top and m d; m or a b; d sand b c;", {}),
    "counted": ("top sand a b; a times 3;", {}),
    "ignored": ("event e(x) = { n: x }; event f(x) = { m: x }; ignore f(1); top sand a b; a on e(1); b on e(_);", {}),
    "ignored for values": ("event e(x) = { n: x }; ignore e(X) when X > 5; top sand a b; a on e(1); b on e(2);", {}),
    "overlapping": ("event e(x, y) = { n: x, m: y }; top and a b c; a on e(1, _); b on e(_, 2); c;", {}),
    "constant": ("event e(x) = { n: x }; top or a b; a on e(1) when 1 < 0; b on e(2) when 1 > 0;", {}),
    "one event": ("event e(x) = { n: x }; top sand a b; a on e(X) when X > 3; b on e(_);", {}),
    "names of one event": ("event e(x) = { n: x, m: x }; top sand a b; a on e(X); b on e(Y);", {}),
    "two variables": ("event e(x, y) = { n: x, m: y }; top sand a b; a on e(X, Y); b on e(Z, Z);", {}),
    "unordered": ("event e(x) = { n: x }; event f(x) = { m: x }; top and a b; a on e(X) when X > 3; b on f(Y);", {}),
    "a guard elsewhere": ("event e(x) = { n: x }; top sand a b c; a on e(X); b when X > 3; c;", {}),
    "for some branches": (
        "event e(x) = { n: x }; top or p q; p sand a b; q sand a c; a on e(X); b on e(Y) when Y > X; c;",
        {},
    ),
    "across nodes": ("event e(x) = { n: x }; top sand a b; a on e(X); b on e(Y) when Y > X;", {}),
    "one value": (
        "event e(x) = { n: x }; event f(x) = { m: x }; top and a b c; a on e(X); b on f(X); c;",
        {"rml": SEVERAL},
    ),
    "one value of one event": (
        """event e(x) = { t: "e", n: x }; event f(x) = { t: "f", n: x };
           top sand b c; b or p q; p on e(X); q on f(X); c on e(Y) when Y != X and Y != "no";""",
        {},
    ),
    "literals": (
        """event e(x, y) = { n: x, m: y }; top sand a b; a on e(1, X) when X in (1, 2, "go"); b or c d;
           c on e(2, Y) when not Y == null; d on e(3, Z) when Z != 0 and Z != 1;""",
        {},
    ),
    "counted with a variable": ("event e(x) = { n: x }; top sand a b; a times 3 on e(X); b;", {}),
    "an item": (
        "event e(x, y) = { n: [..., { m: x }, ...], k: y }; top sand a b; a on e(X, 1); b on e(X, Y) when Y != 1;",
        {},
    ),
    "times": ("time t as s; top sand a b within 5 s;", {}),
    "time points": (
        """time t as s; event e(x) = { n: x }; top sand a g; g and b d; a on e(X) when end(g) <= at(a) + 2 s;
           b on e(X); d on e(1) when at(d) - start(top) > 1 s;""",
        {},
    ),
    "in order": ("time t as s late 5 s; assume order 5 s; top sand a b;", {}),
}
"""For each tree the languages that are not certified, with the reason."""


@built
@pytest.mark.parametrize("language", LANGUAGES)
@pytest.mark.parametrize(("name", "semantics"), sampled(product(SMALL, Semantics), 5))
def test_what_is_certified(name: str, language: str, semantics: Semantics) -> None:
    text, reasons = SMALL[name]
    tree = loads(text)
    written = emitted(tree, language, semantics)
    if written is None:
        assert language == "rml"
        assert tree.time is not None or tree.events
        return
    if language in reasons:
        expected = 2, f"not certified: {reasons[language]}"
    else:
        expected = 0, IN_ORDER if name == "in order" else CERTIFIED
    assert certified(tree, written, language, semantics) == expected


SAND = "top sand a b c;"
ONE = "event e(x) = { n: x }; top sand a b; a on e(X) when X > 3; b on e(Y) when Y < X;"
SHARED = "event e(x) = { n: x }; event f(x) = { m: x }; top and a b c; a on e(X); b on f(X); c on f(0);"
EITHER = (
    "event e(x) = { n: x }; event f(x) = { m: x };"
    'top or p q; p sand a b; q sand a c; a on e(X); b on f(Y) when Y > X; c on f(Z) when Z == "go";'
)
SOON = "time t as s; event e(x) = { n: x }; top sand a b within 5 s; a on e(1); b on e(2);"
WRONG = [
    ("a guard", "ltlf", "strict", ONE, "when X > 3", "when X > 4"),
    ("no guard", "ltlf", "strict", ONE, " when X > 3", ""),
    ("no guard across nodes", "ltlf", "scattered", ONE, "Y } when Y < X", "Y }"),
    ("the variable of an atom", "ltlf", "projected", ONE, "b := { n: Y }", "b := { n: X }"),
    ("variables of a guard", "ltlf", "consecutive", ONE, "Y } when Y < X", "Y } when X < Y"),
    ("the order of atoms with variables", "ltlf", "strict", ONE, "a & X[!] b", "b & X[!] a"),
    ("another variable", "ltlf", "scattered", SHARED, "{ m: X }", "{ m: Y }"),
    ("an alternative less", "ltlf", "strict", EITHER, " | (a_2 & X[!] c)", ""),
    ("an alternative without its guard", "ltlf", "scattered", EITHER, ' when Z == "go"', ""),
    (
        "a window",
        "ltlf",
        "scattered",
        SOON,
        "b := { n: 2 } at T2 when max(T1, T2) - min(T1, T2) <= 5",
        "b := { n: 2 } at T2 when max(T1, T2) - min(T1, T2) <= 6",
    ),
    ("the time of an atom", "ltlf", "scattered", SOON, "{ n: 2 } at T2", "{ n: 2 } at T1"),
    ("a guard", "automaton", "strict", ONE, '"X > 3"', '"X > 4"'),
    ("a guard across nodes", "automaton", "projected", ONE, '"Y < X"', '"Y <= X"'),
    ("the variable of an event", "automaton", "scattered", ONE, '"{ n: Y }"', '"{ n: X }"'),
    ("a window", "automaton", "strict", SOON, "<= 5000000000", "<= 5000000001"),
    ("the order", "ltlf", "strict", SAND, "b & X[!] c", "c & X[!] b"),
    ("no order", "ltlf", "scattered", SAND, "F(a & X[!] F(b & X[!] F c))", "(F a) & F b & F c"),
    ("one operand less", "ltlf", "strict", SAND, "(b & X[!] c)", "b"),
    ("a weak next", "ltlf", "strict", SAND, "X[!] c", "X c"),
    ("the event of an atom", "ltlf", "strict", SAND, '"c"', '"d"'),
    ("a relevant event less", "ltlf", "projected", SAND, 'relevant rel := { event: "c" }\n', ""),
    ("relevance", "ltlf", "projected", SAND, "!rel U (rel & c)", "1 U c"),
    ("the accepting state", "automaton", "strict", SAND, "[0] 1\n", "[0] 1\n[!0] 5\n"),
    ("no accepting state", "automaton", "strict", SAND, "State: 5 {0}", "State: 5"),
    ("an edge less", "automaton", "strict", SAND, "[0&3] 4\n", ""),
    ("another target", "automaton", "projected", SAND, "[0&1&3] 3", "[0&1&3] 4"),
    ("a relevant event less", "automaton", "projected", SAND, 'alphabet: "{ event: \\"c\\" }"\n', ""),
    ("the order", "rml", "strict", SAND, "a b c all", "a c b all"),
    ("no order", "rml", "strict", SAND, "a b c all", "(a | b | c) all"),
    ("one operand less", "rml", "strict", SAND, "a b c all", "a b all"),
    ("no rest", "rml", "strict", SAND, "a b c all", "a b c empty none"),
    ("a relevant event less", "rml", "projected", SAND, "a | b | c;", "a | b;"),
    ("no filter", "rml", "projected", SAND, "relevant >> (a b c all)", "a b c all"),
    ("a branch less", "rml", "strict", "top or m n; m sand a b; n sand a c;", "(b \\/ c)", "b"),
    (
        "left preference",
        "rml",
        "strict",
        "top or m n; m sand a b; n sand a c;",
        "a (b \\/ c) all",
        "(a b all) \\/ (a c all)",
    ),
]


ACCEPTS = "the text (accepts|does not accept) the (empty )?trace.*, in which the tree detects( nothing)?"
DIFFERENCES = {"rml": "the verdicts differ after the trace .*", "ltlf": ACCEPTS, "automaton": ACCEPTS}


@built
@pytest.mark.parametrize(
    ("language", "semantics", "tree", "old", "new"),
    [
        pytest.param(*row, id=f"{language} {name}", marks=[] if language == "rml" else NEEDS_SPOT)
        for name, *row in WRONG
        for language in row[:1]
    ],
)
def test_a_fault_in_a_text_is_not_certified(language: str, semantics: str, tree: str, old: str, new: str) -> None:
    found, meaning = loads(tree), Semantics(semantics)
    text = translate(found, language, semantics=meaning).text
    assert text.count(old) == 1, text
    assert certified(found, text, language, meaning)[0] == 0
    status, why = certified(found, text.replace(old, new), language, meaning)
    assert status == 1
    assert re.fullmatch(f"not certified: {DIFFERENCES[language]}", why), why


PRUNED = (TREES / "remote_inspection/pruned.rvaft").read_text()
WRONG_VALUES = [
    ("t1 + 10", "t1 + 11"),
    ("t >= (t1", "t > (t1"),
    ("v >= 250", "v >= 251"),
    ("'entrance'", "'exit'"),
    ("'success'", "'failure'"),
    (" inspect(waypoint)", " inspect(newWp)"),
    ("(ev10(newWp) all)", "(ev10(waypoint) all)"),
    ("ev10(wp) not matches", "ev10(wp) matches"),
    ("(move(newWp, t2) /\\ ev7)", "move(newWp, t2)"),
    ("let waypoint, t1,", "let t1,"),
    ("((ev6_ev8(newWp, t2, t1) all) /\\ (ev7 all)) \\/ ", ""),
]


@built
@pytest.mark.parametrize(("old", "new"), WRONG_VALUES)
def test_a_fault_in_a_text_of_rml_with_variables_is_not_certified(old: str, new: str) -> None:
    tree = loads(PRUNED)
    text = translate(tree, "rml", semantics="strict").text
    assert text.count(old) == 1, text
    assert certified(tree, text, "rml", Semantics.STRICT) == (0, CERTIFIED)
    assert certified(tree, text.replace(old, new), "rml", Semantics.STRICT)[0] == 2


@built
def test_an_undeclared_or_repeated_variable_is_not_certified() -> None:
    """A block inside the text binds its variable anew each time; the validator follows one value."""
    tree = loads('event e(x) = { t: "e", n: x }; event f(x) = { t: "f", m: x }; top sand a b; a on e(X); b on f(X);')
    text = translate(tree, "rml", semantics="strict").text
    assert certified(tree, text, "rml", Semantics.STRICT) == (0, CERTIFIED)
    for old, new in (
        ("{ let x; e(x) f(x) all }", "{ let x; e(x) } { let x; f(x) all }"),
        ("{ let x; e(x)", "{ let y; e(x)"),
    ):
        assert text.count(old) == 1, text
        status, why = certified(tree, text.replace(old, new), "rml", Semantics.STRICT)
        assert (status, why.partition(": ")[2][:30]) == (2, "the text has an operator or a ")


BY_HAND = {
    "other names and order": """/* rvaft
atom second := { n: Y } when Y < X
atom first := { n: X } when Y < X when X > 3
*/
!G !(first & X[!] F second)""",
    "an idle alternative": """/* rvaft
atom a := { n: X } when X > 3 when Y < X
atom b := { n: Y } when Y < X
*/
F(a & X[!] F b) | F(a & X[!] F(b & X[!] F a))""",
    "unused atoms": """/* rvaft
atom a := { n: X } when X > 3 when Y < X
atom b := { n: Y } when Y < X
atom c := { n: Z } when Z > X
*/
F(a & X[!] F b) & (c | !c)""",
}


@built
@pytest.mark.parametrize("name", [pytest.param(name, marks=NEEDS_SPOT) for name in BY_HAND])
def test_a_formula_of_a_person_is_certified(name: str) -> None:
    tree = loads(ONE)
    assert certified(tree, BY_HAND[name], "ltlf", Semantics.SCATTERED) == (0, CERTIFIED)
    random = Random(name)
    for trace in (random_trace(random, tree, max_length=6) for _ in range(30)):
        verdicts = list(backend("ltlf").read(BY_HAND[name]).run(trace))
        assert verdicts == list(Reference(tree, Semantics.SCATTERED).run(trace))


@built
@pytest.mark.spot
@pytest.mark.skipif(find_spec("spot") is None, reason="needs Spot")
def test_names_of_variables_are_kept_apart() -> None:
    """Two variables of one event may differ; one variable that stands twice has one value."""
    two = loads("event e(x, y) = { n: x, m: y }; top sand a b; a on e(X, Y) when X != Y; b;")
    text = translate(two, "ltlf", semantics="strict").text
    assert certified(two, text, "ltlf", Semantics.STRICT)[0] == 0
    assert certified(two, text.replace("m: Y", "m: X"), "ltlf", Semantics.STRICT)[0] == 1
    assert certified(two, text.replace("X != Y", "X != X"), "ltlf", Semantics.STRICT)[0] == 1


@built
@pytest.mark.parametrize("language", LANGUAGES[1:])
def test_a_text_without_the_time_of_events_is_not_certified(language: str) -> None:
    """Without the line `time`, no event has a time, so the reader of the text detects nothing."""
    text = translate(loads(SOON), language, semantics="scattered").text
    untimed, count = re.subn(r"(?m)^time.*\n", "", text)
    assert count == 1
    assert set(backend(language).read(untimed).run([{"n": 1, "t": 0}, {"n": 2, "t": 1}])) == {Verdict.UNKNOWN}
    reason = "not certified: the text does not say where events have their time"
    assert certified(loads(SOON), untimed, language, Semantics.SCATTERED) == (2, reason)


@built
@pytest.mark.spot
@pytest.mark.skipif(find_spec("spot") is None, reason="needs Spot")
def test_a_time_of_one_event_is_never_bound() -> None:
    tree = loads("time t as s; event e(x) = { n: x }; top sand a b; a on e(1); b on e(2);")
    atoms = "atom a := { n: 1 } at _t\natom b := { n: 2 } at _t"
    text = f"/* rvaft\ntime t as s\n{atoms}\n*/\nF(a & X[!] F b)"
    assert certified(tree, text, "ltlf", Semantics.SCATTERED) == (0, CERTIFIED)
    assert certified(tree, text.replace("_t", "T"), "ltlf", Semantics.SCATTERED)[0] != 0


ALIVE_IS_AN_EVENT = """HOA: v1
States: 3
Start: 0
AP: 2 "alive" "b"
event: 0 "{ event: \\"a\\" }"
acc-name: Buchi
Acceptance: 1 Inf(0)
properties: trans-labels explicit-labels state-acc deterministic
--BODY--
State: 0
[!0] 0
[0] 1
State: 1
[!1] 1
[1] 2
State: 2 {0}
[t] 2
--END--
"""
SAND_ALIVE = """acc-name: Buchi
Acceptance: 1 Inf(0)
properties: trans-labels explicit-labels state-acc deterministic
--BODY--
State: 0
[0&!1] 0
[0&1] 1
State: 1
[0&!2] 1
[0&2] 2
State: 2
[0] 2
"""
"""`a`, then `b`; what follows them is left open."""
RELEVANT_AFTER_THE_END = f"""HOA: v1
States: 4
Start: 0
AP: 4 "alive" "a" "b" "relevant"
relevant: 3
alphabet: "{{}}"
{SAND_ALIVE}[!0&3] 3
State: 3 {{0}}
[!0] 3
--END--
"""


@built
@pytest.mark.spot
@pytest.mark.skipif(find_spec("spot") is None, reason="needs Spot")
@pytest.mark.parametrize("text", [ALIVE_IS_AN_EVENT, RELEVANT_AFTER_THE_END])
def test_alive_is_true_until_the_end_and_nothing_afterwards(text: str) -> None:
    tree = loads("top sand a b;")
    assert any(
        list(backend("automaton").read(text).run(trace)) != list(Reference(tree, Semantics.SCATTERED).run(trace))
        for trace in ([{"event": one}, {"event": "b"}] for one in "ab")
    )
    assert certified(tree, text, "automaton", Semantics.SCATTERED)[0] == 1


CYCLE_AFTER_THE_END = f"""HOA: v1
States: 5
Start: 0
AP: 3 "alive" "a" "b"
{SAND_ALIVE}[!0] 3
State: 3 {{0}}
[!0] 4
State: 4
[!0] 3
--END--
"""
FIELD_OF_TIMES = """/* rvaft
time t as s
atom a := { n: 1, t: 0 } at T1
atom b := { n: 2, t: 100 } at T2 when T2 - T1 >= 100000000000
*/
F(a & X[!] F b)
"""
TIMES = "time t as s; event e(x, y) = { n: x, t: y }; top sand a b; a on e(1, 0); b on e(2, 100);"


@built
@pytest.mark.spot
@pytest.mark.skipif(find_spec("spot") is None, reason="needs Spot")
@pytest.mark.parametrize(
    ("tree", "language", "text", "trace"),
    [
        ("top sand a b;", "automaton", CYCLE_AFTER_THE_END, [{"event": "a"}, {"event": "b"}]),
        (TIMES, "ltlf", FIELD_OF_TIMES, [{"n": 1, "t": 0}, {"n": 2, "t": 100}]),
    ],
)
def test_a_right_text_that_is_not_certified_does_not_differ(tree: str, language: str, text: str, trace: Any) -> None:
    verdicts = list(backend(language).read(text).run(trace))
    assert verdicts == list(Reference(loads(tree), Semantics.SCATTERED).run(trace))
    reason = "not certified: the text may differ from the tree; no trace is known on which it does"
    assert certified(loads(tree), text, language, Semantics.SCATTERED) == (2, reason)


@built
@pytest.mark.parametrize("language", LANGUAGES)
def test_a_text_of_another_semantics_is_not_certified(language: str) -> None:
    tree = loads(SAND)
    for one in Semantics:
        text = translate(tree, language, semantics=one).text
        assert [certified(tree, text, language, other)[0] for other in Semantics if other is not one] == [1, 1, 1]


@built
@pytest.mark.parametrize("language", LANGUAGES)
@pytest.mark.parametrize(("one", "other"), [("1", "true"), ("0", "false"), ("null", "0"), ('"1"', "1")])
def test_values_of_other_types_are_other_events(language: str, one: str, other: str) -> None:
    def tree(second: str) -> RVAFT:
        return loads(f"event e(x) = {{ n: x }}; top sand a b; a on e({one}); b on e({second});")

    for semantics in (Semantics.STRICT, Semantics.PROJECTED):
        text = translate(tree(other), language, semantics=semantics).text
        assert certified(tree(one), text, language, semantics)[0] == 1
        assert certified(tree(other), text, language, semantics) == (0, CERTIFIED)


@pytest.mark.parametrize("program", ["true", "false"])
def test_a_program_that_is_no_validator_certifies_nothing(program: str) -> None:
    done = CliRunner().invoke(
        main, ["emit", "trees/gates/sand.rvaft", "--to", "rml", "--certify", "--verified", f"/bin/{program}"]
    )
    assert done.exit_code == 2
    assert "not certified" in done.stderr


@built
@pytest.mark.parametrize("language", LANGUAGES)
def test_branches_and_kinds(language: str) -> None:
    """Clause: relevance is that of the whole tree."""
    tree = loads("top or m n; m sand a b; n sand c d fault; a; b; c fault; d fault;")
    for semantics in Semantics:
        whole = translate(tree, language, semantics=semantics).text
        for part in ({"branch": 1}, {"branch": 2}, {"kind": Kind.FAULT}):
            text = translate(tree, language, semantics=semantics, **part).text
            assert certified(tree, text, language, semantics, **part)[0] == 0
            assert certified(tree, whole, language, semantics, **part)[0] == 1
            assert certified(tree, text, language, semantics)[0] == 1


VARIABLES = Shape(max_nodes=6, times=0, functions=0, assumptions=0)
TIMED = Shape(max_nodes=5, times=1, functions=0, assumptions=0)


def differing(right: RVAFT, wrong: RVAFT, semantics: Semantics, random: Random) -> bool:
    """Whether the definition gives the trees different verdicts on some random trace."""
    first, second = Reference(right, semantics), Reference(wrong, semantics)
    traces = (random_trace(random, tree, max_length=8) for _ in range(100) for tree in (right, wrong))
    return any(list(first.fork().run(trace)) != list(second.fork().run(trace)) for trace in traces)


@built
@pytest.mark.parametrize(
    ("tree", "reason"),
    [
        ("top sand y; y times 2 distinct X on a(X);", "values of each event (`distinct`, `each`) are not certified"),
        ("top sand y; y times 2 each X on a(X);", "values of each event (`distinct`, `each`) are not certified"),
        ("top sand x y without a(5); x on a(6); y on a(7);", "absent events (`without`) are not certified"),
    ],
)
def test_what_other_positions_and_own_values_need_is_not_certified(tree: str, reason: str) -> None:
    """A right text of another tree is compared with it, which says why it decides nothing."""
    event = "event a(x) = { a: x };"
    text = emitted(loads(f"{event} top sand x; x on a(X);"), "ltlf", Semantics.SCATTERED)
    assert text is not None
    status, why = certified(loads(f"{event} {tree}"), text, "ltlf", Semantics.SCATTERED)
    assert (status, why) == (2, f"not certified: {reason}")


@built
@pytest.mark.ci
@pytest.mark.parametrize(("language", "seed"), sampled(product(LANGUAGES, range(6)), 36, ci=6))
def test_random_trees_and_mistakes(language: str, seed: int) -> None:
    """Clause: what is certified has the verdicts of the tree; what differs has a trace of its nodes."""
    statuses: Counter[tuple[bool, int]] = Counter()
    for number in range(4):
        random = Random(f"{seed} {number}")
        # certificates are of trees without absent events, which have tests of their own
        tree = random_tree(random, replace((PLAIN, VARIABLE_FREE, VARIABLES, TIMED)[number], absences=0))
        if drops_late_events(tree):
            continue
        others = (MISTAKES[name](tree) for name in random.sample(sorted(MISTAKES), len(MISTAKES)))
        wrong_trees = [tree, *islice((one for one in others if one != tree), 5)]
        for semantics in Semantics:
            for wrong in wrong_trees:
                text = emitted(wrong, language, semantics)
                if text is None:
                    continue
                status, why = certified(tree, text, language, semantics)
                statuses[wrong == tree, status] += 1
                if status == 0 and wrong != tree:
                    assert not differing(tree, wrong, semantics, random), (number, semantics)
                if status == 1:
                    assert wrong != tree, (number, semantics, why)
                    if tree.events or tree.time is not None or "+" in why or "(" in why:
                        continue
                    word = why.partition(" trace ")[2].partition(",")[0].split()
                    trace = [{"event": name} for name in word]
                    verdicts = list(backend(language).read(text).run(trace))
                    assert verdicts != list(Reference(tree, semantics).run(trace)), (number, semantics, word)
    assert statuses[True, 0] > 8
    assert statuses[False, 1] > 4
    assert statuses[True, 1] == 0


@pytest.mark.ci
@built
@pytest.mark.parametrize("language", LANGUAGES)
def test_most_random_trees_without_variables_are_certified(language: str) -> None:
    counts: Counter[int] = Counter()
    for seed in range(12):
        tree = random_tree(Random(seed), VARIABLE_FREE)
        for semantics in Semantics:
            text = emitted(tree, language, semantics)
            if text is not None:
                counts[certified(tree, text, language, semantics)[0]] += 1
    assert counts[0] >= 40
    assert counts[1] == 0


@built
@pytest.mark.parametrize("language", LANGUAGES[1:])
@pytest.mark.parametrize("shape", sampled([VARIABLES, TIMED], 2), ids=["variables", "times"])
def test_certified_texts_with_variables_have_the_verdicts_of_the_reference(language: str, shape: Shape) -> None:
    counts: Counter[int] = Counter()
    for seed in range(12):
        random = Random(f"slices {seed}")
        tree = random_tree(random, shape)
        if drops_late_events(tree):
            continue
        for semantics in Semantics:
            text = emitted(tree, language, semantics)
            if text is None:
                continue
            status, why = certified(tree, text, language, semantics)
            counts[status] += 1
            assert status in (0, 2), (seed, semantics, why)
            for trace in (random_trace(random, tree, max_length=7) for _ in range(20 if status == 0 else 0)):
                expected = list(Reference(tree, semantics).run(trace))
                assert list(backend(language).read(text).run(trace)) == expected, (seed, semantics, trace)
    assert counts[0] > counts[2]


@built
@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "language"), [(seed, one) for seed in range(8) for one in ("rml", "ltlf", "automaton")]
)
def test_random_trees_of_all_kinds(seed: int, language: str) -> None:
    for number in range(30):
        random = Random(f"{seed} {number}")
        tree = random_tree(random, Shape())
        for semantics in Semantics:
            text = emitted(tree, language, semantics)
            if text is None:
                continue
            status, why = certified(tree, text, language, semantics)
            assert status in (0, 2), (number, semantics, why)


def emit(folder: Path, tree: str, *options: str) -> Any:
    (file := folder / "tree.rvaft").write_text(tree)
    return CliRunner().invoke(main, ["emit", str(file), *options])


@built
def test_the_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    options = ["--to", "rml", "--semantics", "strict", "--certify", "--verified", str(PROGRAM)]
    done = emit(tmp_path, SAND, *options)
    assert (done.exit_code, done.stderr) == (0, f"{CERTIFIED}\n")
    assert done.stdout == emit(tmp_path, SAND, *options[:4]).stdout
    done = emit(tmp_path, SAND, *options, "--format", "latex")
    assert done.exit_code == 0
    other = translate(loads("top sand a c b;"), "rml", semantics="strict")
    with monkeypatch.context() as patched:
        patched.setattr("rvaft.cli.emit._specification", lambda *_, **__: other)
        done = emit(tmp_path, SAND, *options)
    assert done.exit_code == 1
    assert done.stdout.endswith("Main = a c b all;\n")
    assert done.stderr == "not certified: the verdicts differ after the trace a c\n"


@built
@pytest.mark.parametrize(
    ("tree", "to", "reason"),
    [
        (SAND, "c", "c has no formal syntax in the proofs"),
        ("event e(x) = { n: x }; event f(x) = { m: x }; top and a b; a on e(X); b on f(X);", "rml", SEVERAL),
    ],
)
def test_what_cannot_be_certified(tmp_path: Path, tree: str, to: str, reason: str) -> None:
    options = ["--to", to, "--semantics", "strict"]
    done = emit(tmp_path, tree, *options, "--certify", "--verified", str(PROGRAM))
    assert done.exit_code == 2
    assert done.stderr.startswith(f"not certified: {reason}")
    assert done.stdout == emit(tmp_path, tree, *options).stdout


@built
def test_a_limit() -> None:
    tree, rml = loads("top 3of5 a b c d e;"), backend("rml")
    text = translate(tree, "rml", semantics="scattered")
    assert certificate(tree, rml, text, Semantics.SCATTERED, PROGRAM) == (0, CERTIFIED)
    found = certificate(tree, rml, text, Semantics.SCATTERED, PROGRAM, limit=10)
    assert found == (2, "not certified: the comparison ended at the limit of 10 steps")
    found = certificate(tree, rml, text, Semantics.SCATTERED, PROGRAM, timeout=1e-6)
    assert found == (2, "not certified: no answer within 1e-06 s")


def test_without_the_program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    options = ["--to", "rml", "--semantics", "strict"]
    for more, reason in (
        ([], "rvaft-verified is not on the PATH: build it by `make verified`"),
        (["--verified", str(tmp_path / "nowhere")], "the verified monitor is not installed"),
    ):
        done = emit(tmp_path, SAND, *options, "--certify", *more)
        assert done.exit_code == 2
        assert done.stderr.startswith(f"not certified: {reason}")
        assert done.stdout.endswith("Main = a b c all;\n")


def test_wrong_options(tmp_path: Path) -> None:
    assert "--verified is for --certify" in emit(tmp_path, SAND, "--to", "rml", "--verified", "x").stderr
    assert "omit --certify" in emit(tmp_path, SAND, "--to", "dot", "--certify").stderr
