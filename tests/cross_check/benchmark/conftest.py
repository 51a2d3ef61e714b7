"""How exact times are is no question where the measurement itself is tested."""

import pytest

from cross_check.benchmark import measurement


@pytest.fixture(autouse=True)
def _few_readers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(measurement, "READERS", 1)
    monkeypatch.setattr(measurement, "PATIENCE", 0.01)
