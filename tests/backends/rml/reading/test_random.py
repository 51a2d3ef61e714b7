"""Random programs: the reader, the published tools, and the published monitor on our own Prolog agree but for the deviations."""

from dataclasses import dataclass
from pathlib import Path
from random import Random

import pytest

from backends.rml.prolog import prolog
from backends.rml.reader.deviations import touching
from rvaft.errors import TooLarge
from rvaft.model.values import Json
from tests.backends.rml.published.runner import compiled, needs_published, verdicts
from tests.backends.rml.reading.letters import letters
from tests.backends.rml.reading.programs import Programs, trace

SEED = 20
PROGRAMS = 300
TRACES = 6


@dataclass
class Sample:
    text: str
    traces: list[list[Json]]


def _samples(seed: int, programs: int) -> list[Sample]:
    random = Random(seed)
    texts = [Programs(random).text() for _ in range(programs)]
    return [Sample(text, [trace(random, text) for _ in range(TRACES)]) for text in texts]


@pytest.mark.published
@needs_published
def test_the_reader_agrees_with_the_published_tools(tmp_path: Path) -> None:
    samples = _samples(SEED, PROGRAMS)
    specifications = compiled([sample.text for sample in samples], tmp_path)
    jobs = [(path, s.traces) for path, s in zip(specifications, samples, strict=True) if isinstance(path, Path)]
    kept = [s for path, s in zip(specifications, samples, strict=True) if isinstance(path, Path)]
    compared = masked = 0
    for sample, found in zip(kept, verdicts(jobs), strict=True):
        for events, published in zip(sample.traces, found, strict=True):
            if "E" in published or touching(sample.text, events):
                masked += 1
                continue
            compared += 1
            assert _letters(sample.text, events) == published[1:], (sample.text, events)
    assert compared > 4 * masked
    assert compared > PROGRAMS * TRACES * 0.7


@pytest.mark.published
@needs_published
def test_our_prolog_behaves_as_the_published_compiler_s(tmp_path: Path) -> None:
    samples = _samples(SEED + 1, PROGRAMS)
    specifications = compiled([sample.text for sample in samples], tmp_path)
    theirs, ours = [], []
    for index, (path, sample) in enumerate(zip(specifications, samples, strict=True)):
        if isinstance(path, Path):
            own = tmp_path / f"own{index}.pl"
            own.write_text(prolog(sample.text), encoding="utf-8")
            theirs.append((path, sample.traces))
            ours.append((own, sample.traces))
    assert len(ours) > PROGRAMS * 0.9
    assert verdicts(ours) == verdicts(theirs)


def _letters(text: str, events: list[Json]) -> str:
    try:
        return letters(text, events)
    except TooLarge as error:
        return str(error)


def test_random_programs_are_read_and_reach_every_verdict() -> None:
    endings = {_letters(s.text, events)[-1] for s in _samples(SEED, 60) for events in s.traces}
    assert {"T", "F", "?"} <= endings
