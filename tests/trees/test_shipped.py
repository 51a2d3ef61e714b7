"""Every shipped tree: its traces get the verdicts that are stored with it."""

import pytest

from tests.trees import shipped


@pytest.mark.parametrize("name", shipped.names())
def test_the_reference_gives_the_stored_verdicts(name: str) -> None:
    assert shipped.computed(name) == shipped.expected(name)
    assert len(dict(shipped.traces(name))) >= 6
