"""The abstract syntax of formulas without variables, for the validator of `proofs/`."""

from typing import Final

from backends.ltlf.formulas import Connective, Formulas
from backends.ltlf.reader import formula_of
from rvaft.backend import Observed
from rvaft.errors import NotExpressible
from rvaft.export.verified import EventConditions
from rvaft.model.patterns import Literal, ObjectPattern, rigid_variables
from rvaft.model.values import Json

_WORDS: Final = {
    Connective.TRUE: "and",
    Connective.FALSE: "or",
    Connective.ATOM: "atom",
    Connective.NOT: "not",
    Connective.AND: "and",
    Connective.OR: "or",
    Connective.NEXT: "next",
    Connective.EVENTUALLY: "eventually",
    Connective.UNTIL: "until",
}
assert set(_WORDS) == set(Connective)


def formal(text: str) -> Json:
    """Return the formula as rows, operands first; raises `NotExpressible` and `LanguageError`."""
    formulas, events = Formulas(), EventConditions()
    header, root = formula_of(text, formulas)
    if header.time is not None:
        raise NotExpressible("the text has times")

    def atom(name: str) -> Json:
        if name in header.relevant or name in header.ignored:
            kinds = header.relevant.get(name, ()), header.ignored.get(name, ())
            return events.relevance(*([Observed(one.pattern, one.when) for one in kind] for kind in kinds))
        one = header.atoms.get(name)
        if one is None:
            return events.of(Observed(ObjectPattern((("event", Literal(name)),))))
        if one.guards or rigid_variables(one.pattern):
            raise NotExpressible("the events of the text have variables")
        return events.of(Observed(one.pattern))

    numbers = formulas.reachable(root)
    place = {number: row for row, number in enumerate(numbers)}
    body: list[Json] = []
    for number in numbers:
        row = formulas.rows[number]
        operands = [atom(row.name)] if row.op is Connective.ATOM else [place[operand] for operand in row.operands]
        body.append([_WORDS[row.op], *operands])
    return events.text("ltlf", body)
