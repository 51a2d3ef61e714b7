"""`ltlf-mona`: emitted formulas by MONA's automata have the verdicts of the reference; what MONA
cannot take is refused in words.
"""

import os
import shutil
import sys
from importlib.util import find_spec
from pathlib import Path
from random import Random

import pytest

from backends import conformance
from backends.conformance import examples
from cross_check.judges import MONA, mona_of
from cross_check.participants import Absent, Participant
from cross_check.published.mona import MonaMonitor
from rvaft import (
    LanguageError,
    Monitor,
    NotExpressible,
    Semantics,
    TooLarge,
    ToolFailed,
    ToolMissing,
    Verdict,
    loads,
)
from rvaft.semantics import Reference
from tests.backends import ltlf
from tests.tables import rows, sampled

pytestmark = [
    pytest.mark.spot,
    pytest.mark.skipif(find_spec("spot") is None, reason="Spot's parser reads the texts (spottl)"),
]
needs_ltlf2dfa = pytest.mark.skipif(find_spec("ltlf2dfa") is None, reason="ltlf2dfa is not installed")
needs_mona = pytest.mark.skipif(
    find_spec("ltlf2dfa") is None or shutil.which("mona") is None, reason="ltlf2dfa or mona is not installed"
)


def by_mona(text: str) -> Monitor:
    return MonaMonitor(text)


@needs_mona
@pytest.mark.parametrize(
    ("formula", "word", "expected"), sampled((row[:3] for row in rows(ltlf.__file__, "verdicts.txt")[::2]), 4)
)
def test_verdicts_of_formulas(formula: str, word: str, expected: str) -> None:
    """Those that the reader of the backend gives, too."""
    verdicts = by_mona(formula).run({"event": name} for name in word.split())
    assert [verdict.symbol for verdict in verdicts] == [{"T": "⊤", "F": "⊥"}.get(sign, sign) for sign in expected]


@needs_mona
def test_names_that_differ_in_case_only() -> None:
    header = "".join(f"atom {name} := {{ {field}: _ }}\n" for name, field in (("p0", "x"), ("p1", "X"), ("x", "p0")))
    monitor = by_mona(f"/* rvaft\n{header}*/\np1 & X[!](p0 & X[!] x)")
    assert [verdict.symbol for verdict in monitor.run([{"X": 1}, {"x": 1}, {"p0": 1}])] == ["?", "?", "⊤"]


@pytest.mark.ci
@needs_mona
def test_emitted_formulas_have_the_verdicts_of_the_reference() -> None:
    found = set()
    for example in [*examples()][::32]:
        for semantics in Semantics:
            one = mona_of(example.tree, semantics)
            if isinstance(one, Absent):
                assert example.tree.variables or semantics is Semantics.CONSECUTIVE or example.tree.time
                assert one.status == "not expressible"
                continue
            assert isinstance(one, Participant), one
            for trace in conformance.traces(example, 8, Random(example.name)):
                verdicts = list(one.start().run(trace))
                assert verdicts == list(Reference(example.tree, semantics).run(trace)), (example.name, semantics, trace)
                found.update(verdicts)
    assert found == set(Verdict)


@needs_mona
def test_monitors_of_one_text_share_their_states_and_do_not_feel_each_other() -> None:
    participant = mona_of(loads("r sand a b;"), Semantics.PROJECTED)
    assert isinstance(participant, Participant)
    assert participant.name == MONA
    one, other = participant.start(), participant.start()
    one.step({"event": "a"})
    assert one.state != other.state == participant.start().state
    list(other.run([{"event": "noise"}, {"event": "a"}]))
    assert one.state == other.state
    assert (one.step({"event": "b"}), other.step({"event": "a"})) == (Verdict.TRUE, Verdict.FALSE)


def test_variables_are_not_expressible() -> None:
    text = "/* rvaft\natom a := { a: X }\natom b := { b: _ } when Y > 1\n*/\na & X[!] b"
    with pytest.raises(NotExpressible, match=r"its automata have no variables \(X, Y\)"):
        by_mona(text)


@needs_ltlf2dfa
def test_many_atoms_and_large_formulas_are_too_large() -> None:
    absent = mona_of(loads(f"r and {' '.join('abcdefghi')};"), Semantics.SCATTERED)
    assert isinstance(absent, Absent)
    assert absent.status == "too large"
    assert "9 atoms" in str(absent.error)
    with pytest.raises(TooLarge, match="more operators"):
        by_mona(" xor ".join(["F a", "F b", "F c", "F(d & X[!] F a)"] * 4))
    with pytest.raises(TooLarge, match="nested too deep"):
        by_mona("X[!] " * 1_500 + "a")


def test_malformed_formulas() -> None:
    with pytest.raises(LanguageError):
        by_mona("a &")


@needs_ltlf2dfa
def test_without_mona_there_is_no_automaton(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    absent = mona_of(loads("only sand no mona;"), Semantics.STRICT)
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
    monkeypatch.setattr("cross_check.published.mona.SECONDS", 1 if error is TooLarge else 30)
    with pytest.raises(error, match=reason):
        by_mona(f"a & failing_{len(script)}")
