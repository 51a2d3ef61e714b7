"""The reference page of the language: its grammar is the grammar, its examples load, its messages are the messages."""

import re
from importlib.resources import files
from pathlib import Path

import pytest

from rvaft.api import load, loads
from rvaft.errors import LanguageError
from rvaft.language.parser import parse
from rvaft.language.printer import dumps

PAGE = (Path(__file__).parents[2] / "docs" / "language.md").read_text(encoding="utf-8")
BLOCKS: list[tuple[str, str]] = re.findall(r"^```(\w+)\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
TREES = [text for language, text in BLOCKS if language == "rvaft"]
MESSAGES: list[tuple[str, str]] = re.findall(
    r"^\| `([^`]+;|toplevel a)` \| (.*) \|$", PAGE.split("## Messages")[1], re.MULTILINE
)


def test_the_grammar_on_the_page_is_the_grammar() -> None:
    grammar = files("rvaft.language").joinpath("grammar.lark").read_text(encoding="utf-8")
    assert [text for language, text in BLOCKS if language == "lark"] == [grammar]


def test_the_page_has_examples_and_messages() -> None:
    assert len(TREES) >= 10
    assert len(MESSAGES) >= 8
    assert {language for language, _ in BLOCKS} == {"rvaft", "lark"}


@pytest.mark.parametrize("text", TREES, ids=lambda text: text.splitlines()[0])
def test_an_example_loads(text: str, tmp_path: Path) -> None:
    for example in TREES:
        if example.startswith("// file: "):
            (tmp_path / example.split()[2]).write_text(example, encoding="utf-8")
    path = tmp_path / "example.rvaft"
    path.write_text(text, encoding="utf-8")
    tree = load(path)
    assert loads(dumps(tree)) == tree


def test_the_example_of_several_files(tmp_path: Path) -> None:
    for example in TREES:
        if example.startswith("// file: "):
            (tmp_path / example.split()[2]).write_text(example, encoding="utf-8")
    tree = load(tmp_path / "drive.rvaft")
    assert set(tree.nodes) == {"System", "Drive", "Motor", "Wheel"}
    assert tree.root == "Drive"


@pytest.mark.parametrize(("text", "message"), MESSAGES)
def test_a_message_on_the_page_is_the_message(text: str, message: str) -> None:
    with pytest.raises(LanguageError) as caught:
        parse(text)
    assert caught.value.message == message
