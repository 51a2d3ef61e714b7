"""Which variables of a declaration every match binds, however the event type is used."""

from collections.abc import Mapping

from backends.rml.reading import syntax as s


def always_bound(program: s.Program) -> Mapping[s.Declaration, frozenset[str]]:
    """For each declaration the names that stand for a value once its pattern or its parents have matched."""
    known: dict[s.Declaration, frozenset[str]] = {d: frozenset() for d in program.declarations}
    for _ in program.declarations:
        now = {declaration: _bound(declaration, program, known) for declaration in program.declarations}
        if now == known:
            break
        known = now
    return known


def _bound(
    declaration: s.Declaration, program: s.Program, known: Mapping[s.Declaration, frozenset[str]]
) -> frozenset[str]:
    if declaration.negated:
        return frozenset()
    ways = [_in_value(value) for value in declaration.values]
    ways += [_in_use(parent, program, known) for parent in declaration.parents]
    return frozenset.intersection(*ways)


def _in_value(value: s.Value) -> frozenset[str]:
    """The names that every choice of a pattern binds."""
    found: set[str] = set()
    todo = [value]
    while todo:
        match todo.pop():
            case s.Name(name):
                found.add(name)
            case s.Fields(fields):
                todo.extend(inner for _, inner in fields)
            case s.Items(items):
                todo.extend(items)
            case _:  # what stands in a `|` may stay without a value
                pass
    return frozenset(found)


def _in_use(use: s.TypeUse, program: s.Program, known: Mapping[s.Declaration, frozenset[str]]) -> frozenset[str]:
    found: frozenset[str] | None = None
    for declaration in program.declarations:
        if (declaration.name, len(declaration.parameters)) == (use.name, len(use.parameters)):
            pairs = zip(declaration.parameters, use.parameters, strict=True)
            here = frozenset(p.name for name, p in pairs if isinstance(p, s.Name) and name in known[declaration])
            found = here if found is None else found & here
    return found or frozenset()
