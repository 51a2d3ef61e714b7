"""The Prolog form back to the syntax of RML: the inverse of `writing`, so that RML's own rules run what was written.

Alternatives of a pattern come back as declarations of their own, which means the same.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import Final

from backends.rml.prolog.folding import fold
from backends.rml.prolog.terms import Clause, Term, clauses, refusal
from backends.rml.reading import syntax as s
from backends.rml.reading.reader import RmlMonitor, Rules
from backends.rml.reading.static import check
from rvaft.monitors import Monitor

_DATA: Final = {"=:=": "==", "=\\=": "!=", "=<": "<=", ",": "&&", ";": "||"}
_JOINS: Final = {"/\\": "and", "\\/": "or", "|": "shuffle"}
_REPEATS: Final = {"star": "star", "plus": "plus", "optional": "optional", "clos": "closure"}
_WORDS: Final[dict[str, bool | None]] = {"true": True, "false": False, "null": None}
_ADDED: Final = 2  # the event types `any` and `none`, which every specification has anyway


def read(text: str) -> Monitor:
    """A fresh monitor of a text in Prolog form, under the rules of the `rml` reader; raises `LanguageError`."""
    return RmlMonitor(_rules(text))


@lru_cache(maxsize=256)
def _rules(text: str) -> Rules:
    return Rules(program(text))


@lru_cache(maxsize=256)
def program(text: str) -> s.Program:
    """The specification that a text in Prolog form says; raises `LanguageError`."""
    *types, last = clauses(text)
    declarations = [_declaration(clause) for clause in types]
    if last.head.word != "trace_expression" or len(declarations) < _ADDED:
        raise refusal("there is no trace_expression at the end")
    equations = {goal.word: _equation(goal) for goal in last.goals if goal.kind == "equation"}
    found = s.Program(tuple(declarations[:-_ADDED]), equations)
    check(found)
    return found


# -- event types -------------------------------------------------------------------------------------------------------


def _declaration(clause: Clause) -> s.Declaration:
    if clause.head.word != "match" or len(clause.head.parts) != 2:
        raise refusal(f"a clause for {clause.head.word}")
    use = _use(clause.head.parts[1])
    negated = clause.goals[0].word == "not"
    values: list[s.Value] = []
    parents: list[s.TypeUse] = []
    guard = None
    for goal in clause.goals:
        match goal:
            case Term("guard", parts=(condition,)):
                guard = _data(condition)
            case Term("compound", "not", (Term("compound", ("fits" | "match") as way, (_, what)),)) if negated:
                values += [_value(what)] if way == "fits" else []
                parents += [_use(what)] if way == "match" else []
            case Term("compound", "fits", (_, what)) if not negated:
                values.append(_value(what))
            case Term("compound", "match", (_, what)) if not negated:
                parents.append(_use(what))
            case _:
                raise refusal(f"the goal {goal.word or goal.kind} in a clause for {use.name}")
    names = tuple(parameter.name for parameter in use.parameters if isinstance(parameter, s.Name))
    return s.Declaration(use.name, names, negated, tuple(values), tuple(parents), guard)


def _use(term: Term) -> s.TypeUse:
    name = term.word.removesuffix("_et")
    if term.kind not in ("name", "compound") or name == term.word:
        raise refusal(f"{term.word or term.kind} is no event type")
    return s.TypeUse(name, tuple(map(_parameter, term.parts)))


def _parameter(term: Term) -> s.Parameter:
    calculated = term.kind in ("operation", "negative") or (term.kind == "compound" and term.word != "var")
    return s.Unevaluated(_data(term)) if calculated else _value(term)


def _value(root: Term) -> s.Value:
    def inside(term: Term) -> Sequence[Term]:
        return term.parts if term.kind in ("object", "list", "open list") else ()

    def build(term: Term, parts: list[s.Value]) -> s.Value:
        match term.kind:
            case "object":
                return s.Fields(tuple(zip(term.names, parts, strict=True)))
            case "open list" if [part.kind for part in term.parts] == ["ignored"]:
                return s.Items((), more=True)  # `[_|_]` asks for at least one item, as `[...]` does
            case "list" | "open list":
                return s.Items(tuple(parts), more=term.kind == "open list")
            case "ignored":
                return s.Ignored()
            case _:
                return _datum(term)

    return fold(root, inside, build)


# -- data --------------------------------------------------------------------------------------------------------------


def _datum(term: Term) -> s.Constant | s.Name:
    match term:
        case Term("constant", value=value):
            return s.Constant(value)
        case Term("name", word) if word in _WORDS:
            return s.Constant(_WORDS[word])
        case Term("variable", word) if word.startswith("V_"):
            return s.Name(word.removeprefix("V_"))
        case Term("compound", "var", (Term("name", name),)):
            return s.Name(name)
        case _:
            raise refusal(f"{term.word or term.kind} where a value should stand")


def _data(root: Term) -> s.Data:
    def operands(term: Term) -> Sequence[Term]:
        named = term.kind == "compound" and term.word != "var"
        return term.parts if named or term.kind in ("operation", "negative", "group") else ()

    def build(term: Term, parts: list[s.Data]) -> s.Data:
        match term.kind:
            case "group":
                return parts[0]
            case "negative":
                return s.Apply("neg", tuple(parts))
            case "operation":
                return s.Apply(_DATA.get(term.word, term.word), tuple(parts))
            case _:
                return s.Apply(term.word, tuple(parts)) if parts else _datum(term)

    return fold(root, operands, build)


# -- expressions -------------------------------------------------------------------------------------------------------


def _equation(goal: Term) -> s.Equation:
    match goal.parts[0]:
        case Term("compound", "gen", (Term("list", parts=names), body)):
            return s.Equation(goal.word, tuple(name.word for name in names), _expression(body), (1, 1))
        case body:
            return s.Equation(goal.word, (), _expression(body), (1, 1))


def _expression(root: Term) -> s.Expression:
    return fold(root, _inside, _built)


def _inside(term: Term) -> Sequence[Term]:
    match term:
        case Term("group", parts=parts):
            return parts
        case Term("operation", ";", (Term("operation", ">>", (_, kept)), rest)):
            return kept, rest
        case Term("operation", "*"):
            return _sequence(term)
        case Term("operation", word) if word in _JOINS:
            return _operands(term)
        case Term("compound", "times", (body, _)):
            return (body,)
        case Term("compound", "var", (_, body)):
            return (body,)
        case Term("compound", "guarded", (_, *branches)):
            return branches
        case Term("compound", word, parts) if word in _REPEATS:
            return parts
        case _:
            return ()


def _sequence(term: Term) -> list[Term]:
    """The parts of `(a*(b*(c)))`: what stands in parentheses of its own is the last one."""
    parts = []
    while term.kind == "operation" and term.word == "*":
        parts.append(term.parts[0])
        term = term.parts[1]
    return [*parts, term]


def _operands(term: Term) -> list[Term]:
    r"""The parts of `((a/\b)/\c)`."""
    parts, word = list[Term](), term.word
    while term.kind == "operation" and term.word == word:
        parts.append(term.parts[1])
        term = term.parts[0]
    return [term, *reversed(parts)]


def _built(term: Term, parts: list[s.Expression]) -> s.Expression:
    match term:
        case Term("group"):
            return parts[0]
        case Term("constant", value=1):
            return s.Leaf("all")
        case Term("name", "eps"):
            return s.Leaf("empty")
        case Term("variable", word):
            return s.Reference(word)
        case Term("operation", ";", (Term("operation", ">>", (use, _)), _)):
            return s.Filtered(_use(use), *parts)
        case Term("operation", "*"):
            return s.Joined("cat", tuple(parts))
        case Term("operation", word) if word in _JOINS:
            return s.Joined(_JOINS[word], tuple(parts))
        case Term("compound", "times", (_, Term("constant", value=int() as number))):
            return s.Repeated("times", parts[0], number)
        case Term("compound", "var", (Term("name", name), _)):
            return s.Block(name, parts[0])
        case Term("compound", "guarded", (condition, _, _)):
            return s.Conditional(_data(condition), *parts)
        case Term("compound", "app", (Term("variable", name), Term("list", parts=arguments))):
            return s.Reference(name, tuple(map(_data, arguments)))
        case Term("compound", word) if word in _REPEATS:
            return s.Repeated(_REPEATS[word], parts[0])
        case _:
            return s.Occurs(_use(term))
