"""The verified monitor beside decoding, on the gates with every event relevant."""

import json
from pathlib import Path
from random import Random

import pytest

from rvaft import Semantics, loads
from rvaft.export.tree_json import json_text
from tests.benchmarks.conftest import Ratios
from tests.benchmarks.test_native import decoding, running
from tests.proofs.verified import PROGRAM, built

EVENTS = 100_000
GATES = {
    "sand": "top sand a b c d;",
    "and": "top and a b c d;",
    "or": "top or x y; x sand a d; y and b d;",
    "vot": "top 3of4 a b d e;",
    "pand": "top pand x y; x and a b; y and c d;",
}


@built
@pytest.mark.parametrize("gate", GATES)
def test_the_gates(gate: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], ratios: Ratios) -> None:
    """Nothing is detected, so that no event is free."""
    (tree := tmp_path / "tree.json").write_text(json_text(loads(GATES[gate])), encoding="utf-8")
    random = Random(gate)
    lines = (json.dumps({"event": random.choice("abc")}) + "\n" for _ in range(EVENTS))
    (log := tmp_path / "log.jsonl").write_text("".join(lines), encoding="utf-8")
    for semantics in (Semantics.SCATTERED, Semantics.CONSECUTIVE):
        seconds = min(running(PROGRAM, str(tree), "--semantics", semantics, log) for _ in range(2))
        ratio = seconds / decoding(log)
        ratios.add(f"verified monitor, {gate}, {semantics}", "orjson.loads", ratio, 90)
        with capsys.disabled():
            print(f"\n{gate:5} {semantics:12} {ratio:6.1f} times orjson.loads, {EVENTS / seconds:,.0f} events a second")
        assert ratio < 90
