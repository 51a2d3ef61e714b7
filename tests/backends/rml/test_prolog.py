"""The Prolog form of RML: its text, and what is said where somebody wants it read (the published monitor judges it, see `published`)."""

import pytest

from backends.rml.prolog import HEADER, prolog
from cross_check.participants import Absent, faithful_backends, translated
from rvaft.api import loads
from rvaft.backend import backend
from rvaft.errors import LanguageError, NotExpressible, OptionError, TooLarge
from rvaft.model.verdict import Semantics, Verdict
from tests.backends.rml.reading.cases import CASES

RML, PROLOG = backend("rml"), backend("rml-prolog")


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


PROGRAMS = [
    ("a(x) matches {'k': 'a\\'b\\\\c\\n', v: x | 1} with x > -1 && x != 2.5;\nMain = {let x; a(x)! \\/ empty};",
     ["match(Event, a_et(V_x)) :- fits(Event, _{'k':\"a'b\\\\c\\n\", 'v':V_x}), {((V_x > (-1)) , (V_x =\\= 2.5))}.",
      "match(Event, a_et(V_x)) :- fits(Event, _{'k':\"a'b\\\\c\\n\", 'v':1}), {((V_x > (-1)) , (V_x =\\= 2.5))}.",
      "    Main = var(x, (clos(a_et(var(x)))\\/eps))."]),
    ("a matches {v: [1, _, ...]} | {v: [...]};\nb not matches a;\nMain = (a >> b{2} : (a | b?)) /\\ G<1 + 2>;\nG<n> = a if (n <= 3) all else b;",
     ["match(Event, a_et) :- fits(Event, _{'v':[1, _|_]}).", "match(Event, a_et) :- fits(Event, _{'v':[_|_]}).",
      "match(Event, b_et) :- not(match(Event, a_et)).",
      "    Main = (((a_et>>times(b_et, 2));(a_et|optional(b_et)))/\\app(G, [(1 + 2)])),",
      "    G = gen([n], (a_et*(guarded((var(n) =< 3), 1, b_et))))."]),
]  # fmt: skip


@pytest.mark.parametrize(("text", "lines"), PROGRAMS)
def test_the_text_of_a_program(text: str, lines: list[str]) -> None:
    kept = [line for line in prolog(text).removeprefix(HEADER).splitlines() if "any_et" not in line]
    assert [line for line in kept if not line.startswith("trace_expression")] == lines


@pytest.mark.parametrize("text", ["", "Main = ;", "Main = Main;"])
def test_it_refuses_what_is_no_rml(text: str) -> None:
    with pytest.raises(LanguageError):
        prolog(text)


def test_every_pinned_program_has_a_form() -> None:
    for case in CASES:
        assert prolog(case.whole).startswith(HEADER)


def test_long_sequences_are_no_deep_recursion() -> None:
    leaves = [f"a{number}" for number in range(2_000)]
    specification = PROLOG.translate(loads(f"r sand {' '.join(leaves)};"), Semantics.STRICT)
    assert list(specification.monitor().run([{"event": name} for name in leaves]))[-1] is Verdict.TRUE


def test_it_refuses_what_rml_refuses() -> None:
    tree = loads("event p(x) = {p: x}; event q(x) = {q: x}; r sand a b; a on p(X); b on q(X);")
    overlapping = loads("event p(x) = {p: x}; r and m n a b c d; m on p(1); n on p(_);")
    for language in (RML, PROLOG):
        with pytest.raises(NotExpressible):
            language.translate(tree, Semantics.SCATTERED)
        with pytest.raises(TooLarge):
            language.translate(overlapping, Semantics.STRICT, limit=10)


def test_it_is_only_emitted() -> None:
    specification = PROLOG.translate(loads("r sand a b;"), Semantics.STRICT)
    assert specification.monitor().step({"event": "b"}) is Verdict.FALSE  # that of the RML text it was written from
    with pytest.raises(OptionError, match="rml-prolog is only emitted: nothing here runs its texts"):
        PROLOG.read(specification.text)
    assert (PROLOG.faithful, PROLOG.form_of, PROLOG.readable) == (True, "rml", False)
    assert "rml" in faithful_backends()
    assert "rml-prolog" not in faithful_backends()
    absent = translated("rml-prolog", loads("r sand a b;"), Semantics.STRICT)
    assert isinstance(absent, Absent)
    assert (absent.status, "only emitted" in str(absent.error)) == ("could not run", True)
