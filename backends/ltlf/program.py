"""A text made ready to run; monitors of one text share it, so that their states can be compared."""

from collections.abc import Mapping
from functools import lru_cache

from backends.ltlf.atoms import Atom, atoms_of, candidates_of
from backends.ltlf.formulas import Formulas, Op
from backends.ltlf.header import Header, split
from backends.ltlf.liveness import Liveness
from backends.ltlf.residuals import Residuals
from backends.ltlf.spot_text import parse
from rvaft.errors import LanguageError
from rvaft.patterns import Pattern


class Program:
    """The formula of a text, its atoms, and everything that was found out about its residuals so far."""

    def __init__(self, text: str, given: Mapping[str, Pattern]) -> None:
        header, rest = split(text)
        formulas = Formulas()
        root = root_of(header, rest, formulas)
        names = [row.name for row in formulas.rows if row.op is Op.ATOM]
        self.atoms: dict[str, Atom] = atoms_of(header, names, given)
        self.candidates = candidates_of(self.atoms)
        self.residuals = Residuals(formulas, {name: atom.mentions for name, atom in self.atoms.items()})
        self.liveness = Liveness(formulas, self.residuals.diagrams)
        self.initial = self.residuals.of(root)


def root_of(header: Header, rest: str, formulas: Formulas) -> int:
    """The formula behind a header, among `formulas`; raises `LanguageError` and `ToolMissing`."""
    known: dict[str, int] = {}

    def atom(name: str) -> int:
        if name in header.definitions and name not in known:
            unknown = next(one for one in header.definitions if one not in known)  # the one that is being read
            line, column = header.places[unknown]
            raise LanguageError(f"{name} is used before it is defined", file="<ltlf>", line=line, column=column)
        return known[name] if name in known else formulas.atom(name)

    for name in header.definitions:
        line, column = header.places[name]
        known[name] = parse(header.definitions[name], formulas, atom, line=line, column=column)
    skipped = len(rest) - len(rest.lstrip())
    before = rest[:skipped]
    line = 1 + before.count("\n")
    column = len(before) - before.rfind("\n")
    if not rest.strip():
        message = "there is no formula after the comment" if skipped else "there is no formula"
        raise LanguageError(message, file="<ltlf>", line=line, column=column)
    return parse(rest[skipped:].rstrip(), formulas, atom, line=line, column=column)


@lru_cache(maxsize=32)
def _cached(text: str, given: tuple[tuple[str, Pattern], ...]) -> Program:
    return Program(text, dict(given))


def program(text: str, given: Mapping[str, Pattern]) -> Program:
    """The program of a text; the same one again while it is remembered. Raises `LanguageError` and `ToolMissing`."""
    return _cached(text, tuple(sorted(given.items(), key=lambda item: item[0])))
