"""The page of `make trust`: it has every case and every fault, and says what is wrong."""

from pathlib import Path

import pytest

from cross_check.participants import ENGINE, REFERENCE
from rvaft import RVAFT, Verdict
from tests.faults import trust
from tests.faults.wrong_trees import MISTAKES
from tests.semantics.cases import CASES, Case

ROOT = Path(__file__).parents[2]
SECTIONS = [*trust.sections()]


def test_each_case_is_in_a_section_and_other_sections_are_tested_elsewhere() -> None:
    assert [case for section in SECTIONS for case in section.cases] == CASES
    assert [
        file for files in trust.ELSEWHERE.values() for file in files.split(", ") if not (ROOT / file).exists()
    ] == []


@pytest.mark.ci
def test_the_page_has_what_is_right_and_the_faults_that_are_found() -> None:
    (absent,) = (section for section in SECTIONS if section.title == "absent events")
    lines, right = trust.page([REFERENCE, ENGINE], [absent])
    assert right
    row, faults, _, told, *_ = lines[len(trust.LEGEND) + 2 :]
    assert row.split() == ["1.5,", "3.6,", "4.7", "absent", "events", *[str(len(absent.cases))] * 3]
    found, of = map(int, faults.split()[-1].split("/"))
    assert (found == of, told) == (True, "every verdict that is owed is right")
    assert "a `without` ignored" not in lines[-1]


def test_a_wrong_participant_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def wrong(name: str, case: Case, tree: RVAFT) -> tuple[list[Verdict], list[Verdict]]:
        return [Verdict.TRUE], [Verdict.TRUE if name == REFERENCE else Verdict.UNKNOWN]

    monkeypatch.setattr(trust, "answer", wrong)
    assert trust.judged([REFERENCE, ENGINE], CASES[0]) == {REFERENCE: "right", ENGINE: "wrong"}


@pytest.mark.slow
def test_every_fault_is_shown_by_a_case() -> None:
    lines, right = trust.page([REFERENCE], SECTIONS)
    assert right
    assert f" {len(MISTAKES)}/{len(MISTAKES)} " in "\n".join(lines)
