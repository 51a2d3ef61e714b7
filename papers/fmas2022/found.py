"""Findings about the paper, each with the commands that show it.

`shows` is the expected output of a command; the generated page marks findings without it.
"""

from dataclasses import dataclass, replace
from typing import Final

from papers.fmas2022.shell import COMPILER, MONITOR, Need

_TREES: Final = "trees/remote_inspection"
_TRACES: Final = f"{_TREES}/pruned.traces"
_TEXTS: Final = "papers/fmas2022/texts"
_COMPILE: Final = "java -jar $RML_COMPILER --input={0} --output={1}"
_RUN: Final = "swipl -O -p monitor=$RML_MONITOR $RML_MONITOR/monitor.pl -- {0} {1} | tail -n 1"
_REJECTED: Final = "Trace did not match specification"
_ACCEPTED: Final = "Execution terminated correctly"


@dataclass(frozen=True, slots=True)
class Step:
    """A command, its expected output, and its requirements.

    Without `shows` it must print nothing and succeed. An output line that begins with `not run: `
    reports that the command left something out.
    """

    command: str
    shows: str = ""
    needs: tuple[Need, ...] = ()
    before: str = ""
    """Introduction to the command; it asserts nothing, because the command may not run."""


@dataclass(frozen=True, slots=True)
class Finding:
    """A claim with explanation and commands.

    If some commands cannot run, `question` replaces the title, and `seen`, the description of their
    result, is left out.
    """

    title: str
    text: str
    steps: tuple[Step, ...]
    question: str = ""
    seen: str = ""


def _published(tree: str, semantics: str, name: str, *, trace: str = "", words: str = "") -> tuple[Step, ...]:
    """Return steps in which the published tools reject a trace by the paper's translation of a
    tree.
    """
    given = trace or f"$OUT/{name}.jsonl"
    commands = [
        f"rvaft emit {tree} --to rml-paper --semantics {semantics} -o $OUT/{name}.rml",
        _COMPILE.format(f"$OUT/{name}.rml", f"$OUT/{name}.pl"),
        *([] if trace else [f"""printf '{{"event": "%s"}}\\n' {words} > {given}"""]),
        _RUN.format(f"$OUT/{name}.pl", given),
    ]
    *quiet, last = (Step(command, needs=COMPILER + MONITOR) for command in commands)
    return replace(quiet[0], before="By the published tools:"), *quiet[1:], replace(last, shows=_REJECTED)


FINDINGS: Final = (
    Finding(
        "The Listing uses NewWp where nothing binds it",
        "In the Listing the altered goal may follow the radiation reading directly. Its guard compares the goal "
        "with NewWp, which only the other alternative binds. In the formula φ of section 4.2 the command to move "
        "precedes both.",
        (
            Step(f"rvaft check {_TREES}/listing.rvaft", "variable NewWp in the guard of altered is not bound"),
            Step(
                f"rvaft check {_TREES}/pruned.rvaft",
                before="In the tree the command to move precedes the choice, and there is no finding:",
            ),
            Step(
                f"rvaft emit {_TREES}/pruned.rvaft --to rml --semantics strict -o $OUT/listing.rml",
                before="The intended Listing in RML (`listing.rml`) agrees with the tree:",
            ),
            Step(
                f"rvaft cross-check {_TREES}/pruned.rvaft --against $OUT/listing.rml --semantics strict | "
                "tail -n 1 | sed 's/.*; //'",
                "no disagreement",
            ),
        ),
    ),
    Finding(
        "The published compiler rejects the Listing as printed",
        "The printed Listing writes variables with capitals, some strings without quotes, and `and` in guards. RML "
        "wants lower case, quotes, and `&&`. `in_print.rml` is a small text in the style of the Listing.",
        (
            Step(
                _COMPILE.format(f"{_TEXTS}/in_print.rml", "$OUT/printed.pl") + " && wc -c < $OUT/printed.pl",
                "no viable alternative at input 'go(Place'\n0",
                COMPILER,
            ),
            Step(
                f"rvaft cross-check {_TREES}/pruned.rvaft --against {_TEXTS}/in_print.rml",
                "unexpected '('",
                before="The reader of rvaft, on the same text:",
            ),
            Step(
                f"rvaft emit {_TREES}/pruned.rvaft --to rml --semantics strict -o $OUT/listing.rml",
                needs=COMPILER,
                before="The text that `make paper` writes:",
            ),
            Step(_COMPILE.format("$OUT/listing.rml", "$OUT/listing.pl"), needs=COMPILER),
        ),
        question="Whether the published compiler takes the Listing as printed",
        seen="The compiler stops at the first variable, writes nothing, and ends with exit status 0. The text that "
        "`make paper` writes compiles.",
    ),
    Finding(
        "The event types of the Listing match no event of the tables, and do not tell an inspection from a move",
        "Topics of the Listing have no leading slash, those of the tables have one. The event types `move` and "
        "`inspect` do not contain the name of the command. Without the slashes, a second command to the same waypoint "
        "counts as the inspection.",
        (
            Step(
                f"rvaft monitor {_TEXTS}/listing_types.rvaft {_TRACES}/table2_row1.jsonl | grep 'be move'",
                "near miss: 3 events would be move but for the field topic",
            ),
            Step(
                f'sed \'s|"/|"|; s/"inspect"/"move"/\' {_TRACES}/table2_row1.jsonl'
                f" | rvaft monitor {_TEXTS}/listing_types.rvaft | head -n 1",
                "event 4: true",
            ),
        ),
    ),
    Finding(
        "Table 3 prints ⊥ for φ too early",
        "In traces 1 and 2 the paper prints ⊥ for φ after the fourth event. φ₁ (φ₂) is no longer possible there, "
        "because the command to move came in time. But φ₃ (φ₄) still is: with one more event the attack is detected.",
        (
            Step(
                f"rvaft monitor {_TREES}/pruned.rvaft {_TRACES}/table3_row1.jsonl | head -n 1",
                "verdict unknown after 4 events",
            ),
            Step(
                f"""(cat {_TRACES}/table3_row1.jsonl; echo '{{"topic": "/move_base/goal", "goal": 2, "time": 20.0}}')"""
                f" | rvaft monitor {_TREES}/pruned.rvaft | head -n 2",
                "event 5: true",
            ),
        ),
    ),
    Finding(
        "The third and fourth trace of both tables lack an event",
        "The printed traces go from the radiation reading to the goal. φ₃ and φ₄ need the command to move between "
        "the two: it binds the waypoint that the goal is compared with. As printed, no branch can be completed. With "
        "a move to waypoint 1 between the two, the printed verdicts follow.",
        (
            Step(
                f"rvaft monitor {_TREES}/pruned.rvaft {_TRACES}/table2_row3_as_printed.jsonl | head -n 1",
                "event 4: false",
            ),
            Step(f"rvaft monitor {_TREES}/pruned.rvaft {_TRACES}/table2_row3.jsonl | head -n 2", "event 5: true"),
            Step(
                f"grep -v '\"waypoint\": 1' {_TRACES}/table2_row4.jsonl"
                f" | rvaft monitor {_TREES}/pruned.rvaft | head -n 1",
                "event 4: false",
            ),
            Step(f"rvaft monitor {_TREES}/pruned.rvaft {_TRACES}/table2_row4.jsonl | head -n 2", "event 5: true"),
        ),
    ),
    Finding(
        "φ₁ ∨ φ₃ in RML misses the attack",
        "A monitor of RML is deterministic: a union commits to its left operand while that can consume the event. "
        "φ₁ and φ₃ start with the same events, so φ₁ consumes the reading and the events before it, and φ₃ is dropped. "
        "The union of the branches rejects the attack of Table 2; the translation of rvaft detects it.",
        (
            Step(
                f"rvaft monitor {_TREES}/pruned.rvaft {_TRACES}/table2_row3.jsonl --backend rml-paper | head -n 1",
                "event 4: false",
            ),
            Step(
                f"rvaft monitor {_TREES}/pruned.rvaft {_TRACES}/table2_row3.jsonl --backend rml | head -n 1",
                "event 5: true",
            ),
            Step(
                f"rvaft cross-check {_TREES}/pruned.rvaft --semantics projected --backends rml-paper | head -n 1",
                "rml-paper differs from reference",
            ),
            *_published(f"{_TREES}/pruned.rvaft", "projected", "union", trace=f"{_TRACES}/table2_row3.jsonl"),
        ),
    ),
    Finding(
        "The unrolled VOT loses interleavings of compound children",
        "For two of {a then d, b, c} the events a b d suffice. The unrolling of section 3.2 completes a child before "
        "the next one, so b must not come between a and d.",
        (
            Step(
                f'rvaft monitor {_TEXTS}/vot_over_compound.rvaft --word "a b d" --semantics strict | head -n 1',
                "event 3: true",
            ),
            Step(
                f'rvaft monitor {_TEXTS}/vot_over_compound.rvaft --word "a b d" --semantics strict --backend rml-paper'
                " | head -n 1",
                "event 2: false",
            ),
            Step(
                f"rvaft cross-check {_TEXTS}/vot_over_compound.rvaft --semantics strict --backends "
                "rml-paper | sed '/^$/,$d'",
                "rml-paper differs from reference",
            ),
            *_published(f"{_TEXTS}/vot_over_compound.rvaft", "strict", "compound", words="a b d"),
        ),
    ),
    Finding(
        "The unrolled VOT means exactly K where something follows it",
        "Section 3.2 says at least k. The trace a b c d contains two of {a, b, c} and then d. The unrolling counts "
        "down to zero and then requires d, so a third child ends the match.",
        (
            Step(
                f'rvaft monitor {_TEXTS}/vot_followed.rvaft --word "a b c d" --semantics strict | head -n 1',
                "event 4: true",
            ),
            Step(
                f'rvaft monitor {_TEXTS}/vot_followed.rvaft --word "a b c d" --semantics strict --backend rml-paper'
                " | head -n 1",
                "event 3: false",
            ),
            Step(
                f"rvaft cross-check {_TEXTS}/vot_followed.rvaft --semantics strict --backends rml-paper | "
                "sed '/^$/,$d'",
                "rml-paper differs from reference",
            ),
            *_published(f"{_TEXTS}/vot_followed.rvaft", "strict", "followed", words="a b c d"),
        ),
    ),
    Finding(
        "The published monitor takes a goal 1.0 after a command to waypoint 1 for an attack",
        "In JSON, 1 and 1.0 are equal. The trace is the third of Table 3, where nothing was altered; the monitor of "
        "rvaft raises no alarm.",
        (
            Step(
                f'sed \'s/"goal": 1,/"goal": 1.0,/\' {_TRACES}/table3_row3.jsonl'
                f" | rvaft monitor {_TREES}/pruned.rvaft | head -n 1",
                "event 5: false",
            ),
            Step(
                f'sed \'s/"goal": 1,/"goal": 1.0,/\' {_TRACES}/table3_row3.jsonl > $OUT/decimal.jsonl',
                needs=MONITOR,
                before="By the published monitor, with the text of rvaft: the trace with 1.0, then the one with 1:",
            ),
            Step(f"rvaft emit {_TREES}/pruned.rvaft --to rml-prolog -o $OUT/faithful.pl", needs=MONITOR),
            Step(_RUN.format("$OUT/faithful.pl", "$OUT/decimal.jsonl"), _ACCEPTED, MONITOR),
            Step(_RUN.format("$OUT/faithful.pl", f"{_TRACES}/table3_row3.jsonl"), _REJECTED, MONITOR),
        ),
        question="Whether the published monitor takes a goal 1.0 after a command to waypoint 1 for an attack",
        seen="The published monitor distinguishes 1 from 1.0 and reports an attack for the trace with 1.0.",
    ),
    Finding(
        "About the tool, not the paper: all participants agree on every cell of Tables 2 and 3",
        "The reference, the engine and the texts of all faithful backends give a verdict after every event of the "
        "completed traces. The verdicts of the engine are the cells of the generated tables.",
        (Step("python -m papers.fmas2022.verdict_table | grep agree", " agree"),),
        question="Whether all participants agree on the cells of Tables 2 and 3",
    ),
)
