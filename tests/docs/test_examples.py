"""Every `sh` and `python` block of README and docs is executed and its output compared."""

import doctest
from pathlib import Path

import pytest

from tests.docs.examples import ROOT, SETUP, Block, blocks, commands, run


@pytest.mark.parametrize("block", list(blocks("sh")), ids=str)
def test_shell(block: Block) -> None:
    assert block.text.startswith("$ "), "a shell block starts with a command after `$ `"
    for command, shown in commands(block.text):
        if SETUP.match(command):
            assert not shown, "a command that sets up the machine shows no output"
        else:
            assert run(command, ROOT) == shown, command


SESSIONS = [block for block in blocks("python") if block.page.name != "rules.md"]
"""The blocks of the page of rules are bad and mended trees, which the tests of the rules run."""


@pytest.mark.parametrize("block", SESSIONS, ids=str)
def test_python(block: Block, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    example = doctest.DocTestParser().get_doctest(block.text, {}, str(block), str(block.page), block.line)
    assert example.examples, "a python block is an interactive session, with `>>> `"
    said: list[str] = []
    results = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(example, out=said.append)
    assert results.failed == 0, "".join(said)


def test_the_readme_has_a_tour() -> None:
    assert len(list(blocks("sh"))) > 5
    assert Path(ROOT / "README.md").stat().st_size > 1000
