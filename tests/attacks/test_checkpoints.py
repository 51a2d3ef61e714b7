"""Checkpoints under attack: runs that are killed at random moments and resumed with other options.

A kill is SIGKILL. What all the runs report together, and the last summary, equal those of a run that
was never killed.
"""

import json
import re
import signal
import subprocess
import sys
from pathlib import Path
from random import Random
from time import monotonic
from typing import Any, Final

import pytest

from tests.tables import sampled

TREE: Final = """
time time as s;
event go(r, u) = { kind: "go", place: r, user: u };
event back(r, u) = { kind: "back", place: r, user: u };
event stop(u) = { kind: "stop", user: u };
top or pair all;
pair sand x y attack; x on go(R, U); y on back(R, U);
all and p q r fault; p on stop(1); q on stop(2); r on go(7, 3);
"""
COUNT: Final = 3_000
PATIENCE: Final = 60.0
ORDER: Final = ("--order-by", "seq", "--window", "60")
"""By a field that is not the time of the tree, since only then blocks are read."""
COMBINATIONS: Final = {
    "plain": (),
    "repeat": ("--repeat",),
    "key": ("--repeat", "--key", "robot"),
    "keys": ("--repeat", "--key", "robot", "--key", "site"),
    "cooldown": ("--repeat", "--cooldown", "9 s"),
    "order": ("--repeat", *ORDER),
    "order once": ORDER,
    "order key": ("--repeat", "--key", "robot", *ORDER),
    "order keys cooldown": ("--repeat", "--key", "robot", "--key", "site", "--cooldown", "9 s", *ORDER),
    "order kind": ("--repeat", "--per", "kind", "--key", "robot", *ORDER),
}
SIZES: Final = (("--checkpoint-every", "50"), ("--checkpoint-every", "1000"), ("--checkpoint-every", "2500"), ())


def events(random: Random, count: int) -> list[dict[str, Any]]:
    """Events of several robots, not quite in order; most are irrelevant, and some lack a field."""
    made: list[dict[str, Any]] = []
    for number in range(count):
        event: dict[str, Any] = {"robot": random.randrange(20), "time": number + random.randrange(30)}
        event |= {"kind": random.choice(["go", "back", "stop", "noise", "noise", "noise", "noise", "other"])}
        event |= {"place": random.randrange(12), "user": random.randrange(12), "site": random.choice(["n", "s"])}
        event["seq"] = event["time"]
        event["note"] = f"the whole of event {number}"
        if random.random() < 0.01:
            del event[random.choice(["robot", "seq", "user"])]
        made.append(event)
    return made


def words(folder: Path, *options: str) -> list[str]:
    return [sys.executable, "-m", "rvaft", "monitor", "tree.rvaft", "log.jsonl", "--semantics", "scattered", *options]


def ran(folder: Path, *options: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        words(folder, *options), cwd=folder, capture_output=True, text=True, timeout=PATIENCE, check=False
    )


def killed(folder: Path, moment: float, *options: str) -> list[str]:
    """The whole lines that a run prints until it is killed, unless it ends before."""
    with (folder / "said").open("w") as said:
        running = subprocess.Popen(words(folder, *options), cwd=folder, stdout=said, stderr=subprocess.DEVNULL)
        try:
            running.wait(moment)
        except subprocess.TimeoutExpired:
            running.kill()
    assert running.wait(PATIENCE) in (0, 1, -signal.SIGKILL)
    return (folder / "said").read_text().split("\n")[:-1]


def summary(text: str) -> list[str]:
    """The lines of an output that are not about a change of the verdict."""
    change = re.compile(r"(\w+=.*: )?event \d+( \(line \d+\))?: |  ")
    return [line for line in text.splitlines() if not change.match(line)]


def attacked(folder: Path, options: tuple[str, ...], *, kills: int, seed: int) -> None:
    random = Random(seed)
    (folder / "tree.rvaft").write_text(TREE)
    log = folder / "log.jsonl"
    log.write_text("".join(json.dumps(event) + "\n" for event in events(random, COUNT)))
    whole = ran(folder, *options, "--format", "jsonl", "--detections")
    begun = monotonic()
    final = ran(folder, *options)
    takes = monotonic() - begun
    assert whole.returncode == final.returncode == 1, (whole.stderr, final.stderr)
    detections = whole.stdout.splitlines()
    assert len(detections) > 5 or "--repeat" not in options
    keeping = (*options, "--checkpoint", "state")
    said: list[str] = []
    for _ in range(kills):
        if random.random() < 0.2:
            (folder / "state").unlink(missing_ok=True)
            said = []
        size, follow = random.choice(SIZES), random.choice(((), ("--follow",)))
        form = ("--format", "jsonl", "--detections")
        said += killed(folder, takes * random.uniform(0.3, 1.2), *keeping, *size, *follow, *form)
    last = ran(folder, *keeping, *random.choice(SIZES), "--format", "jsonl", "--detections")
    assert (last.returncode, [line for line in last.stderr.splitlines() if "error" in line]) == (1, [])
    said += last.stdout.splitlines()
    unmarked = [line for line in said if '"again": true' not in line]
    assert len(set(unmarked)) == len(unmarked)
    assert {line.replace(', "again": true', "") for line in said} == set(detections)
    ended = ran(folder, *keeping)
    assert (ended.returncode, summary(ended.stdout), ended.stderr) == (1, summary(final.stdout), final.stderr)


@pytest.mark.parametrize(
    "name", sampled([name for name in COMBINATIONS if name not in ("order", "order kind", "key")], 3, pytest.mark.slow)
)
def test_a_run_that_is_killed_twice_reports_the_same(name: str, tmp_path: Path) -> None:
    attacked(tmp_path, COMBINATIONS[name], kills=2, seed=len(name))


@pytest.mark.slow
@pytest.mark.parametrize("name", COMBINATIONS)
def test_a_run_that_is_killed_thirty_times_reports_the_same(name: str, tmp_path: Path) -> None:
    for seed in range(3):
        folder = tmp_path / str(seed)
        folder.mkdir()
        attacked(folder, COMBINATIONS[name], kills=10, seed=seed)


@pytest.mark.parametrize("key", [(), ("--key", "robot")])
@pytest.mark.parametrize("now", ["table", "jsonl", "exec"])
def test_events_held_back_by_an_order_are_whole_in_a_resumed_run(
    now: str, key: tuple[str, ...], tmp_path: Path
) -> None:
    """A run that reads blocks is resumed by one that reads event by event, and shows them."""
    if now == "table" and key:
        pytest.skip("a table is for whole traces")
    (tmp_path / "tree.rvaft").write_text(TREE)
    made = events(Random(1), 900)
    log = tmp_path / "log.jsonl"
    options = ["--repeat", "--order-by", "seq", "--window", "500", *key]
    for number in (*range(0, 400, 40), 899):
        made[number] |= {"kind": "go", "place": 1, "user": 1, "time": number, "seq": number, "robot": 1}
        made[number + 7 if number < 800 else 880] |= {
            "kind": "back",
            "place": 1,
            "user": 1,
            "time": number + 7,
            "seq": number + 7,
            "robot": 1,
        }
    log.write_text("".join(json.dumps(event) + "\n" for event in made))
    shown = {"table": ("--format", "table"), "jsonl": ("--format", "jsonl"), "exec": ("--exec", "cat >> found")}[now]
    whole = ran(tmp_path, *options, *shown)
    found = tmp_path / "found"
    commands = found.read_text().splitlines() if now == "exec" else []
    found.unlink(missing_ok=True)
    text = log.read_text()
    log.write_text("".join(json.dumps(event) + "\n" for event in made[:600]))
    keeping = [*options, "--checkpoint", "state"]
    assert ran(tmp_path, *keeping, "--exec", "true").returncode == 1
    log.write_text(text)
    resumed = ran(tmp_path, *keeping, *shown, "--checkpoint-every", "10")
    assert (resumed.returncode, resumed.stderr) == (whole.returncode, whole.stderr)
    said = resumed.stdout.replace(', "again": true', "").replace(" (reported before)", "").splitlines()
    if now == "jsonl":
        assert len(said) > 700
        assert said == whole.stdout.splitlines()[-len(said) :]
    elif now == "table":
        rows = [line for line in said if line.startswith("{")]
        assert len(rows) > 700
        assert [row.split("  ")[0] for row in rows] == [
            line.split("  ")[0] for line in whole.stdout.splitlines() if line.startswith("{")
        ][-len(rows) :]
    else:
        told = [line.replace(', "again": true', "") for line in found.read_text().splitlines()]
        assert told
        assert set(told) <= set(commands)


def test_a_resumed_run_tells_that_earlier_events_lack_fields(tmp_path: Path) -> None:
    (tmp_path / "tree.rvaft").write_text(TREE)
    (tmp_path / "log.jsonl").write_text("".join(json.dumps(event) + "\n" for event in events(Random(1), 100)))
    for options, lacks in ((("--checkpoint-every", "10"), False), ((), True)):
        (tmp_path / "state").unlink(missing_ok=True)
        keeping = ("--repeat", "--checkpoint", "state", "--checkpoint-every", "2000")
        assert ran(tmp_path, *keeping, *options).returncode in (0, 1)
        said = ran(tmp_path, *keeping, "--exec", "true").stderr
        assert ("events up to event 100 may lack others" in said) is lacks


def test_saving_takes_no_longer_than_the_rest_also_with_many_keys(tmp_path: Path) -> None:
    """A checkpoint after each 100 events, and up to 12,000 monitors in it."""
    (tmp_path / "tree.rvaft").write_text(TREE)
    with (tmp_path / "log.jsonl").open("w") as log:
        for number in range(12_000):
            log.write(json.dumps({"kind": "go", "place": 1, "user": 1, "robot": number, "time": number}) + "\n")
    took = []
    for options in ((), ("--checkpoint", "state", "--checkpoint-every", "100")):
        begun = monotonic()
        assert ran(tmp_path, "--key", "robot", *options).returncode == 0
        took.append(monotonic() - begun)
    assert took[1] < 3 * took[0] + 2


def test_a_first_large_checkpoint_is_put_off_as_well(tmp_path: Path) -> None:
    """The only checkpoint before the end comes when 10,000 monitors are in it."""
    (tmp_path / "tree.rvaft").write_text(TREE)
    with (tmp_path / "log.jsonl").open("w") as log:
        for number in range(12_000):
            log.write(json.dumps({"kind": "go", "place": 1, "user": 1, "robot": number, "time": number}) + "\n")
    begun = monotonic()
    assert ran(tmp_path, "--key", "robot").returncode == 0
    plain = monotonic() - begun
    begun = monotonic()
    assert ran(tmp_path, "--key", "robot", "--checkpoint", "state", "--checkpoint-every", "10000").returncode == 0
    assert monotonic() - begun < 3 * plain + 2
