"""The trees that ship, their traces, and the verdicts expected of them.

`python -m tests.trees.shipped` writes NAME.verdicts.json anew from the reference; a change there is
a change of meaning.
"""

import json
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import rvaft
from rvaft import RVAFT, Semantics
from rvaft.core.branches import branches
from rvaft.semantics import Reference

TREES = Path(__file__).parents[2] / "trees"
REFUSED = {"remote_inspection/listing"}
ADDING = {"remote_inspection/ros": "remote_inspection/pruned"}
"""Trees that add to another one what no verdict depends on; its traces and verdicts are theirs."""
FOLLOWED = {("cloudtrail/takeover", Semantics.SCATTERED)}
"""Where the engine is asked: the reference looks at every twenty of the failures.

`test_logs.py` holds it against the reference with fewer.
"""

Expected = Mapping[str, Mapping[str, Mapping[str, str]]]
"""Trace name -> semantics -> "tree" or branch number -> the signs ⊤, ⊥, ? after every event."""


def names() -> list[str]:
    """The trees that are valid and have traces of their own, as folder/name."""
    found = [str(path.relative_to(TREES).with_suffix("")) for path in sorted(TREES.rglob("*.rvaft"))]
    return [name for name in found if name not in REFUSED | ADDING.keys()]


@cache
def load(name: str) -> RVAFT:
    """One tree."""
    return rvaft.load(TREES / f"{name}.rvaft")


def traces(name: str) -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """Its traces by name."""
    for path in sorted((TREES / f"{name}.traces").glob("*.jsonl")):
        yield path.stem, [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


def expected(name: str) -> Expected:
    """The verdicts that are stored."""
    stored: Expected = json.loads((TREES / f"{name}.verdicts.json").read_text(encoding="utf-8"))
    return stored


def computed(name: str) -> Expected:
    """The verdicts that the reference gives."""
    tree = load(name)
    columns: dict[str, int | None] = {"tree": None, **{str(branch.number): branch.number for branch in branches(tree)}}
    judges = {semantics: rvaft.monitor if (name, semantics) in FOLLOWED else Reference for semantics in Semantics}
    return {
        trace: {
            semantics.value: {
                column: "".join(
                    v.symbol for v in judges[semantics](tree, semantics=semantics, branch=number).run(events)
                )
                for column, number in columns.items()
            }
            for semantics in Semantics
        }
        for trace, events in traces(name)
    }


if __name__ == "__main__":
    for tree_name in names():
        text = json.dumps(computed(tree_name), indent=1, ensure_ascii=False)
        (TREES / f"{tree_name}.verdicts.json").write_text(text + "\n", encoding="utf-8")
