"""Pages of the site that come from the program, and the pages beside the README.

MkDocs calls `on_files` once for each build. These pages are not stored, so they cannot differ from
the program.
"""

import json
import posixpath
import re
import sys
from collections.abc import Set
from html import escape
from pathlib import Path
from typing import Final

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT: Final = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "docs")]  # the checkout, also where another rvaft is installed

import commands  # noqa: E402
from commands import BAR  # noqa: E402
from drawings import style_sheet  # noqa: E402
from playground import ASSETS  # noqa: E402

import rvaft  # noqa: E402
from rvaft.backend import all_backends, backend  # noqa: E402
from rvaft.capabilities import table  # noqa: E402
from rvaft.rules.registry import page as rules  # noqa: E402

CASES: Final = sorted(page.parent.name for page in (ROOT / "trees").glob("*/README.md"))
"""The folders of `trees` that have a page."""
COPIED: Final = {
    "README.md": "index.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
    "SECURITY.md": "security.md",
    **{f"trees/{case}/README.md": f"examples/{case}.md" for case in CASES},
}
"""Files of the checkout that are pages of the site, with their names on the site."""
_LINK: Final = re.compile(r"(?<!!)\[([^\[\]]*)\]\((?!https?:|#)([^)#]*)(#[^)]*)?\)")
_BARS: Final = re.compile(r"`([^`\n]*\\\|[^`\n]*)`")
"""A code span with an escaped bar."""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the generated pages to the files of the site."""
    for name, text in generated().items():
        files.append(File.generated(config, name, content=text))
    for case in CASES:
        picture = (ROOT / "trees" / case / "picture.svg").read_text(encoding="utf-8")
        files.append(File.generated(config, f"examples/{case}.svg", content=picture))
    files.append(File.generated(config, "drawings.css", content=style_sheet()))
    for name, text in (
        ("examples.json", examples()),
        ("program.py", (ROOT / "docs" / "playground_program.py").read_text()),
    ):
        files.append(File.generated(config, f"playground/{name}", content=text))
    for asset in sorted(ASSETS.glob("*")):
        files.append(File.generated(config, f"playground/{asset.name}", abs_src_path=str(asset)))
    return files


def on_page_markdown(markdown: str, *, page: Page, files: Files, **_: object) -> str:
    """Change the links of a page that lead out of the folder `docs`."""
    name = page.file.src_uri
    source = next((source for source, copy in COPIED.items() if copy == name), f"docs/{name}")
    markdown = markdown.replace("```sh\n$ ", "```console\n$ ")  # the lexer tells commands from their output
    return _BARS.sub(_code, linked(markdown, source, name, set(files.src_uris)))


def _code(found: re.Match[str]) -> str:
    """Return a code span of a table as HTML: Python-Markdown shows the backslash before a bar."""
    return f"<code>{escape(found[1].replace(BAR, '|')).replace('|', '&#124;')}</code>"


def linked(text: str, source: str, name: str, known: Set[str]) -> str:
    """Return the text of a page with its links as they are on the site.

    `source` is the file of the page in the checkout and `name` its name on the site. A link to a
    file that is not `known` on the site becomes plain text.
    """

    def link(found: re.Match[str]) -> str:
        words, target, anchor = found[1], found[2], found[3] or ""
        if not target:
            return found[0]
        file = posixpath.normpath(posixpath.join(posixpath.dirname(source), target))
        place = COPIED.get(file, file.removeprefix("docs/"))
        if place not in known:
            return words if (ROOT / file).exists() else found[0]  # a broken link stays, so that MkDocs reports it
        return f"[{words}]({posixpath.relpath(place, posixpath.dirname(name) or '.')}{anchor})"

    text = _LINK.sub(link, text).replace("](picture.svg)", f"]({posixpath.basename(name).removesuffix('.md')}.svg)")
    return text.replace('"docs/', '"').replace("](docs/pictures/", "](pictures/") if source in COPIED else text


def generated() -> dict[str, str]:
    """Return the text of each page that is not stored in `docs`, by its name on the site."""
    copies = {name: (ROOT / source).read_text(encoding="utf-8") for source, name in COPIED.items()}
    return {
        **copies,
        "reference/cli.md": commands.page(),
        "reference/rules.md": rules(),
        "reference/capabilities.md": capabilities(),
        "reference/grammar.md": grammar(),
        "reference/detections.md": detections(),
    }


def detections() -> str:
    """Return the page of the shipped detections, from the folder `trees/detections`."""
    rows = []
    for file in sorted((ROOT / "trees" / "detections").glob("*.rvaft")):
        text, tree = file.read_text(encoding="utf-8"), rvaft.load(file)
        root, about = tree.nodes[tree.root], text.splitlines()[0].removeprefix("// ")
        tags = [tag.removeprefix("attack.") for tag in dict(root.attributes).get("tags", "").split(",")]
        named = ", ".join(tag.upper() if re.fullmatch(r"t[0-9.]+", tag) else tag.replace("-", " ") for tag in tags)
        traces = len(list(file.with_suffix(".traces").glob("*.jsonl")))
        rows.append(f"| `{file.stem}` | {about.replace('|', BAR)} | {named} | {traces} |")
    return "\n".join(
        [
            "# Ready detections",
            "",
            "The folder `trees/detections` has detections to use as they are, or to start from. The first comment of",
            "each says which log it reads. Each has its technique of MITRE ATT&CK, and logs with expected verdicts,",
            "which `rvaft test trees/detections/*.rvaft` compares.",
            "",
            "| tree | detects | ATT&CK | logs |",
            "| --- | --- | --- | --- |",
            *rows,
            "",
            "All of them share the reading of a log: `rvaft monitor trees/detections/ -- LOG --repeat --format ecs`. A",
            "rule for a product: `rvaft emit trees/detections/NAME.rvaft --to sigma`, or `eql`, `kql`, `sql` and",
            "[others](languages/index.md).",
            "",
        ]
    )


EXAMPLES: Final = {
    "Data stolen after a break-in": ("docs/first/break_in.rvaft", "docs/first/break_in.traces/monday.jsonl"),
    "Password guessed over SSH": ("docs/first/ssh_guessed.rvaft", "docs/first/ssh_guessed.traces/*"),
    "Ready detection: five failed passwords": (
        "trees/detections/ssh_guessing.rvaft",
        "trees/detections/ssh_guessing.traces/four.jsonl",
    ),
    "A lost heartbeat": ("trees/absence/watchdog.rvaft", "trees/absence/watchdog.traces/*"),
    "A robot in a nuclear plant": (
        "trees/remote_inspection/pruned.rvaft",
        "trees/remote_inspection/pruned.traces/table2_row3.jsonl",
    ),
    "Rupture of a pressure tank": ("trees/pressure_tank/tank.rvaft", "trees/pressure_tank/tank.traces/*"),
}
"""The examples of the playground: a tree and a log, or the first log of a folder."""


def examples() -> str:
    """Return the examples of the playground, as JSON."""
    found = []
    for name, (tree, log) in EXAMPLES.items():
        first = min(ROOT.glob(log))
        texts = {"tree": (ROOT / tree).read_text(encoding="utf-8"), "log": first.read_text(encoding="utf-8")}
        scattered = "semantics" not in texts["tree"] and tree.startswith("docs/first")
        found.append({"name": name, **texts, "semantics": "scattered" if scattered else ""})
    return json.dumps(found)


def grammar() -> str:
    """Return the page with the grammar of the tree language."""
    text = (ROOT / "rvaft" / "language" / "grammar.lark").read_text(encoding="utf-8")
    return (
        "# Grammar\n\nThe grammar of the [tree language](language.md), in the notation of Lark. It is LALR(1); the "
        f"lexer\nknows which terminals can stand at a place.\n\n```text\n{text}```\n"
    )


def capabilities() -> str:
    """Return the table of what each language can express."""
    found = {name: one for name in all_backends() if (one := backend(name)).form_of is None}
    header, *rows = table({name: one.capabilities() for name, one in found.items()})
    lines = [f"| {' | '.join(map(commands.cell, row))} |" for row in (header, ["---"] * len(header), *rows)]
    return (
        "---\nhide: [toc]\n---\n\n"
        "# Capabilities\n\nWhat each backend lists, as `rvaft backends --capabilities` prints it. A tree that needs "
        "something\nelse is refused with the reason. A backend may refuse a combination of things that it lists.\n\n"
        + "\n".join(lines)
        + "\n"
    )
