"""The table at the end of `rvaft monitor` where there are many monitors."""

from pathlib import Path

import pytest

from tests.cli.runs import run


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where the logs are, so that their names are short."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def ends(folder: Path, branches: int, *logs: str) -> list[str]:
    """The last lines: the headings, and a row for each log."""
    tree = folder / "tree.rvaft"
    tree.write_text(f"top or {' '.join(f'a{n}' for n in range(1, branches + 1))};")
    for number, words in enumerate(logs):
        (folder / f"{number}.log").write_text("".join(f'{{"event": "{word}"}}\n' for word in words.split()))
    lines = run("monitor", tree, "*.log", "--per", "branch", "--semantics", "scattered").stdout.splitlines()
    return lines[-len(logs) - 1 :]


def test_of_many_monitors_those_of_a_detection_are_listed(folder: Path) -> None:
    lines = ends(folder, 300, "noise a7 a300", "noise", " ".join(f"a{n}" for n in range(100, 110)))
    assert max(map(len, lines)) <= 80
    head, *rows = (line.split() for line in lines)
    assert head == ["TRACE", "EVENTS", "VERDICT", "EVENT", "BRANCH", "KINDS", "DETECTED"]
    assert [row[1:] for row in rows] == [
        ["3", "true", "2", "7", "-", "φ7", "2,", "φ300", "3"],
        ["1", "unknown", "-", "-", "-", "-"],
        ["10", "true", "1", "100", "-", "φ100", "1,", "φ101", "2,", "φ102", "3", "and", "7", "more"],
    ]


@pytest.mark.parametrize(("branches", "columns"), [(7, 8), (8, 2)])
def test_few_monitors_have_a_column_each(folder: Path, branches: int, columns: int) -> None:
    head = ends(folder, branches, "a1", "a2")[0].split()
    assert len(head) == len(["TRACE", "EVENTS", "BRANCH", "KINDS"]) + columns + (branches > 7)
    assert ("φ7" in head) == (branches == 7)
