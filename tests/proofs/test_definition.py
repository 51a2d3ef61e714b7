"""The clauses of the definition, and what the Coq development states of them."""

import re

from tests.proofs.verified import PROOFS

DOCS = PROOFS.parent / "docs"
UNSTATED = {"4.6", "4.9"}
"""Which match is explained is free, so that Coq states nothing."""


def plain(text: str) -> str:
    """A text without emphasis and line breaks."""
    text = re.sub(r"\| --- [-| ]*\|", "", text.replace("*", ""))
    return re.sub(r"\s+", " ", text).strip()


def clauses() -> dict[str, str]:
    """The numbered clauses of sections 2 to 4, and section 1.5."""
    page = (DOCS / "semantics.md").read_text(encoding="utf-8")
    sections = page[page.index("## 2. ") : page.index("## 5. ")]
    parts = re.split(r"(?m)^(?:- )?\*\*(\d\.\d)\*\* ", sections)
    numbered = zip(parts[1::2], parts[2::2], strict=True)
    heading = "### 1.5 Absent events\n"
    absent = page[page.index(heading) + len(heading) : page.index("## 2. ")]
    return {"1.5": plain(absent)} | {number: plain(re.split(r"(?m)^## ", text)[0]) for number, text in numbered}


def names() -> set[str]:
    """What the Coq files define and prove."""
    statement = r"(?m)^(?:Theorem|Lemma|Definition|Fixpoint|Inductive|Record|Corollary|\|) (\w+)"
    return {name for file in PROOFS.glob("*.v") for name in re.findall(statement, file.read_text(encoding="utf-8"))}


def test_each_clause_stands_beside_what_states_it() -> None:
    comments = re.findall(
        r"\(\* (\d\.\d): (.*?) \*\)", (PROOFS / "Definition.v").read_text(encoding="utf-8"), re.DOTALL
    )
    quoted = {number: plain(text) for number, text in comments}
    expected = {number: text for number, text in clauses().items() if number not in UNSTATED}
    assert len(expected) == 23
    assert quoted == expected


def test_the_table_links_each_clause_to_its_names() -> None:
    page = (DOCS / "explanation" / "proofs.md").read_text(encoding="utf-8")
    table = dict(re.findall(r"(?m)^\| (\d\.\d) [^|]*\| ([^|]*) \|$", page))
    assert table.keys() == clauses().keys()
    for number, cell in table.items():
        linked = re.findall(r"`(\w+)`", cell)
        assert bool(linked) == (number not in UNSTATED), number
        assert names().issuperset(linked), (number, set(linked) - names())


def test_every_proof_is_finished() -> None:
    for file in PROOFS.glob("*.v"):
        text = file.read_text(encoding="utf-8")
        assert not re.search(r"\b(Admitted|admit|Axiom|Parameter|Conjecture)\b", text), file.name
    listed = (PROOFS / "_CoqProject").read_text(encoding="utf-8").split()
    assert {file.name for file in PROOFS.glob("*.v")} == {*listed[3:], "Extraction.v"}


def test_every_theorem_that_the_page_names_is_there() -> None:
    page = (DOCS / "explanation" / "proofs.md").read_text(encoding="utf-8")
    theorems = re.findall(r"`(\w+_(?:correct|iff|sound|complete|final|faithful|lawful|le|unique))`", page)
    assert len(theorems) > 15
    assert set(theorems) <= names()
