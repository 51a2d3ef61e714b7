"""Where the files go: all or none, and nothing of anybody else's is overwritten."""

import os
from collections.abc import Mapping
from pathlib import Path

import pytest

from rvaft.support.files import place
from tests.cli.runs import TREES, failed, run

ROS = TREES / "remote_inspection" / "ros.rvaft"
FILES: Mapping[str, str | None] = {"a": "1\n", "b": "é\n", "c": "3\n"}


def content(folder: Path) -> dict[str, str]:
    return {path.name: path.read_text(encoding="utf-8") for path in folder.iterdir()}


def test_they_are_written_and_written_again(tmp_path: Path) -> None:
    for _ in range(2):
        place(tmp_path / "new", FILES)
        assert content(tmp_path / "new") == FILES
    place(tmp_path, FILES)
    assert {name: (tmp_path / name).read_text(encoding="utf-8") for name in FILES} == FILES


def test_what_is_there_with_another_text_stays_unless_forced(tmp_path: Path) -> None:
    before = {"b": "mine\n", "other": "x"}
    place(tmp_path, before)
    (tmp_path / "b").chmod(0o640)
    with pytest.raises(FileExistsError, match="another text; --force replaces it") as caught:
        place(tmp_path, FILES)
    assert caught.value.filename == str(tmp_path / "b")
    assert content(tmp_path) == before
    place(tmp_path, FILES, force=True)
    assert content(tmp_path) == {**FILES, "other": "x"}
    assert (tmp_path / "b").stat().st_mode & 0o777 == 0o640


def test_what_must_not_be_there_is_removed_only_if_forced(tmp_path: Path) -> None:
    place(tmp_path, FILES)
    now = {**FILES, "b": None, "z": None}
    with pytest.raises(FileExistsError, match="out of date"):
        place(tmp_path, now)
    assert content(tmp_path) == FILES
    place(tmp_path, now, force=True)
    place(tmp_path, now)
    assert content(tmp_path) == {"a": "1\n", "c": "3\n"}


@pytest.mark.parametrize("fails_at", range(1, 6))
def test_when_one_cannot_be_put_in_place_all_is_as_it_was(
    fails_at: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Five renames: `a` and `gone` away, `a`, `b` and `c` there."""
    before = {"a": "old\n", "gone": "old\n", "other": "x"}
    place(tmp_path, before)
    rename, calls = Path.rename, 0

    def failing(path: Path, target: Path) -> Path:
        nonlocal calls
        calls += 1
        if calls == fails_at:
            raise OSError(28, "No space left on device")
        return rename(path, target)

    monkeypatch.setattr(Path, "rename", failing)
    with pytest.raises(OSError, match="cannot write: No space left"):
        place(tmp_path, {**FILES, "gone": None}, force=True)
    assert content(tmp_path) == before
    calls = fails_at - 1  # so that the next one fails
    with pytest.raises(OSError, match="cannot write: No space left"):
        place(tmp_path / "new", FILES)
    assert not (tmp_path / "new").exists()


def test_when_one_cannot_be_written_all_is_as_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write = Path.write_bytes

    def failing(path: Path, data: bytes) -> int:
        if path.name == "c":
            raise OSError(28, "No space left on device")
        return write(path, data)

    monkeypatch.setattr(Path, "write_bytes", failing)
    with pytest.raises(OSError, match="cannot write: No space left") as caught:
        place(tmp_path / "new", FILES)
    assert caught.value.filename == str(tmp_path / "new" / "c")
    assert not (tmp_path / "new").exists()


def test_a_folder_that_cannot_be(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    for folder, part in (
        (tmp_path / "file", "a file of this name is there"),
        (tmp_path / "file" / "below", "Not a directory"),
        (tmp_path / "none" / "below", "make the one above it first"),
        (Path("/proc/nowhere"), "cannot make the folder"),
        (tmp_path / "no\nline", r"no\nline"),
    ):
        if "\n" in str(folder):
            folder.write_text("x")
        failed(run("rosmonitoring", ROS, "-o", folder), part)
    (tmp_path / "taken" / "monitors.yaml").mkdir(parents=True)
    failed(
        run("rosmonitoring", ROS, "-o", tmp_path / "taken", "--force"), "monitors.yaml", "something else than a file"
    )
    assert [path.name for path in (tmp_path / "taken").iterdir()] == ["monitors.yaml"]


def test_a_folder_that_nobody_may_write_to(tmp_path: Path) -> None:
    (folder := tmp_path / "closed").mkdir()
    folder.chmod(0o500)
    if os.access(folder, os.W_OK):
        folder = Path("/proc/self/fdinfo")  # a folder where even root makes no files
    failed(run("rosmonitoring", ROS, "-o", folder), "cannot write into the folder")


def test_the_specifications_of_an_earlier_run_go_with_its_configuration(tmp_path: Path) -> None:
    assert run("rosmonitoring", ROS, "-o", tmp_path, "--per", "branch").exit_code == 0
    (tmp_path / "mine.rml").write_text((tmp_path / "damaged_branch_1.rml").read_text())
    (tmp_path / "damaged_branch_2.rml").write_text("Main = mine;\n")
    (tmp_path / "damaged_branch_3.pl").unlink()
    (tmp_path / "damaged_branch_3.pl").symlink_to("damaged_branch_1.pl")
    (tmp_path / "damaged_branch_4.txt").write_text("mine\n")
    with (tmp_path / "monitors.yaml").open("a") as stream:
        stream.write("path: /opt/robot\n")
    before = content(tmp_path)
    failed(run("rosmonitoring", ROS, "-o", tmp_path), "--force")
    assert content(tmp_path) == before
    assert run("rosmonitoring", ROS, "-o", tmp_path, "--force").exit_code == 0
    made = {"damaged.pl", "damaged.rml", "monitors.yaml", "run.txt"}
    kept = {"mine.rml", "damaged_branch_2.rml", "damaged_branch_3.pl", "damaged_branch_4.txt"}
    assert {path.name for path in tmp_path.iterdir()} == made | kept


@pytest.mark.parametrize(
    "text",
    [
        "monitors:\n- monitor: {id: damaged_branch_1}\n",  # not written here
        "# Written by rvaft rosmonitoring: change the tree and write it again.\n{",
        "# Written by rvaft rosmonitoring: change the tree and write it again.\nmonitors: [{monitor: {id: 1}}, 7]\n",
        "\xff",
    ],
)
def test_a_configuration_of_somebody_else_says_nothing_of_files(text: str, tmp_path: Path) -> None:
    assert run("rosmonitoring", ROS, "-o", tmp_path, "--per", "branch").exit_code == 0
    (tmp_path / "monitors.yaml").write_bytes(text.encode("latin-1"))
    assert run("rosmonitoring", ROS, "-o", tmp_path, "--force").exit_code == 0
    assert (tmp_path / "damaged_branch_1.rml").exists()


def test_edits_of_a_configuration_survive(tmp_path: Path) -> None:
    assert run("rosmonitoring", ROS, "-o", tmp_path).exit_code == 0
    before = content(tmp_path)
    assert run("rosmonitoring", ROS, "-o", tmp_path).exit_code == 0
    edited = before["monitors.yaml"] + "path: /opt/robot\n"
    (tmp_path / "monitors.yaml").write_text(edited)
    failed(run("rosmonitoring", ROS, "-o", tmp_path, "--per", "kind"), "monitors.yaml", "--force")
    assert content(tmp_path) == {**before, "monitors.yaml": edited}
    assert run("rosmonitoring", ROS, "-o", tmp_path, "--force").exit_code == 0
    assert content(tmp_path) == before
