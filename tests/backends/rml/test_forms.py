"""What is emitted beside `rml`: the paper's own translation, known to differ from the tree where it
does, and the Prolog form.

The published monitor judges the Prolog form, see `test_published`.
"""

from typing import Any

import pytest

from backends.rml.prolog import HEADER, prolog
from cross_check.participants import Absent, faithful_backends, translated
from papers.fmas2022.translation import RmlPaperBackend
from rvaft.api import loads
from rvaft.backend import backend
from rvaft.errors import LanguageError, NotExpressible, OptionError
from rvaft.model.verdict import Semantics, Verdict
from rvaft.semantics import Reference
from tests.backends.rml.programs import CASES
from tests.backends.texts import signs
from tests.core.trees import is_plain
from tests.tables import rows
from tests.trees import shipped

PROLOG, PAPER = backend("rml-prolog"), RmlPaperBackend()


@pytest.mark.parametrize(("tree", "equations"), rows(__file__, "paper_gates.txt"))
def test_the_gates_as_printed(tree: str, equations: str) -> None:
    text = PAPER.translate(loads(tree), Semantics.STRICT).text
    assert text[text.index("Main") :].strip() == equations


COMMON_START = 'top or x y; x sand a b; y sand a2 c; a2 on e(); a on e(); event e() = { event: "k" };'
OVERLAP = "top and m n; m on p(1); n on q(1); event p(x) = { x: x }; event q(y) = { y: y };"
DIFFERS = [
    ("VOT over a compound child loses an interleaving", "top 2of3 s b c; s sand a d;", "a b d", "?FF", "??T"),
    ("VOT followed by an event means exactly K", "top sand v d; v 2of3 a b c;", "a b c d", "??FF", "???T"),
    ("branches with a common start: the later one is missed", COMMON_START, "k c", "?F", "?T"),
    ("AND over overlapping events commits to the left", OVERLAP, [{"x": 1, "y": 1}, {"x": 1}], "?F", "?T"),
]


@pytest.mark.parametrize(("why", "text", "trace", "published", "meant"), DIFFERS, ids=[row[0] for row in DIFFERS])
def test_where_the_paper_is_known_to_differ(why: str, text: str, trace: Any, published: str, meant: str) -> None:
    assert signs(PAPER.translate(loads(text), Semantics.STRICT).monitor(), trace) == published
    assert signs(Reference(loads(text), Semantics.STRICT), trace) == meant
    assert not PAPER.faithful


UNEXPRESSED = {"detections/aws_trail_off", "absence/battery", "remote_inspection/deadline"}
"""Plain trees with a guard or an absent event that the paper's translation refuses."""


@pytest.mark.parametrize(
    "name", [one for one in shipped.names() if is_plain(shipped.load(one)) and one not in UNEXPRESSED]
)
@pytest.mark.parametrize("semantics", [Semantics.STRICT, Semantics.PROJECTED])
def test_every_shipped_tree_gives_a_text_that_runs(name: str, semantics: Semantics) -> None:
    specification = PAPER.translate(tree := shipped.load(name), semantics)
    for title, events in shipped.traces(name):
        found = signs(specification.monitor(), events)
        if (name, title, semantics) == ("remote_inspection/pruned", "table2_row3", Semantics.PROJECTED):
            assert (found[-1], signs(Reference(tree), events)[-1]) == ("F", "T")  # the union of the branches misses it
    assert specification.metrics.symbols > 3


ONE_BRANCH = "event on(v) = { v: v };\ntoplevel r; r 1of2 a b; a on on(1); b on on(2) when 1.5 < 0;\n"
REFUSED = [
    ("top or a b;", Semantics.SCATTERED, "the paper does not define it"),
    (ONE_BRANCH, Semantics.STRICT, "every branch has a guard that never"),  # a VOT is one branch, with all its guards
]


@pytest.mark.parametrize(("tree", "semantics", "words"), REFUSED)
def test_what_the_paper_cannot_say_is_refused(tree: str, semantics: Semantics, words: str) -> None:
    with pytest.raises(NotExpressible, match=words):
        PAPER.translate(loads(tree), semantics)


@pytest.mark.parametrize(("text", "clauses", "equations"), rows(__file__, "prolog.txt"))
def test_the_prolog_of_a_program(text: str, clauses: list[str], equations: list[str]) -> None:
    anywhere = ["match(Event, any_et) :- fits(Event, _{}).", "match(Event, none_et) :- not(match(Event, any_et))."]
    made = prolog(text).removeprefix(HEADER).splitlines()
    assert made == [*clauses, *anywhere, "trace_expression('Main', Main) :-", *equations]
    assert "deep_subdict" not in HEADER
    assert HEADER.startswith(":- module(spec, [trace_expression/2, match/2]).\n")


def test_every_pinned_program_has_a_form_and_what_is_no_rml_has_none() -> None:
    assert all(prolog(case.text).startswith(HEADER) for case in CASES)
    for text, *_ in rows(__file__, "errors.txt"):
        with pytest.raises(LanguageError):
            prolog(text)


def test_long_sequences_are_no_deep_recursion() -> None:
    leaves = [f"a{number}" for number in range(1_200)]
    specification = PROLOG.translate(loads(f"r sand {' '.join(leaves)};"), Semantics.STRICT)
    assert list(specification.monitor().run([{"event": name} for name in leaves]))[-1] is Verdict.TRUE


def test_it_is_only_emitted_and_refuses_what_rml_refuses() -> None:
    tree = loads("event p(x) = {p: x}; event q(x) = {q: x}; r sand a b; a on p(X); b on q(X);")
    with pytest.raises(NotExpressible):
        PROLOG.translate(tree, Semantics.SCATTERED)
    specification = PROLOG.translate(loads("r sand a b;"), Semantics.STRICT)
    assert specification.monitor().step({"event": "b"}) is Verdict.FALSE  # that of the RML text it was written from
    with pytest.raises(OptionError, match="rml-prolog is only emitted: rvaft cannot run its texts"):
        PROLOG.read(specification.text)
    assert (PROLOG.faithful, PROLOG.form_of, PROLOG.readable) == (True, "rml", False)
    assert [name in faithful_backends() for name in ("rml", "rml-prolog")] == [True, False]
    absent = translated("rml-prolog", loads("r sand a b;"), Semantics.STRICT)
    assert isinstance(absent, Absent)
    assert (absent.status, "has no reader" in str(absent.error)) == ("could not run", True)
