"""The simulated mission: what it says, what monitors find in it, and the overhead that is measured on it."""

import csv
import json
import subprocess
import sys
from collections.abc import Iterable, Iterator
from itertools import pairwise, product
from pathlib import Path

import pytest

import rvaft
from papers.fmas2022 import mission as simulated
from papers.fmas2022 import overhead as measuring
from papers.fmas2022.mission import ENTRANCE, Event, Mission, Mode
from papers.fmas2022.overhead_cells import Cell, Spread, cells, growth
from papers.fmas2022.overhead_figure import draw
from papers.fmas2022.overhead_runs import NONE, SETUPS, Run
from papers.fmas2022.overhead_statement import statement
from papers.fmas2022.overhead_tables import COLUMNS, detected_tex, nominal_tex
from papers.fmas2022.places import PRUNED, ROOT
from rvaft import OptionError, Verdict

TREE = rvaft.load(PRUNED)
SIZES = (2, 5, 9)
SEEDS = (1, 2, 3)
DETECTED = {Mode.NOMINAL: set[str](), Mode.FAULT: {"φ", "fault", "φ1", "φ2"}, Mode.ATTACK: {"φ", "attack", "φ3", "φ4"}}


def verdicts(events: Iterable[Event], semantics: str) -> dict[str, str]:
    """The last verdict of the monitor of the tree, of each kind and of each branch."""
    makers = {"φ": rvaft.monitor(TREE, semantics=semantics)}
    makers |= {kind: rvaft.monitor(TREE, semantics=semantics, kind=kind) for kind in ("fault", "attack")}
    makers |= {f"φ{n}": rvaft.monitor(TREE, semantics=semantics, branch=n) for n in (1, 2, 3, 4)}
    for event in events:
        for monitor in makers.values():
            monitor.step(event)
    return {name: monitor.verdict.symbol for name, monitor in makers.items()}


def as_printed(events: list[Event]) -> Iterator[Event]:
    """Of the contaminated waypoint the commands, the first high reading, and the goal that follows the last command."""
    commands = [number for number, event in enumerate(events) if event["topic"] == "/command"]
    move, inspect, leave = commands[-3:]
    assert [events[number]["name"] for number in (move, inspect, leave)] == ["move", "inspect", "move"]
    yield events[move]
    yield events[inspect]
    yield next(event for event in events[inspect:leave] if event.get("value", 0) >= 250)
    yield events[leave]
    yield next(event for event in events[leave:] if event["topic"] == "/move_base/goal")


@pytest.mark.parametrize("mode", Mode)
@pytest.mark.parametrize("waypoints", SIZES)
def test_a_mission_is_told_in_order_and_is_what_its_mode_says(mode: Mode, waypoints: int) -> None:
    missions = [list(Mission(waypoints, mode, seed).events()) for seed in SEEDS]
    assert missions[0] == list(Mission(waypoints, mode, SEEDS[0]).events()) != missions[1]
    for events in missions:
        found = verdicts(events, "scattered")
        assert found == {name: "⊤" if name in DETECTED[mode] else "?" for name in found}
        for semantics in ("strict", "projected"):  # the second message, no part of a match, ends all hope
            early = rvaft.monitor(TREE, semantics=semantics).run(events[:2])
            assert [verdict.symbol for verdict in early] == ["?", "⊥"]
            assert verdicts(as_printed(events), semantics)["φ"] == ("⊥" if mode is Mode.NOMINAL else "⊤")
        assert events[1]["topic"] != "/command"
        assert all(earlier["time"] <= later["time"] for earlier, later in pairwise(events))
        readings = [event for event in events if event["topic"] == "/radiation_sensor_plugin/sensor_0"]
        seconds = [event["header"]["stamp"]["secs"] for event in readings]
        assert {later - one for one, later in pairwise(seconds)} == {1}, "a reading each second"
        inspected = [event for event in events if event.get("name") == "inspect"]
        assert [event["waypoint"] for event in inspected] == list(range(waypoints))
        assert min(event["time"] for event in readings if event["value"] >= 250) >= inspected[-1]["time"]
        moves = [event["waypoint"] for event in events if event.get("name") == "move"]
        goals = [event["goal"] for event in events if event["topic"] == "/move_base/goal"]
        assert moves[:-1] == goals[:-1] == list(range(waypoints)), "the planner gets the goal of the command"
        assert (moves[-1] == goals[-1]) is (mode is not Mode.ATTACK), "unless an attacker alters it"
        assert (moves[-1] == ENTRANCE) is (mode is Mode.NOMINAL)


def test_the_explanation_of_a_detection_names_the_departure() -> None:
    for mode, last in ((Mode.FAULT, "ev6"), (Mode.ATTACK, "ev9")):
        monitor = rvaft.monitor(TREE, semantics="scattered")
        at = [verdict is Verdict.TRUE for verdict in monitor.run(Mission(5, mode).events())].index(True) + 1
        assert monitor.explanation is not None
        assert monitor.explanation.kinds == {rvaft.Kind(mode.value)}
        assert (monitor.explanation.events[last], monitor.explanation.variables["NewWp"]) == ([at], 0)


def test_a_second_mission_in_the_same_log_is_a_false_alarm_so_that_a_monitor_lasts_one_mission() -> None:
    first = list(Mission(3).events())
    later = [{**event, "time": event["time"] + first[-1]["time"]} for event in first]
    assert verdicts(later, "scattered")["φ"] == "?"
    assert verdicts(first + later, "scattered")["φ"] == "⊤"


def test_the_messages_have_the_fields_of_the_published_log() -> None:
    fields = {(event["topic"], event.get("name")): set(event) for event in Mission(2).events()}
    assert fields["/radiation_sensor_plugin/sensor_0", None] == {"pose", "value", "topic", "header", "time", "type"}
    assert fields["/command", "move"] == fields["/command", "inspect"] == {"topic", "name", "waypoint", "time"}
    assert fields["/move_base/goal", None] == {"goal", "target_pose", "topic", "header", "goal_id", "time"}
    assert fields["/move_base/result", None] >= {"topic", "waypoint", "result", "time"}
    assert fields["inspected", None] == {"topic", "location", "time", "data"}


def test_a_mission_can_be_piped_into_a_monitor(capsys: pytest.CaptureFixture[str]) -> None:
    assert simulated.main(["--waypoints", "3", "--mode", "attack"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [json.loads(line) for line in lines] == list(Mission(3, Mode.ATTACK).events())
    with pytest.raises(OptionError, match="2 waypoints or more"):
        Mission(1)
    assert simulated.main(["--waypoints", "1"]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_a_reader_of_a_mission_that_has_enough_is_no_error() -> None:
    command = f"{sys.executable} -m papers.fmas2022.mission --waypoints 200 | head -n 1"
    done = subprocess.run(["/bin/sh", "-c", command], capture_output=True, text=True, check=False, cwd=ROOT)
    assert (done.stdout.count("\n"), done.stderr) == (1, "")


# -- the overhead ----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def quick(tmp_path_factory: pytest.TempPathFactory) -> measuring.Overhead:
    pytest.importorskip("matplotlib", reason="the figure needs rvaft[papers]")
    return measuring.overhead(tmp_path_factory.mktemp("overhead") / "new", quick=True)


def written(quick: measuring.Overhead, name: str) -> Path:
    return next(file for file in quick.files if file.name == name)


def table(quick: measuring.Overhead, name: str) -> list[dict[str, str]]:
    return list(csv.DictReader(written(quick, name).read_text(encoding="utf-8").splitlines()))


@pytest.mark.ci
def test_every_cell_is_measured_and_every_run_is_kept(quick: measuring.Overhead) -> None:
    rows = table(quick, "overhead.csv")
    assert tuple(rows[0]) == COLUMNS
    keys = [(row["mode"], row["waypoints"], row["setup"]) for row in rows]
    assert keys == list(product(Mode, ("2", "4"), SETUPS))
    assert [row["monitors"] for row in rows] == ["0", "1", "2", "4"] * 6
    for row in rows:
        monitored = row["setup"] != NONE
        events = list(Mission(int(row["waypoints"]), Mode(row["mode"])).events())
        assert int(row["events"]) == len(events)
        if row["mode"] == Mode.NOMINAL:
            assert row["verdicts"] == "?" * int(row["monitors"]), "each monitor has read the whole mission"
            assert row["detected"] == "0"
        elif monitored:
            assert row["verdicts"].count("⊤") == (2 if row["setup"] == "branch" else 1)
            last = "/command" if row["mode"] == Mode.FAULT else "/move_base/goal"
            assert events[int(row["detected"]) - 1]["topic"] == last
        if monitored:
            assert row["dearest_on"].split()[0] == events[int(row["dearest_event"]) - 1]["topic"]
            dearest = 1e3 * float(row["dearest_ms_median"])
            assert dearest > float(row["us_per_event_median"]), "an event costs as much as the dearest at most"
        for name in ("made_ms", "cpu_ms", "wall_ms", "ratio", "us_per_event", "dearest_ms"):
            assert float(row[f"{name}_q1"]) <= float(row[f"{name}_median"]) <= float(row[f"{name}_q3"])
        assert float(row["cpu_ms_median"]) > 0
        assert (float(row["ratio_median"]) > 1) is monitored
    kept = [tuple(row.values())[:4] for row in table(quick, "overhead_runs.csv")]
    assert len(kept) == len(set(kept)) == 2 * len(rows)
    assert [setup for *_, setup, _ in kept[::4]] == [*SETUPS[1:2] * 2, *SETUPS[2:3] * 2] * 3, (
        "they take turns at being first"
    )


@pytest.mark.ci
def test_what_is_written_of_it(quick: measuring.Overhead) -> None:
    for name, rows, columns in (("overhead", 1 + len(quick.cells) // 3, 6), ("overhead_detected", 1 + 2 * 2 * 3, 7)):
        text = written(quick, f"{name}.tex").read_text(encoding="utf-8")
        assert (text.isascii(), r"\hline" in text) == (True, False)
        lines = [line for line in text.splitlines() if line.endswith(r"\\") and "multicolumn" not in line]
        assert [line.count("&") for line in lines] == [columns] * rows
    assert written(quick, "overhead.md").read_text(encoding="utf-8") == quick.statement
    for said in ("CPU time", "only the shape of the results is comparable", "each reads all events"):
        assert said in quick.statement
    assert quick.statement.count(": every setup detects it at every size.") == 2
    assert quick.statement.count(" ms at 2 and 4 waypoints; ") == 3 * 3, "the dearest event of each mode and setup"


@pytest.mark.ci
def test_the_figure_is_one_column_wide_and_not_blank(quick: measuring.Overhead) -> None:
    from matplotlib.image import imread

    pixels = imread(written(quick, "overhead.png"))
    assert abs(pixels.shape[1] - 8.5 / 2.54 * 300) < 2
    dark = pixels[..., :3].mean(axis=2) < 0.9
    height = dark.shape[0] // 2
    assert min(dark[:height].sum(), dark[height:].sum()) > 5_000
    assert written(quick, "overhead.pdf").read_bytes().startswith(b"%PDF-")


@pytest.mark.parametrize("matplotlib", [True, False])
def test_what_cannot_be_done_is_one_line_and_nothing_is_measured(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, matplotlib: bool
) -> None:
    (tmp_path / "taken").touch()
    error = f"{tmp_path / 'taken'}"
    if not matplotlib:
        monkeypatch.setitem(sys.modules, "matplotlib", None)
        error = "overhead: error: Matplotlib is not installed: pip install '.[papers]' in a checkout\n"
    assert measuring.main([str(tmp_path / "taken"), "--quick"]) == 2
    said = capsys.readouterr()
    assert (said.out, said.err.count("\n"), error in said.err) == ("", 1, True)
    assert [file.name for file in tmp_path.iterdir()] == ["taken"]


# -- numbers from runs with known times ------------------------------------------------------------------------------


def invented(*, stopped: bool = False) -> tuple[Cell, ...]:
    """Missions of 100 events a waypoint, 1 µs each; a monitor adds 2 µs to each and 3 ms once, a
    bit more each repetition.
    """
    made = []
    for repetition, waypoints, (monitors, setup) in product(
        range(1, 6), (5, 10, 20), zip((0, 1, 2, 4), SETUPS, strict=True)
    ):
        events = 100 * waypoints
        base = 1e-6 * events + 1e-3 * repetition
        cpu = base + monitors * (2e-6 * events + 3e-3) + (1e-5 * repetition if monitors else 0)
        run = Run(
            mode=Mode.NOMINAL,
            waypoints=waypoints,
            setup=setup,
            repetition=repetition,
            monitors=monitors,
            events=events,
            mission=90.0 * waypoints,
            made=1e-4,
            cpu=cpu,
            wall=cpu,
            verdicts="⊥" if stopped and monitors == 1 else "?" * monitors,
            dearest=1e-3 * waypoints if monitors else 0.0,
            dearest_event=1,
            dearest_on="/command move",
            detected=0,
        )
        made.append(run)
    return cells(made)


def test_what_is_added_is_compared_within_a_repetition() -> None:
    cell = next(cell for cell in invented() if (cell.waypoints, cell.setup) == (10, "tree"))
    assert cell.extra == pytest.approx(Spread(5.02e-3, 5.03e-3, 5.04e-3))
    assert cell.per_event.median == pytest.approx(5.03)
    assert cell.share == pytest.approx(5.03e-3 / 900)


def test_growth_finds_what_comes_once_and_what_each_event_adds() -> None:
    line = growth([cell for cell in invented() if cell.setup == "branch"])
    assert line.each == pytest.approx(8e-6)
    assert line.once == pytest.approx(12.03e-3)


@pytest.mark.ci
def test_equal_numbers_are_equal_bytes(quick: measuring.Overhead, tmp_path: Path) -> None:
    draw(quick.cells, tmp_path)
    for form in ("pdf", "png"):
        assert (tmp_path / f"overhead.{form}").read_bytes() == written(quick, f"overhead.{form}").read_bytes()
    assert b"CreationDate" not in (tmp_path / "overhead.pdf").read_bytes()
    for name, tex in (("overhead", nominal_tex), ("overhead_detected", detected_tex)):
        assert tex(quick.cells) == written(quick, f"{name}.tex").read_text(encoding="utf-8")


def test_what_stopped_early_and_what_the_dearest_event_costs_is_told() -> None:
    assert "In 3 of 12 rows a monitor has its final verdict before the end" in statement(invented(stopped=True))
    dearest = "The dearest event takes 5.00, 10.00 and 20.00 ms at 5, 10 and 20 waypoints"
    assert statement(invented()).count(dearest) == 3
