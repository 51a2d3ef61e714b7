"""The text means the tree: read back by the RML reader it gives the verdicts of the reference after every prefix."""

from random import Random
from time import process_time

import pytest

from backends.rml import RmlBackend, writer
from cross_check.generate.traces import random_trace
from cross_check.generate.trees import PLAIN, VARIABLE_FREE, Shape, random_tree
from rvaft.analysis.branches import restrict
from rvaft.api import loads
from rvaft.errors import NotExpressible, TooLarge, TreeError
from rvaft.language.printer import dumps
from rvaft.model.nodes import Causality, Gate, Node
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics
from rvaft.semantics import Reference
from tests.semantics.cases import CASES, Case

RML = RmlBackend()
LIMIT = 5_000
SIGNS = {"true": "T", "false": "F", "unknown": "?"}
SINGLE = Shape(sharing=0, typed_events=0.1, variables=0, guards=0.1, ignores=0.1, max_nodes=11)
VARIABLES = Shape(variables=1, guards=0.4, max_nodes=6)


@pytest.fixture(params=[pytest.param(False, id="small"), pytest.param(True, id="counted")])
def form(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Small votes as they are, and counted like large ones."""
    if request.param:
        monkeypatch.setattr(writer, "SMALL", 0)


def compare(tree: RVAFT, semantics: Semantics, random: Random, traces: int) -> None:
    text = RML.translate(tree, semantics, limit=LIMIT).text
    for _ in range(traces):
        trace = random_trace(random, tree)
        monitor, reference = RML.read(text), Reference(tree, semantics)
        found, expected = list(monitor.run(trace)), list(reference.run(trace))
        assert found == expected, f"{semantics}\n{dumps(tree)}\n{text}\n{trace}"


@pytest.mark.usefixtures("form")
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_hand_written_cases(case: Case) -> None:
    """And random traces of their trees, under each semantics."""
    tree = restrict(loads(case.tree), branch=case.branch, kind=case.kind)
    for semantics in Semantics:
        try:
            made = RML.translate(tree, semantics)
        except NotExpressible as error:
            assert "order strings" in error.reason or (tree.variables and semantics is Semantics.SCATTERED)  # noqa: PT017
            continue
        if semantics == case.semantics:
            assert "".join(SIGNS[verdict.value] for verdict in made.monitor().run(case.events)) == case.verdicts
        if tree.part_of is None:
            compare(tree, semantics, Random(4), 10)


@pytest.mark.parametrize("shape", [PLAIN, VARIABLE_FREE, SINGLE], ids=["plain", "variable-free", "read-once"])
@pytest.mark.parametrize("semantics", list(Semantics))
def test_random_trees_without_variables_are_refused_only_where_an_ignore_orders_strings(
    shape: Shape, semantics: Semantics
) -> None:
    random = Random(f"{shape}{semantics}")
    compared = 0
    for _ in range(25):
        tree = random_tree(random, shape)
        try:
            compare(tree, semantics, random, 4)
        except TooLarge:
            continue
        except NotExpressible as error:
            assert "order strings" in error.reason  # noqa: PT017
            assert semantics is Semantics.PROJECTED
            assert error.nodes == ("ignore",)  # noqa: PT017
            continue
        compared += 1
    assert compared >= 22


IGNORING = 'event x(p) = { x: p }; ignore x(V) when V > "1"; top sand a b; a on x(_);'


def test_an_ignore_that_orders_strings_is_refused_under_projected_alone() -> None:
    tree = loads(IGNORING)
    with pytest.raises(NotExpressible, match="RML cannot order strings"):
        RML.translate(tree, Semantics.PROJECTED)
    for semantics in (Semantics.STRICT, Semantics.SCATTERED):
        compare(tree, semantics, Random(3), 10)


def test_a_part_is_refused_where_a_guard_outside_it_orders_strings() -> None:
    tree = loads('event x(p) = { x: p }; top or a b; a; b on x(V) when V > "1";')
    part = restrict(tree, branch=1)
    assert not part.variables
    with pytest.raises(NotExpressible, match="RML cannot order strings"):
        RML.translate(part, Semantics.PROJECTED)
    compare(part, Semantics.STRICT, Random(3), 10)


@pytest.mark.usefixtures("form")
@pytest.mark.parametrize("semantics", list(Semantics))
def test_trees_that_are_written_gate_by_gate(semantics: Semantics) -> None:
    random = Random(5)
    for _ in range(40):
        compare(random_tree(random, SINGLE), semantics, random, 4)


@pytest.mark.parametrize("semantics", list(Semantics))
def test_a_large_vot_is_translated_or_refused_at_once(semantics: Semantics) -> None:
    tree = loads(f"top 20of40 {' '.join(f'e{i}' for i in range(40))};")
    start = process_time()
    if semantics is Semantics.SCATTERED:
        with pytest.raises(TooLarge, match="scenarios"):
            RML.translate(tree, semantics, limit=2_000)
    else:
        assert RML.translate(tree, semantics).metrics.symbols < 160
    assert process_time() - start < 1


def test_what_no_scenario_can_keep_is_not_tried() -> None:
    """There are 2^30 ways to resolve the gate, and four that keep possible children alone."""
    leaves = [f"e{i}" for i in range(30)]
    guarded = " ".join(f"{leaf} on x(_) when 1 < 0;" for leaf in leaves[3:])
    tree = loads(f"event x(p) = {{ x: p }}; top and v v2; v 2of30 {' '.join(leaves)}; v2 or v; {guarded}")
    for semantics in Semantics:
        found = RML.translate(tree, semantics, limit=20).monitor().run([{"event": "e2"}, {"event": "e0"}])
        assert [SIGNS[verdict.value] for verdict in found] == ["?", "T"]


@pytest.mark.parametrize("semantics", [Semantics.STRICT, Semantics.PROJECTED])
def test_random_trees_with_variables(semantics: Semantics) -> None:
    random = Random(f"{semantics}")
    compared = 0
    for _ in range(60):
        tree = random_tree(random, VARIABLES)
        try:
            compare(tree, semantics, random, 6)
        except TooLarge:
            continue
        except NotExpressible as error:
            assert "order strings" in error.reason  # noqa: PT017
            continue
        compared += 1
    assert compared >= 50


@pytest.mark.parametrize(
    "tree",
    [
        'event n(v) = { v: v }; top sand a b; a on n(X); b on n(Y) when Y < "b";',
        'event n(v) = { v: v }; top sand a b; a on n(X); b on n(Y) when not ("b" <= Y);',
    ],
)
def test_a_guard_that_orders_strings_is_refused(tree: str) -> None:
    with pytest.raises(NotExpressible, match="RML cannot order strings") as caught:
        RML.translate(loads(tree), Semantics.STRICT)
    assert caught.value.nodes == ("b",)


def test_variables_are_refused_under_scattered_with_the_nodes_that_share_them() -> None:
    tree = loads("event n(v) = { v: v }; top sand a b c; a on n(X); b on n(X); c on n(Y);")
    with pytest.raises(NotExpressible, match="any event may be skipped") as caught:
        RML.translate(tree, Semantics.SCATTERED)
    assert caught.value.nodes == ("a", "b")


def test_a_variable_of_one_event_is_no_obstacle_under_scattered() -> None:
    tree = loads("event n(v, w) = { v: v, w: w }; top sand a b; a on n(X, X) when X > 1; b on n(Y, _);")
    compare(tree, Semantics.SCATTERED, Random(1), 40)


def test_two_assignments_at_once() -> None:
    """Which of two events binds X is open until later; each partial match has registers of its own."""
    tree = loads(
        "event p(v) = { x: v }; event q(v) = { y: v }; top and m n g; m on p(X); n on q(Y); g and c when X < Y + 0;"
    )
    for semantics in (Semantics.STRICT, Semantics.PROJECTED):
        compare(tree, semantics, Random(2), 60)


def test_too_large_is_said_before_it_is_built() -> None:
    tree = loads(
        "event p(x) = { x: x }; top and m n " + " ".join(f"a{i}" for i in range(20)) + "; m on p(1); n on p(_);"
    )
    with pytest.raises(TooLarge, match="alternatives") as caught:
        RML.translate(tree, Semantics.STRICT, limit=1_000)
    assert caught.value.limit == 1_000
    choices = "; ".join(f"o{i} or x{i} y{i}" for i in range(20))
    shared = loads(f"top and m n {' '.join(f'o{i}' for i in range(20))}; m and s; n and s; {choices};")
    with pytest.raises(TooLarge, match="scenarios") as caught:
        RML.translate(shared, Semantics.STRICT, limit=1_000)
    assert caught.value.limit == 1_000


def test_the_length_of_the_text_is_limited_too() -> None:
    tree = loads("top and " + " ".join(f"a{i}" for i in range(1_000)) + ";")
    assert RML.translate(tree, Semantics.STRICT, limit=1_200).metrics.symbols > 2_000
    with pytest.raises(TooLarge, match="symbols of the RML text, 10 allowed for each alternative") as caught:
        RML.translate(tree, Semantics.STRICT, limit=1_000)
    assert caught.value.limit == 1_000


HARD = (
    "event x(p) = { x: p }; event xx(p) = { x: p, y: p }; causality bottom_up; top and c d m a z; m sand b on xx(X) when X < Y; "
    "b on x(Y); d on x(Zz); a on x(Zz); z when X <= X;"
)


def test_the_default_limit_refuses_soon_what_could_not_be_read_soon() -> None:
    start = process_time()
    with pytest.raises(TooLarge) as caught:
        RML.translate(loads(HARD), Semantics.STRICT)
    assert caught.value.limit == RML.default_limit
    assert process_time() - start < 10  # about 1


def test_an_impossible_tree_is_an_error() -> None:
    tree = RVAFT(
        "r", [Node("r", Gate.SAND, ("a", "b")), Node("a", Gate.AND, ("c",)), Node("b", Gate.AND, ("c",)), Node("c")]
    )
    with pytest.raises(TreeError, match="feasible"):
        RML.translate(tree, Semantics.STRICT)


@pytest.mark.parametrize("gate", [Gate.AND, Gate.SAND, Gate.SAND_RL, Gate.OR])
@pytest.mark.parametrize("causality", list(Causality))
def test_a_chain_of_five_thousand_gates(gate: Gate, causality: Causality) -> None:
    nodes = [Node(f"g{i}", gate, (f"g{i + 1}", f"a{i}") if i % 50 == 0 else (f"g{i + 1}",)) for i in range(5_000)]
    leaves = [Node(f"a{i}") for i in range(0, 5_000, 50)]
    tree = RVAFT("g0", [*nodes, *leaves, Node("g5000")], causality=causality)
    for semantics in (Semantics.STRICT, Semantics.PROJECTED):
        assert "Main" in RML.translate(tree, semantics).text
