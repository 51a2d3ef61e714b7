"""`rvaft check` and `rvaft explain`, beyond what answers.txt has."""

import os
import re
from pathlib import Path

from tests.cli.runs import process, run, written


def test_every_code_is_listed_and_explained() -> None:
    codes = [line.split()[0] for line in run("explain").stdout.splitlines()[1:]]
    assert {"undeclared", "cycle", "syntax", "no-branch"} <= set(codes)
    assert all(code in run("explain", code).stdout for code in codes)


def test_bytes_that_are_no_text_and_a_standard_input_that_cannot_be_read() -> None:
    result = run("check", "-", data=b"a;\n\xff")
    assert result.exit_code == 2
    assert result.stderr.startswith("rvaft: error: <stdin>:2:1: the file is not valid UTF-8")
    with Path(os.devnull).open("wb") as writable:
        done = process("check", "-", stdin=writable)
    assert done.returncode == 2
    assert done.stderr.startswith("rvaft: error: <stdin>: cannot read the file: ")


def test_names_are_guessed_for_a_hundred_children_and_no_more(tmp_path: Path) -> None:
    """Comparing every undeclared child with every declared one would keep `check` busy for minutes."""
    gates = (f"gate{number} 2of3 gate{number + 1} x{number} gat{number};" for number in range(300))
    tree = written(tmp_path / "deep.rvaft", "toplevel gate0;\n" + "\n".join(gates) + "\ngate300;\n")
    said = run("check", tree).stdout.splitlines()
    assert len(said) == 600
    assert sum("did you mean gate" in line for line in said) == 50
    assert all(re.fullmatch(r"[^:]+:\d+:\d+: (error|warning): .+ \[[a-z-]+\]", line) for line in said)
