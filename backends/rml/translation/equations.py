"""Equations for an automaton: one per class that several others lead to, the others written where they are needed."""

from collections import Counter
from itertools import groupby

from backends.rml.translation.automaton import ACCEPT, STAY
from backends.rml.translation.letters import Letters
from backends.rml.translation.minimising import Choice, Class
from backends.rml.translation.terms import ALL, ANY, MAX_DEPTH, NONE, Name, Term, both, either, then


def equations(classes: list[Class], letters: Letters) -> tuple[Term, list[tuple[str, Term]]]:
    """The expression for the first state, and the equations it needs."""
    return _Writer(classes, letters).result()


class _Writer:
    def __init__(self, classes: list[Class], letters: Letters) -> None:
        self.classes = classes
        self.letters = letters
        self.first = len(classes) - 1
        self.uses = Counter(target for made in classes for target in {choice.target for choice in made})
        self.names = self._names()

    def result(self) -> tuple[Term, list[tuple[str, Term]]]:
        terms: dict[int, Term] = {}
        for number, choices in enumerate(self.classes):
            body = self._body(number, choices, terms)
            name = self.names.get(number)
            terms[number] = body if name is None else Name(name)
            self.bodies[number] = body
        made = [(name, self.bodies[number]) for number, name in self.names.items()]
        return terms[self.first], made

    def _names(self) -> dict[int, str]:
        """Names for the classes that get an equation, in the order in which a reader meets them."""
        self.bodies: dict[int, Term] = {}
        deep = self._deep()
        order, seen = [self.first], {self.first}
        for number in order:
            for choice in self.classes[number]:
                if choice.target >= 0 and choice.target not in seen:
                    seen.add(choice.target)
                    order.append(choice.target)
        named = [number for number in order if number in deep or self._shared(number)]
        return {number: f"S{position}" for position, number in enumerate(named, 1)}

    def _shared(self, number: int) -> bool:
        return self.uses[number] > 1 or any(choice.target == STAY for choice in self.classes[number])

    def _deep(self) -> set[int]:
        """Classes that would be written too deep inside others."""
        height: dict[int, int] = {}
        deep: set[int] = set()
        for number, choices in enumerate(self.classes):
            below = [height[c.target] for c in choices if c.target >= 0 and not self._shared(c.target)]
            height[number] = 1 + max(below, default=0)
            if height[number] >= MAX_DEPTH:
                deep.add(number)
                height[number] = 0
        return deep

    def _body(self, number: int, choices: Class, terms: dict[int, Term]) -> Term:
        parts: list[Term] = []
        for (target, joint), group in groupby(choices, key=self._alike):
            run = list(group)
            if joint:
                parts += [both(then(event, ALL) for event in self._events(choice)) for choice in run]
                continue
            heads = [both(self._events(choice)) if choice.letters else ANY for choice in run]
            after = {ACCEPT: ALL, STAY: Name(self.names.get(number, ""))}.get(target) or terms[target]
            parts.append(then(either(heads), after))
        return either(parts) if parts else NONE  # guards that no event can fulfil

    def _alike(self, choice: Choice) -> tuple[int, bool]:
        """Neighbours that lead to the same are written as one; detecting by several types at once has a form of its own."""
        return choice.target, choice.target == ACCEPT and len(self._events(choice)) > 1

    def _events(self, choice: Choice) -> list[Term]:
        found = dict.fromkeys(text for letter in choice.letters for text in self.letters.texts(letter))
        return [Name(text) for text in found]
