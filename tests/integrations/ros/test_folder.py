"""Where the files go: all or none, and nothing of anybody else's is overwritten."""

import os
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest

from rvaft.support.files import place
from tests.cli.runs import TREES, failed, run

ROS = TREES / "remote_inspection" / "ros.rvaft"
FILES: Mapping[str, str | None] = {"a": "1\n", "b": "é\n", "c": "3\n"}
MINE = {"b": "mine\n", "other": "x"}
LESS = {"a": "1\n", "c": "3\n"}
GONE = {**FILES, "b": None, "z": None}


def content(folder: Path) -> dict[str, str]:
    return {path.name: path.read_text(encoding="utf-8") for path in folder.iterdir()}


@pytest.mark.parametrize(
    ("before", "files", "after", "refused"),
    [
        ({}, FILES, FILES, None),
        (FILES, FILES, FILES, None),
        (MINE, FILES, {**FILES, "other": "x"}, "another text; --force replaces it"),
        (FILES, GONE, LESS, "out of date"),
        (LESS, GONE, LESS, None),
    ],
)
def test_what_is_there_with_another_text_is_replaced_or_removed_only_if_forced(
    before: Mapping[str, str],
    files: Mapping[str, str | None],
    after: Mapping[str, str],
    refused: str | None,
    tmp_path: Path,
) -> None:
    folder = tmp_path / "new"
    place(folder, before)
    for path in folder.iterdir():
        path.chmod(0o640)
    if refused is not None:
        with pytest.raises(FileExistsError, match=refused) as caught:
            place(folder, files)
        assert caught.value.filename == str(folder / "b")
        assert content(folder) == before
    place(folder, files, force=refused is not None)
    assert content(folder) == after
    assert all((folder / name).stat().st_mode & 0o777 == 0o640 for name in {*before} & {*after})


def test_when_one_cannot_be_written_or_put_in_place_all_is_as_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All texts are written, then what is there is renamed and what is new takes its place: each of
    these steps fails once.
    """
    before = {"a": "old\n", "gone": "old\n", "other": "x"}
    place(tmp_path / "old", before)
    left = 0

    def limited(step: Callable[[Path, object], object]) -> Callable[[Path, object], object]:
        def taken(path: Path, given: object) -> object:
            nonlocal left
            left -= 1
            if left == 0:
                raise OSError(28, "No space left on device")
            return step(path, given)

        return taken

    for name in ("write_bytes", "rename"):
        monkeypatch.setattr(Path, name, limited(getattr(Path, name)))
    for folder, steps in ((tmp_path / "old", "a b c a a b c gone"), (tmp_path / "new", "a b c a b c")):
        for number, step in enumerate(steps.split(), 1):
            left = number
            with pytest.raises(OSError, match="cannot write: No space left") as caught:
                place(folder, {**FILES, "gone": None}, force=True)
            assert caught.value.filename == str(folder / step)
            assert content(tmp_path / "old") == before
            assert not (tmp_path / "new").exists()


def test_a_folder_that_cannot_be(tmp_path: Path) -> None:
    for name in ("file", "no\nline"):
        (tmp_path / name).write_text("x")
    for folder, part in (
        (tmp_path / "file", "a file has this name"),
        (tmp_path / "file" / "below", "Not a directory"),
        (tmp_path / "none" / "below", "create its parent folder first"),
        (Path("/proc/nowhere"), "cannot make the folder"),
        (tmp_path / "no\nline", r"no\nline"),
    ):
        failed(run("rosmonitoring", ROS, "-o", folder), part)
    (tmp_path / "taken" / "monitors.yaml").mkdir(parents=True)
    failed(run("rosmonitoring", ROS, "-o", tmp_path / "taken", "--force"), "monitors.yaml", "not a regular file")
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


def test_a_configuration_of_somebody_else_says_nothing_of_files(tmp_path: Path) -> None:
    written_here = "# Written by rvaft rosmonitoring: change the tree and write it again.\n"
    assert run("rosmonitoring", ROS, "-o", tmp_path, "--per", "branch").exit_code == 0
    for text in (
        "monitors:\n- monitor: {id: damaged_branch_1}\n",
        f"{written_here}{{",
        f"{written_here}monitors: [{{monitor: {{id: 1}}}}, 7]\n",
        "\xff",
    ):
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
