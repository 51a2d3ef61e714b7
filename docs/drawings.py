"""Trees as SVG in the colours of the report page, light and dark."""

import re
from typing import Final

import rvaft
from rvaft.export.svg import svg_text
from rvaft.reports.log_report import PAGE
from rvaft.reports.page import template

THEMES: Final = ("light", "dark")
_VARIABLE: Final = re.compile(r"--(\w+): light-dark\(([^,]+), ([^)]+)\)")


def style(theme: str) -> str:
    """Return the rules of the report page for trees, with the colours of a theme."""
    text = template(PAGE)
    colours = {name: dark if theme == "dark" else light for name, light, dark in _VARIABLE.findall(text)}
    rules = "\n".join(line for line in text.splitlines() if line.startswith("svg "))
    return re.sub(r"var\(--(\w+)\)", lambda found: colours[found[1]], rules)


def styled(svg: str, rules: str) -> str:
    """Return an SVG with a style sheet."""
    head, body = svg.split(">", 1)
    return f"{head}><style>\n{rules}\n</style>{body}"


def adaptive(svg: str, light: str, dark: str) -> str:
    """Return an SVG with the style sheet for the colour scheme that the viewer prefers."""
    return styled(svg, f"{light}\n@media (prefers-color-scheme: dark) {{\n{dark}\n}}")


def drawing(tree: rvaft.RVAFT, theme: str) -> str:
    """Return a tree as SVG in the colours of a theme, without a background."""
    return styled(svg_text(tree), style(theme))


def both(tree: rvaft.RVAFT) -> str:
    """Return a tree as SVG in the colours that the viewer prefers."""
    return adaptive(svg_text(tree), style("light"), style("dark"))


def style_sheet() -> str:
    """Return the rules for the drawing on the playground page, for both colour schemes of the site."""
    light = style("light").replace("svg ", "#pg-drawing svg ")
    dark = style("dark").replace("svg ", "[data-md-color-scheme=slate] #pg-drawing svg ")
    return f"{light}\n{dark}\n"
