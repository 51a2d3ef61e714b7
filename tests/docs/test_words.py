"""The words of documentation, help texts and messages are those of the glossary."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

from rvaft.cli import loaded, main
from rvaft.rules.registry import meanings
from tests.docs.examples import ROOT

FORBIDDEN = re.compile(
    r"\b(told|tells|hope|hopeless|speaks? of|nothing to say|whoever|somebody else's|the house|hindsight|oversights?"
    r"|basic event|judges?|of its own accord|in vain|by and by)\b"
)
"""Words of a private dialect, and words that the glossary replaces."""
DEFINITION = ROOT / "docs" / "semantics.md"
GLOSSARY = ROOT / "docs" / "reference" / "glossary.md"
PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md", "tests/README.md", "papers/README.md")),
    *sorted(page for page in (ROOT / "docs").rglob("*.md") if page not in (DEFINITION, GLOSSARY)),
    *sorted((ROOT / "trees").glob("*/README.md")),
]
BLOCK = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)


def forbidden(text: str) -> list[str]:
    """The forbidden words of a text."""
    return [found[0] for found in FORBIDDEN.finditer(text)]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_a_page_uses_the_words_of_the_glossary(page: Path) -> None:
    assert forbidden(BLOCK.sub("", page.read_text(encoding="utf-8"))) == []


@pytest.mark.parametrize("name", main.list_commands(click.Context(main)))
def test_a_help_text_uses_the_words_of_the_glossary(name: str) -> None:
    command = loaded(name)
    assert forbidden(command.get_help(click.Context(command, info_name=name))) == []


def test_the_rules_use_the_words_of_the_glossary() -> None:
    found = {code: forbidden(f"{meaning.title} {meaning.explanation}") for code, meaning in meanings().items()}
    assert {code: words for code, words in found.items() if words} == {}


def messages(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """The texts within `raise` statements, and within calls that print or warn, with their lines."""
    for node in ast.walk(tree):
        call = isinstance(node, ast.Call) and isinstance(node.func, (ast.Name, ast.Attribute))
        name = getattr(node.func, "attr", getattr(node.func, "id", "")) if call and isinstance(node, ast.Call) else ""
        if isinstance(node, ast.Raise) or name in ("warn", "echo", "option", "reject", "refuse"):
            for part in ast.walk(node):
                if isinstance(part, ast.Constant) and isinstance(part.value, str):
                    yield part.lineno, part.value


def test_messages_use_the_words_of_the_glossary() -> None:
    found = [
        f"{file.relative_to(ROOT)}:{line}: {text}"
        for package in ("rvaft", "backends", "cross_check")
        for file in sorted((ROOT / package).rglob("*.py"))
        for line, text in messages(ast.parse(file.read_text(encoding="utf-8")))
        if forbidden(text)
    ]
    assert found == []
