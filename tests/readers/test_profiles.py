"""Profiles of products: the shipped ones on logs in the documented formats, and those of a user."""

import io
import json
from pathlib import Path
from typing import Any

import pytest

import rvaft
from rvaft.errors import OptionError
from rvaft.readers.log import SHIPPED
from rvaft.readers.profile import profile
from rvaft.readers.registry import UnknownFormat, profile_reader
from tests.cli.runs import run
from tests.tables import rows

SAMPLES = rows(__file__, "profiles.txt")
WRONG = rows(__file__, "wrong_profiles.txt")


@pytest.mark.parametrize(("name", "log", "events", "reports"), [(*row[:3], row[3:]) for row in SAMPLES])
def test_events_of_a_product(name: str, log: str, events: list[dict[str, Any]], reports: list[str]) -> None:
    found, warnings = list[Any](), list[str]()
    reading = rvaft.read_log(io.BytesIO(log.encode()), profile=name, year=2026, warn=warnings.append)
    try:
        found.extend(reading)
    except rvaft.TraceError as error:
        warnings.append(str(error))
    assert found == events
    assert warnings == reports
    time = profile(name).time
    assert time is not None
    assert all(time.read(event) is not None for event in found)


def test_every_shipped_profile_has_a_sample() -> None:
    assert {row[0] for row in SAMPLES} == {*SHIPPED}


@pytest.mark.parametrize("row", SAMPLES, ids=[row[0] for row in SAMPLES])
def test_a_tree_is_inferred_that_detects(row: list[Any], tmp_path: Path) -> None:
    log, tree = tmp_path / "some.log", tmp_path / "some.rvaft"
    log.write_text(row[1])
    options = ["--profile", row[0], "--year", "2026"]
    fields = run("fields", log, *options, "--format", "json")
    if row[0] == "zeek":  # with a line that is no row
        assert fields.exit_code == 2
        log.write_text(row[1].replace("\n1\t2\n", "\n"))
        fields = run("fields", log, *options, "--format", "json")
    assert fields.exit_code == 0
    time = profile(row[0]).time
    assert time is not None
    assert json.loads(fields.stdout)["times"][0]["field"] == [*time.field]
    assert run("infer", log, *options, "-o", tree).exit_code == 0
    found = run("monitor", tree, log, *options, "--semantics", "scattered")
    assert found.exit_code == 1
    assert found.stdout.startswith("event 1")
    assert ": true\n" in found.stdout


@pytest.mark.parametrize(("text", "reason"), WRONG)
def test_a_wrong_profile_is_refused(text: str, reason: str, tmp_path: Path) -> None:
    file = tmp_path / "own.toml"
    file.write_text(text)
    with pytest.raises((OptionError, UnknownFormat)) as caught:
        profile_reader(str(file))
    assert str(caught.value).removeprefix(f"{file}: ") == reason


def test_the_options_of_a_profile() -> None:
    for options in (["--input", "syslog"], ["--records", "a"], ["--pattern", "(?P<a>.)"]):
        refused = run("fields", "README.md", "--profile", "sshd", *options)
        assert (refused.exit_code, "omit --input" in refused.stderr) == (2, True)
    unknown = run("fields", "README.md", "--profile", "ssh")
    assert (unknown.exit_code, "unknown profile ssh; known: auditd" in unknown.stderr) == (2, True)
    assert run("fields", "README.md", "--profile", "absent.toml").exit_code == 2
    assert run("fields", "README.md", "--profile", "sshd").exit_code == 2, "no line is an event"


def test_the_year_of_a_log() -> None:
    log = b"Feb 29 08:00:00 web1 sshd[1]: Server listening on :: port 22.\n"
    read = {year: [*rvaft.read_log(io.BytesIO(log), "syslog", year=year, warn=str)] for year in (2024, 2028)}
    assert [read[year][0]["time"] for year in read] == ["2024-02-29T08:00:00", "2028-02-29T08:00:00"]
    with pytest.raises(rvaft.TraceError):
        list(rvaft.read_log(io.BytesIO(log), "syslog", year=2026))
