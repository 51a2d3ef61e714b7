"""A folder for the compiled programs of a module, and how they are compiled."""

import os
from collections.abc import Sequence
from pathlib import Path

import pytest

from backends.c.library import compile_c, fast_compiler


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("native")


def compile_quickly(text: str, to: Path, options: Sequence[str]) -> None:
    compile_c(text, to, options, command=fast_compiler())


@pytest.fixture(autouse=True)
def _quick_programs(monkeypatch: pytest.MonkeyPatch) -> None:
    """In `make test`, programs are compiled at once; `.ci/run` has them optimised, as users have."""
    if os.environ.get("HYPOTHESIS_PROFILE") != "ci":
        for module in ("library", "cache"):
            monkeypatch.setattr(f"backends.c.{module}.compile_monitor", compile_quickly)
