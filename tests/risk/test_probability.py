"""Probabilities against published and enumerated ones, and the chains against simulations of the monitor."""

import math

import pytest
from hypothesis import given, settings

import rvaft
from rvaft.errors import TooLarge
from rvaft.risk.model import RiskError, of_tree, without
from rvaft.risk.probability import Analysis
from rvaft.risk.simulation import Simulation, wilson
from tests.risk.forms import form, probability, static_texts

pytest.importorskip("oxidd")

LEAVES = "x lambda=.5; y lambda=.2; z lambda=.1;"
DYNAMIC = [
    ("t sand x y;", False, 0.0398025180),
    ("t pand x y;", True, 0.0374364766),
    ("t wsp x y z;", True, 0.00367842346),
    ("t csp x y z;", True, 0.00678736562),
    ("t 2of3 x y z;", False, 0.11244276767),
    ("t and x x2; x2 or x y;", False, 1 - math.exp(-0.5)),
]


@pytest.mark.parametrize(("text", "galileo", "expected"), DYNAMIC)
def test_small_trees_have_the_known_probability(text: str, galileo: bool, expected: float) -> None:
    dormant = LEAVES.replace("y lambda=.2", "y lambda=.2 dorm=.5").replace("z lambda=.1", "z lambda=.1 dorm=.5")
    leaves = dormant if "wsp" in text else LEAVES
    assert Analysis(form(f"toplevel t; {text}{leaves}", galileo=galileo)).at(1.0) == pytest.approx(expected, rel=1e-8)


def test_a_spare_that_two_gates_share_goes_to_the_first_that_fails() -> None:
    text = "toplevel t; t or a b; a wsp p s; b wsp q s; p lambda=1; q lambda=1; s lambda=1 dorm=0;"
    analysis = Analysis(form(text, galileo=True))
    # the first failure of p or q takes s (rate 2); then s (1) or the other (1) fails
    expected = 1 - 2 * math.exp(-2) - math.exp(-2) * (2 - 1)  # Erlang of rate 2, twice
    assert analysis.at(1.0) == pytest.approx(1 - math.exp(-2) * (1 + 2), rel=1e-12)
    assert expected == pytest.approx(analysis.at(1.0), rel=1e-12)
    assert analysis.mean_time() == pytest.approx(1.0, rel=1e-9)


A, B = (math.exp(-rate) for rate in (0.5, 0.2))  # nothing of the rates of LEAVES by time 1


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        # the spare of a spare gate in use is not in use itself: x, y, z fail one after the other
        ("t csp g z; g csp x y;", 0.0013692667546319),
        # what another gate uses, too, is in use from the beginning
        ("t or g h; g csp x y; h pand x y;", (1 - A) * (1 - B)),
        # a taken spare stays taken, also one that never fails
        ("t or g h; g wsp x s; h wsp y s; s lambda=0;", (1 - A) * (1 - B)),
    ],
)
def test_spares_in_use(text: str, expected: float) -> None:
    leaves = LEAVES.replace(";", " dorm=0;")
    assert Analysis(form(f"toplevel t; {text}{leaves}", galileo=True)).at(1.0) == pytest.approx(expected, rel=1e-10)


def test_a_trigger_fails_a_leaf_that_did_not_happen_by_its_probability() -> None:
    text = "toplevel t; t and g u; g pand a b; a prob=.4; b lambda=.7; u lambda=.1; d fdep u a;"
    hit = (1 - math.exp(-0.7)) * (1 - math.exp(-0.1))  # b and u have happened, a at time 0
    later = 1 - math.exp(-0.1) - 0.1 / 0.8 * (1 - math.exp(-0.8))  # b before u
    assert Analysis(form(text, galileo=True)).at(1.0) == pytest.approx(0.4 * hit + 0.6 * (hit - later), rel=1e-10)


@given(static_texts())
@settings(max_examples=60)
def test_static_trees_equal_an_enumeration(text: str) -> None:
    tree = form(text)
    assert Analysis(tree).at(0.0) == pytest.approx(probability(tree), abs=1e-12)


@given(static_texts(leaves=5))
@settings(max_examples=30)
def test_importance_equals_its_definition(text: str) -> None:
    tree = form(text)
    whole = probability(tree)
    for one in Analysis(tree).importance(0.0):
        leaf = tree.leaves[one.leaf]
        certain = form(text.replace(f"{one.leaf} prob={leaf.numbers.chance};", f"{one.leaf} prob=1;"))
        with_it, gone = probability(certain), probability(without(tree, one.leaf))
        assert one.birnbaum == pytest.approx(with_it - gone, abs=1e-12)
        if whole:
            assert one.achievement == pytest.approx(with_it / whole, rel=1e-9)
            assert one.diagnostic == pytest.approx((leaf.numbers.chance or 0) * with_it / whole, rel=1e-9, abs=1e-12)
        if gone:
            assert one.reduction == pytest.approx(whole / gone, rel=1e-9)


def test_importance_of_the_example() -> None:
    text = "t and g h; g or a b; h or a c; a prob=.1; b prob=.2; c prob=.3;"
    found = {one.leaf: one for one in Analysis(form(text)).importance(0.0)}
    assert found["a"].achievement == pytest.approx(6.4935064935)
    assert found["b"].birnbaum == pytest.approx(0.27)


@pytest.mark.parametrize(
    "text",
    [
        "t sand x y;",
        "t and g z; g sand x y;",
        "t 2of3 g y z; g sand x z2; z2 lambda=.7 once=no;",
        "t sand x g z; g or y y2; y2 lambda=.4 once=no;",
        "t sand x y; y times 3 lambda=4 once=no;",
    ],
)
def test_chains_agree_with_simulated_logs_that_the_monitor_reads(text: str) -> None:
    given_ = (
        text + " x lambda=.5 once=no; z lambda=.1 once=no;" + ("" if "y times" in text else " y lambda=.2 once=no;")
    )
    tree = rvaft.loads(f"toplevel t; {given_}")
    samples = 4000
    exact = Analysis(of_tree(tree)).at(2.0)
    found = Simulation(tree, of_tree(tree)).estimate(rvaft.monitor(tree, semantics="scattered"), 2.0, samples=samples)
    assert abs(found.probability - exact) < 4 * math.sqrt(exact * (1 - exact) / samples)


def test_a_window_is_estimated() -> None:
    text = "event e(k) = {k: k}; time t as s; top and x y within 2 s; x on e(1) lambda=.5/s; y on e(2) lambda=.2/s;"
    tree = rvaft.loads(text)
    with pytest.raises(RiskError, match="windows"):
        Analysis(of_tree(tree))
    watching = rvaft.monitor(tree, semantics="scattered")
    simulation = Simulation(tree, of_tree(tree))
    found = simulation.estimate(watching, 5.0, samples=2000)
    assert found.low < 0.5223 < found.high
    watching.step({"k": 1, "t": 10})
    later = simulation.estimate(watching, 5.0, samples=2000, now=11_500_000_000)
    assert later.low < 0.5415 < later.high


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('x on e("x", X) lambda=1; y on e("y", Y) lambda=1; g when X != Y', "of g compares values of several"),
        ('x on e("x", X) lambda=1; y on e("y", Y) when X < Y lambda=1; g prob=1', "of y compares values of several"),
        ('x on e("x", X) when startswith(X, "a") lambda=1; y on e("y", X) lambda=1; g prob=1', "depends on values"),
        ("x sand y; y prob=.5 once=no; g prob=1", "y has a probability and happens when a later part"),
        ("x pand y z; y prob=.5; z prob=.5; g lambda=1", "y and z happen at time 0"),
        ('x times 2 distinct X on e("x", X) lambda=1; y lambda=1; g lambda=1', "counts different values"),
    ],
)
def test_what_a_simulated_log_cannot_tell_is_refused(text: str, message: str) -> None:
    top = "toplevel top; top and x g; x2 prob=1;" if "pand" in text else "toplevel top; top and x y g;"
    if "x sand y" in text:
        text, top = text.replace("x sand y", "x sand x1 y; x1 lambda=1"), "toplevel top; top and x g;"
    tree = rvaft.loads(f"event e(n, v) = {{event: n, value: v}}; {top} {text};".replace("x2 prob=1;", ""))
    with pytest.raises(RiskError, match=message):
        Simulation(tree, of_tree(tree))


@pytest.mark.parametrize("guard", ["X > 3", "X == 0", "X != 0"])
def test_simulated_events_satisfy_the_guards_of_one_instance(guard: str) -> None:
    text = f'x on e("x", X) when {guard} lambda=1; y on e("y", X) lambda=1 without e("x", 0) before;'
    tree = rvaft.loads(f"event e(n, v) = {{event: n, value: v}}; toplevel t; t and x y; {text}")
    found = Simulation(tree, of_tree(tree)).estimate(rvaft.monitor(tree, semantics="scattered"), 1.0, samples=1000)
    assert (found.low < (1 - math.exp(-1)) ** 2 < found.high) == (guard != "X == 0")


def test_a_guard_over_times_or_values_of_other_events_is_no_part_of_a_rate() -> None:
    text = "time t as s; event e(n, v) = {event: n, value: v}; toplevel t; t sand x y; "
    timed = text + 'x on e("x", X) lambda=1/s; y on e("y", Y) when at(y) - at(x) >= 1 s lambda=1/s;'
    with pytest.raises(RiskError, match="--simulate"):
        Analysis(form(timed))
    other = form(text + 'x on e("x", X) lambda=1/s; y on e("y", Y) when X < Y lambda=1/s;')
    assert other.assumed == ("y",)


def test_wilson_never_leaves_0_to_1() -> None:
    assert wilson(0, 10)[0] == 0.0
    assert wilson(10, 10)[1] == pytest.approx(1.0)
    assert wilson(0, 10)[1] > 0.2


@pytest.mark.parametrize("time", [1e-6, 1e-3, 1.0, 100.0])
def test_small_and_large_times_keep_their_relative_error(time: float) -> None:
    text = "t sand a b c; a lambda=1; b lambda=1; c lambda=1;"
    terms = [time**k / math.factorial(k) for k in range(3, 60)]
    expected = math.exp(-time) * sum(terms) if time < 10 else 1 - math.exp(-time) * (1 + time + time * time / 2)
    assert Analysis(form(text)).at(time) == pytest.approx(expected, rel=1e-11)


def test_the_mean_time_is_infinite_if_an_order_can_be_missed() -> None:
    assert Analysis(form("toplevel t; t pand x y;" + LEAVES, galileo=True)).mean_time() == math.inf
    assert Analysis(form("t or x y; x prob=.5; y lambda=0;")).mean_time() == math.inf


def test_the_mean_time_of_parts_and_leaves() -> None:
    # the minimum of an Erlang time of two steps of rate 1 and an exponential one of rate 1: 1/2 + 1/2 * 1/2
    found = Analysis(form("t or g c; g sand a b; a lambda=1; b lambda=1; c lambda=1;")).mean_time()
    assert found == pytest.approx(0.75, rel=1e-9)


@pytest.mark.parametrize(
    ("text", "galileo", "message"),
    [
        ("t or a b; a lambda=1/h; b lambda=1;", False, "has none"),
        ("t or a b; a lambda=1;", False, "no probability and no rate at b"),
        ("t or a b; a lambda=-1; b prob=.1;", False, "not a rate"),
        ("t or a b; a prob=1.5; b prob=.1;", False, "not a probability"),
        ("t or a b; a lambda=x; b prob=.1;", False, "not a rate"),
        ("t or a b; a lambda=1 repair=1; b prob=.1;", True, "unavailability"),
        ("t pand a b c; d fdep t2 a b; t2 lambda=1; a lambda=1; b lambda=1; c lambda=1; toplevel t;", True, "order of"),
        ("t and g h; g wsp a s; h wsp a s; a lambda=1; s lambda=1;", True, "at the same moment"),
        (
            "t or g h; g wsp a b; h or c d; b and c e; a lambda=1; c lambda=1 dorm=0; e lambda=1; d lambda=1;",
            True,
            "in use",
        ),
        ("t wsp a b; b wsp c d; a lambda=1; c lambda=1; d lambda=1;", True, "spare gate"),
    ],
)
def test_what_has_no_meaning_is_refused(text: str, galileo: bool, message: str) -> None:
    with pytest.raises(RiskError, match=message):
        Analysis(form(text, galileo=galileo)).at(1.0)


def test_limits_are_told() -> None:
    names = [f"e{number}" for number in range(14)]
    text = f"t pand {' '.join(names)}; " + " ".join(f"{name} lambda=1;" for name in names)
    with pytest.raises(TooLarge, match="states"):
        Analysis(form(text, galileo=True), states=10).at(1.0)


RARE = (
    "M or W V; W wsp A C; V wsp B C;",
    "M or W V; W wsp A C D; V wsp B D C;",
    "M or A X; X por B C; F fdep D B A;",
    "M and W V; W csp A C; V csp B C; F fdep D A;",
    "M or A X; X pand B C D;",
)


@pytest.mark.parametrize("never", ["lambda=0", "prob=0"])
@pytest.mark.parametrize("gates", RARE)
def test_a_leaf_that_never_happens_is_the_limit_of_rare_ones(gates: str, never: str) -> None:
    """A spare that never fails stays taken, and a trigger fails what does not fail by itself."""
    leaves = [name for name in "ABCD" if name in gates.replace(";", " ").split()]
    for leaf in leaves:
        rare, none = (
            f"toplevel M; {gates} " + " ".join(f"{one} {numbers if one == leaf else 'lambda=0.5'};" for one in leaves)
            for numbers in ("lambda=1e-9", never)
        )
        limit = Analysis(form(rare, galileo=True)).at(1.0)
        assert Analysis(form(none, galileo=True)).at(1.0) == pytest.approx(limit, abs=1e-7)


def test_a_dependent_with_a_probability_fails_by_itself_or_by_its_trigger() -> None:
    text = "toplevel M; M pand A B; F fdep T A; A prob=0.5; B lambda=1; T lambda=1;"
    b, b_after_t = 1 - math.exp(-1), (1 - math.exp(-1)) - (1 - math.exp(-2)) / 2
    expected = (b + b_after_t) / 2
    assert Analysis(form(text, galileo=True)).at(1.0) == pytest.approx(expected, rel=1e-12)


def test_importance_has_no_ratios_to_a_probability_of_0() -> None:
    [one, _] = Analysis(form("t and a b; a lambda=0; b prob=0;")).importance(1.0)
    assert (one.criticality, one.diagnostic, one.achievement, one.reduction) == (None, None, None, None)
