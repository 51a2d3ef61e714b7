"""The logs that tell a story, beside their trees: they are what the script writes, and what it says happens in them is found."""

from typing import Final

import pytest

import rvaft
from rvaft.model.verdict import Semantics
from rvaft.semantics import Reference
from tests.trees import logs, shipped

STORIES: Final = [name for name in logs.STORIES if (shipped.TREES / f"{name}.rvaft").exists()]


@pytest.mark.parametrize("name", STORIES)
def test_the_logs_are_what_the_script_writes(name: str) -> None:
    assert str(dict(shipped.traces(name))) == str(
        dict(sorted(logs.STORIES[name]()))
    )  # NaN equals nothing, itself neither


FEW: Final = 4
"""So many failures for the twenty of the story: few enough for the reference."""


@pytest.mark.skipif("cloudtrail/takeover" not in STORIES, reason="not there yet")
@pytest.mark.parametrize("semantics", Semantics)
def test_a_takeover_with_fewer_failures_is_found_by_the_reference_too(semantics: Semantics) -> None:
    text = (shipped.TREES / "cloudtrail/takeover.rvaft").read_text(encoding="utf-8")
    assert "times 20 " in text
    tree, stored = rvaft.loads(text.replace("times 20 ", f"times {FEW} ")), shipped.expected("cloudtrail/takeover")
    for name, log in logs.takeovers(FEW):
        verdicts = list(Reference(tree, semantics).run(log))
        assert list(rvaft.monitor(tree, semantics=semantics).run(log)) == verdicts, name
        assert verdicts[-1].symbol == stored[name][semantics]["tree"][-1], name
