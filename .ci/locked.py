"""Print the locked requirements of some extras, or of the group `build`, with their hashes.

`python .ci/locked.py dev | pip install --require-hashes --no-deps -r /dev/stdin`. The lock file,
which `make lock` writes, names below each package the packages that need it.
"""

import re
import sys
import tomllib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final

HERE: Final = Path(__file__).parent
BUILD: Final = "build"
_NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")


def normal(requirement: str) -> str:
    """Return the normalised name of the package of a requirement."""
    found = _NAME.match(requirement)
    if found is None:
        raise SystemExit(f"not a requirement: {requirement}")
    return re.sub(r"[-_.]+", "-", found[0]).lower()


def entries() -> dict[str, tuple[list[str], set[str]]]:
    """Return the lines of each locked package, one for each marker, and who needs it."""
    found: dict[str, tuple[list[str], set[str]]] = {}
    lines, parents = list[str](), set[str]()
    for line in (HERE / "requirements.txt").read_text(encoding="utf-8").splitlines():
        if line.strip() and not line.startswith((" ", "#")):
            lines, parents = found.setdefault(normal(line), ([], set()))
            lines.append(line)
        elif line.strip().startswith("--hash="):
            lines.append(line)
        elif line.startswith("    #") and (parent := line.strip("# ").removeprefix("via").strip()):
            parents.add(normal(parent))
    return found


def roots(chosen: Iterable[str]) -> set[str]:
    """Return the direct requirements of rvaft with these extras, or of the group `build`."""
    project = tomllib.loads((HERE.parent / "pyproject.toml").read_text(encoding="utf-8"))
    extras = project["project"]["optional-dependencies"]
    found: list[str] = []
    for name in chosen:
        if name == BUILD:
            found += project["dependency-groups"][BUILD]
            continue
        if name and name not in extras:
            raise SystemExit(f"rvaft has no extra {name}; known: {', '.join(extras)}")
        found += [*project["project"]["dependencies"], *extras.get(name, ())]
    return {normal(one) for one in found}


def locked(chosen: Iterable[str]) -> Iterator[str]:
    """Yield the lines of the packages that the chosen extras need; an empty name is no extra."""
    every, wanted = entries(), set[str]()
    agenda = sorted(roots(chosen))
    while agenda:
        name = agenda.pop()
        if name not in every:
            raise SystemExit(f"the lock file lacks {name}: write it anew with make lock")
        if name not in wanted:
            wanted.add(name)
            agenda += [other for other, (_, parents) in every.items() if name in parents]
    for name in sorted(wanted):
        yield from every[name][0]


if __name__ == "__main__":
    print("\n".join(locked(one.strip() for argument in sys.argv[1:] or [""] for one in argument.split(","))))
