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
        "Measured: the CPU time of the loop of a simulated mission without faults and attacks, with "
        f"{small.waypoints} to {large.waypoints} waypoints ({small.events} to {large.events} events). The "
        "simulation creates each event, and monitors in the same process read it, under the semantics "
        f"`{SEMANTICS}`. Values are medians of {small.repetitions} repetitions with alternating setups, with "
        f"quartiles; {python_implementation()} {python_version()} on {machine()}. The loop has no messages, "
        "waiting or physics: without monitors an event takes "
        f"{1e6 * large.cpu.median / large.events:.1f} µs. A simulation with more work per event has a smaller "
        "ratio. The creation of monitors is timed separately (`made_ms` in `overhead.csv`)."
    )
    stopped = [cell for cell in cells if set(cell.verdicts) - {Verdict.UNKNOWN.symbol}]
    yield ""
    yield (
        "No monitor has a final verdict before the end, so each reads all events."
        if not stopped
        else f"In {len(stopped)} of {len(cells)} rows a monitor has its final verdict before the end, and "
        "reads nothing after it."
    )


def _found(cells: Sequence[Cell]) -> Iterator[str]:
    yield (
        "The cost of monitors: a least-squares line through the medians, and the values at the smallest and "
        "the largest mission. The cost per event varies: an event at which a monitor computes what it awaits "
        "costs many times the mean. The dearest event is therefore given for every number of waypoints, from "
        "separate runs."
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
        "The paper (section 4.5) runs a ROS simulation with ROSMonitoring and RML on its own machine. It reports "
        "that missions take longer with more waypoints, while the cost of monitors is almost zero and almost "
        "constant. That simulation is not part of this project, so only the shape of the results is "
        f"comparable. Relative to the mission time, monitors cost at most {1e6 * share:.0f} millionths of one "
        f"core; a single event takes at most {1e3 * dearest.dearest.median:.1f} ms ({TITLES[dearest.setup]}, "
        f"{dearest.mode}, {dearest.waypoints} waypoints). Their cost per second of a long mission is constant; "
        "their cost per mission grows with its events. The paper does not state which of the two is constant."
    )
