"""The tests of events that a monitor in C makes, as a comment of the text.

Proofs of agreement need them. The comment has a digest of the code, so it is not believed for a text that
was changed.
"""

import re
from collections import Counter
from collections.abc import Iterator
from hashlib import sha256
from itertools import chain
from typing import Final, NamedTuple

from rvaft.backend import Observed
from rvaft.core.property import Condition, Property
from rvaft.language.parser import parse_guard, parse_pattern
from rvaft.model.expressions import guard_text, pattern_text
from rvaft.model.guards import variables
from rvaft.model.patterns import rigid_variables

_COMMENT: Final = re.compile(r"/\* observes, for the code with the digest ([0-9a-f]{64}):\n(.*?)\*/\n", re.DOTALL)


class _Question(NamedTuple):
    """A test of an event; the variables `own` are local to it."""

    observed: Observed
    own: tuple[str, ...]


def comment(prop: Property, code: str) -> str:
    """Return the comment for some code; empty if verdicts depend on times or absent events."""
    if prop.timed or prop.absences or (prop.time is not None and prop.time.late is not None):
        return ""
    lines = "".join(f"   {line}\n" for line in dict.fromkeys(map(_line, _questions(prop))))
    return f"/* observes, for the code with the digest {sha256(code.encode()).hexdigest()}:\n{lines}*/\n"


def _line(one: _Question) -> str:
    pattern, when = one.observed.pattern, one.observed.when
    text = "\t".join((pattern_text(pattern), "" if when is None else guard_text(when), " ".join(one.own)))
    text = text.replace("*/", "*\\/").replace("/*", "\\/*")  # in a string
    return "".join(c if c.isascii() and c != "\x7f" else _escaped(c) for c in text)


def _escaped(character: str) -> str:
    data = character.encode("utf-16-be")
    return "".join(f"\\u{data[at : at + 2].hex()}" for at in range(0, len(data), 2))


def _questions(prop: Property) -> Iterator[_Question]:
    guards = [part.guard for part in prop.parts if isinstance(part, Condition)]
    uses = Counter(name for event in prop.events for name in rigid_variables(event.pattern))
    for event in prop.events:
        names = rigid_variables(event.pattern)
        about = {name: [guard for guard in guards if name in variables(guard)] for name in names}
        alone = (name for name in names if all(set(variables(guard)) <= set(names) for guard in about[name]))
        own = tuple(name for name in alone if uses[name] == 1)
        for guard in (None, *chain(*(about[name] for name in names))):
            local = own if guard is None or set(variables(guard)) <= set(own) else names
            yield _Question(Observed(event.pattern, guard), local)
    for pattern, when in chain(((one.pattern, one.when) for one in prop.alphabet), prop.ignored):
        yield _Question(Observed(pattern, when), rigid_variables(pattern))


def observed(text: str) -> tuple[Observed, ...] | None:
    """Return the tests of events in a text, or None if it does not list them, or was changed."""
    found = _COMMENT.match(text)
    if found is None or sha256(text[found.end() :].encode()).hexdigest() != found[1]:
        return None
    made = []
    for line in found[2].splitlines():
        pattern, guard, own = line.removeprefix("   ").split("\t")
        question = Observed(parse_pattern(pattern), parse_guard(guard) if guard else None)
        made.append(question.untied(own.split()))
    return tuple(dict.fromkeys(made))
