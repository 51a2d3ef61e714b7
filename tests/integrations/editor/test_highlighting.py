"""The lexer of Pygments, and the grammar for TextMate."""

import json
import re
import tomllib
from importlib import import_module
from pathlib import Path
from typing import Any, Final

import pytest
from pygments.token import Error, Keyword, Operator

from rvaft.integrations.editor.highlighting import RvaftLexer, text_mate
from rvaft.language.parser import SUFFIXES
from tests.language.test_lexemes import ROOT, TEXTS

STORED: Final = ROOT / "editors" / "vscode" / "syntaxes" / "rvaft.tmLanguage.json"
BLOCK: Final = re.compile(r"^```rvaft\n(.*?)^```$", re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("name", TEXTS)
def test_pygments_reads_every_tree(name: str) -> None:
    lexer: Any = RvaftLexer(stripnl=False, ensurenl=False)
    found = list(lexer.get_tokens(TEXTS[name]))
    assert "".join(text for _, text in found) == TEXTS[name]
    assert [text for kind, text in found if kind in Error] == []


def test_the_trees_of_the_documentation_have_no_error() -> None:
    pages = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    blocks = [(page, text) for page in pages for text in BLOCK.findall(page.read_text(encoding="utf-8"))]
    assert blocks
    assert [page.name for page, text in blocks if any(kind in Error for kind, _ in RvaftLexer().get_tokens(text))] == []


def test_a_word_has_the_kind_of_its_place() -> None:
    found = list(RvaftLexer().get_tokens("top or a; a when X or Y;"))
    assert [str(kind) for kind, text in found if text == "or"] == [str(Keyword), str(Operator.Word)]
    assert [text for kind, text in RvaftLexer().get_tokens("top or ?;") if kind in Error] == ["?"]


def test_the_lexer_is_an_entry_point() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    module, _, name = project["entry-points"]["pygments.lexers"]["rvaft"].partition(":")
    assert getattr(import_module(module), name) is RvaftLexer


def test_the_stored_grammar_is_that_of_the_language() -> None:
    """`python -m rvaft.integrations.editor.highlighting` writes it."""
    assert json.loads(STORED.read_text(encoding="utf-8")) == text_mate()


def coloured(line: str) -> list[tuple[str, str]]:
    """The pieces of a line with their scopes, by the first match; of equal ones that of the first rule."""
    rules = [(re.compile(rule.get("match") or rule["begin"]), rule["name"]) for rule in text_mate()["patterns"]]
    found, position = [], 0
    while position < len(line):
        matches = [
            (hit.start(), number, hit) for number, (rule, _) in enumerate(rules) if (hit := rule.search(line, position))
        ]
        if not matches:
            break
        _, number, hit = min(matches)
        found.append((hit[0], rules[number][1].removesuffix(".rvaft")))
        position = max(hit.end(), position + 1)
    return found


def test_the_grammar_colours_a_line() -> None:
    text = 'wrong on login("Failed \\" or", User) times 3 within 10 min when at(x) >= 2 or not b; // on'
    scopes = dict(coloured(text))
    assert scopes['"Failed \\" or"'] == "string.quoted.double"
    assert scopes["10 min"] == "constant.numeric.duration"
    assert (scopes["on"], scopes["or"], scopes["not"]) == (
        "keyword.other.clause",
        "keyword.control.gate",
        "keyword.operator.word",
    )
    assert (scopes["login"], scopes["at"], scopes["User"]) == (
        "entity.name.function",
        "support.function",
        "variable.parameter",
    )
    assert scopes["// on"] == "comment.line"
    assert dict(coloured("event a() = { event: 1 };"))["event"] == "variable.other.property"
    assert dict(coloured("top 2of3 or1 b c;"))["2of3"] == "keyword.control.gate"
    assert "or1" not in dict(coloured("top 2of3 or1 b c;"))
    assert dict(coloured("semantics scattered;"))["semantics"] == "keyword.other.statement"
    assert "semantics" not in dict(coloured("semantics or a b;"))


def test_the_extension_is_about_files_of_trees() -> None:
    package = json.loads((STORED.parents[1] / "package.json").read_text(encoding="utf-8"))
    (language,) = package["contributes"]["languages"]
    (grammar,) = package["contributes"]["grammars"]
    assert tuple(language["extensions"]) == SUFFIXES
    assert grammar["scopeName"] == text_mate()["scopeName"]
    for path in (language["configuration"], grammar["path"], package["main"]):
        assert (STORED.parents[1] / Path(path)).is_file()
