"""`findings.md` and the command that makes everything: what is run, what cannot be, what no longer holds."""

import os
import sys
from pathlib import Path

import pytest

from papers.fmas2022 import making
from papers.fmas2022.__main__ import main
from papers.fmas2022.findings import State, findings
from papers.fmas2022.found import FINDINGS, Finding, Step
from papers.fmas2022.places import ROOT
from papers.fmas2022.shell import Need, run
from rvaft import ToolFailed, ToolMissing
from tests.backends.rml.published import needs_published

EXPECTED = Path(making.__file__).parent / "expected" / "findings.md"
NOWHERE = Need("set NOWHERE to a place", variable="RVAFT_NOWHERE", inside="file")
NO_PROGRAM = Need("install no-such-program", program="no-such-program")


def finding(*steps: Step) -> Finding:
    return Finding("a title", "A text.", steps)


BODIES = [
    (
        "commands run in the project and share a folder",
        (Step("ls README.md > $OUT/here"), Step("cat $OUT/here", "README.md"), Step("echo $OUT", "$OUT")),
        "$ ls README.md > $OUT/here\n$ cat $OUT/here\nREADME.md\n$ echo $OUT\n$OUT\n",
    ),
    (
        "the exit status is shown where it is not 0 and errors are output",
        (Step("echo no >&2; exit 3", "no"),),
        "$ echo no >&2; exit 3\nno\n(exit status 3)\n",
    ),
    ("paths of the machine are not shown", (Step(f"echo {ROOT}/trees", "trees"),), f"$ echo {ROOT}/trees\ntrees\n"),
    (
        "what lacks a tool is not run and says what to do",
        (
            Step("echo here", "here"),
            Step("echo one", "x", (NO_PROGRAM,), before="Then:"),
            Step("echo two", "y", (NO_PROGRAM,)),
            Step("echo three", "z", (NO_PROGRAM, NOWHERE)),
        ),
        (
            "$ echo here\nhere\n```\n\nThen:\n\n```sh\n$ echo one\n$ echo two\nnot run: install no-such-program\n"
            "$ echo three\nnot run: install no-such-program, and set NOWHERE to a place\n"
        ),
    ),
]


@pytest.mark.parametrize(("why", "steps", "shown"), BODIES, ids=[row[0] for row in BODIES])
def test_what_is_shown(why: str, steps: tuple[Step, ...], shown: str) -> None:
    assert findings([finding(*steps)]).text.partition("A text.\n\n")[2] == f"```sh\n{shown}```\n"


STATES = [
    (Step("echo x", "x"), State.CONFIRMED),
    (Step("echo x", "x", (NO_PROGRAM,)), State.PARTLY),
    (Step("echo x; echo not run: y", "x"), State.PARTLY),
    (Step("echo not run: y", "x"), State.UNCONFIRMED),
    (Step("echo yes", "no"), State.UNCONFIRMED),
    (Step("echo yes", ""), State.UNCONFIRMED),
    (Step("exit 1", ""), State.UNCONFIRMED),
]


@pytest.mark.parametrize(("step", "state"), STATES)
def test_what_hangs_on_a_command_that_was_not_run_is_not_asserted(step: Step, state: State) -> None:
    made = findings([Finding("It is so", "A text.", (step,), question="Whether it is so", seen="It was seen.")])
    title = "Whether it is so" if state is State.PARTLY else "It is so"
    assert made.states == [(title, state)]
    said = {State.PARTLY: "**Not run in full**", State.UNCONFIRMED: "**Not confirmed**", State.CONFIRMED: "A text."}
    assert f"## 1. {title}\n\n{said[state]}" in made.text
    assert ("It was seen." in made.text) is (state is State.CONFIRMED)


def test_a_variable_that_names_no_such_place_counts_as_absent(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("RVAFT_NOWHERE", str(tmp_path))
    assert NOWHERE.missing
    (tmp_path / "file").touch()
    assert not NOWHERE.missing


def test_a_command_that_does_not_end_is_given_up(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("papers.fmas2022.shell.TIMEOUT", 0.2)
    with pytest.raises(ToolFailed, match=r"no end within 0\.2 s: sleep 20"):
        run("sleep 20", tmp_path)


def test_the_findings_are_those_that_are_promised() -> None:
    titles = " / ".join(one.title for one in FINDINGS)
    words = "NewWp|rejects the Listing|⊥ for φ too early|lack an event|φ₁ ∨ φ₃|compound|exactly K|1.0"
    assert all(word in titles for word in words.split("|"))


# -- the real ones ---------------------------------------------------------------------------------------------------


@pytest.mark.ci
def test_a_quick_one_is_as_stored() -> None:
    made, stored = findings([FINDINGS[3]]).text, EXPECTED.read_text(encoding="utf-8")
    one, other = made.split("\n## ")[1], stored.split("\n## ")[4]
    assert one.partition(". ")[2].rstrip() == other.partition(". ")[2].rstrip()


@pytest.mark.slow
def test_without_the_published_tools_all_findings_hold_and_say_what_was_not_run(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("RML_COMPILER", raising=False)
    monkeypatch.delenv("RML_MONITOR", raising=False)
    made = findings()
    assert made.having(State.UNCONFIRMED) == ()
    assert len(made.having(State.CONFIRMED)) >= 4
    assert made.text.count("not run: ") >= 6
    assert "set RML_COMPILER to the jar" in made.text
    claims = "The published compiler rejects|stops at the first variable|9. The published monitor takes|without a word"
    assert not [claim for claim in claims.split("|") if claim in made.text]


@pytest.mark.slow
@pytest.mark.published
@pytest.mark.spot
@needs_published
def test_with_all_tools_the_page_is_as_stored() -> None:
    made = findings()
    assert {state for _, state in made.states} == {State.CONFIRMED}
    assert made.text == EXPECTED.read_text(encoding="utf-8")


# -- the command -----------------------------------------------------------------------------------------------------


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """The command without what takes long."""
    monkeypatch.setattr(making, "findings", lambda: findings([finding(Step("echo here", "here"))]))


def test_texts_only(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    new = tmp_path / "new"
    assert main(["--texts", "--out", str(new)]) == 0
    said = capsys.readouterr()
    assert (said.out.splitlines()[0], said.err) == (str(new / "table1.tex"), "")
    assert {file.name for file in new.iterdir()} == {file.name for file in EXPECTED.parent.iterdir()}
    assert (new / "paper.tex").read_bytes() == (EXPECTED.parent / "paper.tex").read_bytes()


def test_a_finding_that_no_longer_holds_ends_with_1(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(making, "latex_texts", lambda _: {})
    absent = Step("echo yes", "yes", (NO_PROGRAM,))
    for step, status, said in ((Step("echo yes", "no"), 1, "not confirmed"), (absent, 0, "not run in full")):
        monkeypatch.setattr(making, "findings", lambda step=step: findings([finding(step)]))
        assert main(["--texts", "--out", str(tmp_path)]) == status
        assert capsys.readouterr().err == f"papers.fmas2022: {said}: a title\n"


def test_what_lacks_a_tool_is_left_out_and_the_rest_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def missing(*_: object, **__: object) -> None:
        raise ToolMissing("matplotlib", remedy="pip install 'rvaft[papers]'")

    monkeypatch.setattr(making, "latex_texts", lambda _: {"table3.tex": ""})
    monkeypatch.setattr(making, "overhead", missing)
    monkeypatch.setitem(sys.modules, "cairosvg", None)
    assert main(["--out", str(tmp_path)]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert [line.partition(": not run: ")[2][:24] for line in lines] == [
        "figures 4a and 4b: cairo",
        "overhead: matplotlib is ",
    ]
    assert "pip install '.[pictures]'" in lines[0]
    assert "not run: matplotlib is not installed" in (tmp_path / "findings.md").read_text(encoding="utf-8")
    document = (tmp_path / "paper.tex").read_text(encoding="utf-8")
    assert r"\input{table3}" in document
    assert "includegraphics" not in document


NOT_ROOT = pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
TAKEN = ("file", ""), ("file/deeper", ""), ("", "Is a directory")


@pytest.mark.parametrize(("target", "said"), [*TAKEN, pytest.param("locked", "Permission denied", marks=NOT_ROOT)])
def test_what_cannot_be_written_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], target: str, said: str
) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "table1.tex").mkdir()
    (tmp_path / "locked").mkdir(0o500)
    assert main(["--out", str(tmp_path / target)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"papers.fmas2022: error: {tmp_path / target}")
    assert line.endswith(said)
