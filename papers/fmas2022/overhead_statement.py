"""The overhead in words, computed from the cells: what was measured, what was found, and how that compares with the paper."""

from collections.abc import Iterator, Sequence
from platform import machine, python_implementation, python_version

from papers.fmas2022.overhead_cells import Cell, growth
from papers.fmas2022.overhead_figure import TITLES
from papers.fmas2022.overhead_runs import NONE, SEMANTICS, SETUPS
from rvaft.verdict import Verdict


def statement(cells: Sequence[Cell]) -> str:
    """Markdown: what was measured, what was found, what the paper reports."""
    return "\n".join([*_measured(cells), "", *_found(cells), "", *_compared(cells), ""])


def _measured(cells: Sequence[Cell]) -> Iterator[str]:
    bare = [cell for cell in cells if cell.setup == NONE]
    small, large = bare[0], bare[-1]
    yield (
        f"Measured: the processor's time of the loop of a simulated, nominal mission of {small.waypoints} to {large.waypoints} waypoints "
        f"({small.events} to {large.events} events), where the simulation makes each event and the monitors, in the same process, "
        f"read it; semantics `{SEMANTICS}`; the median of {small.repetitions} repetitions in which the setups take turns, with quartiles; "
        f"{python_implementation()} {python_version()} on {machine()}. No message is encoded, sent or decoded, nothing waits for a clock, "
        f"and there is no physics: without monitors an event takes {1e6 * large.cpu.median / large.events:.1f} µs. "
        "The ratio therefore compares a monitor with next to nothing; a simulation that does more for each event makes it smaller. "
        "Making the monitors is timed apart (`made_ms` in `overhead.csv`)."
    )
    stopped = [cell for cell in cells if set(cell.verdicts) - {Verdict.UNKNOWN.symbol}]
    yield ""
    yield (
        "No monitor has a final verdict when the mission ends, so each has read all of it."
        if not stopped
        else f"In {len(stopped)} of {len(cells)} rows a monitor had its final verdict before the end, and read nothing from there on."
    )


def _found(cells: Sequence[Cell]) -> Iterator[str]:
    yield (
        "What monitors add: a line of least squares through the medians, of which the part that comes once is what a monitor works out when it "
        "first meets an event of each type; and what was measured at the smallest and the largest mission."
    )
    yield ""
    for setup in SETUPS:
        if setup != NONE:
            yield _added([cell for cell in cells if cell.setup == setup])


def _added(cells: Sequence[Cell]) -> str:
    small, large, line = cells[0], cells[-1], growth(cells)
    return (
        f"- {TITLES[large.setup]} ({large.monitors} in all): {1e3 * line.once:.1f} ms once and {1e6 * line.each:.1f} µs for each event. "
        f"From {small.waypoints} to {large.waypoints} waypoints {1e3 * small.extra.median:.1f} to {1e3 * large.extra.median:.1f} ms, "
        f"{small.per_event.median:.1f} to {large.per_event.median:.1f} µs for an event, "
        f"{small.ratio.median:.1f} to {large.ratio.median:.1f} times the loop without, "
        f"{1e6 * small.share:.1f} to {1e6 * large.share:.1f} millionths of the time that the mission takes the rover "
        f"({small.mission:.0f} to {large.mission:.0f} s)."
    )


def _compared(cells: Sequence[Cell]) -> Iterator[str]:
    share = max(cell.share for cell in cells)
    yield (
        "The paper (section 4.5) runs a ROS simulation with ROSMonitoring and RML on its own machine, and reports that a mission takes "
        "longer with more waypoints, while what monitors add is almost nothing and stays almost constant. That simulation is not part of "
        "this project, so its numbers are neither reproduced nor repeated. What can be compared is the shape. On the time that the rover "
        f"needs, monitors are as invisible here: at most {1e6 * share:.0f} millionths of one core. Constant is what they add to a second of the "
        "mission, once it is long enough for what comes once not to matter; what they add to a whole mission grows with its events. Which of "
        "the two the paper means by constant it does not say."
    )
