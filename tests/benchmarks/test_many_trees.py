"""A hundred trees on one reading of a log, beside a run for each; `pytest -s` prints the seconds."""

import contextlib
import io
import json
import time
from pathlib import Path
from random import Random
from typing import Final

from rvaft.cli import main
from tests.benchmarks.conftest import Ratios

TREES: Final = 100
EVENTS: Final = 20_000
ACTIONS: Final = [f"act{number}" for number in range(60)]


def written(folder: Path, events: int = EVENTS) -> list[Path]:
    """Write trees of three events of a user within 30 minutes, and a log of which a tenth is relevant."""
    random, found = Random(5), list[Path]()
    for number in range(TREES):
        names = random.sample(ACTIONS, 3)
        types = "\n".join(f'event {name}(u) = {{ action: "{name}", user: u }};' for name in names)
        nodes = "\n".join(f"{node} on {name}(U);" for node, name in zip("xyz", names, strict=True))
        text = f"semantics scattered;\ntime time as s;\n{types}\ntop sand x y z within 30 min;\n{nodes}\n"
        found.append(folder / f"rule{number:03}.rvaft")
        found[-1].write_text(text, encoding="utf-8")
    with (folder / "log.jsonl").open("w", encoding="utf-8") as log:
        for number in range(events):
            action = random.choice(ACTIONS) if random.random() < 0.1 else f"other{random.randrange(30)}"
            event = {"time": number * 1.5, "action": action, "user": f"u{random.randrange(10)}"}
            event |= {"host": f"h{random.randrange(500)}", "text": "some text " * random.randrange(8)}
            log.write(f"{json.dumps(event)}\n")
    return found


def monitored(*words: object) -> tuple[list[str], float]:
    """The detections of a run, and its seconds of the processor."""
    with contextlib.redirect_stdout(io.StringIO()) as said:
        begun = time.process_time()
        main(["monitor", *map(str, words), "--repeat", "--format", "jsonl", "--detections"], standalone_mode=False)
        seconds = time.process_time() - begun
    return said.getvalue().splitlines(), seconds


def test_a_hundred_trees_cost_a_part_of_a_hundred_runs(tmp_path: Path, ratios: Ratios) -> None:
    files, log = written(tmp_path), tmp_path / "log.jsonl"
    monitored(files[0], log)
    detections, together = min((monitored(tmp_path, log) for _ in range(3)), key=lambda found: found[1])
    apart, alone = 0.0, list[str]()
    for file in files:
        found, seconds = monitored(file, log)
        apart += seconds
        alone += [json.dumps({"tree": str(file), **json.loads(line)}) for line in found]
    assert len(detections) > 30
    assert sorted(detections) == sorted(alone)
    print(f"{TREES} trees, {EVENTS} lines: {together:.2f} s together, {apart:.2f} s in runs of their own")
    ratios.add(f"{TREES} trees on one log", "a run for each, without imports", together / apart, 0.5)
    assert together < 0.5 * apart
