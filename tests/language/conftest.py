"""Texts that several tests read."""

import re
from pathlib import Path

import pytest


@pytest.fixture
def remote_inspection() -> str:
    """The worked example at the end of the definition."""
    page = (Path(__file__).parents[2] / "docs" / "semantics.md").read_text(encoding="utf-8")
    found = re.search(r"^```\w*\n(// Robot damaged.*?)^```$", page, re.MULTILINE | re.DOTALL)
    assert found is not None
    return found[1]
