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
from papers.fmas2022.overhead_runs import NONE, SETUPS, Run, runs
from papers.fmas2022.overhead_statement import statement
from papers.fmas2022.overhead_tables import COLUMNS, detected_tex, nominal_tex
from papers.fmas2022.places import PRUNED, ROOT
from rvaft import Verdict
from rvaft.errors import OptionError
from rvaft.model.tree import RVAFT

SIZES = (2, 5, 9)
SEEDS = range(1, 4)


@pytest.fixture(scope="module")
def tree() -> RVAFT:
    return rvaft.load(PRUNED)


def verdicts(tree: RVAFT, events: Iterable[Event], semantics: str) -> dict[str, str]:
    """The last verdict of the monitor of the tree, of each kind and of each branch."""
    makers = {"φ": rvaft.monitor(tree, semantics=semantics)}
    makers |= {kind: rvaft.monitor(tree, semantics=semantics, kind=kind) for kind in ("fault", "attack")}
    makers |= {f"φ{n}": rvaft.monitor(tree, semantics=semantics, branch=n) for n in (1, 2, 3, 4)}
    for event in events:
        for monitor in makers.values():
            monitor.step(event)
    return {name: monitor.verdict.symbol for name, monitor in makers.items()}


DETECTED = {Mode.NOMINAL: set[str](), Mode.FAULT: {"φ", "fault", "φ1", "φ2"}, Mode.ATTACK: {"φ", "attack", "φ3", "φ4"}}

# -- what is detected ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", Mode)
@pytest.mark.parametrize("waypoints", SIZES)
def test_each_mode_is_what_a_scattered_monitor_says_it_is(tree: RVAFT, mode: Mode, waypoints: int) -> None:
    for seed in SEEDS:
        found = verdicts(tree, Mission(waypoints, mode, seed).events(), "scattered")
        assert found == {name: "⊤" if name in DETECTED[mode] else "?" for name in found}, seed


@pytest.mark.parametrize("mode", Mode)
@pytest.mark.parametrize("semantics", ["strict", "projected"])
def test_the_other_semantics_give_up_at_the_second_message_for_it_is_no_part_of_a_match(
    tree: RVAFT, mode: Mode, semantics: str
) -> None:
    events = list(Mission(5, mode).events())
    found = list(rvaft.monitor(tree, semantics=semantics).run(events))
    assert [verdict.symbol for verdict in found[:2]] == ["?", "⊥"]
    assert events[1]["topic"] != "/command"


@pytest.mark.parametrize("semantics", ["strict", "projected"])
@pytest.mark.parametrize(("mode", "expected"), [(Mode.NOMINAL, "⊥"), (Mode.FAULT, "⊤"), (Mode.ATTACK, "⊤")])
def test_the_events_that_the_tables_print_have_the_verdicts_that_the_tables_print(
    tree: RVAFT, mode: Mode, expected: str, semantics: str
) -> None:
    for seed in SEEDS:
        excerpt = list(as_printed(list(Mission(5, mode, seed).events())))
        assert verdicts(tree, excerpt, semantics)["φ"] == expected


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


def test_the_explanation_of_a_detection_names_the_departure(tree: RVAFT) -> None:
    for mode, last in ((Mode.FAULT, "ev6"), (Mode.ATTACK, "ev9")):
        events = list(Mission(5, mode).events())
        monitor = rvaft.monitor(tree, semantics="scattered")
        at = [verdict is Verdict.TRUE for verdict in monitor.run(events)].index(True) + 1
        assert monitor.explanation is not None
        assert monitor.explanation.kinds == {rvaft.Kind(mode.value)}
        assert monitor.explanation.matched[last] == at
        assert monitor.explanation.variables["NewWp"] == 0


def test_a_second_mission_in_the_same_log_is_a_false_alarm_so_that_a_monitor_lasts_one_mission(tree: RVAFT) -> None:
    first = list(Mission(3).events())
    later = [{**event, "time": event["time"] + first[-1]["time"]} for event in Mission(3).events()]
    assert verdicts(tree, later, "scattered")["φ"] == "?"
    assert verdicts(tree, first + later, "scattered")["φ"] == "⊤"


# -- what is said ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", Mode)
@pytest.mark.parametrize("waypoints", SIZES)
def test_a_mission_is_told_in_order_with_a_reading_each_second(mode: Mode, waypoints: int) -> None:
    missions = [list(Mission(waypoints, mode, seed).events()) for seed in SEEDS]
    assert missions[0] == list(Mission(waypoints, mode, SEEDS[0]).events()) != missions[1]
    for events in missions:
        assert all(earlier["time"] <= later["time"] for earlier, later in pairwise(events))
        readings = [event for event in events if event["topic"] == "/radiation_sensor_plugin/sensor_0"]
        seconds = [event["header"]["stamp"]["secs"] for event in readings]
        assert {later - one for one, later in pairwise(seconds)} == {1}
        inspected = [event for event in events if event.get("name") == "inspect"]
        assert [event["waypoint"] for event in inspected] == list(range(waypoints))
        assert min(event["time"] for event in readings if event["value"] >= 250) >= inspected[-1]["time"]
        json.dumps(events)


def test_the_planner_gets_the_goal_of_the_command_unless_an_attacker_alters_it() -> None:
    for mode in Mode:
        for seed in SEEDS:
            events = list(Mission(2, mode, seed).events())
            moves = [event["waypoint"] for event in events if event.get("name") == "move"]
            goals = [event["goal"] for event in events if event["topic"] == "/move_base/goal"]
            assert moves[:-1] == goals[:-1] == [0, 1]
            assert (moves[-1] == goals[-1]) is (mode is not Mode.ATTACK)
            assert (moves[-1] == ENTRANCE) is (mode is Mode.NOMINAL)


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
    with written(quick, name).open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


def test_every_cell_is_measured_and_every_run_is_kept(quick: measuring.Overhead) -> None:
    rows = table(quick, "overhead.csv")
    assert tuple(rows[0]) == COLUMNS
    cells_ = [(row["mode"], row["waypoints"], row["setup"]) for row in rows]
    assert cells_ == [(mode, size, one) for mode in Mode for size in ("2", "4") for one in SETUPS]
    assert [row["monitors"] for row in rows] == ["0", "1", "2", "4"] * 6
    for row in rows:
        monitored, mission = row["setup"] != NONE, Mission(int(row["waypoints"]), Mode(row["mode"]))
        events = list(mission.events())
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
        assert int(row["events"]) == len(events)
    kept = [
        (row["mode"], row["waypoints"], row["setup"], row["repetition"]) for row in table(quick, "overhead_runs.csv")
    ]
    assert len(kept) == len(set(kept)) == 2 * len(rows)


def test_the_tables_have_a_row_for_each_cell(quick: measuring.Overhead) -> None:
    rows = {}
    for name in ("overhead", "overhead_detected"):
        text = written(quick, f"{name}.tex").read_text(encoding="utf-8")
        assert text.isascii()
        assert r"\hline" not in text
        rows[name] = [line for line in text.splitlines() if line.endswith(r"\\") and "multicolumn" not in line]
    assert len(rows["overhead"]) == 1 + len(quick.cells) // 3
    assert {row.count("&") for row in rows["overhead"]} == {6}
    assert len(rows["overhead_detected"]) == 1 + 2 * 2 * 3
    assert {row.count("&") for row in rows["overhead_detected"]} == {7}


def test_the_figure_is_one_column_wide_and_not_blank(quick: measuring.Overhead) -> None:
    from matplotlib.image import imread

    pixels = imread(written(quick, "overhead.png"))
    assert abs(pixels.shape[1] - 8.5 / 2.54 * 300) < 2
    dark = pixels[..., :3].mean(axis=2) < 0.9
    height = dark.shape[0] // 2
    assert dark[:height].sum() > 5_000
    assert dark[height:].sum() > 5_000
    assert written(quick, "overhead.pdf").read_bytes().startswith(b"%PDF-")


def test_the_statement_says_what_is_measured_and_what_is_not(quick: measuring.Overhead) -> None:
    assert written(quick, "overhead.md").read_text(encoding="utf-8") == quick.statement
    assert "processor's time" in quick.statement
    assert "neither reproduced nor repeated" in quick.statement
    assert "each has read all of it" in quick.statement
    assert quick.statement.count(": every setup detects it at every size.") == 2
    assert quick.statement.count(" ms at 2 and 4 waypoints; ") == 3 * 3, "the dearest event of each mode and setup"


def test_a_folder_that_cannot_be_written_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "taken").write_text("a file", encoding="utf-8")
    assert measuring.main([str(tmp_path / "taken"), "--quick"]) == 2
    said = capsys.readouterr()
    assert not said.out
    assert said.err.count("\n") == 1
    assert str(tmp_path / "taken") in said.err


def test_without_matplotlib_the_extra_is_named_and_nothing_is_measured(tmp_path: Path) -> None:
    script = (
        "import sys; sys.modules['matplotlib'] = None\n"
        "from papers.fmas2022.overhead import main\n"
        f"sys.exit(main([{str(tmp_path)!r}, '--quick']))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False, cwd=ROOT)
    assert done.returncode == 2
    assert done.stderr == "overhead: error: matplotlib is not installed: pip install '.[papers]' in a checkout\n"
    assert not list(tmp_path.iterdir())


# -- numbers from runs with known times ------------------------------------------------------------------------------


def invented(*, stopped: bool = False) -> tuple[Cell, ...]:
    """Missions of 100 events a waypoint, 1 µs each; a monitor adds 2 µs to each and 3 ms once, a bit more each repetition."""
    made = []
    for repetition, waypoints, (monitors, setup) in product(
        range(1, 6), (5, 10, 20), zip((0, 1, 2, 4), SETUPS, strict=True)
    ):
        events = 100 * waypoints
        base = 1e-6 * events + 1e-3 * repetition
        cpu = base + monitors * (2e-6 * events + 3e-3) + (1e-5 * repetition if monitors else 0)
        run = Run(
            mode=Mode.NOMINAL, waypoints=waypoints, setup=setup, repetition=repetition, monitors=monitors, events=events,
            mission=90.0 * waypoints, made=1e-4, cpu=cpu, wall=cpu, verdicts="⊥" if stopped and monitors == 1 else "?" * monitors,
            dearest=1e-3 * waypoints if monitors else 0.0, dearest_event=1, dearest_on="/command move", detected=0,
        )  # fmt: skip
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


def test_equal_numbers_are_equal_bytes(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="the figure needs rvaft[papers]")
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        draw(invented(), tmp_path / name)
    for form in ("pdf", "png"):
        one, two = ((tmp_path / name / f"overhead.{form}").read_bytes() for name in ("one", "two"))
        assert one == two
    assert b"CreationDate" not in (tmp_path / "one" / "overhead.pdf").read_bytes()
    assert nominal_tex(invented()) == nominal_tex(invented())
    assert detected_tex(invented()) == detected_tex(invented())


def test_what_stopped_early_and_what_the_dearest_event_costs_is_told() -> None:
    assert "In 3 of 12 rows a monitor had its final verdict before the end" in statement(invented(stopped=True))
    dearest = "The dearest event takes 5.00, 10.00 and 20.00 ms at 5, 10 and 20 waypoints"
    assert statement(invented()).count(dearest) == 3


def test_setups_take_turns_at_being_first(tree: RVAFT) -> None:
    order = [(run.repetition, run.setup) for run in runs(tree, [2], 4)]
    assert [setup for number, setup in order if number == 1] == [*SETUPS[1:], *SETUPS[:1]]
    assert {order[4 * number][1] for number in range(4)} == set(SETUPS)
