"""`rvaft check`: what is wrong or doubtful in trees."""

import json

import click

from rvaft.cli.failure import FAILED, FOUND, report
from rvaft.cli.options import standard_input
from rvaft.errors import LanguageError, RvaftError
from rvaft.language.draft import Draft
from rvaft.language.parser import parse_bytes, parse_file
from rvaft.model.nodes import Place
from rvaft.model.values import Json
from rvaft.rules import check
from rvaft.rules.rule import SYNTAX, Finding, Severity
from rvaft.support.terminal import visible


@click.command("check")
@click.argument("trees", nargs=-1, required=True, metavar="TREE...")
@click.option("--strict", is_flag=True, help="Warnings count as errors do.")
@click.option(
    "--format", "form", type=click.Choice(["text", "json"]), default="text", show_default=True, help="What to print."
)
def check_command(*, trees: tuple[str, ...], strict: bool, form: str) -> int:
    """Report what is wrong or doubtful in trees, one finding per line; `rvaft explain CODE` says more.

    The TREE - is standard input.
    """
    findings: list[Finding] = []
    unreadable: list[Finding] = []
    status = 0
    for tree in trees:
        try:
            found = check(_draft(tree))
        except LanguageError as error:
            report(error)
            status = FAILED
            place = Place(error.file, error.line, error.column)
            unreadable.append(Finding(place, Severity.ERROR, SYNTAX, error.message))
            continue
        except OSError as error:
            report(error)
            status = FAILED
            unreadable.append(
                Finding(Place(error.filename, 1, 1), Severity.ERROR, SYNTAX, error.strerror or str(error))
            )
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


def _draft(tree: str) -> Draft:
    if tree != "-":
        return parse_file(tree)
    stream = standard_input("TREE")
    try:
        data = stream.read()
    except OSError as error:
        raise OSError(error.errno, f"cannot read the file: {error.strerror}", "<stdin>") from error
    return parse_bytes(data, "<stdin>")


def _value(finding: Finding) -> dict[str, Json]:
    return {
        "file": finding.place.file,
        "line": finding.place.line,
        "column": finding.place.column,
        "severity": finding.severity.value,
        "code": finding.code,
        "message": finding.message,
    }
