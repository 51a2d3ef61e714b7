"""The ten patterns of Timescales (Ulus, RV 2019) as trees, and two of them as deadlines.

They are compared with their formulas of past MTL, run by Reelay. A tree detects the first event at which the formula
does not hold. Of the propositions p, q, r and s at most one is true at a time, and there is an event every second, as
in the traces of that generator; of the `always` patterns, p is true except where an event says `not p`.
"""

from collections.abc import Iterator
from pathlib import Path
from random import Random
from typing import Any, Final

import pytest

from backends.mtl import MtlBackend
from rvaft import Verdict, load, monitor
from rvaft.monitors import DetectionMonitor
from tests.tables import sampled

TREES = Path(__file__).with_name("timescales")
BETWEEN: Final = "{r: true} and not {q: true} and once {q: true}"
ANSWERED: Final = "((not {s: true} or once[2:4] {p: true}) and not ((not {s: true}) since[4:] {p: true}))"
VIOLATIONS: Final = {
    "absence_after_q": "once[0:4] {q: true} and not ((not {p: true}) since {q: true})",
    "absence_before_r": "{r: true} and not historically[0:4] (not {p: true})",
    "absence_between_q_and_r": f"{BETWEEN} and not ((not {{p: true}}) since[2:4] {{q: true}})",
    "always_after_q": "once[0:4] {q: true} and not ((not {n: true}) since {q: true})",
    "always_before_r": "{r: true} and not historically[0:4] (not {n: true})",
    "always_between_q_and_r": f"{BETWEEN} and not ((not {{n: true}}) since[2:4] {{q: true}})",
    "recurrence_globally": "not once[0:4] {p: true}",
    "recurrence_between_q_and_r": f"{BETWEEN} and not ((once[0:4] ({{p: true}} or {{q: true}})) since {{q: true}})",
    "response_globally": f"not {ANSWERED}",
    "response_between_q_and_r": f"{BETWEEN} and not ({ANSWERED} since {{q: true}})",
    "recurrence_deadline": "pre((not {p: true}) since[4:] {p: true})",
    "response_deadline": "pre((not {s: true}) since[4:] {p: true})",
}
"""When each pattern is violated, with the bounds 2 and 4; the last two are deadlines, which the next event decides."""
PROPOSITIONS: Final = {"p": "p", "n": "not p", "q": "q", "r": "r", "s": "s"}


def formula(name: str) -> DetectionMonitor:
    """Return the monitor of Reelay for the violation of a pattern."""
    lines = [f'{letter} := {{ is: "{what}" }}' for letter, what in PROPOSITIONS.items()]
    found = MtlBackend().read("\n".join(["/* rvaft", *lines, "*/", VIOLATIONS[name]]))
    assert isinstance(found, DetectionMonitor)
    return found


def traces(name: str) -> Iterator[list[dict[str, Any]]]:
    """Yield random traces, and the same times with what keeps the pattern more often."""
    random = Random(name)
    used = sorted({letter for letter in PROPOSITIONS if f"{{{letter}: true}}" in VIOLATIONS[name]})
    first = ["p"] if name == "recurrence_globally" else ["", ""]  # before 2 s there is nothing to look back to
    for number in range(150):
        idle = ["", "", "", "", "", "", "p", "p"] if number % 2 else [""] * random.choice([2, 6, 12])
        letters = [*first, *random.choices([*used, *idle], k=random.choice([8, 12, 16]))]
        yield [{"time": time, "is": PROPOSITIONS.get(letter, "idle")} for time, letter in enumerate(letters)]


@pytest.mark.parametrize("name", sampled(VIOLATIONS, 4, ci=3))
def test_the_tree_detects_where_the_pattern_is_violated(name: str) -> None:
    pytest.importorskip("reelay", reason="needs Reelay")
    tree, words = load(TREES / f"{name}.rvaft"), [*traces(name)]
    expected = formula(name).first_detections(words)
    found = []
    for word in words:
        verdicts = list(monitor(tree).run(word))
        found.append(verdicts.index(Verdict.TRUE) + 1 if Verdict.TRUE in verdicts else None)
    wrong = [
        ("".join(one["is"][0] for one in word), *pair)
        for word, *pair in zip(words, found, expected, strict=True)
        if pair[0] != pair[1]
    ]
    assert wrong == []
    assert min(expected.count(None), len(expected) - expected.count(None)) >= 5
