"""One table of all ratios that a run of the benchmarks measures."""

from typing import Final, NamedTuple

import pytest


class Ratio(NamedTuple):
    """The time of rvaft on a workload, as a multiple of what a user would take instead."""

    workload: str
    compared: str
    value: float
    most: float | None
    """The bound that the test asserts, if any."""

    def line(self) -> str:
        """The row of the table."""
        bound = "" if self.most is None else f"{self.most:g}"
        return f"{self.workload:58} {self.compared:32} {self.value:7.2f} {bound:>8}"


_FOUND: Final[list[Ratio]] = []


class Ratios:
    """Where a benchmark notes its ratios."""

    def add(self, workload: str, compared: str, value: float, most: float | None = None) -> None:
        """Note a ratio for the table."""
        _FOUND.append(Ratio(workload, compared, value, most))


@pytest.fixture
def ratios() -> Ratios:
    """Of one test; the table has those of all tests."""
    return Ratios()


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Print the table."""
    if _FOUND:
        terminalreporter.section("time of rvaft, as a multiple")
        terminalreporter.write_line(f"{'workload':58} {'compared with':32} {'ratio':>7} {'at most':>8}")
        for one in _FOUND:
            terminalreporter.write_line(one.line())
