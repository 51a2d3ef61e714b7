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


def by_mona(text: str) -> Monitor:
    return backend("ltlf").read_with("mona", text)


def word(letters: str) -> list[Json]:
    """`ab c .` is an event with the fields a and b, one with c, and one with none."""
    return [{"p0": 1} if one == "p0" else dict.fromkeys(one.strip("."), 1) for one in letters.split()]


HEADER = "/* rvaft\natom a := { a: _ }\natom b := { b: _ }\natom p0 := { x: _ }\natom p1 := { X: _ }\natom x := { p0: _ }\n*/\n"


FORMULAS = """
1 | . | ⊤
0 | . | ⊥
a | a . | ⊤⊤
a & !a | a | ⊥
F a | . . a . | ??⊤⊤
G a | a a b a | ??⊥⊥
X[!] a | b a | ?⊤
X[!] a | a b | ?⊥
X a | b a | ?⊤
X a | b b | ?⊥
X[!] 1 | . . | ?⊤
!X[!] 1 | . . | ?⊥
!F(a & !X[!] 1) | a b | ??
a U b | a a ab . | ??⊤⊤
a U b | a . b | ?⊥⊥
F(a & X[!] F b) | b a ab | ??⊤
F a & F b | ab | ⊤
a xor b | ab | ⊥
b R a | a ab . | ?⊤⊤
b W a | b ab | ?⊤
b M a | a a b | ??⊥
p1 & X[!](p0 & X[!] x) | X x p0 | ??⊤
"""  # the last has names that differ in case only


@needs_mona
@pytest.mark.parametrize("row", FORMULAS.strip().splitlines())
def test_verdicts_of_formulas(row: str) -> None:
    formula, letters, verdicts = row.split(" | ")
    for monitor in (by_mona(HEADER + formula), backend("ltlf").read(HEADER + formula)):
        assert "".join(verdict.symbol for verdict in monitor.run(word(letters))) == verdicts


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
    assert (one.step({"event": "b"}), other.step({"event": "a"})) == (Verdict.TRUE, Verdict.FALSE)


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
    with pytest.raises(ToolMissing, match=r"ltlf2dfa is not installed: pip install '\.\[mona\]' in a checkout"):
        by_mona("without & ltlf2dfa")


@needs_ltlf2dfa
@pytest.mark.parametrize(
    ("script", "error", "reason"),
    [
        ("echo; echo 'Out of memory' >&2; exit 3", ToolFailed, "mona failed: Out of memory"),
        ("exit 4", ToolFailed, "mona failed: exit status 4"),
        ("echo fine", ToolFailed, "mona failed: it printed no automaton"),
        ("exec sleep 60", TooLarge, "more seconds"),
    ],
)
def test_a_mona_that_fails_or_comes_to_no_end(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, script: str, error: type[Exception], reason: str
) -> None:
    (tmp_path / "mona").write_text(f"#!/bin/sh\n{script}\n")
    (tmp_path / "mona").chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setattr("backends.ltlf.mona.SECONDS", 1 if error is TooLarge else 30)
    with pytest.raises(error, match=reason):
        by_mona(f"a & failing_{len(script)}")
