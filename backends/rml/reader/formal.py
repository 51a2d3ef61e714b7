"""The abstract syntax of texts without shared variables, for the validator of `proofs/`."""

from backends.rml.reader import syntax as s
from backends.rml.reader.event_types import alternatives_of
from backends.rml.reader.parser import parse
from rvaft.errors import NotExpressible
from rvaft.export.verified import EventConditions
from rvaft.model.values import Json


def formal(text: str) -> Json:
    """Return the equations, `Main` first; raises `NotExpressible`, `LanguageError`, `TooLarge`."""
    program, events = parse(text), EventConditions()
    reachable = list(program.reachable())
    place = {equation.name: number for number, equation in enumerate(reachable)}

    def test(use: s.TypeUse) -> Json:
        alternatives: list[Json] = ["or"]
        for declaration in program.declared.get(s.signature(use), ()):
            derived = [one for one in declaration.alternatives if isinstance(one, s.TypeUse)]
            if declaration.negated or (derived and not declaration.parameters and declaration.guard is None):
                if (
                    declaration.parameters
                    or declaration.guard is not None
                    or len(derived) < len(declaration.alternatives)
                ):
                    raise NotExpressible("an event type has a negation with variables")
                either: Json = ["or", *map(test, derived)]
                alternatives.append(["not", either] if declaration.negated else either)
            else:
                alternatives += map(events.of, alternatives_of(program, declaration, use))
        return alternatives

    def term(part: s.Expression, below: list[Json]) -> Json:
        match part:
            case s.Expression("all" | "empty" | "cat" | "and" | "or" | "shuffle" | "star" | "optional" as operator):
                return [operator, *below]
            case s.Expression("event" | "filter" as operator, data=use) if not use.variables:
                return [operator, test(use), *below]
            case s.Expression("times", data=number) if number > 0:
                return ["cat", *below * number]
            case s.Expression("call", data=(name, (), ())):
                return ["call", place[name]]
            case _:
                raise NotExpressible("the text has variables, or an operator that is not in the formal syntax")

    if any(equation.parameters for equation in reachable):
        raise NotExpressible("an equation of the text has parameters")
    return events.text("rml", [s.fold(equation.body, term, lambda part: part.parts) for equation in reachable])
