"""The program of the verified monitor, where it is built."""

import json
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import pytest

import rvaft
from rvaft.export.tree_json import json_text

PROOFS: Final = Path(rvaft.__file__).parent.parent / "proofs"
_BUILT: Final = PROOFS / "build" / "rvaft-verified"
_FOUND: Final = str(_BUILT) if _BUILT.is_file() else shutil.which("rvaft-verified")
PROGRAM: Final = Path(_FOUND or _BUILT)
built: Final = pytest.mark.skipif(_FOUND is None, reason="the verified monitor is not built (make verified)")


def run(
    folder: Path, tree: rvaft.RVAFT, *options: str, given: str = "", changed: Mapping[str, Any] | None = None
) -> subprocess.CompletedProcess[str]:
    """The program with a tree, and fields of its JSON changed."""
    (file := folder / "tree.json").write_text(json.dumps(json.loads(json_text(tree)) | dict(changed or {})))
    return subprocess.run(
        [PROGRAM, file, *options], input=given, capture_output=True, encoding="utf-8", timeout=60, check=False
    )


def lines(events: Sequence[object]) -> str:
    """Events as JSON Lines."""
    return "".join(f"{json.dumps(event)}\n" for event in events)
