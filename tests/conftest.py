"""What all tests need of the process that they run in."""

import os
import signal
import threading

import pytest
from hypothesis import HealthCheck, settings

# Other examples in each run; always the same ones; many, for changes of what it tests: pytest --hypothesis-profile thorough PATH.
# How long an example takes is a matter of what else the machine does.
unhurried = settings(max_examples=50, deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("fast", unhurried)
settings.register_profile("ci", unhurried, derandomize=True, database=None)
settings.register_profile("thorough", unhurried, max_examples=1000)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "fast"))

# A shell ignores interrupts for what it starts in the background, and processes started here would inherit that.
if threading.current_thread() is threading.main_thread() and signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """How exact the times of `rvaft compare` are is no question."""
    monkeypatch.setattr("cross_check.benchmark.measurement.READERS", 1)
    monkeypatch.setattr("cross_check.benchmark.measurement.PATIENCE", 0.01)
