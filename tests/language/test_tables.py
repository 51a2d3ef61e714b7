"""The stored tables of the parser: `python -m tests.language.test_tables` writes them."""

from importlib.resources import files
from pathlib import Path

import pytest
from lark import __version__

from rvaft.language import parser

STORED = Path(str(files("rvaft.language").joinpath(parser.TABLES)))


def test_the_tables_are_those_of_the_grammar() -> None:
    title, of_grammar = STORED.read_bytes().partition(b"\n")[0], parser.tables().partition(b"\n")[0]
    if title.split()[1] != __version__.encode():
        pytest.skip(f"the tables are of another version of Lark than {__version__}")
    assert title == of_grammar


def test_the_stored_tables_parse_as_the_grammar_does(monkeypatch: pytest.MonkeyPatch) -> None:
    text = Path("trees/remote_inspection/pruned.rvaft").read_text(encoding="utf-8")
    stored = parser.parse(text)
    parser.grammar.cache_clear()
    with monkeypatch.context() as changed:
        changed.setattr(parser, "TABLES", "nothing")
        assert parser.parse(text) == stored
    parser.grammar.cache_clear()


if __name__ == "__main__":
    STORED.write_bytes(parser.tables())
