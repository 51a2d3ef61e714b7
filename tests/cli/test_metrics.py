"""`--metrics FILE`: counts for Prometheus."""

import re
from pathlib import Path

from tests.cli.runs import SAND, failed, lines, run, written

EVENTS = [{"event": name, "who": who} for who in "xy" for name in "abcabca"]


def counts(file: Path) -> dict[str, float]:
    """The values of a file, by metric and tree."""
    found = re.findall(r'^(\w+)\{tree="([^"]*)"\} (\S+)$', file.read_text(), re.MULTILINE)
    return {f"{name} {Path(tree).stem}": float(value) for name, tree, value in found}


def test_events_and_detections_are_counted(tmp_path: Path) -> None:
    log, file = written(tmp_path / "log.jsonl", lines(EVENTS)), tmp_path / "rvaft.prom"
    for options, detections, traces in (([], 1, 1), (["--repeat"], 4, 1), (["--key", "who", "--repeat"], 4, 2)):
        assert run("monitor", SAND, log, "--semantics", "scattered", "--metrics", file, *options).exit_code == 1
        found = counts(file)
        assert found.pop("rvaft_last_detection_timestamp_seconds sand") > 1_000_000_000
        assert found == {
            "rvaft_events_total sand": len(EVENTS),
            "rvaft_detections_total sand": detections,
            "rvaft_traces sand": traces,
            "rvaft_running sand": 0,
        }
    assert file.read_text().startswith("# HELP rvaft_events_total Events read.\n# TYPE rvaft_events_total counter\n")


def test_each_tree_has_its_counts(tmp_path: Path) -> None:
    log, file = written(tmp_path / "log.jsonl", lines(EVENTS)), tmp_path / "rvaft.prom"
    other = written(tmp_path / "other.rvaft", "semantics scattered; top or z q;")
    assert run("monitor", SAND, other, "--semantics", "scattered", "--metrics", file, "--", log).exit_code == 1
    found = counts(file)
    assert (found["rvaft_detections_total sand"], found["rvaft_detections_total other"]) == (1, 0)
    assert found["rvaft_events_total other"] == len(EVENTS)


def test_what_counts_nothing_is_refused(tmp_path: Path) -> None:
    log = written(tmp_path / "log.jsonl", lines(EVENTS))
    for options, why in (
        (["--jobs", "2"], "one process"),
        (["--native"], "--native does not take --metrics"),
        (["--engine", "duckdb"], ""),
    ):
        failed(run("monitor", SAND, log, "--metrics", tmp_path / "m.prom", *options), why)
    failed(run("monitor", SAND, log, "--metrics", tmp_path), "a folder")
