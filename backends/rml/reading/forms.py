"""The forms that terms are brought to after a step, as in the published monitor but for `t | all` (see `deviations`)."""

from backends.rml.reading.terms import Term, Terms


class Forms:
    """The forms over the terms of one program."""

    def __init__(self, terms: Terms) -> None:
        self._terms = terms

    def then(self, first: Term, rest: Term) -> Term:
        """One after the other, nested to the right by one step; what that puts together is not simplified."""
        terms = self._terms
        if first in (terms.all, terms.nothing):
            return first
        if first is terms.empty:
            return rest
        if rest is terms.empty:
            return first
        if first.operator != "cat":
            return terms.sequence([first, rest])
        head, tail = first.parts
        return terms.sequence([head, terms.make("cat", (tail, rest))])

    def shuffle(self, parts: tuple[Term, ...]) -> Term:
        """Side by side, flat."""
        left = tuple(part for part in _flat("shuffle", parts) if part is not self._terms.empty)
        if not left:
            return self._terms.empty
        return left[0] if len(left) == 1 else self._terms.make("shuffle", left)

    def both(self, parts: tuple[Term, ...]) -> Term:
        """All at once, flat."""
        left = tuple(part for part in _flat("and", parts) if part is not self._terms.all)
        if not left:
            return self._terms.all
        return left[0] if len(left) == 1 else self._terms.make("and", left)

    def closure(self, body: Term) -> Term:
        """Every prefix."""
        return body if body is self._terms.all else self._terms.repeated("closure", body)

    def filtered(self, term: Term, inside: Term, outside: Term) -> Term:
        """A filter with new parts."""
        if inside is self._terms.all and outside is self._terms.all:
            return self._terms.all
        return self._terms.filtered(term.data, inside, outside)


def _flat(operator: str, parts: tuple[Term, ...]) -> list[Term]:
    found: list[Term] = []
    for part in parts:
        found.extend(part.parts if part.operator == operator else (part,))
    return found
