"""What all tests need of the process that they run in."""

import gc
import os
import shutil
import signal
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import pytest
from hypothesis import HealthCheck, settings

# Other examples in each run; always the same ones; many, for changes of what it tests: pytest
# --hypothesis-profile thorough PATH.
# How long an example takes is a matter of what else the machine does.
unhurried = settings(max_examples=50, deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("fast", unhurried)
settings.register_profile("ci", unhurried, derandomize=True, database=None)
settings.register_profile("thorough", unhurried, max_examples=1000)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "fast"))

# A shell ignores interrupts for what it starts in the background, and processes started here would inherit that.
if threading.current_thread() is threading.main_thread() and signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


_PROCESS: Final = os.getpid()
_WHOLE: Final = ("attacks", "papers")
"""Folders whose tests all have the mark `ci`; `make attack` runs the first alone."""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Give the tests of some folders the mark `ci`."""
    folders = [Path(__file__).with_name(name) for name in _WHOLE]
    for item in items:
        if any(item.path.is_relative_to(folder) for folder in folders):
            item.add_marker(pytest.mark.ci)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_makereport(item: pytest.Item) -> None:
    """A process that a test forks and that comes back would run and report the remaining tests a second time."""
    if os.getpid() != _PROCESS:
        os.write(2, f"\nA process that {item.nodeid} forked came back from it.\n".encode())
        os._exit(70)


def pytest_collection_finish() -> None:
    """What was imported and collected is never looked through for what nobody needs, and the rest
    less often: a tenth of the time.
    """
    gc.freeze()
    gc.set_threshold(20_000)


def pytest_sessionfinish() -> None:
    """At the end all is looked through again: DuckDB complains of what is left."""
    gc.unfreeze()


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """How exact the times of `rvaft compare` are is no question."""
    monkeypatch.setattr("papers.languages.measurement.READERS", 1)
    monkeypatch.setattr("papers.languages.measurement.PATIENCE", 0.01)


_SETTINGS: Final = (
    *("headless", "no-sandbox", "disable-gpu", "disable-quic", "no-first-run", "disable-background-networking"),
    *("disable-component-update", "disable-sync", "window-size=1400,1000"),
)


@pytest.fixture(scope="session")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """Chromium, with a new profile, for all tests that look at a page."""
    webdriver = pytest.importorskip("selenium.webdriver", reason="needs selenium")
    program, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if program is None or driver is None:
        pytest.skip("needs chromium and chromium-driver")
    options = webdriver.ChromeOptions()
    options.binary_location = program
    for setting in (*_SETTINGS, f"user-data-dir={tmp_path_factory.mktemp('profile')}"):
        options.add_argument(f"--{setting}")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    running = webdriver.Chrome(options=options, service=webdriver.ChromeService(driver))
    yield running
    running.quit()
