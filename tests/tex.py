"""LaTeX in tests: whether a text is sound on its face, and, where TeX is installed, whether it compiles."""

import re
import shutil
import subprocess
from pathlib import Path
from typing import Final

import pytest

needs_tex: Final = pytest.mark.skipif(
    shutil.which("pdflatex") is None, reason="needs pdflatex (apt-get install texlive-latex-extra texlive-pictures)"
)
_COMMAND: Final = re.compile(r"\\(?:[A-Za-z]+\*?|.)", re.DOTALL)
_COMMENT: Final = re.compile(r"^%.*\n", re.MULTILINE)
_INDEX: Final = re.compile(
    r"[_^](?=\{)|(?<=\{)[_^](?=.\})"
)  # `\ensuremath{^4}` is a raised 4 without anything below it
ENVIRONMENT: Final = re.compile(r"\\(?:begin|end)\{[a-z]+\*?\}")


def unsound(text: str, *, allowed: str = "") -> str | None:
    r"""What is wrong with the LaTeX of a formula: a special character that stands there raw, or
    brackets that do not balance.

    Whole lines of comments and `\begin{…}` are left out; `allowed` are special characters that may stand there.
    """
    bare = _COMMENT.sub("", text)
    if "\\\\[" in re.sub(r"\s", "", bare):
        return "a row that starts with [ would be an argument of the line end"
    for left, right in (r"\left", r"\right"), (r"\begin", r"\end"):
        if len(re.findall(re.escape(left) + r"(?![a-z])", bare)) != len(
            re.findall(re.escape(right) + r"(?![a-z])", bare)
        ):
            return f"{left} without {right}"
    rest = _INDEX.sub("", _COMMAND.sub("", ENVIRONMENT.sub("", bare)))
    raw = sorted(set("#$%&~^_\"'`<>|") & set(re.sub(r"``|''|[<>]", "", rest)) - set(allowed))
    if raw:
        return f"raw {raw}"
    depth = 0
    for character in rest:
        depth += (character == "{") - (character == "}")
        if depth < 0:
            return "a } too many"
    return "a { too many" if depth else None


def compiled(body: str, folder: Path, *packages: str) -> str:
    """Compile a document with this body; what TeX says, fails if that is an error."""
    head = [r"\documentclass{article}", *(rf"\usepackage{{{package}}}" for package in packages), r"\begin{document}"]
    # Draft mode embeds no fonts: a small TeX has not all of them as outlines.
    return document("\n".join([*head, body, r"\end{document}", ""]), folder, "-draftmode")


def document(text: str, folder: Path, *options: str) -> str:
    """Compile a whole document to test.pdf in the folder; what TeX says, fails if that is an error."""
    (folder / "test.tex").write_text(text, encoding="utf-8")
    command = ["pdflatex", *options, "-interaction=nonstopmode", "-halt-on-error", "-no-shell-escape", "test.tex"]
    done = subprocess.run(command, cwd=folder, capture_output=True, check=False, timeout=120)
    said = done.stdout.decode(errors="replace")
    assert done.returncode == 0, said[-3000:]
    return said
