"""From reductions of the grammar to statements: one method per rule, run while the text is parsed.

Nothing here recurses: the parser keeps the stack, so a text may nest as deep as it likes until a rule refuses it.
"""

# ruff: noqa: D102 - what a method is about is the rule of its name in the grammar

from typing import Any, TypeAlias

from lark import Token, Transformer

from rvaft.guards import Guard, Operator
from rvaft.language.statements import (
    At,
    AttributeClause,
    CausalityStatement,
    Clause,
    EventStatement,
    GateClause,
    IgnoreStatement,
    ImportStatement,
    KindClause,
    LabelClause,
    NodeStatement,
    OnClause,
    ParamStatement,
    PruneStatement,
    Statement,
    TopicStatement,
    ToplevelStatement,
    WhenClause,
)
from rvaft.language.terms import (
    CONSTANTS,
    GuardTerm,
    PatternTerm,
    Slip,
    anything,
    integer_of,
    list_of,
    number_of,
    object_of,
    operation_of,
    scalar_of,
    text_of,
    word_of,
)
from rvaft.language.words import shown
from rvaft.model import Argument, Causality, Gate, Kind, On
from rvaft.patterns import Anything, Literal, Pattern, Variable

Items: TypeAlias = list[Any]


def _at(value: Any, token: Token) -> At[Any]:
    return At(value, token.line or 1, token.column or 1)


def _quoted(token: Token) -> str:
    return text_of(token) if token.startswith('"') else str(token)


def _between_commas(items: Items) -> Items:
    return items[::2]


class Build(Transformer[Token, Any]):
    """The callbacks of the grammar's rules."""

    # -- whole texts ------------------------------------------------------------------------------------------------

    def tree(self, items: Items) -> list[Statement]:
        return items

    def only_pattern(self, items: Items) -> Pattern:
        term: PatternTerm = items[0]
        return term.pattern

    def only_guard(self, items: Items) -> Guard:
        term: GuardTerm = items[0]
        return term.guard

    # -- statements -------------------------------------------------------------------------------------------------

    def toplevel(self, items: Items) -> ToplevelStatement:
        return ToplevelStatement(items[1])

    def param(self, items: Items) -> ParamStatement:
        return ParamStatement(items[1])

    def causality(self, items: Items) -> CausalityStatement:
        return CausalityStatement(_at(Causality(items[1]), items[0]))

    def import_(self, items: Items) -> ImportStatement:
        return ImportStatement(_at(text_of(items[1]), items[1]))

    def prune(self, items: Items) -> PruneStatement:
        return PruneStatement(tuple(items[1:-1]))

    def ignore(self, items: Items) -> IgnoreStatement:
        _, call, _, guard, _ = items
        return IgnoreStatement(call, None if guard is None else guard.guard)

    def event(self, items: Items) -> EventStatement:
        name, words, term = items[1], items[3] or [], items[6]
        parameters: list[str] = []
        for word in words:
            _check_parameter(word, parameters)
            parameters.append(str(word))
        for word in term.words:
            if word not in parameters:
                raise Slip(f"{shown(word)} is no parameter of {shown(name.value)}; text stands in quotes", word)
        return EventStatement(name, tuple(parameters), term.pattern)

    def topic(self, items: Items) -> TopicStatement:
        _, name, _, type_, _, publishers, _ = items
        return TopicStatement(_at(text_of(name), name), _at(text_of(type_), type_), tuple(publishers or ()))

    def publishers(self, items: Items) -> Items:
        return _between_commas(items)

    def parameters(self, items: Items) -> Items:
        return _between_commas(items)

    # -- nodes ------------------------------------------------------------------------------------------------------

    def node(self, items: Items) -> NodeStatement:
        name, *clauses, _ = items
        return NodeStatement(name, tuple(clause for clause in clauses if clause is not None))

    def gate(self, items: Items) -> At[Clause]:
        token, *children = items
        threshold = out_of = None
        if token.type == "K_OF_N":
            k, n = token.split("of")
            threshold, out_of = integer_of(k, token), integer_of(n, token)
        elif token.type == "VOT_K":
            threshold = integer_of(token.removeprefix("vot"), token)
        gate = Gate.VOT if threshold is not None else Gate(token)
        return _at(GateClause(gate, tuple(children), threshold, out_of), token)

    def on(self, items: Items) -> At[Clause]:
        call: At[On] = items[1]
        return At(OnClause(call.value), call.line, call.column)

    def when(self, items: Items) -> At[Clause]:
        return _at(WhenClause(items[1].guard), items[0])

    def kind(self, items: Items) -> At[Clause]:
        return _at(KindClause(Kind(items[0])), items[0])

    def label(self, items: Items) -> At[Clause]:
        return _at(LabelClause(text_of(items[1])), items[0])

    def attribute(self, items: Items) -> At[Clause]:
        key, _, value = items
        return _at(AttributeClause(_quoted(key), value), key)

    def call(self, items: Items) -> At[On]:
        name, arguments = items[0], items[2] or []
        return At(On(name.value, tuple(arguments)), name.line, name.column)

    def arguments(self, items: Items) -> list[Argument]:
        return [_argument(term.pattern) for term in _between_commas(items)]

    def name(self, items: Items) -> At[str]:
        return _at(_quoted(items[0]), items[0])

    event_name = name

    def value(self, items: Items) -> str:
        return _quoted(items[0])

    # -- patterns ---------------------------------------------------------------------------------------------------

    def variable(self, items: Items) -> PatternTerm:
        return word_of(items[0])

    def anything(self, _items: Items) -> PatternTerm:
        return anything()

    def string(self, items: Items) -> PatternTerm:
        return scalar_of(text_of(items[0]))

    def number(self, items: Items) -> PatternTerm:
        return scalar_of(number_of(items[-1], negative=len(items) > 1))

    def constant(self, items: Items) -> PatternTerm:
        return scalar_of(CONSTANTS[items[0]])

    def mapping(self, items: Items) -> PatternTerm:
        return object_of(items[0], items[1] or [])

    def fields(self, items: Items) -> Items:
        return _between_commas(items)

    def field(self, items: Items) -> tuple[Token, PatternTerm]:
        return items[0], items[2]

    def sequence(self, items: Items) -> PatternTerm:
        return list_of(items[0], items[1] or [])

    def items(self, items: Items) -> Items:
        return _between_commas(items)

    # -- guards -----------------------------------------------------------------------------------------------------

    def junction(self, items: Items) -> GuardTerm:
        return operation_of(Operator(items[1]), _between_commas(items), items[1])

    def binary(self, items: Items) -> GuardTerm:
        left, token, right = items
        return operation_of(Operator(token), [left, right], token)

    def unary(self, items: Items) -> GuardTerm:
        token, operand = items
        return operation_of(Operator.NOT if token.type == "NOT" else Operator.NEGATE, [operand], token)

    def guard_variable(self, items: Items) -> GuardTerm:
        return GuardTerm(Variable(str(items[0])))

    def guard_string(self, items: Items) -> GuardTerm:
        return GuardTerm(Literal(text_of(items[0])))

    def guard_number(self, items: Items) -> GuardTerm:
        return GuardTerm(Literal(number_of(items[0])), unsigned=True)

    def guard_constant(self, items: Items) -> GuardTerm:
        return GuardTerm(Literal(CONSTANTS[items[0]]))

    def parentheses(self, items: Items) -> GuardTerm:
        term: GuardTerm = items[1]
        return GuardTerm(term.guard, term.depth)


def _argument(pattern: Pattern) -> Argument:
    match pattern:
        case Literal() | Variable() | Anything():
            return pattern
        case _:  # the grammar has no other arguments
            raise AssertionError(pattern)


def _check_parameter(word: Token, before: Items) -> None:
    if word in CONSTANTS or not "a" <= word[0] <= "z":
        lower = word.lstrip("_")[:1].lower() + word.lstrip("_")[1:]
        mend = f", as in {shown(lower)}" if lower not in ("", word, *CONSTANTS) else ""
        raise Slip(f"{shown(word)} is no name for a parameter, which starts with a lower-case letter{mend}", word)
    if word in before:
        raise Slip(f"the parameter {shown(word)} stands twice in one event type", word)
