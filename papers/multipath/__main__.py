"""`python -m papers.multipath [TREE TYPE...]`: write the results, or the texts for the published tools.

Without arguments, the generated parts of `README.md` are written anew. With a tree and hidden event
types, the property goes to `TREE.hltl` and `TREE.mchyper`, and the automaton to `TREE.aag`, in the
current folder.
"""

import re
import sys
from collections.abc import Iterator, Sequence
from itertools import chain, combinations
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import Final, NamedTuple

from papers.multipath.determinism import IDLE, EventLetter, Machine, aiger, difference, hyperltl, machine
from rvaft import RvaftError, Semantics, load
from rvaft.support.files import place

FOLDER: Final = Path(__file__).parent
TREES: Final = FOLDER.parents[1] / "trees"
MANY: Final = 8
"""Event types of which every set is decided; of more, each one and all."""
PART: Final = re.compile(r"(<!-- (?P<name>(?!end)\w+) -->\n)(.*?)(\n<!-- end -->)", re.DOTALL)
"""A generated part of the page."""


class TreeResult(NamedTuple):
    """A machine, and which sets of its event types may be hidden."""

    tree: str
    semantics: Semantics
    machine: Machine
    free: list[tuple[str, ...]]
    sets: int
    milliseconds: float
    """The median of the decisions."""
    most: float


def results(names: str = "*.rvaft") -> Iterator[TreeResult]:
    """Decide the shipped trees that an automaton expresses without `ignore`."""
    for path in sorted(TREES.rglob(names)):
        for semantics in Semantics:
            try:
                found = machine(load(path), semantics)
            except RvaftError:
                continue
            types, times, free = found.types, list[float](), list[tuple[str, ...]]()
            sizes = range(1, len(types) + 1) if len(types) <= MANY else (1, len(types))
            sets = [*chain.from_iterable(combinations(types, size) for size in sizes)]
            for hidden in sets:
                begun = perf_counter()
                if difference(found, hidden) is None:
                    free.append(hidden)
                times.append(1000 * (perf_counter() - begun))
            name = str(path.relative_to(TREES).with_suffix(""))
            yield TreeResult(name, semantics, found, free, len(sets), median(times), max(times))


def page(text: str, every: Sequence[TreeResult]) -> str:
    """Return the page with these results in its generated parts: `<!-- NAME -->` to `<!-- end -->`."""
    free = ", ".join(
        f"{one.tree} under {one.semantics} ({', '.join(map(_names, one.free))})" for one in every if one.free
    )
    trees = {one.tree for one in every}
    parts = {
        "counts": f"{len(trees)} trees, {len(every)} automata, {sum(one.sets for one in every):,} sets of hidden "
        f"types; of these may be hidden: {sum(len(one.free) for one in every)} ({free or 'none'}).",
        "states": "\n".join(_states(every)),
        "times": f"A decision takes {median(one.milliseconds for one in every):.1g} ms, the median of all sets, "
        f"and {max(one.most for one in every):.0f} ms at most.",
        "pairs": "\n".join(_pairs(every)),
    }
    return PART.sub(lambda found: f"{found[1]}{parts[found['name']]}{found[4]}", text)


def _states(every: Sequence[TreeResult]) -> Iterator[str]:
    """Yield the table of the states of gates and of the paper's trees."""
    yield f"| tree | event types | {' | '.join(Semantics)} |"
    yield f"| --- | ---: |{' ---: |' * len(Semantics)}"
    by_tree: dict[str, list[TreeResult]] = {}
    for found in every:
        if found.tree.startswith(("gates/", "remote_inspection/")):
            by_tree.setdefault(found.tree, []).append(found)
    for tree, some in by_tree.items():
        yield f"| `{tree}` | {len(some[0].machine.types)} | {' | '.join(str(len(one.machine.next)) for one in some)} |"


def _pairs(every: Sequence[TreeResult]) -> Iterator[str]:
    """Yield the table of shortest pairs of traces for the paper's trees."""
    yield "| tree | hidden | semantics | one trace | the other |"
    yield "| --- | --- | --- | --- | --- |"
    paper = {(one.tree, one.semantics): one.machine for one in every if one.tree.startswith("remote_inspection/")}
    for tree, hidden in (("full", ("battery", "image")), *(("pruned", (name,)) for name in ("radiation", "goal"))):
        for semantics in (Semantics.PROJECTED, Semantics.SCATTERED):
            steps = difference(paper[f"remote_inspection/{tree}", semantics], hidden)
            assert steps is not None
            one, other = (_word(letters) for letters in zip(*steps, strict=True))
            yield f"| {tree} | {_names(hidden)} | {semantics} | {one} | {other} |"


def _names(hidden: Sequence[str]) -> str:
    return " and ".join(f"`{name}`" for name in hidden)


def _word(letters: Sequence[EventLetter | None]) -> str:
    return ", ".join(IDLE if letter is None else str(letter) for letter in letters)


def main() -> int:
    """Write what is asked for; return the exit status."""
    if sys.argv[1:] in (["-h"], ["--help"]):
        print(__doc__)
        return 0
    if len(sys.argv) == 1:
        file = FOLDER / "README.md"
        file.write_text(page(file.read_text(encoding="utf-8"), [*results()]), encoding="utf-8")
        return 0
    path, *hidden = sys.argv[1:]
    try:
        tree = load(path)
        found = machine(tree, tree.semantics or Semantics.PROJECTED)
    except (OSError, RvaftError) as error:
        print(f"papers.multipath: error: {error}", file=sys.stderr)
        return 2
    if unknown := {*hidden} - {*found.types}:
        print(
            f"papers.multipath: error: no event type {min(unknown)}; known: {', '.join(found.types)}", file=sys.stderr
        )
        return 2
    written, stem = hyperltl(found, hidden), Path(path).stem
    formulas = {f"{stem}.hltl": f"{written['rvhyper']}\n", f"{stem}.mchyper": f"{written['mchyper']}\n"}
    try:
        place(Path(), {**formulas, f"{stem}.aag": aiger(found, hidden)}, force=True)
    except (OSError, RvaftError) as error:
        print(f"papers.multipath: error: {error}", file=sys.stderr)
        return 2
    print("not deterministic" if difference(found, hidden) else "deterministic")
    return 0


if __name__ == "__main__":
    sys.exit(main())
