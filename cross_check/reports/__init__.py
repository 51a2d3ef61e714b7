"""Results for people, spreadsheets and continuous integration."""

from cross_check.reports.formats import csv_text, json_text
from cross_check.reports.junit import junit_text
from cross_check.reports.markdown import markdown_text
from cross_check.reports.text import difference_lines, result_lines, summary_lines
from cross_check.reports.totals import Totals

__all__ = [
    "Totals",
    "csv_text",
    "difference_lines",
    "json_text",
    "junit_text",
    "markdown_text",
    "result_lines",
    "summary_lines",
]
