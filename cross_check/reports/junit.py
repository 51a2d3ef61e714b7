"""Results as JUnit XML, which continuous integration shows as tests."""

from collections.abc import Iterable
from itertools import groupby
from xml.etree import ElementTree as ET

from cross_check.reports.text import difference_lines
from cross_check.results import Result, Status

_SKIPPED = (Status.NOT_EXPRESSIBLE, Status.TOO_LARGE, Status.TIMEOUT)


def junit_text(results: Iterable[Result], note: str = "") -> str:
    """One suite per tree and semantics, one test case per participant.

    A disagreement is a failure, what could not run an error, and what a language cannot say or is too large is skipped.
    """
    root = ET.Element("testsuites", name=f"rvaft cross-check{f': {note}' if note else ''}")
    for job, group in groupby(results, key=lambda result: result.job):
        cases = list(group)
        suite = ET.SubElement(root, "testsuite", name=_text(f"{job.title} ({job.semantics})"))
        suite.set("tests", str(len(cases)))
        suite.set("failures", str(sum(case.status is Status.DIFFERS for case in cases)))
        suite.set("errors", str(sum(_erroneous(case) for case in cases)))
        suite.set("skipped", str(sum(case.status in _SKIPPED for case in cases)))
        suite.set("time", f"{sum(case.seconds for case in cases):.3f}")
        for case in cases:
            _case(suite, case)
    ET.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ET.tostring(root, encoding="unicode")}\n'


def _erroneous(result: Result) -> bool:
    return result.status in (Status.COULD_NOT_RUN, Status.TOOL_MISSING)


def _case(suite: ET.Element, result: Result) -> None:
    name = _text(result.participant)
    made = ET.SubElement(suite, "testcase", name=name, classname=_text(f"{result.job.title}.{result.job.semantics}"))
    made.set("time", f"{result.seconds:.3f}")
    if result.status is Status.DIFFERS:
        failure = ET.SubElement(made, "failure", message=_text(result.text))
        failure.text = _text("\n".join(difference_lines(result)))
    elif result.status in _SKIPPED:
        ET.SubElement(made, "skipped", message=_text(result.text))
    elif _erroneous(result):
        ET.SubElement(made, "error", message=_text(result.text))


def _text(text: str) -> str:
    """The text without the control characters that XML cannot hold."""
    return "".join(c if c in "\t\n" or (c.isprintable() or ord(c) > 0x9F) else "\ufffd" for c in text)
