"""`rvaft new`, and what first commands lead to."""

from pathlib import Path

import pytest

from tests.cli.runs import PRUNED, failed, run, written


def test_the_tree_to_start_from_is_sound_and_detects(tmp_path: Path) -> None:
    tree = tmp_path / "theft.rvaft"
    assert run("new", tree).exit_code == 0
    assert run("new").stdout == tree.read_text()
    assert run("check", "--strict", tree).output == ""
    log = written(tmp_path / "log.jsonl", run("traces", tree).stdout)
    assert run("monitor", tree, log).exit_code == 1
    assert '"Data stolen"' in run("show", tree).stdout


def test_no_file_is_overwritten(tmp_path: Path) -> None:
    tree = written(tmp_path / "mine.rvaft", "top or a b;")
    failed(run("new", tree), "mine.rvaft exists: name another file")
    assert tree.read_text() == "top or a b;"


@pytest.mark.parametrize(
    ("product", "leads_to"),
    [
        ("splunk", "sigma convert -t splunk"),
        ("Elastic", "--to eql"),
        ("sentinel", "--to kql"),
        ("postgres", "--to sql-postgres"),
        ("monpoly", "--to mfotl"),
        ("ros", "rvaft serve"),
    ],
)
def test_a_product_leads_to_its_language(product: str, leads_to: str) -> None:
    failed(run("emit", PRUNED, "--to", product), f"unknown backend {product}", leads_to)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("log.jsonl", '{"event": "a"}\n'),
        ("auth.log", "Nov 29 host sshd\n"),
        ("events", ' \n{"event": "a"}\n'),
        ("a.csv", "a,b\n"),
    ],
)
def test_a_log_in_place_of_the_tree_is_said(tmp_path: Path, name: str, text: str) -> None:
    log = written(tmp_path / name, text)
    failed(run("monitor", log), "seems to be a log, and the tree comes first: rvaft monitor TREE", "rvaft infer LOG")
    failed(run("report", log, PRUNED), f"the tree comes first: rvaft report {PRUNED} {log}")


def test_a_tree_in_place_of_a_command_is_said() -> None:
    failed(run(PRUNED), f"{PRUNED} is a tree: name a command first, as in rvaft show {PRUNED}")


def test_an_unread_format_lists_the_readable_ones(tmp_path: Path) -> None:
    log = written(tmp_path / "flight.xlsx", "")
    failed(run("monitor", PRUNED, log), "does not read spreadsheets", "csv", "jsonl", "parquet", "zeek")


def test_the_help_has_its_options_by_purpose() -> None:
    text = run("monitor", "--help").stdout
    headings = ["What is detected:", "The log:", "Detections:", "Live logs:", "Output:", "Reactions:", "Other options:"]
    places = [text.index(f"\n{heading}") for heading in headings]
    assert places == sorted(places)
    assert text.count("--key FIELD") == text.count("  --input FORMAT") == 1
    assert "Examples:\n    rvaft monitor" in text


def test_colours_are_for_terminals_that_take_them(monkeypatch: pytest.MonkeyPatch) -> None:
    from rvaft.support.terminal import takes_colour

    class Terminal:
        def isatty(self) -> bool:
            return True

    for name in ("NO_COLOR", "TERM"):
        monkeypatch.delenv(name, raising=False)
    assert takes_colour(Terminal())  # type: ignore[arg-type]
    monkeypatch.setenv("NO_COLOR", "1")
    assert not takes_colour(Terminal())  # type: ignore[arg-type]
    assert not takes_colour(None)
    assert "\x1b" not in run("check", "/no/such").output
