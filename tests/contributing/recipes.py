"""What each recipe of CONTRIBUTING.md adds, step by step, in the order of the recipe."""

from typing import Final

from tests.contributing.copies import Edit, Recipe

OPERATOR: Final[Recipe] = {
    "member": [Edit("rvaft/model/guards.py", '    MAX = "max"\n', '    LENGTH = "length"\n')],
    "table": [
        Edit(
            "rvaft/model/guards.py",
            '    _O.MAX: OperatorFacts(8, "max", _calculating(max), _NUMERALS, TermSort.NUMBER, None),\n',
            '    _O.LENGTH: OperatorFacts(8, "length", _texts(len), _STRINGS, TermSort.NUMBER, 1),\n',
        )
    ],
    "grammar": [Edit("rvaft/language/grammar.lark", "FUNCTION    : /(?:", "length|")],
    "reference": [
        Edit(
            "rvaft/semantics/events.py",
            "FUNCTIONS: Mapping[str, Callable[..., Any]] = {\n",
            '    "length": lambda text: len(typed(text, str)),\n',
        )
    ],
    "conformance": [
        Edit(
            "backends/conformance.toml",
            "[operator]\n",
            'length = { one = ["length(X) > 2", "abc", "ab"], '
            'two = ["length(X) == length(Y)", ["ab", "xy"], ["ab", "xyz"]] }\n',
        )
    ],
}
"""The function `length(X)`: the number of characters of a text."""

_MEANS: Final = (
    "means=lambda x, low, high: Operation(_O.AND, (Operation(_O.GE, (x, low)), Operation(_O.LE, (x, high))))"
)
DEFINED: Final[Recipe] = {
    "member": [Edit("rvaft/model/guards.py", '    MAX = "max"\n', '    BETWEEN = "between"\n')],
    "table": [
        Edit(
            "rvaft/model/guards.py",
            '    _O.MAX: OperatorFacts(8, "max", _calculating(max), _NUMERALS, TermSort.NUMBER, None),\n',
            f'    _O.BETWEEN: OperatorFacts(8, "between", None, _ORDERED, TermSort.TRUTH, 3, {_MEANS}),\n',
        )
    ],
    "grammar": [Edit("rvaft/language/grammar.lark", "FUNCTION    : /(?:", "between|")],
    "reference": [
        Edit(
            "rvaft/semantics/events.py",
            "    operator, operands = guard.operator.value, guard.operands\n",
            '    if operator == "between":\n'
            "        value, low, high = operands\n"
            '        at_least = binary(">=", evaluate(value, binding), evaluate(low, binding))\n'
            '        return at_least and binary("<=", evaluate(value, binding), evaluate(high, binding))\n',
        )
    ],
    "conformance": [
        Edit(
            "backends/conformance.toml",
            "[operator]\n",
            'between = { one = ["between(X, 1, 3)", 3, 4], two = ["between(Y, X, 3)", [1, 2], [1, 4]] }\n',
        )
    ],
}
"""The function `between(X, A, B)`, which means `X >= A and X <= B`."""

_TABLES: Final = {
    "rvaft/export/layout.py": '    Gate.INHIBIT: ("INHIBIT", "all, from left to right, but the last one first"),\n',
}
_LAST: Final = {
    "rvaft/export/layout.py": '    Gate.VOT: ("VOT k/n", "at least k of the n"),\n',
}

GATE: Final[Recipe] = {
    "member": [
        Edit("rvaft/model/nodes.py", '    PAND = "pand"\n', '    INHIBIT = "inhibit"\n'),
        Edit("rvaft/model/nodes.py", "        return self in (Gate.SAND, ", "Gate.INHIBIT, "),
    ],
    "core": [
        Edit(
            "rvaft/core/build.py",
            "            return EndInOrder(source, parts)\n",
            "        case Gate.INHIBIT:\n            return Sequence(source, (parts[-1], *parts[:-1]))\n",
        ),
    ],
    "drawings": [
        *(Edit(file, _LAST[file], text) for file, text in _TABLES.items()),
        Edit(
            "rvaft/export/layout.py",
            "            return len(node.children) - place\n",
            "        case Gate.INHIBIT:\n            return (place + 1) % len(node.children) + 1\n",
        ),
        Edit("rvaft/export/placing.py", "            case Gate.AND ", "| Gate.INHIBIT "),
        Edit("rvaft/export/galileo_text.py", '    Gate.SAND_RL: "pand",\n', '    Gate.INHIBIT: "pand",\n'),
    ],
    "prune": [Edit("rvaft/language/draft.py", "            case Gate.OR | Gate.AND ", "| Gate.INHIBIT ")],
    "grammar": [
        Edit("rvaft/language/grammar.lark", "gate        : (OR | AND ", "| INHIBIT "),
        Edit("rvaft/language/grammar.lark", "PLAIN_NODE.5: NAME (GAP (OR | AND ", "| INHIBIT "),
        Edit("rvaft/language/grammar.lark", "PAND        : /pand(?!\\w)/\n", "INHIBIT     : /inhibit(?!\\w)/\n"),
    ],
    "reference": [
        Edit(
            "rvaft/semantics/scenarios.py",
            "children = self.kept[node.name] if node.gate is not Gate.SAND_RL else self.kept[node.name][::-1]\n",
            "            if node.gate is Gate.INHIBIT:\n                children = children[-1:] + children[:-1]\n",
        ),
        Edit("rvaft/semantics/scenarios.py", "            if node.gate in (Gate.SAND, ", "Gate.INHIBIT, "),
    ],
    "conformance": [
        Edit(
            "backends/conformance.toml",
            'detects = ["c", "b", "a", "d"]\nmisses = ["a", "c", "d", "b"]\n',
            '[construct.inhibit]\ntree = "r inhibit a b c;"\ndetects = ["c", "a", "b"]\nmisses = ["a", "b", "c"]\n',
        )
    ],
}
"""The gate `inhibit a b c`: all children in sequence, the last one first."""

ESPER: Final = '''"""The `esper` backend: a pattern of Esper EPL, which follows events in order. It is only emitted."""

import json
from typing import ClassVar

from rvaft.backend import Backend, Metrics, SpecificationText
from rvaft.core.property import Event, Part, Property, Sequence
from rvaft.errors import NotExpressible, TooLarge, unwritten
from rvaft.model.patterns import Anything, Literal, ObjectPattern, Pattern, Variable
from rvaft.model.verdict import Semantics, Verdict


class EsperBackend(Backend):
    """Sequences of events, of which the pattern skips what comes between."""

    name: ClassVar[str] = "esper"
    language: ClassVar[str] = "epl"
    suffix: ClassVar[str] = ".epl"
    readable: ClassVar[bool] = False
    verdicts: ClassVar[frozenset[Verdict]] = frozenset({Verdict.TRUE, Verdict.UNKNOWN})
    semantics: ClassVar[frozenset[Semantics]] = frozenset({Semantics.SCATTERED})
    says: ClassVar[frozenset[type[Part]]] = frozenset({Event, Sequence})
    default_limit: ClassVar[int] = 1_000

    def write(self, prop: Property, semantics: Semantics, limit: int) -> SpecificationText:
        """A pattern; `limit` bounds its events."""
        if len(prop.events) > limit:
            raise TooLarge("events of a pattern", limit=limit)
        text = f"select * from pattern [every {written(prop.root)}]\\n"
        return SpecificationText(text, Metrics(symbols=len(prop.parts), subformulas=len(prop.events)))


def written(part: Part) -> str:
    """A part as a pattern."""
    match part:
        case Event(source, pattern):
            tests = " and ".join(conditions("", pattern, source.node))
            return f"Log({tests})"
        case Sequence(parts=parts):
            return f"({' -> '.join(map(written, parts))})"
        case _:
            raise AssertionError(f"{type(part).__name__} is not in `says`")


def conditions(path: str, pattern: Pattern, node: str) -> list[str]:
    """What a pattern asks of the property at a path."""
    match pattern:
        case ObjectPattern(fields) if fields:
            inner = ((f"{path}.{name}" if path else name, below) for name, below in fields)
            return [test for place, below in inner for test in conditions(place, below, node)]
        case Literal(str() as text) if path:
            return [f"{path} = {json.dumps(text)}"]
        case Variable() | Anything() if path:
            return [f"exists({path}?)"]
        case _:
            raise NotExpressible(unwritten("a filter of EPL asks for texts in properties"), nodes=[node])
'''
BACKEND: Final[Recipe] = {
    "class": [Edit("backends/esper.py", "", ESPER)],
    "registration": [
        Edit("pyproject.toml", '[project.entry-points."rvaft.backends"]\n', 'esper = "backends.esper:EsperBackend"\n')
    ],
}
"""A writer of Esper EPL that has sequences of events alone."""

LOGFMT: Final = '''"""Lines of `key=value`; a value with spaces stands in quotes."""

import json
import re
from typing import ClassVar, Final

from rvaft.model.values import Json
from rvaft.readers.log import LineReader, Log

_FIELD: Final = re.compile(r\'([^\\s="]+)=("(?:[^"\\\\]|\\\\.)*"|[^\\s"]*)(?:\\s+|$)\')


class LogfmtReader(LineReader):
    """Lines of logfmt; every value is a text."""

    name: ClassVar[str] = "logfmt"
    suffixes: ClassVar[tuple[str, ...]] = (".logfmt",)

    def event(self, line: str, log: Log) -> dict[str, Json]:
        """The fields of a line."""
        event, place = dict[str, Json](), 0
        while found := _FIELD.match(line, place):
            name, text = found.groups()
            event[name] = json.loads(text) if text.startswith(\'"\') else text
            place = found.end()
        if place < len(line):
            raise ValueError("no line of logfmt: fields are written key=value")
        return event
'''
READER: Final[Recipe] = {
    "class": [Edit("rvaft/readers/logfmt.py", "", LOGFMT)],
    "registration": [
        Edit(
            "pyproject.toml",
            '[project.entry-points."rvaft.readers"]\n',
            'logfmt = "rvaft.readers.logfmt:LogfmtReader"\n',
        )
    ],
}
"""A reader of logs in logfmt."""
