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
