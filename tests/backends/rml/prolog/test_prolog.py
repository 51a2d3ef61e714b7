"""The Prolog form of RML: its text, and that reading it back gives the verdicts of the RML text it was written from."""

from random import Random

import pytest

from backends import conformance
from backends.conformance import examples
from backends.rml import RmlBackend
from backends.rml.prolog import HEADER, RmlPrologBackend, prolog
from backends.rml.reader.monitor import read
from cross_check.participants import faithful_backends
from rvaft.api import loads
from rvaft.errors import LanguageError, NotExpressible, TooLarge
from rvaft.model.tree import RVAFT
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import Monitor
from rvaft.semantics import Reference
from tests.backends.rml.reading.cases import CASES, events
from tests.backends.rml.reading.programs import Programs, trace

PROLOG = RmlPrologBackend()


def test_the_text_of_a_sequence() -> None:
    text = PROLOG.translate(loads("r sand a b;"), Semantics.STRICT).text
    assert text.removeprefix(HEADER).splitlines() == [
        "match(Event, a_et) :- fits(Event, _{'event':\"a\"}).",
        "match(Event, b_et) :- fits(Event, _{'event':\"b\"}).",
        "match(Event, any_et) :- fits(Event, _{}).",
        "match(Event, none_et) :- not(match(Event, any_et)).",
        "trace_expression('Main', Main) :-",
        "    Main = (a_et*(b_et*(1))).",
    ]


def test_the_header_needs_no_matching_of_the_monitor_s() -> None:
    assert "deep_subdict" not in HEADER
    assert HEADER.startswith(":- module(spec, [trace_expression/2, match/2]).\n")


def _verdicts(monitor: Monitor, given: list[Json]) -> list[Verdict | str]:
    found: list[Verdict | str] = []
    try:
        found.extend(monitor.run(given))
    except TooLarge as error:
        found.append(str(error))
    return found


@pytest.mark.parametrize("case", CASES, ids=lambda case: str(case.name))
def test_pinned_programs_read_back(case: object) -> None:
    text, runs = case.whole, case.runs  # type: ignore[attr-defined]
    for run in runs:
        assert _verdicts(PROLOG.read(prolog(text)), events(run)) == _verdicts(read(text), events(run))


def test_random_programs_read_back() -> None:
    random = Random("prolog")
    endings = set()
    for _ in range(60):
        text = Programs(random).text()
        for _ in range(4):
            given = trace(random, text)
            found = _verdicts(PROLOG.read(prolog(text)), given)
            assert found == _verdicts(read(text), given), text
            endings.update(found[-1:])
    assert set(Verdict) <= endings


def oracle(tree: RVAFT, semantics: Semantics) -> Monitor:
    return Reference(tree, semantics)


def test_it_conforms() -> None:
    some = [example for number, example in enumerate(examples()) if number % 12 == 0]
    report = conformance.run(PROLOG, oracle, required=conformance.without_variables_or_determinate, trees=some, words=8)
    assert report.passed, report


def test_long_sequences_are_no_deep_recursion() -> None:
    leaves = [f"a{number}" for number in range(2_000)]
    specification = PROLOG.translate(loads(f"r sand {' '.join(leaves)};"), Semantics.STRICT)
    assert list(specification.monitor().run([{"event": name} for name in leaves]))[-1] is Verdict.TRUE


def test_strings_come_back() -> None:
    odd = "a'b\"c\\d\ne\x07ü*/"
    text = (
        "a matches {'k': '" + odd.replace("\\", "\\\\").replace("'", "\\'").replace("\n", "\\n") + "'}; Main = a all;"
    )
    assert PROLOG.read(prolog(text)).step({"k": odd}) is Verdict.TRUE
    assert PROLOG.read(prolog(text)).step({"k": odd + " "}) is Verdict.FALSE


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "does not begin as rvaft writes it"),
        (":- module(spec, [trace_expression/2, match/2]).\n", "does not begin"),
        (HEADER, "unexpected"),
        (HEADER + "match(Event, a_et) :- fits(Event, _{}.\n", "unexpected '.'"),
        (HEADER + "match(Event, a_et) :- fits(Event, _{'k':#}).\n", "unexpected '#'"),
        (HEADER + "match(Event, a_et) :- fits(Event, _{}).\n", "no trace_expression"),
        (prolog("a matches {}; Main = a;").replace("Main = a_et", "Main = a"), "a is no event type"),
        (prolog("a matches {}; Main = a;").replace("fits(Event, _{})", "assertz(Event)", 1), "the goal assertz"),
        (prolog("a matches {}; Main = a;").replace("match(Event, a_et)", "known(Event)", 1), "a clause for known"),
        (prolog("a matches {}; Main = a;").replace("Main = a_et", "Main = Other"), "Other"),
    ],
)
def test_other_prolog_is_refused(text: str, message: str) -> None:
    with pytest.raises(LanguageError, match=message):
        PROLOG.read(text)


def test_a_refusal_says_what_runs_it_and_where_it_is() -> None:
    with pytest.raises(LanguageError, match="rml-published") as caught:
        PROLOG.read(HEADER + "match(Event, a_et) :- fits(Event, _{'k':#}).\n")
    assert (caught.value.line, caught.value.column) == (HEADER.count("\n") + 1, 41)
    assert len(str(caught.value).splitlines()) == 1


def test_it_refuses_what_rml_refuses() -> None:
    tree = loads("event p(x) = {p: x}; event q(x) = {q: x}; r sand a b; a on p(X); b on q(X);")
    for backend in (RmlBackend(), PROLOG):
        with pytest.raises(NotExpressible):
            backend.translate(tree, Semantics.SCATTERED)
    overlapping = loads("event p(x) = {p: x}; r and m n a b c d; m on p(1); n on p(_);")
    for backend in (RmlBackend(), PROLOG):
        with pytest.raises(TooLarge):
            backend.translate(overlapping, Semantics.STRICT, limit=10)


def test_it_is_left_out_of_comparisons_unless_named() -> None:
    assert PROLOG.faithful
    assert PROLOG.form_of == "rml"
    assert "rml" in faithful_backends()
    assert "rml-prolog" not in faithful_backends()


def test_both_forms_have_the_same_masks() -> None:
    tree = loads("event p(x) = {p: x}; r sand a b; a on p(X) when X > 1; b on p(_);")
    rml, same = (backend.translate(tree, Semantics.STRICT).text for backend in (RmlBackend(), PROLOG))
    for given in ([{"p": 1}], [{"p": 1}, {"p": 1.0}], [{"p": "a"}], [{"p": {"q": 1}}], [{"p": 2**60}]):
        assert PROLOG.masked(same, given) == RmlBackend().masked(rml, given)
    assert PROLOG.masked(same, [{"p": 1}]) == ()
    assert PROLOG.masked(same, [{"p": "a"}]) == ("guards over what is no number",)
