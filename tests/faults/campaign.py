"""Mutants of a room of the product, held against the verdicts of the reference: `python -m tests.faults.campaign ROOM`.

The reference gives its verdicts before anything is changed; each mutant lives in a process of its
own, which runs the participants on the same traces. A mutant is killed where a verdict differs,
somebody raises, or the time is over; each is told in a line of JSON.
"""

import gc
import json
import os
import pickle
import signal
from argparse import ArgumentParser
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from importlib import import_module
from itertools import islice
from operator import itemgetter
from pathlib import Path
from random import Random
from types import CodeType
from typing import Any, Final, NamedTuple

import rvaft
from backends.conformance import examples
from cross_check.campaign import catalogue
from cross_check.participants import ENGINE, Participant, reference_of
from cross_check.results import Job
from cross_check.traces import Effort, letters_of, trials
from papers.languages.measurement import limit_memory
from rvaft import RVAFT, NotExpressible, Semantics, TooLarge, Verdict
from rvaft.backend import backend
from rvaft.core.restriction import restrict
from rvaft.model.assumptions import first_violation
from rvaft.model.nodes import Assumption
from rvaft.model.values import is_finite
from tests.engine.checking import small_and_valid
from tests.engine.dense import SHAPES as DENSE
from tests.engine.dense import dense_tree
from tests.faults.mutations import Source, forget_caches, live_functions

ROOT: Final = Path(rvaft.__file__).parent.parent
MEMORY: Final = 4 << 30
"""Bytes that a mutant may take."""
SECONDS: Final = 1.0, 0.04
"""Of processor time that it may take: once, and for each exercise and participant."""
LIMIT: Final = 3_000
"""Of a translation: only two of the exercises have more, and each would take as long as a hundred others."""
BACKENDS: Final = ("automaton", "ltlf", "rml")
ROOMS: Final[dict[str, tuple[tuple[str, ...], tuple[str, ...]]]] = {
    ENGINE: (("rvaft/engine",), (ENGINE,)),
    **{name: ((f"backends/{name}",), (name,)) for name in BACKENDS},
    "shared": (("rvaft", "rvaft/support", "rvaft/model", "rvaft/core"), (ENGINE, *BACKENDS)),
}
"""The folders of each, and who is wrong where they are. The reference has no part in them."""
EFFORT: Final = Effort(words=60, traces=16)
LONG: Final = 10
"""Events in further traces, drawn from those that the tree tells apart."""


class Exercise(NamedTuple):
    """A tree under one semantics, traces, and the verdicts of the reference after each of their prefixes."""

    name: str
    tree: RVAFT
    semantics: Semantics
    traces: Sequence[Sequence[Any]]
    expected: Sequence[Sequence[Verdict]]


def exercises(seed: int, share: float) -> list[Exercise]:
    """A share of all exercises, in no order: the trees of the cross-checker, those of the
    conformance suite, and some random ones.
    """
    trees = [(entry.tree, entry.name, entry.branch, entry.kind) for entry in catalogue()]
    trees += [(example.tree, example.name, None, None) for example in examples()]
    for shape, dense in DENSE.items():
        random = Random(shape)
        made = (tree for _ in range(200) if small_and_valid(tree := dense_tree(random, dense), 30))
        trees += [(tree, f"random {number}, {shape}", None, None) for number, tree in enumerate(islice(made, 12))]
    every = ((tree, Job(name, s, branch, kind)) for tree, name, branch, kind in trees for s in Semantics)
    drawn = [(Random(f"{seed} {job.title} {job.semantics}").random(), tree, job) for tree, job in every]
    chosen = sorted(
        (one for one in drawn if one[0] < share), key=itemgetter(0)
    )  # a new tree changes none of the others
    return [found for _, tree, job in chosen if (found := exercise(tree, job)) is not None]


def exercise(tree: RVAFT, job: Job) -> Exercise | None:
    """The traces of one comparison with the verdicts; the tree is as if nobody had looked at it."""
    part = restrict(tree, branch=job.branch, kind=job.kind)
    fresh = pickle.loads(pickle.dumps(part))
    reference = reference_of(tree, job.semantics, branch=job.branch, kind=job.kind)
    if not isinstance(reference, Participant):
        return None
    traces = list(trials(part, job, EFFORT, [reference], words=True))
    random = Random(job.title)
    letters = letters_of([reference.observed or ()]).events
    traces += [random.choices(letters, k=LONG) for _ in range(EFFORT.traces)]
    expected = [list(reference.start().run(trace)) for trace in traces]
    return Exercise(f"{job.title} under {job.semantics}", fresh, job.semantics, traces, expected)


def wrong(participants: Sequence[str], work: Sequence[Exercise]) -> str:
    """The first exercise in which a participant is wrong, or nothing; whose language cannot say the tree is not."""
    for one in work:
        for participant in participants:
            assumes: frozenset[Assumption] = frozenset()
            try:
                if participant == ENGINE:
                    monitor = rvaft.monitor(one.tree, semantics=one.semantics)
                else:
                    specification = rvaft.translate(one.tree, participant, semantics=one.semantics, limit=LIMIT)
                    monitor, assumes = specification.monitor(), specification.assumes
            except (NotExpressible, TooLarge):
                continue
            for trace, expected in zip(one.traces, one.expected, strict=True):
                asked = participant == ENGINE or not backend(participant).json_alone or all(map(is_finite, trace))
                asked = asked and first_violation(one.tree, trace, assumes) is None
                if asked and list(monitor.fork().run(trace)) != expected:
                    return f"{participant} differs: {one.name}"
    return ""


def in_a_child(work: Callable[[], Any], seconds: float) -> Any:
    """What a function returns that runs in a process of its own, or as text why there is nothing."""
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(read)
        limit_memory(MEMORY)
        signal.setitimer(signal.ITIMER_PROF, seconds)
        try:
            found = work()
        except BaseException as error:  # noqa: BLE001 (a mutant may do anything)
            found = f"{type(error).__name__}: {error}"[:200]
        os.write(write, json.dumps(found).encode())
        os._exit(0)
    os.close(write)
    with os.fdopen(read, "rb") as pipe:
        told = pipe.read()
    _, status = os.waitpid(child, 0)
    if told:
        return json.loads(told)
    return "the time is over" if os.WTERMSIG(status) == signal.SIGPROF else f"died of signal {os.WTERMSIG(status)}"


def sources(folders: Sequence[str]) -> list[Source]:
    """The modules of a room that can be imported, all of them imported."""
    found = []
    paths = {path for folder in folders for path in (ROOT / folder).glob("*.py" if folder == "rvaft" else "**/*.py")}
    for path in sorted(path for path in paths if path.stem != "__main__"):
        name = ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        with suppress(ImportError):  # what needs a tool of others
            found.append(Source(import_module(name)))
    return found


def campaign(room: str, work: Sequence[Exercise], mutants: int, *, seed: int, tries: int) -> Iterator[tuple[str, str]]:
    """So many mutants, drawn from the sites that the exercises reach, and what kills each; nothing
    where nobody sees it.

    Each runs at most so many exercises (`tries`), all of which reach its site.
    """
    folders, participants = ROOMS[room]
    modules = sources(folders)
    gc.unfreeze()  # what is frozen is not found
    live = live_functions()
    forget_caches()
    gc.collect()
    gc.freeze()

    def reaches() -> list[list[list[int]]]:
        """For each exercise and each module the sites that are reached."""
        reached: list[set[int]] = [set() for _ in modules]
        for source, numbers in zip(modules, reached, strict=True):
            source.mark(numbers.add, live)
        told = []
        for one in work:
            differs = wrong(participants, [one])
            assert not differs, f"without any mutant {differs}"
            told.append([sorted(numbers) for numbers in reached])
            for numbers in reached:
                numbers.clear()
        return told

    def judged(source: Source, code: CodeType, work: Sequence[Exercise]) -> str:
        source.put(code, live)
        return wrong(participants, work)

    told = in_a_child(reaches, 600)
    assert isinstance(told, list), told
    by_site: dict[tuple[int, int], list[Exercise]] = defaultdict(list)
    for one, places in zip(work, told, strict=True):
        for place, numbers in enumerate(places):
            for number in numbers:
                by_site[place, number].append(one)
    for place, number in Random(seed).sample(sorted(by_site), min(mutants, len(by_site))):
        where, code = modules[place].mutant(number)
        asked = by_site[place, number][:tries]
        seconds = SECONDS[0] + SECONDS[1] * len(asked) * len(participants)
        yield where, in_a_child(lambda: judged(modules[place], code, asked), seconds)  # noqa: B023 (called at once)


def main() -> None:
    """Run a campaign in each of some rooms and print it."""
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("rooms", nargs="+", choices=ROOMS, metavar="ROOM", help=", ".join(ROOMS))
    parser.add_argument("--mutants", type=int, default=40, help="in each room")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--share", type=float, default=0.4, help="of the exercises")
    parser.add_argument("--tries", type=int, default=60, help="exercises for each mutant")
    given = parser.parse_args()
    work = exercises(given.seed, given.share)
    for room in given.rooms:
        for mutant, killed in campaign(room, work, given.mutants, seed=given.seed, tries=given.tries):
            print(json.dumps({"room": room, "mutant": mutant, "killed": killed}))


if __name__ == "__main__":
    main()
