"""The documentation as a whole: sizes, the generated pages, and that nothing is left out of the site."""

import re
import shlex
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from types import ModuleType

import pytest

import rvaft
from rvaft.cli import loaded
from tests.docs.examples import ROOT

KILOBYTE = 1000


@pytest.fixture(scope="module")
def hooks() -> Iterator[ModuleType]:
    """The module that generates pages when the site is built."""
    pytest.importorskip("mkdocs", reason="needs MkDocs")
    sys.path.insert(0, str(ROOT / "docs"))
    import hooks

    yield hooks
    sys.path.remove(str(ROOT / "docs"))


def stored() -> list[Path]:
    """All Markdown files of the checkout."""
    hidden = {".venv", ".venv-sigma", ".hypothesis", "out", ".pytest_cache"}
    return [file for file in ROOT.rglob("*.md") if not hidden & set(file.relative_to(ROOT).parts)]


def test_the_sizes_of_the_documentation() -> None:
    assert (ROOT / "README.md").stat().st_size <= 8 * KILOBYTE
    definition = ROOT / "docs" / "semantics.md"  # one text, so that every clause is found in one place
    pages = [page for page in (ROOT / "docs").rglob("*.md") if page != definition]
    assert [page.name for page in pages if page.stat().st_size > 12 * KILOBYTE] == []
    assert sum(file.stat().st_size for file in stored()) <= 370 * KILOBYTE


def test_every_page_is_in_the_navigation(hooks: ModuleType) -> None:
    named = set(re.findall(r"([\w/-]+\.md)$", (ROOT / "mkdocs.yml").read_text(encoding="utf-8"), re.MULTILINE))
    there = {str(page.relative_to(ROOT / "docs")) for page in (ROOT / "docs").rglob("*.md")}
    assert named == there | set(hooks.generated())


def test_every_option_has_an_example_that_the_command_reads(hooks: ModuleType) -> None:
    text = hooks.generated()["reference/cli.md"]
    for name in hooks.commands.CALLS:
        for option, _, _ in hooks.commands.options(name):
            example = hooks.commands.example(name, option)
            assert f"| `{example.replace('|', hooks.commands.BAR)}` |" in text
            with suppress(OSError):  # the example names files that are not there
                loaded(name).make_context(name, shlex.split(example)[2:])


def test_the_api_page_has_every_public_name() -> None:
    named = set(re.findall(r"^::: rvaft\.(\w+)$", (ROOT / "docs/reference/api.md").read_text(), re.MULTILINE))
    assert named == set(rvaft.__all__) - {"__version__"}


def test_the_table_of_extras_is_that_of_the_project() -> None:
    import tomllib

    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    rows = re.findall(r"^\| `(\w+)` \|", (ROOT / "docs/installation.md").read_text(), re.MULTILINE)
    assert sorted(rows) == sorted(extras.keys() - {"dev"})


def test_pictures_are_those_that_the_script_makes() -> None:
    pytest.importorskip("selenium", reason="needs selenium")
    sys.path.insert(0, str(ROOT / "docs"))
    import pictures

    for name, text in pictures.badges().items():
        assert (ROOT / "docs" / "pictures" / name).read_text(encoding="utf-8") == text
    for theme in pictures.THEMES:
        drawn = pictures.drawing(rvaft.load(ROOT / pictures.TREE), theme)
        assert (ROOT / "docs" / "pictures" / f"break_in-{theme}.svg").read_text(encoding="utf-8") == drawn
    assert (ROOT / "docs" / "pictures" / "semantics.svg").read_text(encoding="utf-8") == pictures.semantics()
    for file, drawn in pictures.cases().items():
        assert file.read_text(encoding="utf-8") == drawn
