"""Every faithful backend against the reference, by the suite that ships with the package."""

import runpy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import count
from random import Random
from typing import get_args

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from backends import conformance
from backends.conformance import Required, examples
from backends.conformance import trees as suite_trees
from backends.conformance.trees import AT_A, DECISIVE, EVENTS, GROUPS
from backends.rml import RmlBackend, writer
from cross_check.generate.traces import random_trace
from cross_check.generate.trees import random_tree
from rvaft import (
    RVAFT,
    Backend,
    Gate,
    LanguageError,
    Metrics,
    Monitor,
    Node,
    NotExpressible,
    Semantics,
    Verdict,
    all_backends,
    loads,
)
from rvaft.backend import Observed, SpecificationText, backend
from rvaft.capabilities import EVERY_OPERATOR, JSON_VALUES, Feature, Ties
from rvaft.core.build import build
from rvaft.core.property import PARTS, Part, Property
from rvaft.core.restriction import restrict
from rvaft.errors import unwritten
from rvaft.model.event_time import TextFormat
from rvaft.model.guards import Operation, Operator, walk
from rvaft.model.patterns import Pattern, SomeItem
from rvaft.model.patterns import walk as walk_pattern
from rvaft.model.values import Json
from rvaft.semantics import Reference
from tests.backends.texts import SHAPES, agreeing, readable, signs, writes_absence
from tests.semantics.cases import CASES
from tests.tables import part_and_whole


def default_events(example: conformance.Example, semantics: Semantics) -> bool:
    """Every tree over default events, without times, guards and absent events, must be expressible,
    where events are skipped at will.
    """
    plain = all(node.on is None and node.when is None and not node.without for node in example.tree.top_down())
    return semantics is Semantics.SCATTERED and plain and example.tree.time is None


def of_the_c_runtime(example: conformance.Example, semantics: Semantics) -> bool:
    """Every tree but those that search a list, lower texts, or read times as a text."""
    tree = example.tree
    guards = [node.when for node in tree.top_down()]
    lower = any(isinstance(part, Operation) and part.operator is Operator.LOWER for one in guards for part in walk(one))
    patterns = [pattern for name in tree.occurrences if (pattern := tree.pattern(name)) is not None]
    items = any(isinstance(part, SomeItem) for pattern in patterns for part in walk_pattern(pattern))
    return not (lower or items or (tree.time is not None and isinstance(tree.time.format, TextFormat)))


NEEDED: dict[str, Required] = {
    "automaton": conformance.everything,
    "c": of_the_c_runtime,
    "eql": conformance.scattered_by_single_events,
    "kql": default_events,
    "ltlf": conformance.everything,
    "mtl": conformance.scattered_by_single_events,
    "rml": conformance.without_variables_or_determinate,
    "sigma": default_events,
    "sql": conformance.no_variables_of_items,
    "stix": conformance.scattered_by_single_events,
}
"""What must be expressible; `rml-paper` is not faithful and not here; `rml-prolog` is `rml` in
another form, with tests of its own.
"""


def required(name: str) -> Required:
    return lambda one, semantics: (
        lists_operators(name, one) and writes_absence(name, one.tree, semantics) and NEEDED[name](one, semantics)
    )


def lists_operators(name: str, example: conformance.Example) -> bool:
    """Whether a backend lists the operators of a tree that are in no group: a new one may be in none yet."""
    guards = [part for node in example.tree.top_down() for part in walk(node.when)]
    asked = {part.operator for part in guards if isinstance(part, Operation)}
    return asked - EVERY_OPERATOR <= backend(name).operators


REQUIRED: dict[str, Required] = {name: required(name) for name in NEEDED}

EXAMPLES = tuple(examples())
ROWS = tuple(conformance.rows())
SAMPLE = (*ROWS[::3], *[one for one in EXAMPLES if not one.detects][::36])
"""Every third operator and construct, and a few other examples."""
MOST = (*ROWS, *[one for one in EXAMPLES if not one.detects][::4])
"""Each operator and each construct, and every fourth other example."""


SAMPLES = [
    pytest.param(SAMPLE, id="sample", marks=pytest.mark.sample),
    pytest.param(MOST, id="most", marks=pytest.mark.ci),
    pytest.param(EXAMPLES, id="all", marks=pytest.mark.slow),
]


@pytest.mark.parametrize("trees", SAMPLES)
@pytest.mark.parametrize("name", readable(*REQUIRED))
def test_backend_conforms(name: str, trees: Sequence[conformance.Example]) -> None:
    report = conformance.run(backend(name), Reference, required=REQUIRED[name], trees=trees, words=4)
    assert report.passed, report


@pytest.fixture(params=readable(*REQUIRED, "rml, votes counted"))
def translator(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Backend:
    """A backend; that of RML also with small votes counted like large ones."""
    name, _, counted = request.param.partition(", ")
    if counted:
        monkeypatch.setattr(writer, "SMALL", 0)
    return backend(name)


@pytest.mark.parametrize("count", part_and_whole(2, 12))
@pytest.mark.parametrize("shape", SHAPES)
def test_random_trees(translator: Backend, shape: str, count: int) -> None:
    random, compared = Random(shape), 0
    for _ in range(6 * count if translator.name == "kql" else count):  # KQL needs types, which few trees have
        tree = random_tree(random, SHAPES[shape])
        traces = [random_trace(random, tree) for _ in range(4)]
        compared += sum(agreeing(translator, tree, semantics, traces) for semantics in Semantics)
    least = 101 if translator.name not in ("rml", "c") else 31 if "variables" in shape else 81
    assert compared >= (least if Verdict.FALSE in translator.verdicts else 1) * count // 12


@pytest.mark.parametrize(
    ("of_trees", "of_semantics"),
    [
        pytest.param(5, 0, marks=pytest.mark.sample),
        pytest.param(1, 3, marks=pytest.mark.ci),
        pytest.param(1, 1, marks=pytest.mark.slow),
    ],
)
def test_hand_written_cases(translator: Backend, of_trees: int, of_semantics: int) -> None:
    """On their own traces, and whole trees also on random ones.

    One tree in so many, and random traces under one semantics in so many, if any; others for each tree.
    """
    trees = [*dict.fromkeys((case.tree, case.branch, case.kind) for case in CASES)]
    for place, (text, branch, kind) in enumerate(trees[::of_trees]):
        tree = restrict(loads(text), branch=branch, kind=kind)
        drawn = [random_trace(Random(seed), tree) for seed in range(2)] if tree.part_of is None else []
        cases = [case for case in CASES if (case.tree, case.branch, case.kind) == (text, branch, kind)]
        for turn, semantics in enumerate(Semantics, place):
            random = drawn if of_semantics and turn % of_semantics == 0 else []
            own = [case.events for case in cases if case.semantics == semantics]
            late = tree.time is not None and tree.time.late is not None
            narrow = translator.name in ("rml", "c") or Verdict.FALSE not in translator.verdicts
            narrow = narrow or not writes_absence(translator.name, tree, semantics)
            if own or random:
                assert agreeing(translator, tree, semantics, own + random) or not own or late or narrow


NAMES = st.text(max_size=5) | st.text(alphabet="_x5f1aA 2", max_size=5)
WORDS = "alive relevant rel guard_1 X F s1 true xor é Ärger all any with Main matches min S1 not_a _ // a-b"
NAMES |= st.sampled_from([*WORDS.split(), "s 1", 'q"', "*/ 1 /*"])


@pytest.mark.parametrize("name", readable(*REQUIRED))
@given(st.lists(NAMES.filter(str.strip), min_size=2, max_size=4, unique=True))
@example(["0", "0\0"])
@settings(max_examples=30)
def test_any_names_are_told_apart_and_leave_no_place(name: str, leaves: list[str]) -> None:
    root = max(leaves, key=len) + "!"
    tree = RVAFT(root, [Node(root, Gate.SAND, tuple(leaves)), *map(Node, leaves)])
    for semantics in backend(name).semantics:
        if name == "sql" and "\0" in "".join(leaves):
            with pytest.raises(NotExpressible, match="SQL strings cannot hold"):
                backend(name).translate(tree, semantics)
            continue
        try:
            monitor = backend(name).translate(tree, semantics).monitor()
        except NotExpressible:
            if name not in ("kql", "sigma"):  # without an escape for a character; the text 1 is a number
                raise
            continue
        trace: list[Json] = [{"event": leaf} for leaf in leaves]
        assert signs(monitor, trace) == "?" * (len(leaves) - 1) + "T"


def test_every_registered_faithful_backend_is_held_to_it() -> None:
    assert {
        one.name for one in map(backend, all_backends()) if one.faithful and one.readable and one.form_of is None
    } == set(REQUIRED)


class Odd(Backend):
    """Writes what it is told, and reads nothing."""

    name, language, suffix, default_limit = "odd", "none", ".none", 1

    def __init__(self, made: str, readable: bool) -> None:
        self.made, self.readable = made, readable  # type: ignore[misc]

    semantics, says, operators = frozenset(Semantics), frozenset(PARTS), frozenset(Operator)
    features, values, ties = frozenset(Feature), JSON_VALUES, Ties.ANY

    def write(self, prop: Property, semantics: Semantics, limit: int) -> SpecificationText:
        if not self.made:
            raise NotExpressible(unwritten(f"no {prop.tree} under {semantics}, whatever the limit {limit}"))
        if self.made == "another":
            return SpecificationText(f"{prop.tree} {limit} {next(NUMBERS)}", Metrics(0))
        return SpecificationText(self.made, Metrics(1))

    def read(self, text: str, *, atoms: Mapping[str, Pattern] | None = None) -> Monitor:
        raise LanguageError(f"{text} with {atoms} is not for me")


NUMBERS = count()
ODD = [  # what it writes, whether that is to be read, whether it must be expressible, what is found, whether it passes
    ("", True, True, ["required"] * 8, False),
    ("", True, False, [], False),
    ("the same", True, True, ["readable"] * 8, False),
    ("the same", False, True, [], True),
    ("another", False, True, ["repeatable", "metrics"] * 8, False),
]


@pytest.mark.parametrize(("made", "readable", "required", "checks", "passed"), ODD)
def test_what_is_odd_is_found(made: str, readable: bool, required: bool, checks: list[str], passed: bool) -> None:
    report = conformance.run(Odd(made, readable), Reference, trees=EXAMPLES[:2], required=lambda *_: required)
    assert [failure.check for failure in report.failures] == checks
    assert (len(report.refusals), report.passed) == (0 if made else 8, passed)


@pytest.mark.parametrize("row", ROWS, ids=[row.name for row in ROWS])
def test_a_row_detects_and_its_counterpart_does_not(row: conformance.Example) -> None:
    assert row.shown
    for semantics in row.shown:
        detects, misses = (list(Reference(row.tree, semantics).run(trace)) for trace in (row.detects, row.misses))
        assert (detects[-1], Verdict.TRUE in misses) == (Verdict.TRUE, False), semantics


EMITTED = sorted(one.name for one in map(backend, all_backends()) if not one.readable)


@pytest.mark.parametrize("trees", SAMPLES)
@pytest.mark.parametrize("name", EMITTED)
def test_what_is_only_emitted_is_translated_or_refused(name: str, trees: Sequence[conformance.Example]) -> None:
    def required(one: conformance.Example, semantics: Semantics) -> bool:
        if not (lists_operators(name, one) and writes_absence(name, one.tree, semantics)):
            return False
        said = name == "match-recognize" or (name == "mfotl" and semantics is Semantics.SCATTERED)
        no_variables = conformance.no_variables_of_items(one, semantics)
        return said and no_variables and conformance.no_texts_of_several(one, semantics)

    report = conformance.run(backend(name), Reference, required=required, trees=trees)
    assert report.passed, report
    assert report.translations + len(report.refusals) == len(trees) * len(Semantics)


def test_rows_have_every_operator_and_every_part() -> None:
    for row in ROWS:
        guards = [part for node in row.tree.top_down() for part in walk(node.when)]
        asked = {part.operator for part in guards if isinstance(part, Operation)}
        assert not row.name.startswith("operator") or row.name.split("`")[1] in asked, row.name
    parts = {type(part) for row in ROWS for part in build(row.tree).parts}
    assert parts >= set(get_args(Part))


@pytest.mark.parametrize(("group", "name"), [("operator", "abs"), ("construct", "pand"), ("construct", "late")])
def test_without_its_row_the_suite_does_not_load(group: str, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    fewer = {one: {key: row for key, row in some.items() if key != name} for one, some in GROUPS.items()}
    monkeypatch.setattr("tomllib.loads", lambda _: fewer)
    with pytest.raises(AssertionError, match=name):
        runpy.run_path(str(suite_trees.__file__))
    monkeypatch.setattr("tomllib.loads", lambda _: {**fewer, group: {**GROUPS[group], "unheard of": {}}})
    with pytest.raises(AssertionError, match="unheard of"):
        runpy.run_path(str(suite_trees.__file__))


def without_guards(tree: RVAFT) -> RVAFT:
    nodes = [replace(node, when=None) for node in tree.nodes.values() if node.has_event or node.children]
    return RVAFT(tree.root, nodes, tree.events.values(), time=tree.time)


ALTERED: dict[str, tuple[Callable[[RVAFT], RVAFT], list[conformance.Example]]] = {
    "never matches": (lambda _: loads("toplevel r; r sand never ever;"), [*ROWS]),
    "no guards": (without_guards, [row for row in ROWS if row.name.startswith("operator")]),
}


@pytest.mark.parametrize("mistake", ALTERED)
def test_a_text_that_never_detects_or_drops_a_guard_is_found(mistake: str) -> None:
    """For each row by itself, whatever else a backend says rightly."""
    altered, rows = ALTERED[mistake]
    given = [replace(row, tree=altered(row.tree)) for row in rows]
    right = {id(one.tree): row.tree for one, row in zip(given, rows, strict=True)}
    oracle = lambda tree, semantics: Reference(right[id(tree)], semantics)  # noqa: E731
    report = conformance.run(backend("sql"), oracle, required=lambda *_: False, trees=given, words=0)
    assert {one.example for one in report.failures if one.check == "detection"} == {row.name for row in rows}


class Forgetful(RmlBackend):
    """Keeps its last question to itself."""

    def observed(self, text: str, *, atoms: Mapping[str, Pattern] | None = None) -> tuple[Observed, ...] | None:
        return (super().observed(text, atoms=atoms) or ())[:-1]


def test_a_question_that_is_left_out_is_found() -> None:
    report = conformance.run(Forgetful(), Reference, trees=EXAMPLES[:3], words=6)
    assert {failure.check for failure in report.failures} == {"observed"}


MISREADINGS = [
    (">=", ">"),
    ("> ", ">= "),
    ("<=", "<"),
    ("< ", "<= "),
    (" or ", " and "),
    (" and ", " or "),
    ("not ", ""),
]
MISREADINGS += [("X > 0 and X < 3", "X > 0"), ("X < 3 and X > 0", "X < 3"), ("X < 1 or X > 2", "X < 1")]
MISREADINGS += [("px(1)", 'px("1")'), ("px(1)", "px(true)"), ("X == 1", 'X == "1"')]


@pytest.mark.parametrize(("right", "wrong"), MISREADINGS)
def test_what_is_easily_misread_has_an_example(right: str, wrong: str) -> None:
    """On the events of some example, in their order, which every run tries, the misreading has other verdicts."""
    found = set()
    for event, value in DECISIVE.values():
        trees = [loads(f"{EVENTS} toplevel r; {AT_A}{text};") for text in (event, event.replace(right, wrong, 1))]
        for semantics in Semantics:
            one, other = (list(Reference(tree, semantics).run([{"x": value}, {"y": 1}])) for tree in trees)
            found.add(one == other)
    assert False in found


def test_a_wrong_meaning_is_found() -> None:
    other = {Semantics.STRICT: Semantics.SCATTERED, Semantics.SCATTERED: Semantics.STRICT}
    sand = next(one for one in EXAMPLES if one.name == "r sand a b c;")
    wrong = lambda tree, one: Reference(tree, other.get(one, Semantics.STRICT))  # noqa: E731
    assert "verdict" in {one.check for one in conformance.run(RmlBackend(), wrong, trees=[sand]).failures}


def test_examples_have_different_names_and_reach_every_verdict() -> None:
    assert len({example.name for example in EXAMPLES}) == len(EXAMPLES)
    traces = [(one.tree, trace) for one in EXAMPLES for trace in (one.events, one.events[::-1], [{"nothing": 1}])]
    assert {verdict for tree, trace in traces for verdict in Reference(tree, Semantics.STRICT).run(trace)} == {*Verdict}
