"""The overhead as a text, computed from the cells, and compared with the paper."""

from collections.abc import Iterator, Sequence
from platform import machine, python_implementation, python_version

from papers.fmas2022.mission import Mode
from papers.fmas2022.overhead_cells import Cell, growth
from papers.fmas2022.overhead_figure import TITLES
from papers.fmas2022.overhead_runs import NONE, SEMANTICS, SETUPS
from papers.fmas2022.verdicts import listed
from rvaft.model.verdict import Verdict


def statement(cells: Sequence[Cell]) -> str:
    """Return Markdown: the setup, the results, and the paper's results."""
    calm = [cell for cell in cells if cell.mode is Mode.NOMINAL]
    parts = [*_measured(calm), "", *_found(calm), ""]
    for mode in Mode:
        hit = [cell for cell in cells if cell.mode is mode and cell.setup != NONE]
        if hit and mode is not Mode.NOMINAL:
            parts += [*_detected(mode, hit), ""]
    return "\n".join([*parts, *_compared(cells), ""])


def _measured(cells: Sequence[Cell]) -> Iterator[str]:
    bare = [cell for cell in cells if cell.setup == NONE]
    small, large = bare[0], bare[-1]
    yield (
        "Measured: the processor's time of the loop of a simulated mission, in which first nothing "
        f"happens, of {small.waypoints} to {large.waypoints} waypoints "
        f"({small.events} to {large.events} events), where the simulation makes each event and the "
        "monitors, in the same process, "
        f"read it; semantics `{SEMANTICS}`; the median of {small.repetitions} repetitions in which the "
        "setups take turns, with quartiles; "
        f"{python_implementation()} {python_version()} on {machine()}. No message is encoded, sent or "
        "decoded, nothing waits for a clock, "
        f"and there is no physics: without monitors an event takes {1e6 * large.cpu.median / large.events:.1f} µs. "
        "The ratio therefore compares a monitor with next to nothing; a simulation that does more for each "
        "event makes it smaller. "
        "Making the monitors is timed apart (`made_ms` in `overhead.csv`)."
    )
    stopped = [cell for cell in cells if set(cell.verdicts) - {Verdict.UNKNOWN.symbol}]
    yield ""
    yield (
        "No monitor has a final verdict when the mission ends, so each has read all of it."
        if not stopped
        else f"In {len(stopped)} of {len(cells)} rows a monitor had its final verdict before the end, and "
        "read nothing from there on."
    )


def _found(cells: Sequence[Cell]) -> Iterator[str]:
    yield (
        "What monitors add: a line of least squares through the medians, and what was measured at the "
        "smallest and the largest mission. Events "
        "are not alike: one at which a monitor has to work out what it waits for costs many times the "
        "mean. So the dearest one is given, too, "
        "measured in runs of its own, for every number of waypoints."
    )
    yield ""
    for setup in SETUPS:
        if setup != NONE:
            yield _added([cell for cell in cells if cell.setup == setup])


def _added(cells: Sequence[Cell]) -> str:
    small, large, line = cells[0], cells[-1], growth(cells)
    return (
        f"- {_setup(large)}: {1e3 * line.once:.1f} ms once and {1e6 * line.each:.1f} µs for each event. "
        f"From {small.waypoints} to {large.waypoints} waypoints {1e3 * small.extra.median:.1f} to "
        f"{1e3 * large.extra.median:.1f} ms, "
        f"{small.per_event.median:.1f} to {large.per_event.median:.1f} µs for an event, "
        f"{small.ratio.median:.1f} to {large.ratio.median:.1f} times the loop without, "
        f"{1e6 * small.share:.1f} to {1e6 * large.share:.1f} millionths of the time that the mission takes the rover "
        f"({small.mission:.0f} to {large.mission:.0f} s). {_dearest(cells)}"
    )


def _detected(mode: Mode, cells: Sequence[Cell]) -> Iterator[str]:
    missed = [cell for cell in cells if not cell.detected]
    found = f"{len(missed)} of {len(cells)} rows miss it" if missed else "every setup detects it at every size"
    happens = {Mode.FAULT: "where the inspection hangs", Mode.ATTACK: "where an attacker alters the last goal"}[mode]
    yield f"The same missions {happens} (`--mode {mode}`): {found}."
    yield ""
    for setup in SETUPS:
        mine = [cell for cell in cells if cell.setup == setup]
        if mine:
            small, large = mine[0], mine[-1]
            yield (
                f"- {_setup(large)}: {large.verdicts.count(Verdict.TRUE.symbol)} of {large.monitors} "
                "detect, the first one at event "
                f"{small.detected} of {small.events} to event {large.detected} of {large.events}. "
                f"{small.per_event.median:.1f} to {large.per_event.median:.1f} µs for an event, "
                f"{small.ratio.median:.1f} to {large.ratio.median:.1f} times the loop without. {_dearest(mine)}"
            )


def _setup(cell: Cell) -> str:
    return f"{TITLES[cell.setup]} ({cell.monitors} in all)"


def _dearest(cells: Sequence[Cell]) -> str:
    last = cells[-1]
    costs = listed(f"{1e3 * cell.dearest.median:.2f}" for cell in cells)
    sizes = listed(f"{cell.waypoints}" for cell in cells)
    where = f"event {last.dearest_event} of {last.events}, on `{last.dearest_on}`"
    return f"The dearest event takes {costs} ms at {sizes} waypoints; the last of these is {where}."


def _compared(cells: Sequence[Cell]) -> Iterator[str]:
    share = max(cell.share for cell in cells)
    dearest = max(cells, key=lambda cell: cell.dearest.median)
    yield (
        "The paper (section 4.5) runs a ROS simulation with ROSMonitoring and RML on its own machine, and "
        "reports that a mission takes "
        "longer with more waypoints, while what monitors add is almost nothing and stays almost constant. "
        "That simulation is not part of "
        "this project, so its numbers are neither reproduced nor repeated. What can be compared is the "
        "shape. On the time that the rover "
        f"needs, monitors are as invisible here: at most {1e6 * share:.0f} millionths of one core; a single event "
        f"takes at most {1e3 * dearest.dearest.median:.1f} ms ({TITLES[dearest.setup]}, {dearest.mode}, "
        f"{dearest.waypoints} waypoints). Constant is what they add to a second of the "
        "mission, once it is long enough for what comes once not to matter; what they add to a whole "
        "mission grows with its events. Which of "
        "the two the paper means by constant it does not say."
    )
