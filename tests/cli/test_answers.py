"""What the commands answer: their status, what they print, and what they say beside it."""

from pathlib import Path
from typing import Any

import pytest

from tests.cli.runs import lines, run, words, written
from tests.tables import rows


def content(text: str | list[Any]) -> str:
    """The text of a file in the table, which may be a list of events."""
    return text if isinstance(text, str) else lines(text)


@pytest.mark.parametrize("row", rows(__file__, "answers.txt"), ids=lambda row: row[0])
def test_answer(row: list[Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    command, files, status, out, errors = row
    for name, text in files.items():
        if name != "-":
            written(tmp_path / name, content(text))
    result = run(*words(command), data=content(files.get("-", "")))
    assert (result.exit_code, result.stderr) == (status, errors)
    if isinstance(out, str):
        assert result.stdout == out
        return
    rest = result.stdout
    for part in out:
        _, found, rest = rest.partition(part)
        assert found, (part, result.stdout)
