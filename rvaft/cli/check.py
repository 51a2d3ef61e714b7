"""`rvaft check`: what is wrong or doubtful in trees, as text, JSON, annotations of GitHub or SARIF."""

import json
from collections.abc import Callable, Sequence
from pathlib import PurePath
from typing import Final
from urllib.parse import quote

import click

import rvaft
from rvaft.cli.failure import FAILED, FOUND, report
from rvaft.cli.options import standard_bytes
from rvaft.errors import LanguageError, RvaftError
from rvaft.language.parser import NoTree, parse_bytes, parse_file
from rvaft.model.nodes import Place
from rvaft.rules import check, meanings
from rvaft.rules.registry import SYNTAX
from rvaft.rules.rule import Finding, Severity
from rvaft.support.terminal import visible


@click.command("check")
@click.argument("trees", nargs=-1, required=True, metavar="TREE...")
@click.option("--strict", is_flag=True, help="Warnings count as errors do.")
@click.option(
    "--format",
    "form",
    type=click.Choice(["text", "json", "github", "sarif"]),
    default="text",
    show_default=True,
    help="What to print: github are annotations of a workflow, sarif is SARIF 2.1.0.",
)
def check_command(*, trees: tuple[str, ...], strict: bool, form: str) -> int:
    """Report what is wrong or doubtful in trees, one finding per line; `rvaft explain CODE` says more.

    The TREE - is standard input. A file that only declares what trees import has nothing to be checked.
    """
    findings: list[Finding] = []
    unreadable: list[Finding] = []
    status = 0
    for tree in trees:
        try:
            draft = parse_bytes(standard_bytes("TREE"), "<stdin>") if tree == "-" else parse_file(tree)
            found = check(draft)
        except (RvaftError, OSError) as error:
            if isinstance(error, NoTree) and error.is_part:
                continue
            report(error)
            status = FAILED
            if isinstance(error, LanguageError):
                place = Place(error.file, error.line, error.column)
                unreadable.append(Finding(place, Severity.ERROR, SYNTAX, error.message))
            elif isinstance(error, OSError):
                message = error.strerror or str(error)
                unreadable.append(Finding(Place(error.filename, 1, 1), Severity.ERROR, SYNTAX, message))
            continue
        findings += found
        if form == "text":
            for finding in found:
                click.echo(visible(str(finding)))
    if form != "text":
        click.echo(_FORMS[form](findings + unreadable), nl=form != "github")
    serious = any(strict or finding.severity is Severity.ERROR for finding in findings)
    return max(status, FOUND if serious else 0)


def _json(findings: Sequence[Finding]) -> str:
    """A list of objects."""
    return json.dumps(
        [
            {
                **finding.place._asdict(),
                "severity": finding.severity.value,
                "code": finding.code,
                "message": finding.message,
            }
            for finding in findings
        ],
        indent=2,
    )


_IN_MESSAGES: Final = str.maketrans({"%": "%25", "\r": "%0D", "\n": "%0A"})
_IN_PROPERTIES: Final = _IN_MESSAGES | str.maketrans({":": "%3A", ",": "%2C"})


def _github(findings: Sequence[Finding]) -> str:
    """A command of a workflow for each, which shows it at its line."""
    lines = []
    for finding in findings:
        file, line, column = finding.place
        where = f"file={file.translate(_IN_PROPERTIES)},line={line},col={column},title=rvaft {finding.code}"
        message = f"{finding.message} [{finding.code}]".translate(_IN_MESSAGES)
        lines.append(f"::{finding.severity} {where}::{visible(message)}\n")
    return "".join(lines)


def _sarif(findings: Sequence[Finding]) -> str:
    """One run, with the rules that are broken."""
    titles = {code: meanings()[code].title for code in sorted({finding.code for finding in findings})}
    driver = {
        "name": "rvaft",
        "version": rvaft.__version__,
        "rules": [{"id": code, "shortDescription": {"text": title}} for code, title in titles.items()],
    }
    results = [
        {
            "ruleId": finding.code,
            "level": finding.severity.value,
            "message": {"text": finding.message},
            "locations": [
                {
                    "physicalLocation": {
                        "artifactLocation": {"uri": quote(PurePath(finding.place.file).as_posix())},
                        "region": {"startLine": finding.place.line, "startColumn": finding.place.column},
                    }
                }
            ],
        }
        for finding in findings
    ]
    run = {"tool": {"driver": driver}, "columnKind": "unicodeCodePoints", "results": results}
    schema = "https://json.schemastore.org/sarif-2.1.0.json"
    return json.dumps({"$schema": schema, "version": "2.1.0", "runs": [run]}, indent=2)


_FORMS: Final[dict[str, Callable[[Sequence[Finding]], str]]] = {"json": _json, "github": _github, "sarif": _sarif}
