"""`python -m papers.proofs`: write `figures.tex`, the figures of `section.tex`.

They are counted from the Coq files that `make proofs` has accepted. The exit status is 2 if a file
is not compiled, or if coqchk has not confirmed that there are no axioms.
"""

import re
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Final

FOLDER: Final = Path(__file__).parent
PROOFS: Final = FOLDER.parents[1] / "proofs"
PARTS: Final[Mapping[str, tuple[str, ...]]] = {
    "Meaning": ("Values", "Language", "Definition"),
    "Monitor": (
        "Search",
        "Conditions",
        "Scenarios",
        "Waiting",
        "Absences",
        "Pruning",
        "Keys",
        "Monitor",
        "Verdicts",
        "Normal",
    ),
}
"""The files of the definition and of the monitor; all others are about translations."""


def listed() -> list[str]:
    """Return the names of the files that Coq compiles, without suffix."""
    return re.findall(r"(?m)^(\w+)\.v$", (PROOFS / "_CoqProject").read_text(encoding="utf-8"))


def missing() -> list[str]:
    """Return the files that Coq has not accepted in their present state."""
    compiled = {name: PROOFS / f"{name}.vo" for name in listed()}
    source = {name: PROOFS / f"{name}.v" for name in compiled}
    return [
        name
        for name, file in compiled.items()
        if not file.is_file() or file.stat().st_mtime < source[name].stat().st_mtime
    ]


def figures() -> dict[str, int]:
    """Return the figures by macro name: lines of statements and of proofs, theorems and lemmas."""
    parts = {
        **PARTS,
        "Translation": tuple(name for name in listed() if not any(name in part for part in PARTS.values())),
    }
    found: dict[str, int] = {}
    for part, names in parts.items():
        files = [PROOFS / f"{name}.v" for name in names]
        counted = subprocess.run(  # noqa: S603 (the files of this checkout)
            ["coqwc", *files],  # noqa: S607 (a program of Coq)
            capture_output=True,
            text=True,
            check=True,
        ).stdout.splitlines()
        statements, proofs, *_ = (int(word) for word in re.findall(r"\d+", counted[-1]))
        texts = [file.read_text(encoding="utf-8") for file in files]
        theorems = sum(len(re.findall(r"(?m)^(?:Theorem|Corollary) ", text)) for text in texts)
        lemmas = sum(len(re.findall(r"(?m)^Lemma ", text)) for text in texts)
        found |= {f"{part}Statements": statements, f"{part}Proofs": proofs}
        found |= {f"{part}Theorems": theorems, f"{part}Lemmas": lemmas}
    driver = sum(len(file.read_text(encoding="utf-8").splitlines()) for file in (PROOFS / "monitor").glob("*.ml"))
    return {**found, "Trusted": driver, "Files": len(listed())}


def text(values: Mapping[str, int]) -> str:
    """Return the LaTeX macros, one per figure."""
    macros = (f"\\newcommand{{\\proof{name}}}{{{value:,}}}\n" for name, value in values.items())
    return "% Written by python -m papers.proofs\n" + "".join(macros).replace(",", "{,}")


def main() -> int:
    """Write the figures; return the exit status."""
    context = PROOFS / "build" / "context"
    if absent := missing():
        sys.stderr.write(f"papers.proofs: error: Coq has not accepted {', '.join(absent)}; run `make proofs`\n")
        return 2
    if not context.is_file() or "Axioms: <none>" not in context.read_text(encoding="utf-8"):
        sys.stderr.write("papers.proofs: error: coqchk has not confirmed the proofs; run `make proofs`\n")
        return 2
    (FOLDER / "figures.tex").write_text(text(figures()), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
