"""`rvaft check`: what is wrong or doubtful in trees."""

import json

import click

from rvaft.cli.explain import SYNTAX
from rvaft.cli.failure import FAILED, FOUND, report
from rvaft.errors import LanguageError, RvaftError
from rvaft.findings import Finding, Severity
from rvaft.language import parse_file
from rvaft.model import Place
from rvaft.printable import visible
from rvaft.rules import check
from rvaft.values import Json


@click.command("check")
@click.argument("trees", nargs=-1, required=True, metavar="TREE...")
@click.option("--strict", is_flag=True, help="Warnings count as errors do.")
@click.option(
    "--format", "form", type=click.Choice(["text", "json"]), default="text", show_default=True, help="What to print."
)
def command(*, trees: tuple[str, ...], strict: bool, form: str) -> int:
    """Report what is wrong or doubtful in trees, one finding per line; `rvaft explain CODE` says more."""
    findings: list[Finding] = []
    unreadable: list[Finding] = []
    status = 0
    for tree in trees:
        try:
            found = check(parse_file(tree))
        except LanguageError as error:
            report(error)
            status = FAILED
            place = Place(error.file, error.line, error.column)
            unreadable.append(Finding(place, Severity.ERROR, SYNTAX, error.message))
            continue
        except RvaftError as error:
            report(error)
            status = FAILED
            continue
        findings += found
        if form == "text":
            for finding in found:
                click.echo(visible(str(finding)))
    if form == "json":
        click.echo(json.dumps([_value(finding) for finding in findings + unreadable], indent=2))
    serious = any(strict or finding.severity is Severity.ERROR for finding in findings)
    return max(status, FOUND if serious else 0)


def _value(finding: Finding) -> dict[str, Json]:
    return {
        "file": finding.place.file,
        "line": finding.place.line,
        "column": finding.place.column,
        "severity": finding.severity.value,
        "code": finding.code,
        "message": finding.message,
    }
