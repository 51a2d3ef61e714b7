"""Events in batches give what events one by one give: lateness, times and keys."""

import contextlib
import io
import json
from pathlib import Path
from random import Random
from typing import Final

import pytest

from rvaft.cli import main
from rvaft.model.event_time import EventTime, TimeFormat, scaled

TREE: Final = """event a(u) = { event: "a", user: u };
event b(u) = { event: "b", user: u };
time time as s late %s;
semantics scattered;
top sand x y within 5 s;
x times 2 on a(U); y on b(U);
"""


def _log(file: Path, back: float) -> None:
    random, now, lines = Random(7), 1_000.0, list[str]()
    for _ in range(1_500):
        now += random.choice((0, 0.001, 0.2))
        time = round(now - (3 * random.random() if random.random() < back else 0), 3)
        event = {"time": time, "event": random.choice("abcz"), "user": f"u{random.randrange(40)}"}
        digits = "" if random.random() < 0.9 else "000000000000001"
        lines.append(json.dumps(event).replace(f"{time},", f"{time:.3f}{digits},"))
    file.write_text("\n".join(lines), encoding="utf-8")


@pytest.mark.parametrize("late", ["0 s", "2 s"])
@pytest.mark.parametrize("back", [0, 0.002, 0.1])
@pytest.mark.parametrize("options", [(), ("--key", "user"), ("--key", "user", "--max-keys", "30")])
def test_batches_and_single_events_give_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, late: str, back: float, options: tuple[str, ...]
) -> None:
    (tree := tmp_path / "tree.rvaft").write_text(TREE % late, encoding="utf-8")
    _log(log := tmp_path / "log.jsonl", back)

    def outcome(least: int) -> tuple[object, str, str]:
        monkeypatch.setattr("rvaft.stream.batch_steps.FEW", least)
        with contextlib.redirect_stdout(io.StringIO()) as said, contextlib.redirect_stderr(io.StringIO()) as warned:
            words = ["monitor", str(tree), str(log), "--repeat", *options]
            try:
                status: object = main(words, standalone_mode=False)
            except SystemExit as stopped:
                status = stopped.code
        return status, said.getvalue(), warned.getvalue()

    assert outcome(32) == outcome(10**9)


@pytest.mark.parametrize("unit", ["s", "ms", "us", "ns"])
def test_a_double_is_read_as_its_shortest_decimal(unit: str) -> None:
    random = Random(3)
    values = [round(random.uniform(-(10**10), 10**10), random.randrange(9)) for _ in range(2_000)]
    values += [2.0**52 / 10**6 + number / 10**6 for number in range(-50, 50)]
    assert EventTime(("t",), TimeFormat(unit)).of_all(values) == [scaled(repr(value), unit) for value in values]
