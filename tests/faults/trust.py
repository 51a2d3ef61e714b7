"""What is checked, on one page: sections of the definition by participants, and the faults that are found.

`make trust` prints it. The cases are the rows of `tests/semantics/cases.txt`, whose verdicts are written by hand;
the faults are those of `wrong_trees.py`: a participant with a fault is one that was given another tree.
"""

import os
import re
import sys
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Final, NamedTuple

from cross_check.judges import VERIFIED, verified_of
from cross_check.participants import (
    ENGINE,
    REFERENCE,
    Enlisted,
    Outside,
    Participant,
    detections,
    engine_of,
    faithful_backends,
    leaves_open,
    reference_of,
    reports_detections_only,
    translated,
    verdicts_of,
)
from rvaft import RVAFT, Kind, RvaftError, Semantics, Verdict, loads
from rvaft.core.restriction import restrict
from rvaft.export.certificates import PROGRAM
from rvaft.model.values import is_finite
from rvaft.support.terminal import columns
from tests.faults.wrong_trees import MISTAKES
from tests.semantics.cases import CASES, Case

TABLE: Final = Path(__file__).parents[1] / "semantics" / "cases.txt"
VERIFIER: Final = Path(__file__).parents[2] / "proofs" / "build" / PROGRAM
_HEADING: Final = re.compile(r"# ([0-9][0-9., to]*): (.+)")
ELSEWHERE: Final = {
    "1.3 Galileo's dynamic gates": "tests/language/test_galileo_failures.py",
    "1.4 types and assumptions": "tests/model/test_assumptions.py",
    "4.5, 4.9 repetition": "tests/stream/test_repetition.py, tests/engine/test_repeat_by.py",
    "4.6 explanations": "tests/engine/test_cases.py",
    "4.8 passing time": "tests/cli/test_deadlines.py",
}
"""Sections about more than the verdicts of one monitor on one trace, and where they are tested."""
LEGEND: Final = (
    "Cases of each section of docs/semantics.md with verdicts written by hand, and how many of them each participant",
    "has right. It owes no verdict for a tree that it does not express, nor for a trace that it leaves open. A - is",
    "none, each ! a wrong one. A language takes part if its texts can be run here. A fault is a participant that was",
    "given another tree: it is found if a verdict is wrong.",
)
TRIES: Final = 8
"""Cases on which a participant with a fault is tried."""
Found = Mapping[str, str]
"""For each participant: `right`, `wrong`, or "" for a verdict that it does not owe."""


class Section(NamedTuple):
    """Sections of the definition, and their cases."""

    numbers: str
    title: str
    cases: Sequence[Case]


def sections() -> Iterator[Section]:
    """Yield the headings of the table with their cases, in order."""
    known, heading, lines = iter(CASES), ("", ""), list[Case]()
    for line in TABLE.read_text(encoding="utf-8").split("\n"):
        if found := _HEADING.fullmatch(line):
            if lines:
                yield Section(*heading, lines)
            heading, lines = (found[1], found[2]), []
        elif line and not line.startswith("#"):
            lines.append(next(known))
    yield Section(*heading, lines)


def participants() -> list[str]:
    """Return the participants that are here."""
    return [REFERENCE, ENGINE, *([VERIFIED] if VERIFIER.exists() else []), *faithful_backends()]


def part_of(case: Case) -> RVAFT:
    """Return the tree of a case, or the part that it is about."""
    return restrict(loads(case.tree), branch=case.branch, kind=None if case.kind is None else Kind(case.kind))


def enlisted(name: str, case: Case, tree: RVAFT) -> Enlisted:
    """Return a participant for a case, with this tree."""
    semantics = Semantics(case.semantics)
    if name == REFERENCE:
        return reference_of(tree, semantics)
    if name == VERIFIED:
        return verified_of(tree, semantics, VERIFIER, branch=None, kind=None, timeout=60)
    return engine_of(tree, semantics) if name == ENGINE else translated(name, tree, semantics)


def answer(name: str, case: Case, tree: RVAFT) -> tuple[Sequence[Verdict], Sequence[Verdict]] | None:
    """Return the verdicts of a participant and those that it should have, or None if it owes none."""
    one, trace = enlisted(name, case, tree), case.events
    if isinstance(one, Participant | Outside) and leaves_open(one, tree, trace):
        return None
    if isinstance(one, Participant) and one.json_alone and not all(map(is_finite, trace)):
        return None
    found, wanted = verdicts_of(one, trace), tuple(map(Verdict, case.values))
    if isinstance(found, RvaftError):
        return None
    return found, detections(wanted) if reports_detections_only(one) else wanted


def judged(names: Sequence[str], case: Case) -> Found:
    """Return what each participant says of a case."""
    tree, found = part_of(case), dict[str, str]()
    for name in names:
        said = answer(name, case, tree)
        found[name] = "" if said is None else "right" if said[0] == said[1] else "wrong"
    return found


def planted(names: Sequence[str], cases: Sequence[Case], mistake: str) -> tuple[bool, Found]:
    """Return whether the cases show a mistake of the reference, and of which other participants.

    Each is tried on a few of the cases that show it of the reference.
    """
    shown, found, tries = False, dict[str, str](), Counter[str]()
    for case in cases:
        tree = part_of(case)
        try:
            wrong = MISTAKES[mistake](tree)
        except RvaftError:
            continue
        said = None if wrong == tree else answer(REFERENCE, case, wrong)
        if said is None or said[0] == said[1]:
            continue
        shown = True
        for name in names:
            if found.get(name) == "right" or tries[name] >= TRIES:
                continue
            if (said := answer(name, case, wrong)) is not None and answer(name, case, tree) is not None:
                tries[name] += 1
                found[name] = "right" if said[0] != said[1] else "wrong"
    return shown, found


def page(names: Sequence[str], every: Sequence[Section]) -> tuple[list[str], bool]:
    """Return the lines of the page about participants and sections, and whether nothing is wrong."""
    cases = [case for section in every for case in section.cases]
    with ProcessPoolExecutor(os.cpu_count() or 1) as pool:
        results = pool.map(partial(judged, names), cases, chunksize=8)
        faults = pool.map(partial(planted, names[1:], cases), MISTAKES)
        rows = [("SECTION", "ABOUT", "CASES", *names)]
        wrong = 0
        for section in every:
            counts = {name: Counter(dict[str, int]()) for name in names}
            for _ in section.cases:
                for name, one in next(results).items():
                    counts[name][one] += 1
            wrong += sum(count["wrong"] for count in counts.values())
            cells = (f"{count['right'] or '-'}{'!' * count['wrong']}" for count in counts.values())
            rows.append((section.numbers, section.title, str(len(section.cases)), *cells))
        found = dict(zip(MISTAKES, faults, strict=True))
    seen = [mistake for mistake, (there, _) in found.items() if there]
    shown = [f"{len(seen)}/{len(found)}"]
    for name in names[1:]:
        told = [one[name] for _, one in found.values() if name in one]
        shown.append(f"{told.count('right')}/{len(told)}" if told else "-")
    rows.append(("faults", "found, of those that change a tree it has", str(len(found)), *shown))
    lines = [*LEGEND, "", *columns(rows), ""]
    lines.append(f"{wrong} wrong verdicts" if wrong else "every verdict that is owed is right")
    missed = {name: [one for one, (_, who) in found.items() if who.get(name) == "wrong"] for name in names[1:]}
    lines += [f"not found of {name} in {TRIES} cases: {', '.join(some)}" for name, some in missed.items() if some]
    lines += ["", "Tested elsewhere:", *(f"  {what}: {where}" for what, where in ELSEWHERE.items())]
    if unseen := [mistake for mistake in MISTAKES if mistake not in seen]:
        lines += ["", f"faults that no case shows: {', '.join(unseen)}"]
    return lines, not wrong


if __name__ == "__main__":
    text, right = page(participants(), [*sections()])
    print("\n".join(text))
    sys.exit(0 if right else 1)
