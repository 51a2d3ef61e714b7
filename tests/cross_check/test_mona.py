"""`ltlf-mona`: emitted formulas by MONA's automata have the verdicts of the reference; what MONA cannot take is refused in words."""

import os
import shutil
import sys
from importlib.util import find_spec
from pathlib import Path
from random import Random

import pytest

from backends import conformance
from backends.conformance import examples
from cross_check.participants import MONA, Absent, Participant, translated
from rvaft.api import loads
from rvaft.backend import backend
from rvaft.errors import LanguageError, NotExpressible, OptionError, TooLarge, ToolFailed, ToolMissing
from rvaft.model.values import Json
from rvaft.model.verdict import Semantics, Verdict
from rvaft.monitors import Monitor
from rvaft.semantics import Reference

pytestmark = [
    pytest.mark.spot,
    pytest.mark.skipif(find_spec("spot") is None, reason="Spot's parser reads the texts (spottl)"),
]
needs_ltlf2dfa = pytest.mark.skipif(find_spec("ltlf2dfa") is None, reason="ltlf2dfa is not installed")
needs_mona = pytest.mark.skipif(
    find_spec("ltlf2dfa") is None or shutil.which("mona") is None, reason="ltlf2dfa or mona is not installed"
)

T, F, Q = Verdict.TRUE, Verdict.FALSE, Verdict.UNKNOWN


def by_mona(text: str) -> Monitor:
    return backend("ltlf").read_with("mona", text)


def word(letters: str) -> list[Json]:
    """`ab c .` is an event with the fields a and b, one with c, and one with none."""
    return [{"p0": 1} if one == "p0" else dict.fromkeys(one.strip("."), 1) for one in letters.split()]


HEADER = "/* rvaft\natom a := { a: _ }\natom b := { b: _ }\natom p0 := { x: _ }\natom p1 := { X: _ }\natom x := { p0: _ }\n*/\n"


@needs_mona
@pytest.mark.parametrize(
    ("formula", "letters", "verdicts"),
    [
        ("1", ".", [T]),
        ("0", ".", [F]),
        ("a", "a .", [T, T]),
        ("a & !a", "a", [F]),
        ("F a", ". . a .", [Q, Q, T, T]),
        ("G a", "a a b a", [Q, Q, F, F]),
        ("X[!] a", "b a", [Q, T]),
        ("X[!] a", "a b", [Q, F]),
        ("X a", "b a", [Q, T]),
        ("X a", "b b", [Q, F]),
        ("X[!] 1", ". .", [Q, T]),
        ("!X[!] 1", ". .", [Q, F]),
        ("!F(a & !X[!] 1)", "a b", [Q, Q]),
        ("a U b", "a a ab .", [Q, Q, T, T]),
        ("a U b", "a . b", [Q, F, F]),
        ("F(a & X[!] F b)", "b a ab", [Q, Q, T]),
        ("F a & F b", "ab", [T]),
        ("a xor b", "ab", [F]),
        ("b R a", "a ab .", [Q, T, T]),
        ("b W a", "b ab", [Q, T]),
        ("b M a", "a a b", [Q, Q, F]),
        ("p1 & X[!](p0 & X[!] x)", "X x p0", [Q, Q, T]),  # names that differ in case only
    ],
)
def test_verdicts_of_formulas(formula: str, letters: str, verdicts: list[Verdict]) -> None:
    assert list(by_mona(HEADER + formula).run(word(letters))) == verdicts
    assert list(backend("ltlf").read(HEADER + formula).run(word(letters))) == verdicts


@needs_mona
def test_emitted_formulas_have_the_verdicts_of_the_reference() -> None:
    found = set()
    for example in [example for number, example in enumerate(examples()) if number % 16 == 0]:
        for semantics in Semantics:
            one = translated("ltlf", example.tree, semantics, tool="mona")
            if example.tree.variables:
                assert isinstance(one, Absent)
                assert one.status == "not expressible"
                continue
            assert isinstance(one, Participant), one
            for trace in conformance.traces(example, 16, Random(example.name)):
                verdicts = list(one.start().run(trace))
                assert verdicts == list(Reference(example.tree, semantics).run(trace)), (example.name, semantics, trace)
                found.update(verdicts)
    assert found == set(Verdict)


@needs_mona
def test_monitors_of_one_text_share_their_states_and_do_not_feel_each_other() -> None:
    participant = translated("ltlf", loads("r sand a b;"), Semantics.PROJECTED, tool="mona")
    assert isinstance(participant, Participant)
    assert participant.name == MONA
    one, other = participant.start(), participant.start()
    assert one.state == other.state
    one.step({"event": "a"})
    assert one.state != other.state
    other.step({"event": "noise"})
    other.step({"event": "a"})
    assert one.state == other.state
    assert (one.step({"event": "b"}), other.step({"event": "a"})) == (T, F)


def test_variables_are_not_expressible() -> None:
    text = "/* rvaft\natom a := { a: X }\natom b := { b: _ } when Y > 1\n*/\na & X[!] b"
    with pytest.raises(NotExpressible, match=r"its automata have no variables \(X, Y\)"):
        by_mona(text)


def test_many_atoms_are_too_large() -> None:
    by_name = loads(f"r and {' '.join('abcdefghi')};")
    absent = translated("ltlf", by_name, Semantics.SCATTERED, tool="mona")
    assert isinstance(absent, Absent)
    assert absent.status == "too large"
    assert "9 atoms" in str(absent.error)


@needs_ltlf2dfa
def test_large_formulas_are_too_large() -> None:
    with pytest.raises(TooLarge, match="more operators"):
        by_mona(" xor ".join(["F a", "F b", "F c", "F d"] * 4).replace("F d", "F(d & X[!] F a)"))
    with pytest.raises(TooLarge, match="nested too deep"):
        by_mona("X[!] " * 1_500 + "a")


def test_malformed_formulas_and_unknown_tools() -> None:
    with pytest.raises(LanguageError):
        by_mona("a &")
    with pytest.raises(OptionError, match="no tool lamaconv runs ltlf; known: mona"):
        backend("ltlf").read_with("lamaconv", "a")
    with pytest.raises(OptionError, match="known: none"):
        backend("rml").read_with("mona", "Main = empty;")


# -- without the tools, and with such as are none ----------------------------------------------------------------------


@needs_ltlf2dfa
def test_without_mona_there_is_no_automaton(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    absent = translated("ltlf", loads("only sand no mona;"), Semantics.STRICT, tool="mona")
    assert isinstance(absent, Absent)
    assert absent.status == "tool missing"
    assert "mona is not installed: install the program mona" in str(absent.error)


def test_without_ltlf2dfa(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in ("ltlf2dfa", "ltlf2dfa.base", "ltlf2dfa.parser", "ltlf2dfa.parser.ltlf"):
        monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ToolMissing, match=r"ltlf2dfa is not installed: run `pip install 'rvaft\[mona\]'`"):
        by_mona("without & ltlf2dfa")


@needs_ltlf2dfa
@pytest.mark.parametrize(
    ("script", "reason"),
    [
        ("echo; echo 'Out of memory' >&2; exit 3", "mona failed: Out of memory"),
        ("exit 4", "mona failed: exit status 4"),
        ("echo fine", "mona failed: it printed no automaton"),
    ],
)
def test_a_mona_that_fails(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, script: str, reason: str) -> None:
    (tmp_path / "mona").write_text(f"#!/bin/sh\n{script}\n")
    (tmp_path / "mona").chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    with pytest.raises(ToolFailed, match=reason):
        by_mona(f"a & failing_{len(script)}")


@needs_ltlf2dfa
def test_a_mona_that_comes_to_no_end(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "mona").write_text("#!/bin/sh\nexec sleep 60\n")
    (tmp_path / "mona").chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setattr("backends.ltlf.mona.SECONDS", 1)
    with pytest.raises(TooLarge, match="more seconds"):
        by_mona("a & endless")
