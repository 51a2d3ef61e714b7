"""What `rvaft report` costs beside `rvaft monitor --repeat`: ratios within one run.

`pytest tests/benchmarks/test_report.py -s` prints the table, with `-m slow` for 100,000 events.
"""

import json
import subprocess
import sys
from pathlib import Path
from random import Random

import pytest

pytestmark = pytest.mark.benchmark

TREE = """semantics scattered;
time time as s;
event failed(user, address) = { event: "failed", user: user, address: address };
guess and tries within 1 min;
tries on failed(_, Address) times 5 attack;
"""
COST = """import resource, sys
from rvaft.cli import main
try:
    main(standalone_mode=False)
finally:
    used = resource.getrusage(resource.RUSAGE_SELF)
    print('cost', used.ru_utime + used.ru_stime, used.ru_maxrss)
"""


def failed_logins(file: Path, events: int) -> Path:
    """Write a log of failed logins in bursts, from one address in 21 events."""
    random, time = Random(1), 1.7e9
    addresses = [".".join(str(random.randrange(1, 255)) for _ in range(4)) for _ in range(events // 21)]
    weights = [1 / (rank + 1) ** 0.8 for rank in range(len(addresses))]
    written = 0
    with file.open("w", encoding="utf-8") as stream:
        for address in random.choices(addresses, weights, k=events):
            for _ in range(min(random.choice((1, 1, 2, 3, 5, 8)), events - written)):
                time += random.expovariate(1.5)
                user = random.choice(("root", "admin", "test", "oracle"))
                text = (
                    f"Failed password for invalid user {user} from {address} port {random.randrange(1024, 65535)} ssh2"
                )
                event = {"time": round(time, 3), "event": "failed", "user": user, "address": address, "message": text}
                stream.write(f"{json.dumps(event)}\n")
                written += 1
    return file


def cost(*arguments: object) -> tuple[float, float]:
    """Return seconds of the processor and megabytes of a command in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-c", COST, *map(str, arguments)], capture_output=True, text=True, check=False
    )
    *_, seconds, kilobytes = done.stdout.split()
    return float(seconds), int(kilobytes) / 1024


@pytest.mark.parametrize("key", [(), ("--key", "address")], ids=["variable", "key"])
@pytest.mark.parametrize("events", [10_000, pytest.param(100_000, marks=pytest.mark.slow)])
def test_a_report_costs_at_most_three_times_what_monitoring_costs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], events: int, key: tuple[str, ...]
) -> None:
    (tree := tmp_path / "tree.rvaft").write_text(TREE, encoding="utf-8")
    log, page = failed_logins(tmp_path / "log.jsonl", events), tmp_path / "page.html"
    monitored = cost("monitor", tree, log, "--repeat", *key)
    reported = cost("report", tree, log, "--repeat", *key, "-o", page)
    with capsys.disabled():
        sys.stdout.write(f"\n{events:,} events: page of {page.stat().st_size / 1e6:.1f} MB\n")
        for name, (seconds, megabytes) in (("monitor", monitored), ("report", reported)):
            sys.stdout.write(f"{name:8} {seconds:8.1f} s {megabytes:8.0f} MB\n")
    assert reported[0] < 3 * monitored[0]
    assert reported[1] < 3 * monitored[1]
