"""What the commands answer: their status, what they print, and what they say beside it; an error
leaves nothing behind.
"""

import re
from pathlib import Path
from typing import Any

import pytest

from tests.cli.runs import lines, run, words
from tests.tables import rows


def content(text: str | list[Any]) -> str:
    """The text of a file in the table, which may be a list of events."""
    return text if isinstance(text, str) else lines(text)


def has(text: str, parts: str | list[str]) -> bool:
    """Whether a text is this one, or has these parts one after the other."""
    if isinstance(parts, str):
        return text == parts
    return re.search(".*".join(map(re.escape, parts)), text, re.DOTALL) is not None


@pytest.mark.parametrize("row", rows(__file__, "answers.txt"), ids=lambda row: row[0])
def test_answer(row: list[Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    command, files, status, out, errors = row
    for name in files.keys() - {"-"}:
        Path(name).parent.mkdir(exist_ok=True)
        Path(name).write_text(content(files[name]), encoding="utf-8")
    before = sorted(tmp_path.rglob("*"))
    result = run(*words(command), data=content(files.get("-", "")))
    assert result.exit_code == status, result.output
    assert has(result.stdout, out), result.stdout
    assert has(result.stderr, errors), result.stderr
    assert status < 2 or sorted(tmp_path.rglob("*")) == before


def test_rates_of_a_log_and_pruned_nodes_are_statements_to_append(tmp_path: Path) -> None:
    tree, log = tmp_path / "t.rvaft", tmp_path / "l"
    tree.write_text("time time as s; toplevel t; t or a b; a; b;\n", encoding="utf-8")
    events = [{"event": name, "time": time} for time, name in enumerate(["x", *"aaaaaaaaaa", "b"])]
    log.write_text(lines(events), encoding="utf-8")
    for command, time in (
        (["rates", tree, log, "--format", "tree"], ()),
        (["risk", tree, "--prune-below", "0.05"], ["--time", "1s"]),
    ):
        result = run(*command, *time)
        assert result.exit_code == 0, result.output
        with tree.open("a", encoding="utf-8") as stream:
            stream.write(result.stdout)
    assert "prune b;" in tree.read_text(encoding="utf-8")
    assert run("cut-sets", tree, "--format", "csv").stdout == "order,probability,leaves,sequence\n1,,a,\n"
