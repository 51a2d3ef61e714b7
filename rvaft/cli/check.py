"""`rvaft check`: findings about trees as text, JSON, GitHub annotations or SARIF; and `rvaft
explain`.
"""

import sys
from collections.abc import Callable, Sequence
from pathlib import PurePath
from typing import Final
from urllib.parse import quote

import click

import rvaft
from rvaft.cli import FAILED, FOUND, options, painted, report
from rvaft.errors import LanguageError, RvaftError
from rvaft.language.parser import NoTree
from rvaft.model.nodes import Place
from rvaft.rules.registry import RULES, SYNTAX, check, explain, meanings
from rvaft.rules.rule import Finding, Severity
from rvaft.support.terminal import columns, inert, readable_json, visible

_FORMATS: Final = "Output format; github prints workflow annotations, sarif prints SARIF 2.1.0."


@click.command("check")
@click.argument("trees", nargs=-1, required=True, metavar="TREE...")
@options.reading_options
@click.option("--strict", is_flag=True, help="Exit with status 1 on warnings, too.")
@options.output_format("text", "json", "github", "sarif", text=_FORMATS)
def check_command(*, trees: tuple[str, ...], strict: bool, form: str) -> int:
    """Report errors and doubtful parts of trees, one finding per line. `rvaft explain CODE`
    explains a finding.

    Use - as TREE for standard input. Files that only declare events for import are skipped.
    """
    findings: list[Finding] = []
    unreadable: list[Finding] = []
    status = 0
    for tree in trees:
        try:
            found = check(options.read_draft(tree))
        except (RvaftError, OSError) as error:
            if isinstance(error, NoTree) and error.is_part:
                continue
            report(error)
            status = FAILED
            if isinstance(error, LanguageError):
                place, message = Place(error.file, error.line, error.column), error.message
            elif isinstance(error, OSError):
                place, message = Place(error.filename, 1, 1), error.strerror or str(error)
            else:
                continue
            unreadable.append(Finding(place, Severity.ERROR, SYNTAX, message))
            continue
        findings += found
        if form == "text":
            for finding in found:
                severity = finding.severity.value
                click.echo(painted(inert(visible(str(finding))), f" {severity}: ", severity, sys.stdout))
    if form != "text":
        click.echo(_FORMS[form](findings + unreadable), nl=form != "github")
    serious = any(finding.severity in {Severity.ERROR, *([Severity.WARNING] * strict)} for finding in findings)
    return max(status, FOUND if serious else 0)


def _json(findings: Sequence[Finding]) -> str:
    records = [
        {**one.place._asdict(), "severity": one.severity.value, "code": one.code, "message": one.message}
        for one in findings
    ]
    return readable_json(records, indent=2)


_IN_MESSAGES: Final = str.maketrans({"%": "%25", "\r": "%0D", "\n": "%0A"})
_IN_PROPERTIES: Final = _IN_MESSAGES | str.maketrans({":": "%3A", ",": "%2C"})


def _github(findings: Sequence[Finding]) -> str:
    lines = []
    for finding in findings:
        file, line, column = finding.place
        where = f"file={visible(file).translate(_IN_PROPERTIES)},line={line},col={column},title=rvaft {finding.code}"
        message = f"{finding.message} [{finding.code}]".translate(_IN_MESSAGES)
        level = "notice" if finding.severity is Severity.INFORMATION else finding.severity
        lines.append(f"::{level} {where}::{visible(message)}\n")
    return "".join(lines)


def _sarif(findings: Sequence[Finding]) -> str:
    results = []
    for finding in findings:
        file, line, column = finding.place
        artifact, region = {"uri": quote(PurePath(file).as_posix())}, {"startLine": line, "startColumn": column}
        place = {"physicalLocation": {"artifactLocation": artifact, "region": region}}
        level = "note" if finding.severity is Severity.INFORMATION else finding.severity.value
        result = {"ruleId": finding.code, "level": level, "message": {"text": finding.message}}
        results.append({**result, "locations": [place]})
    codes = sorted({finding.code for finding in findings})
    rules = [{"id": code, "shortDescription": {"text": meanings()[code].title}} for code in codes]
    driver = {"name": "rvaft", "version": rvaft.__version__, "rules": rules}
    run = {"tool": {"driver": driver}, "columnKind": "unicodeCodePoints", "results": results}
    schema = "https://json.schemastore.org/sarif-2.1.0.json"
    return readable_json({"$schema": schema, "version": "2.1.0", "runs": [run]}, indent=2)


_FORMS: Final[dict[str, Callable[[Sequence[Finding]], str]]] = {"json": _json, "github": _github, "sarif": _sarif}


@click.command("explain")
@click.argument("code", metavar="[CODE]", required=False)
def explain_command(*, code: str | None) -> int:
    """Explain the CODE of a finding: its meaning, a tree with the finding, and a corrected tree.

    Without CODE, list all codes.
    """
    if code is None:
        severity = {code: rule.severity.value for code, rule in RULES.items()}
        rows = [(code, severity.get(code, "error"), meaning.title) for code, meaning in meanings().items()]
        click.echo("\n".join(columns([("CODE", "SEVERITY", "MEANS"), *sorted(rows)])))
    else:
        click.echo(explain(code).rstrip("\n"))
    return 0
