"""Events that an explanation names, found again."""

import gzip
import json
from pathlib import Path
from random import Random

import pytest

from rvaft.monitoring import fast_reader
from rvaft.monitoring.reader import read
from rvaft.monitoring.run import EventBuffer

SPACES = ["", "\n", "\r\n", "  \n", "\t\r\n\n", "\n\n\n"]


def written(path: Path, seed: int) -> None:
    random = Random(seed)
    text = random.choice(["", "\ufeff"])
    for number in range(random.randrange(1, 60)):
        text += (
            random.choice(SPACES)
            + random.choice(["", " "])
            + json.dumps({"n": number, "pad": "x" * random.randrange(40)})
        )
        text += random.choice(["\n", "\r\n"])
    data = (text + random.choice(SPACES)).encode()
    path.write_bytes(gzip.compress(data) if path.suffix == ".gz" else data)


@pytest.mark.parametrize("suffix", [".jsonl", ".jsonl.gz"])
@pytest.mark.parametrize("seed", range(30))
def test_a_file_is_numbered_as_it_is_read(
    seed: int, suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = tmp_path / f"log{suffix}"
    written(log, seed)
    expected = dict(enumerate(read(log), 1))
    for size in (16, 97, 1 << 20):
        monkeypatch.setattr(fast_reader, "SIZE", size)
        assert EventBuffer(log).events(range(1, len(expected) + 3)) == expected
        for number, event in expected.items():
            assert EventBuffer(log).events([number]) == {number: event}


def test_the_latest_are_remembered_and_the_others_forgotten() -> None:
    buffer = EventBuffer(bound=3)
    for number in range(1, 6):
        buffer.remember(number, {"n": number})
    assert buffer.events([1, 3, 5]) == {3: {"n": 3}, 5: {"n": 5}}
    assert len(buffer.known) == 3


def test_what_is_forgotten_is_looked_up_in_the_file(tmp_path: Path) -> None:
    log = tmp_path / "log.jsonl"
    log.write_text("".join(f'{{"n": {number}}}\n' for number in range(1, 100)))
    buffer = EventBuffer(log, bound=2)
    buffer.remember(50, {"n": 50, "remembered": True})
    assert buffer.events([7, 50]) == {7: {"n": 7}, 50: {"n": 50, "remembered": True}}


def test_a_file_that_has_changed_since_is_no_error(tmp_path: Path) -> None:
    log = tmp_path / "log.jsonl"
    assert EventBuffer(log).events([1]) == {}
    log.write_text('{"n": 1}\nnonsense\n{"n": 3}\n')
    assert EventBuffer(log).events([1, 2]) == {1: {"n": 1}}
    packed = tmp_path / "log.gz"
    packed.write_bytes(gzip.compress(b'{"n": 1}\n' * 10_000)[:-9])
    assert EventBuffer(packed).events([10_001]) == {}
