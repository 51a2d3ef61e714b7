"""Write the pictures of the documentation: trees as SVG, the report page as PNG, each light and dark.

`make pictures` runs this script. It needs Chromium and its driver for the page.
"""

import os
import shutil
import sys
import tempfile
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from drawings import THEMES, adaptive, both, drawing
from selenium import webdriver

import rvaft
from rvaft import Semantics, Verdict
from rvaft.cli import main

ROOT: Final = Path(__file__).parents[1]
PICTURES: Final = ROOT / "docs" / "pictures"
TREE: Final = "docs/first/break_in.rvaft"
LOG: Final = "docs/first/break_in.traces/monday.jsonl"
CASES: Final = {
    "absence": "watchdog",
    "cloudtrail": "takeover",
    "greenhouse": "frost",
    "journald": "root_shell",
    "multiprocessor": "halt",
    "orders": "unpaid",
    "pipeline": "pollution",
    "pressure_tank": "tank",
    "remote_inspection": "pruned",
    "ssh": "guessed",
    "vehicle": "takeover",
}
"""The tree that is drawn for each case in `trees`."""
WORDS: Final = ("x a x b", "a x b", "b a b", "a a b")
"""The logs of the picture of the four semantics; its tree is `top sand a b` with the events a and b."""
_SETTINGS: Final = ("headless=new", "no-sandbox", "disable-gpu", "window-size=1180,860", "hide-scrollbars")


def cases() -> dict[Path, str]:
    """Return the picture of each case by its file."""
    folders = {ROOT / "trees" / folder: name for folder, name in CASES.items()}
    return {folder / "picture.svg": both(rvaft.load(folder / f"{name}.rvaft")) for folder, name in folders.items()}


def semantics() -> str:
    """Return the picture of the four semantics: which events of a log the match of a tree uses."""
    tree = rvaft.load(ROOT / "docs" / "first" / "two.rvaft")
    parts = []
    for row, kind in enumerate(Semantics):
        parts.append(f'<text class="word" x="8" y="{62 + 40 * row}">{kind.value}</text>')
        for column, word in enumerate(WORDS):
            left = 150 + 150 * column
            if row == 0:
                parts.extend(
                    f'<text class="word" x="{left + 24 * place}" y="24" text-anchor="middle">{name}</text>'
                    for place, name in enumerate(word.split())
                )
            parts.extend(_cell(tree, kind, word.split(), left, 56 + 40 * row))
    svg = (
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 740 190" role="img" font-size="15" '
        f'font-family="system-ui, sans-serif">{"".join(parts)}</svg>\n'
    )
    return adaptive(svg, _mark_style("#333", "#1f5fbf", "#b3261e"), _mark_style("#ddd", "#7fb0ff", "#f28b82"))


def _mark_style(text: str, mark: str, rejected: str) -> str:
    """Return the rules for the classes of `semantics`, in three colours."""
    return (
        f".word {{ fill: {text} }} .used {{ fill: {mark} }} .rejected {{ fill: {rejected} }}\n"
        f".unused {{ fill: none; stroke: {mark}; stroke-width: 2 }}"
    )


def _cell(tree: rvaft.RVAFT, kind: Semantics, names: list[str], left: int, middle: int) -> Iterator[str]:
    """Yield the marks of one log under one semantics, up to the event that decides, and the verdict."""
    monitor = rvaft.monitor(tree, semantics=kind)
    verdicts = list(monitor.run({"event": name} for name in names))
    explanation = monitor.explanation
    used = {place for places in explanation.events.values() for place in places} if explanation else set()
    for place, (name, verdict) in enumerate(zip(names, verdicts, strict=True), start=1):
        x = left + 24 * (place - 1)
        if name in ("a", "b") or kind is Semantics.STRICT:
            mark = "used" if place in used else "unused"
            yield f'<rect class="{mark}" x="{x - 7}" y="{middle - 7}" width="14" height="14"/>'
        else:
            yield f'<circle class="word" cx="{x}" cy="{middle}" r="3"/>'
        if verdict is not Verdict.UNKNOWN:
            colour = "used" if verdict is Verdict.TRUE else "rejected"
            yield f'<text class="{colour}" x="{x + 18}" y="{middle + 6}">{verdict.symbol}</text>'
            return


def badge(label: str, value: str) -> str:
    """Return a badge as SVG."""
    left, right = (10 + 7 * len(word) for word in (label, value))
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{left + right}" height="20" role="img" '
        f'aria-label="{label}: {value}"><rect width="{left}" height="20" fill="#555"/>'
        f'<rect x="{left}" width="{right}" height="20" fill="#1f5fbf"/>'
        f'<g fill="#fff" text-anchor="middle" font-family="Verdana,DejaVu Sans,sans-serif" font-size="11">'
        f'<text x="{left / 2}" y="14">{label}</text><text x="{left + right / 2}" y="14">{value}</text></g></svg>\n'
    )


def badges() -> dict[str, str]:
    """Return the badges by file name, from what `pyproject.toml` states."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return {
        "licence.svg": badge("licence", project["license"]),
        "python.svg": badge("python", project["requires-python"].removeprefix(">=") + " or newer"),
    }


def screenshots() -> None:
    """Write the report page of the first log as PNG."""
    program, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if program is None or driver is None:
        sys.exit("the picture of the report page needs chromium and chromium-driver")
    options = webdriver.ChromeOptions()
    options.binary_location = program
    for setting in _SETTINGS:
        options.add_argument(f"--{setting}")
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "page.html"
        main(["report", TREE, LOG, "-o", str(page)], standalone_mode=False)
        browser = webdriver.Chrome(options=options, service=webdriver.ChromeService(driver))
        try:
            for theme in THEMES:
                media = {"features": [{"name": "prefers-color-scheme", "value": theme}]}
                browser.execute_cdp_cmd("Emulation.setEmulatedMedia", media)
                browser.get(page.as_uri())
                browser.find_element("tag name", "body").send_keys("\ue010")  # the key End: after the last event
                browser.save_screenshot(str(PICTURES / f"report-{theme}.png"))
        finally:
            browser.quit()


if __name__ == "__main__":
    os.chdir(ROOT)
    PICTURES.mkdir(exist_ok=True)
    for theme in THEMES:
        (PICTURES / f"break_in-{theme}.svg").write_text(drawing(rvaft.load(TREE), theme), encoding="utf-8")
    for name, text in badges().items():
        (PICTURES / name).write_text(text, encoding="utf-8")
    (PICTURES / "semantics.svg").write_text(semantics(), encoding="utf-8")
    for file, text in cases().items():
        file.write_text(text, encoding="utf-8")
    screenshots()
