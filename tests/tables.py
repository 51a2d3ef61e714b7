"""Tables of data beside the tests that read them: each line is a row in JSON, or a comment after `#`."""

import json
from pathlib import Path
from typing import Any


def rows(test: str, name: str) -> list[Any]:
    """The rows of the table of that name in the folder of a test."""
    lines = Path(test).with_name(name).read_text(encoding="utf-8").split("\n")
    return [json.loads(line) for line in lines if line and not line.startswith("#")]
