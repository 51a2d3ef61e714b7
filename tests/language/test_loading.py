"""From text to a checked tree: the first broken rule is a `TreeError` with its code, place and nodes."""

import os
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from rvaft.api import load, loads
from rvaft.errors import TreeError, WrongType
from rvaft.language.printer import dumps
from tests.tables import rows

# text, rule, place, a culprit
BROKEN = rows(__file__, "broken.txt")


@pytest.mark.parametrize(("text", "rule", "place", "culprit"), BROKEN)
def test_a_broken_rule_is_named(text: str, rule: str, place: str, culprit: str) -> None:
    with pytest.raises(TreeError) as caught:
        loads(text, "f.rvaft")
    error = caught.value
    assert error.rule == rule
    assert error.message.startswith(f"f.rvaft:{place}")
    assert not culprit or culprit in error.nodes
    assert "\n" not in str(error)


def test_a_file_by_path_or_name(tmp_path: Path) -> None:
    path = tmp_path / "a.dft"
    path.write_text("a or b c;")
    assert load(path) == load(str(path)) == load(os.path.relpath(path)) == loads("a or b c; b; c;")


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: loads(b"a;"), "the text of a tree must be a str, not bytes"),  # type: ignore[arg-type]
        (lambda: loads(Path("a")), "the text of a tree must be a str, not PosixPath"),  # type: ignore[arg-type]
        (lambda: load(b"a.rvaft"), "the path of a tree must be a str or a path, not bytes"),  # type: ignore[arg-type]
        (lambda: load(None), "the path of a tree must be a str or a path, not NoneType"),  # type: ignore[arg-type]
    ],
)
def test_arguments_of_a_wrong_type(call: Callable[[], object], said: str) -> None:
    with pytest.raises(WrongType) as caught:
        call()
    assert str(caught.value).replace("WindowsPath", "PosixPath") == said


def test_a_tree_of_10000_nodes_loads() -> None:
    lines = [f"n{i} or n{2 * i + 1} n{2 * i + 2};" if i < 4999 else f'n{i} label "{i}";' for i in range(9999)]
    tree = loads("\n".join(lines))
    assert (len(tree.nodes), tree.root) == (9999, "n0")
    assert dumps(tree).count("\n") == 10_000


def test_the_worked_example_of_the_definition() -> None:
    page = (Path(__file__).parents[2] / "docs" / "semantics.md").read_text(encoding="utf-8")
    found = re.search(r"^```\w*\n(// Robot damaged.*?)^```$", page, re.MULTILINE | re.DOTALL)
    assert found is not None
    tree = loads(found[1])
    assert (tree.root, len(tree.nodes)) == ("damaged", 12)
    assert loads(dumps(tree)) == tree
