"""Every faithful backend against the reference, by the suite that ships with the package."""

from collections.abc import Hashable, Mapping
from importlib.util import find_spec
from itertools import count

import pytest

from backends import conformance
from backends.conformance import AT_A, EVENTS, Required, examples
from rvaft.api import loads
from rvaft.backend import Backend, Metrics, Specification, all_backends, backend
from rvaft.errors import LanguageError, NotExpressible
from rvaft.model.patterns import Pattern
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import Monitor
from rvaft.semantics import Reference

REQUIRED: dict[str, Required] = {
    "automaton": conformance.everything,
    "ltlf": conformance.everything,
    "rml": conformance.without_variables_or_determinate,
}
"""What must be expressible; `rml-paper` is not faithful and not here; `rml-prolog` is `rml` in another form, with tests of its own."""

NEEDS_SPOT = {"automaton", "ltlf"}

EXAMPLES = tuple(examples())


def oracle(tree: RVAFT, semantics: Semantics) -> Monitor:
    return Reference(tree, semantics)


def faithful() -> list[object]:
    return [
        pytest.param(
            name,
            marks=[
                pytest.mark.spot,
                pytest.mark.skipif(find_spec("spot") is None, reason="its reader needs Spot (spottl)"),
            ]
            if name in NEEDS_SPOT
            else [],
        )
        for name in REQUIRED
    ]


@pytest.mark.parametrize("name", faithful())
def test_backend_conforms(name: str) -> None:
    report = conformance.run(backend(name), oracle, required=REQUIRED[name], trees=EXAMPLES, words=6)
    assert report.passed, report


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
    strict = conformance.run(Stubborn(), oracle, trees=two)
    assert len(strict.refusals) == len(strict.failures) == 6
    lenient = conformance.run(Stubborn(), oracle, trees=two, required=lambda *_: False)
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
    report = conformance.run(Mumbling(), oracle, trees=EXAMPLES[:1])
    assert {failure.check for failure in report.failures} == {"readable"}
    assert not report.passed
    assert conformance.run(Emitted(), oracle, trees=EXAMPLES[:1]).passed
    report = conformance.run(Restless(), oracle, trees=EXAMPLES[:1])
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


class Swapped(Monitor):
    """A monitor of another semantics."""

    def __init__(self, tree: RVAFT, semantics: Semantics) -> None:
        super().__init__()
        other = Semantics.STRICT if semantics is Semantics.SCATTERED else Semantics.SCATTERED
        self.inner = Reference(tree, other)

    def _advance(self, event: Json) -> Verdict:
        return self.inner.step(event)

    @property
    def state(self) -> Hashable:
        return self.inner.state


@pytest.mark.spot
def test_a_wrong_meaning_is_found() -> None:
    pytest.importorskip("spot")
    example = next(example for example in EXAMPLES if example.name == "r sand a b c;")
    report = conformance.run(backend("automaton"), Swapped, trees=[example])
    assert any(failure.check == "verdict" for failure in report.failures)


def test_examples_reach_every_verdict() -> None:
    found = set()
    for example in EXAMPLES:
        for trace in ([*example.events], [*reversed(example.events)], [{"nothing": 1}]):
            found |= set(Reference(example.tree, Semantics.STRICT).run(trace))
    assert len(found) == 3
