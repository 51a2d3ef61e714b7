"""The examples of README and docs: `sh` blocks in which a line that starts with `$ ` is a command
and what follows its output.

`python -m tests.docs.examples` writes the outputs anew; look at the difference before you commit it.
"""

import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from click.testing import CliRunner

from rvaft.cli import main

ROOT = Path(__file__).parents[2]
BLOCK = re.compile(r"^```(sh|python)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
SETUP = re.compile(r"^(make|pip|git clone|python3? -m venv|source) ?")
"""Commands that set up a machine; the tests run inside the result."""

ALONE = re.compile(
    r"""(?:(?P<before>(?:printf|echo) [^|]+) \| )?rvaft (?![^|]*/dev/)"""
    r"""(?P<words>(?:'[^']*'|"[^"$`]*"|[^|;&<>$*`("'])+)"""
    r"""(?:\| (?P<rest>.+)|(?P<status>; echo "exit status \$\?"))?"""
)
"""What writes its input, the command, and then what filters its output or says its status."""


@dataclass(frozen=True)
class Block:
    """One block of code in a page."""

    page: Path
    line: int
    language: str
    text: str

    def __str__(self) -> str:
        return f"{self.page.relative_to(ROOT)}:{self.line}"


def pages() -> list[Path]:
    """README and the documentation."""
    return [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")), *sorted((ROOT / "trees").glob("*/README.md"))]


def blocks(language: str) -> Iterator[Block]:
    """All blocks in a language."""
    for page in pages():
        text = page.read_text(encoding="utf-8")
        for found in BLOCK.finditer(text):
            if found[1] == language:
                yield Block(page, text[: found.start()].count("\n") + 1, language, found[2])


def commands(block: str) -> list[tuple[str, str]]:
    """The commands of a block, each with the output that it shows."""
    found: list[tuple[str, str]] = []
    for line in block.splitlines(keepends=True):
        if line.startswith("$ "):
            found.append((line[2:].strip(), ""))
        else:
            found[-1] = (found[-1][0], found[-1][1] + line)
    return found


def run(command: str, data: str = "") -> str:
    """What a command prints, errors included: as a shell runs it, or, to spare a start, here where
    it needs no shell.
    """
    environment = {"LC_ALL": "C.UTF-8", "COLUMNS": "100", "NO_COLOR": "1"}
    if (found := ALONE.fullmatch(command)) is not None:
        data = run(found["before"]) if found["before"] else data
        result = CliRunner().invoke(main, shlex.split(found["words"]), input=data, env=environment)
        if found["rest"]:
            return result.stderr + run(found["rest"], result.stdout)
        return result.output + (f"exit status {result.exit_code}\n" if found["status"] else "")
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "-c", command],
        env={**os.environ, "PATH": path, **environment},
        input=data,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        encoding="utf-8",
        timeout=120,
        check=False,
    )
    return done.stdout


def rewritten(text: str) -> str:
    """The page with every output as it is now."""

    def block(found: re.Match[str]) -> str:
        if found[1] != "sh" or not found[2].startswith("$ "):
            return found[0]
        parts = [
            f"$ {command}\n" + (output if SETUP.match(command) else run(command))
            for command, output in commands(found[2])
        ]
        return f"```sh\n{''.join(parts)}```"

    return BLOCK.sub(block, text)


if __name__ == "__main__":
    os.chdir(ROOT)
    for path in pages():
        path.write_text(rewritten(path.read_text(encoding="utf-8")), encoding="utf-8")
