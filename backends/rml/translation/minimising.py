"""States with the same future made one, and alternatives dropped that a later one does as well."""

from collections.abc import Iterator
from dataclasses import dataclass

from backends.rml.translation.automaton import ACCEPT, STAY, Alternative
from backends.rml.translation.letters import Letter


@dataclass(frozen=True, slots=True)
class Choice:
    """On an event that is all the letters, go on to the target, a class (or ACCEPT or STAY)."""

    letters: tuple[Letter, ...]
    target: int


Class = tuple[Choice, ...]


def minimised(states: list[list[Alternative]]) -> list[Class]:
    """The classes, every one before those that lead to it; the last is that of the first state."""
    number: dict[Class, int] = {}
    of_state: dict[int, int] = {}
    for state in _later_first(states):
        choices = _needed(
            [(Choice(a.letters, of_state.get(a.target, a.target)), a.fits) for a in states[state]],
        )
        of_state[state] = number.setdefault(choices, len(number))
    classes = list(number)
    first = of_state[0]
    assert first == len(classes) - 1, "the first state lies before all others"
    return classes


def _needed(choices: list[tuple[Choice, int]]) -> Class:
    """Without a choice where the next one that would fit leads to the same."""
    kept: list[tuple[Choice, int]] = []
    for choice, fits in reversed(choices):
        following = next((other for other, less in kept if not less & ~fits), None)
        if following is None or following.target != choice.target:
            kept.insert(0, (choice, fits))
    return tuple(choice for choice, _ in kept)


def _later_first(states: list[list[Alternative]]) -> Iterator[int]:
    """The states, each after all that it leads to; the only loops are STAY, so there is such an order."""
    done: set[int] = set()
    agenda = [(0, False)]
    while agenda:
        state, visited = agenda.pop()
        if visited:
            yield state
        elif state not in done:
            done.add(state)
            agenda.append((state, True))
            agenda.extend((a.target, False) for a in states[state] if a.target not in (ACCEPT, STAY))
