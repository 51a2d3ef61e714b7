"""A backend expresses what it lists, and refuses everything else with a reason."""

from collections.abc import Mapping
from typing import Any, ClassVar

import pytest

from backends.conformance.trees import GROUPS
from rvaft import Backend, Metrics, NotExpressible, Semantics, ToolFailed, loads, translate
from rvaft.backend import SpecificationText, backend
from rvaft.capabilities import EVERY_OPERATOR, GATES, JSON_VALUES, Feature, Ties, Value, described, table
from rvaft.core.passes import expand_times
from rvaft.core.property import PARTS, All, Condition, Event, Property
from rvaft.core.restriction import restrict
from rvaft.core.time_order import order_ends, windows_to_guards
from rvaft.errors import Cause, Reason, WrongType, cannot, unwritten
from rvaft.language.parser import parse_guard
from rvaft.model.guards import Operation, Operator, definition, walk
from tests.cli.runs import run

EVENTS = "event e(v) = { v: v }; event f(v) = { w: v }; "
CONSTRUCTS: Mapping[str, tuple[str, str]] = {
    "and": ("r and a b;", "and"),
    "or": ("r or a b;", "or"),
    "sand": ("r sand a b;", "sand"),
    "sand_rl": ("r sand_rl a b;", "sand"),
    "pand": ("r pand a b;", "pand"),
    "vote": ("r 2of3 a b c;", "k-of-n"),
    "times": ("r times 2;", "times"),
    "within": ("time t as s; r and a b within 5 s;", "within"),
    "when": ("r on e(X) when X > 1;", "when"),
    "event of a gate": ("r or a on e(1);", "sand"),
    "number": ("r on e(1);", "numbers"),
    "boolean": ("r on e(true);", "true and false"),
    "null": ("r on e(null);", "null"),
}
GUARDS: Mapping[Operator, str] = {Operator(sign): row["one"][0] for sign, row in GROUPS["operator"].items()}
"""For each operator a guard with it: those of the rows that every backend is held to."""
assert set(GUARDS) == set(Operator)


class Bare(Backend):
    """Lists a semantics and nothing else."""

    name, language, suffix, default_limit = "bare", "bare", ".bare", 100
    semantics: ClassVar[frozenset[Semantics]] = frozenset({Semantics.SCATTERED})

    def write(self, prop: Property, semantics: Semantics, limit: int) -> SpecificationText:
        return SpecificationText(f"{semantics} {limit}: {type(prop.root).__name__}", Metrics(1))


def refusal(backend: Backend, text: str, semantics: str = "scattered") -> NotExpressible:
    with pytest.raises(NotExpressible) as raised:
        backend.translate(loads(EVENTS + text), Semantics(semantics))
    return raised.value


def test_a_backend_that_lists_nothing_expresses_single_events_alone() -> None:
    assert Bare().translate(loads("r;"), Semantics.SCATTERED).text == "scattered 100: Event"
    assert Bare().translate(loads("r;"), Semantics.SCATTERED, limit=7).text == "scattered 7: Event"
    assert str(refusal(Bare(), "r;", "strict")) == (
        "rvaft does not write this tree in bare under strict: the backend does not write this semantics"
    )


@pytest.mark.parametrize(("text", "word"), CONSTRUCTS.values(), ids=CONSTRUCTS)
def test_it_refuses_every_construct_by_name(text: str, word: str) -> None:
    found = refusal(Bare(), text)
    assert found.backend == "bare"
    assert word in found.reason


def test_a_refusal_names_the_nodes() -> None:
    found = refusal(Bare(), "r and a b; b times 3;")
    assert str(found).endswith("the backend writes no events in any order (`and`) (at r)")


@pytest.mark.parametrize(("operator", "guard"), GUARDS.items(), ids=map(str, GUARDS))
def test_every_operator_is_refused_unless_it_is_listed(operator: Operator, guard: str) -> None:
    meaning = definition(parse_guard(guard))
    parts = {part.operator for part in walk(meaning) if isinstance(part, Operation)}

    class Without(Bare):
        says = GATES | {Condition}
        values = JSON_VALUES
        operators = frozenset(Operator) - {operator, *parts}

    class With(Without):
        operators = frozenset(Operator)

    class WithParts(Without):
        operators = frozenset(Operator) - {operator}

    text = f"r on e(X) when {guard};"
    assert f"`{operator.value}`" in refusal(Without(), text).reason
    assert With().translate(loads(EVENTS + text), Semantics.SCATTERED)
    if parts:
        assert WithParts().translate(loads(EVENTS + text), Semantics.SCATTERED)


def test_a_guard_that_decides_relevance_is_checked_where_relevance_counts() -> None:
    class Gates(Bare):
        says, values, semantics = GATES, JSON_VALUES, frozenset(Semantics)

    text = "ignore e(X) when X > 1; r sand a b;"
    assert Gates().translate(loads(EVENTS + text), Semantics.STRICT)
    assert "`>`" in refusal(Gates(), text, "projected").reason


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("r and a b; a on e(X); b on f(X);", "variables over several events: variable X"),
        ("r and a b; a on e(X); b on f(Y) when Y > X;", "variables over several events: a guard over several events"),
        ('r and a b when X == "u"; a on e(X); b on f(X);', "values that guards and types leave: variable X"),
    ],
)
def test_what_ties_events_is_refused_unless_it_is_listed(text: str, reason: str) -> None:
    class Untied(Bare):
        says, operators = GATES | {Condition}, EVERY_OPERATOR

    class Tied(Untied):
        ties = Ties.ANY

    assert refusal(Untied(), text).reason.endswith(reason)
    assert Tied().translate(loads(EVENTS + text), Semantics.SCATTERED)


def test_variables_of_alternatives_tie_nothing() -> None:
    class Untied(Bare):
        says, operators, values = GATES | {Condition}, EVERY_OPERATOR, frozenset({Value.NUMBER})

    text = "r or a b; a on e(X) when X > 1; b on f(X) when X > 2;"
    assert Untied().translate(loads(EVENTS + text), Semantics.SCATTERED)


def test_passes_remove_what_a_language_lacks_before_it_is_written() -> None:
    class Plain(Bare):
        says, values, operators = GATES | {Condition}, JSON_VALUES, EVERY_OPERATOR
        features: ClassVar[frozenset[Feature]] = frozenset({Feature.TIME_POINTS})
        passes, ties = (expand_times, order_ends, windows_to_guards), Ties.ANY

        def write(self, prop: Property, semantics: Semantics, limit: int) -> SpecificationText:
            assert {type(part) for part in prop.parts} <= self.says
            return super().write(prop, semantics, limit)

    for text, _ in CONSTRUCTS.values():
        if "late" not in text:
            assert Plain().translate(loads(EVENTS + text), Semantics.SCATTERED)


def test_what_passes_leave_behind_is_refused() -> None:
    class Half(Bare):
        """Claims no gate, though its pass makes sequences."""

        says: ClassVar[frozenset[Any]] = frozenset({Event})
        passes = (expand_times,)

    assert "events in order (`sand`)" in refusal(Half(), "r times 2;").reason


def test_reasons_of_a_language_replace_the_general_ones() -> None:
    class Reasoned(Bare):
        reasons: ClassVar[Mapping[Any, Reason]] = {
            All: cannot("all of it at once is too much"),
            Semantics: unwritten("it skips events"),
        }

    found = refusal(Reasoned(), "r and a b;")
    assert (found.reason, found.cause) == ("all of it at once is too much", Cause.LANGUAGE)
    assert str(found) == "bare cannot express this tree under scattered: all of it at once is too much (at r)"
    found = refusal(Reasoned(), "r;", "strict")
    assert (found.reason, found.cause) == ("it skips events", Cause.WRITER)
    assert str(found) == "rvaft does not write this tree in bare under strict: it skips events"


def test_a_refusal_without_a_cause_is_an_error_of_the_backend() -> None:
    with pytest.raises(WrongType, match=r"the reason of a refusal must be cannot\(…\) or unwritten\(…\)"):
        NotExpressible("too much")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("text", "language", "cause"),
    [
        ("r and a b; a on e(X); b on f(X);", "mtl", Cause.LANGUAGE),
        ("r and a b; a on e(X); b on f(Y) when Y > X;", "stix", Cause.LANGUAGE),
        ("r and a b when X in (1, 2); a on e(X); b on f(X);", "mtl", Cause.WRITER),
        ("r and a b; a on e(X); b on f(Y) when Y == 1 or X == 1;", "mtl", Cause.WRITER),
        ("r and a b; a on e(X); b on f(Y) when X * Y == 0;", "mtl", Cause.WRITER),
        ("event t(v: boolean) = { v: v }; assume types; r and a b; a on t(X); b on t(X);", "mtl", Cause.WRITER),
        ("r or a; a on e(null);", "stix", Cause.LANGUAGE),
        ("r or a; a on e(null);", "eql", Cause.LANGUAGE),
        ("time t as s; r sand a b within 5 s;", "mtl-r2u2", Cause.WRITER),
        ("time t as s; r sand a b when at(b) >= at(a) + 5 s;", "mtl", Cause.WRITER),
    ],
)
def test_a_language_cannot_what_no_text_of_it_could(text: str, language: str, cause: Cause) -> None:
    assert refusal(backend(language), text).cause is cause


def test_an_extension_is_told_of_a_text_and_in_the_table() -> None:
    for name in ("automaton", "ltlf"):
        found = {
            text: translate(loads(EVENTS + text), name, semantics="scattered").extensions
            for text in ("r sand a b;", "r sand a b; a on e(X); b on e(X);", "time t as s; r and a b within 5 s;")
        }
        assert [*found.values()] == [(), ("slices",), ("time variables",)]
    assert (
        translate(loads(f"{EVENTS} r and a b; a on e(X); b on e(X);"), "mfotl", semantics="scattered").extensions == ()
    )
    rows = {row[0]: row for row in table({name: backend(name).capabilities() for name in ("ltlf", "mtl", "sigma")})}
    assert rows["variables over any events"][1:] == ("slices", "no", "-")
    assert rows["windows (`within`)"][1:] == ("time variables", "yes", "yes")
    assert rows["guards (`when`)"][1:] == ("yes", "yes", "assume types")


@pytest.mark.parametrize("text", ["ignore e(1); r;", "r or a b; a; b on e(1);"])
def test_a_value_that_decides_relevance_is_checked_where_relevance_counts(text: str) -> None:
    class Wide(Bare):
        says = frozenset(PARTS)
        semantics: ClassVar[frozenset[Semantics]] = frozenset({Semantics.PROJECTED})

    with pytest.raises(NotExpressible, match="the backend writes no numbers"):
        Wide().translate(restrict(loads(EVENTS + text), branch=1), Semantics.PROJECTED)


@pytest.mark.parametrize("wrong", [{"says": [Event]}, {"ties": "none"}, {"operators": set()}, {"passes": []}])
def test_a_capability_of_a_wrong_type_is_refused_when_the_class_is_made(wrong: dict[str, Any]) -> None:
    with pytest.raises(TypeError, match=f"Wrong.{next(iter(wrong))} must be a "):
        type("Wrong", (Bare,), wrong)


def test_what_write_returns_is_checked() -> None:
    class Silent(Bare):
        def write(self, prop: Property, semantics: Semantics, limit: int) -> SpecificationText:  # noqa: ARG002
            return None  # type: ignore[return-value]

    with pytest.raises(ToolFailed, match="returned NoneType"):
        Silent().translate(loads("r;"), Semantics.SCATTERED)


def test_translate_cannot_be_replaced() -> None:
    with pytest.raises(TypeError, match=r"must not override Backend\.translate"):

        class Own(Bare):
            def translate(self, *_: Any, **__: Any) -> Any:  # type: ignore[misc]
                return None


def test_the_table_of_capabilities_has_every_part() -> None:
    table = run("backends", "--capabilities").stdout
    for part in PARTS:
        assert f"\n{described(part)} " in table
    for operator in set(Operator) - {Operator.NEGATE}:
        assert f" {operator.value} " in table
