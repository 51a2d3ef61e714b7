"""Every `sh` and `python` block of README and docs is executed and its output compared."""

import doctest
import re
from collections.abc import Iterable
from importlib.util import find_spec

import pytest
from _pytest.mark.structures import ParameterSet

from tests.docs.examples import ROOT, SETUP, Block, blocks, commands, run

pytestmark = pytest.mark.usefixtures("quick")
NEEDS = {
    "spot": re.compile(r'--backend (ltlf|automaton)|"ltlf"|rvaft cross-check|rvaft compare|rvaft backends'),
    "pyarrow": re.compile(r"\.parquet"),
    "rosbags": re.compile(r"\.mcap"),
    "paho": re.compile(r"mqtts?://"),
    "eql": re.compile(r"findings/\w+\.eql|import eql"),
    "sigma": re.compile(r"findings/\w+\.yml"),
    "stix2matcher": re.compile(r"findings/\w+\.stix|stix2matcher"),
    "reelay": re.compile(r"findings/\w+\.mtl"),
}
LONG = re.compile(r"rvaft (cross-check|compare)|--backend|--to (sigma|automaton|dot|stix)|python3 -c")
"""Commands that run other programs, or compare many trees: only the README has them in every run."""
FIRST = ("README.md", "tutorial.md")
"""Pages whose examples run in every run; of the others every third does."""


def params(found: Iterable[Block]) -> list[ParameterSet]:
    """The blocks; those that need a library which is not installed are left out."""
    absent = {name: asks for name, asks in NEEDS.items() if find_spec(name) is None}
    lacking = {b: [name for name, asks in absent.items() if asks.search(b.text)] for b in found}
    marks = {b: [pytest.mark.skip(reason=f"needs {name}") for name in names[:1]] for b, names in lacking.items()}
    late = {
        b: [pytest.mark.ci]
        for number, b in enumerate(marks)
        if (LONG.search(b.text) and b.page.name != "README.md") or (number % 3 and b.page.name not in FIRST)
    }
    return [pytest.param(b, id=str(b), marks=[*own, *late.get(b, [])]) for b, own in marks.items()]


@pytest.mark.parametrize("block", params(blocks("sh")))
def test_shell(block: Block, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    assert block.text.startswith("$ "), "a shell block starts with a command after `$ `"
    for command, shown in commands(block.text):
        if SETUP.match(command):
            assert not shown, "a command that sets up the machine shows no output"
        else:
            assert run(command) == shown, command


@pytest.mark.parametrize("block", params(blocks("python")))
def test_python(block: Block, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    example = doctest.DocTestParser().get_doctest(block.text, {}, str(block), str(block.page), block.line)
    assert example.examples, "a python block is an interactive session, with `>>> `"
    said: list[str] = []
    results = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(example, out=said.append)
    assert results.failed == 0, "".join(said)


NAMED = re.compile(r"`((?:rvaft|backends|cross_check|tests|trees|papers|docs)/[\w./-]+)`")


def test_the_files_that_pages_name_are_there() -> None:
    pages = [*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("tests/*.md"), *ROOT.glob("papers/**/*.md")]
    named = {(page, name) for page in pages for name in NAMED.findall(page.read_text()) if "NAME" not in name}
    assert len(named) > 20
    lost = [(page.name, name) for page, name in named if not any((at / name).exists() for at in (ROOT, page.parent))]
    assert lost == []
