"""Every faithful backend against the reference, by the suite that ships with the package."""

import sys
from collections.abc import Mapping
from importlib.util import find_spec
from itertools import count, product
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from backends import conformance
from backends.conformance import AT_A, EVENTS, Required, examples
from backends.rml import writer
from cross_check.generate.traces import random_trace
from cross_check.generate.trees import PLAIN, VARIABLE_FREE, Shape, random_tree
from rvaft.analysis.branches import restrict
from rvaft.api import loads
from rvaft.backend import Backend, Metrics, Specification, all_backends, backend
from rvaft.errors import LanguageError, NotExpressible, ToolMissing
from rvaft.model.nodes import EventType, Gate, Node, On
from rvaft.model.patterns import Literal, ObjectPattern, Pattern
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics
from rvaft.monitors import Monitor
from rvaft.semantics import Reference
from tests.backends.texts import agreeing, readable, signs
from tests.semantics.cases import CASES

SHAPES = {
    "plain": PLAIN,
    "variable-free": VARIABLE_FREE,
    "shared": Shape(max_nodes=7, sharing=0.5),
    "read-once": Shape(sharing=0, typed_events=0.1, variables=0, guards=0.1, ignores=0.1, max_nodes=11),
    "variables": Shape(max_nodes=7, variables=1, guards=0.5, typed_events=0.9),
    "shared variables": Shape(max_nodes=6, sharing=0.4, variables=1, guards=0.4, typed_events=0.8),
}
REQUIRED: dict[str, Required] = {
    "automaton": conformance.everything,
    "ltlf": conformance.everything,
    "rml": conformance.without_variables_or_determinate,
}
"""What must be expressible; `rml-paper` is not faithful and not here; `rml-prolog` is `rml` in another form, with tests of its own."""

EXAMPLES = tuple(examples())


@pytest.mark.parametrize("name", readable(*REQUIRED))
def test_backend_conforms(name: str) -> None:
    report = conformance.run(backend(name), Reference, required=REQUIRED[name], trees=EXAMPLES, words=6)
    assert report.passed, report


@pytest.fixture(params=readable(*REQUIRED, "rml, votes counted"))
def translator(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Backend:
    """A backend; that of RML also with small votes counted like large ones."""
    name, _, counted = request.param.partition(", ")
    if counted:
        monkeypatch.setattr(writer, "SMALL", 0)
    return backend(name)


@pytest.mark.parametrize("shape", SHAPES)
def test_random_trees(translator: Backend, shape: str) -> None:
    random, compared = Random(shape), 0
    for _ in range(12):
        tree = random_tree(random, SHAPES[shape])
        traces = [random_trace(random, tree) for _ in range(4)]
        compared += sum(agreeing(translator, tree, semantics, traces) for semantics in Semantics)
    assert compared > (100 if translator.name != "rml" else 30 if "variables" in shape else 80)


def test_hand_written_cases(translator: Backend) -> None:
    """On their own traces; whole trees also on random ones, under each semantics."""
    for case in CASES:
        tree = restrict(loads(case.tree), branch=case.branch, kind=case.kind)
        assert agreeing(translator, tree, Semantics(case.semantics), [case.events]) or translator.name == "rml"
        traces = [random_trace(Random(seed), tree) for seed in range(3)]
        for semantics in Semantics if tree.part_of is None else ():
            agreeing(translator, tree, semantics, traces)


NAMES = st.text(max_size=5) | st.text(alphabet="_x5f1aA 2", max_size=5)
NAMES |= st.sampled_from(
    ["alive", "relevant", "rel", "guard_1", "X", "F", "s1", "s 1", "true", "xor", "é", "Ärger", 'q"']
)
NAMES |= st.sampled_from(["all", "any", "with", "Main", "matches", "min", "S1", "not_a", "_", "*/ 1 /*", "//", "a-b"])


@pytest.mark.parametrize("name", readable(*REQUIRED))
@given(st.lists(NAMES.filter(str.strip), min_size=2, max_size=4, unique=True))
@settings(max_examples=30)
def test_any_names_are_told_apart_and_leave_no_place(name: str, leaves: list[str]) -> None:
    root = max(leaves, key=len) + "!"
    tree = RVAFT(root, [Node(root, Gate.SAND, tuple(leaves)), *map(Node, leaves)])
    for semantics in Semantics:
        monitor = backend(name).translate(tree, semantics).monitor()
        trace: list[Json] = [{"event": leaf} for leaf in leaves]
        assert signs(monitor, trace) == "?" * (len(leaves) - 1) + "T"


def test_strings_stay_in_their_place() -> None:
    event = EventType("*/ 1 /*", (), ObjectPattern((("*/", Literal("*/ 1 /*")), ("when", Literal("when\n//")))))
    for name, semantics in product(("ltlf", "rml"), Semantics):
        tree = RVAFT("t", [Node("t", Gate.SAND, ("a", "b")), Node("a", on=On("*/ 1 /*", ())), Node("b")], [event])
        text = backend(name).translate(tree, semantics).text
        assert text.count("*/") == text.count("/*") == 1 or name == "rml"
        if name == "rml" or find_spec("spot"):
            trace: list[Json] = [{"*/": "*/ 1 /*", "when": "when\n//"}, {"event": "b"}]
            assert signs(backend(name).read(text), trace) == "?T"


@pytest.mark.parametrize("name", ["automaton", "ltlf"])
def test_without_spot_the_error_says_what_to_install_and_translating_needs_none(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "spot", None)
    text = backend(name).translate(loads("toplevel r; r and never_read_before b;"), Semantics.STRICT).text
    with pytest.raises(ToolMissing, match="pip install spottl"):
        backend(name).read(text).step({})


def test_every_registered_faithful_backend_is_held_to_it() -> None:
    made = [backend(name) for name in all_backends()]
    assert {one.name for one in made if one.faithful and one.form_of is None} == set(REQUIRED)


def test_examples_have_different_names() -> None:
    assert len({example.name for example in EXAMPLES}) == len(EXAMPLES)


class Stubborn(Backend):
    """Refuses everything and reads nothing; what it says of its language does not matter."""

    name = "stubborn"
    language = "none"
    suffix = ".none"
    default_limit = 1

    def translate(self, tree: RVAFT, semantics: Semantics, *, limit: int | None = None) -> Specification:
        raise NotExpressible(f"no {tree}, whatever the limit {limit}", backend=self.name, semantics=semantics)

    def read(self, text: str, *, atoms: Mapping[str, Pattern] | None = None) -> Monitor:
        raise AssertionError((text, atoms))


def test_a_refusal_counts_as_a_failure_only_where_it_is_required() -> None:
    two = EXAMPLES[:2]
    strict = conformance.run(Stubborn(), Reference, trees=two)
    assert len(strict.refusals) == len(strict.failures) == 6
    lenient = conformance.run(Stubborn(), Reference, trees=two, required=lambda *_: False)
    assert (len(lenient.refusals), lenient.failures) == (6, [])
    assert not lenient.passed


class Mumbling(Stubborn):
    """Writes what it cannot read."""

    def translate(self, tree: RVAFT, semantics: Semantics, *, limit: int | None = None) -> Specification:
        return Specification(f"{tree} {semantics} {limit}", self.language, Metrics(1), self.read)

    def read(self, text: str, *, atoms: Mapping[str, Pattern] | None = None) -> Monitor:
        raise LanguageError(f"{text} with {atoms} is not for me")


class Emitted(Mumbling):
    """Its texts are for others to read."""

    readable = False


NUMBERS = count()


class Restless(Emitted):
    """Never writes the same text twice, and nothing in it."""

    def translate(self, tree: RVAFT, semantics: Semantics, *, limit: int | None = None) -> Specification:
        return Specification(f"{tree} {semantics} {limit} {next(NUMBERS)}", "another", Metrics(0))


def test_a_text_that_its_backend_cannot_read_is_a_failure_unless_it_is_only_emitted() -> None:
    report = conformance.run(Mumbling(), Reference, trees=EXAMPLES[:1])
    assert {failure.check for failure in report.failures} == {"readable"}
    assert not report.passed
    assert conformance.run(Emitted(), Reference, trees=EXAMPLES[:1]).passed
    report = conformance.run(Restless(), Reference, trees=EXAMPLES[:1])
    assert {failure.check for failure in report.failures} == {"repeatable", "language", "metrics"}


MISREADINGS = [(">=", ">"), ("> ", ">= "), ("<=", "<"), ("< ", "<= "), (" or ", " and "), (" and ", " or ")]
MISREADINGS += [("X > 0 and X < 3", "X > 0"), ("X < 3 and X > 0", "X < 3"), ("X < 1 or X > 2", "X < 1")]
MISREADINGS += [("not (X == 1)", "X == 1"), ("px(1)", 'px("1")'), ("px(1)", "px(true)"), ("X == 1", 'X == "1"')]


@pytest.mark.parametrize(("right", "wrong"), MISREADINGS)
def test_what_is_easily_misread_has_an_example(right: str, wrong: str) -> None:
    """On the events of some example, in their order, which every run tries, the misreading has other verdicts."""
    found = set()
    for event, value in conformance.DECISIVE.values():
        trees = [loads(f"{EVENTS} toplevel r; {AT_A}{text};") for text in (event, event.replace(right, wrong, 1))]
        for semantics in Semantics:
            one, other = (list(Reference(tree, semantics).run([{"x": value}, {"y": 1}])) for tree in trees)
            found.add(one == other)
    assert False in found


@pytest.mark.spot
def test_a_wrong_meaning_is_found() -> None:
    pytest.importorskip("spot")
    example = next(example for example in EXAMPLES if example.name == "r sand a b c;")
    other = {Semantics.STRICT: Semantics.SCATTERED, Semantics.SCATTERED: Semantics.STRICT}
    report = conformance.run(
        backend("automaton"), lambda tree, one: Reference(tree, other.get(one, Semantics.STRICT)), trees=[example]
    )
    assert any(failure.check == "verdict" for failure in report.failures)


def test_examples_reach_every_verdict() -> None:
    found = set()
    for example in EXAMPLES:
        for trace in ([*example.events], [*reversed(example.events)], [{"nothing": 1}]):
            found |= set(Reference(example.tree, Semantics.STRICT).run(trace))
    assert len(found) == 3
