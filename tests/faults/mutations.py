"""Small changes of Python functions: the places where one is possible, and the functions changed where they live.

A site is an expression in the body of a function and another one in its place. What has no meaning to be wrong about is left out:
assertions, what is raised, annotations, doc strings.
"""

import ast
import gc
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from copy import deepcopy
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Final, TypeAlias

Definition: TypeAlias = ast.FunctionDef | ast.AsyncFunctionDef
Other: TypeAlias = Callable[[], ast.expr]
"""Another expression, made when it is wanted."""
Live: TypeAlias = Mapping[tuple[str, str, int], list[FunctionType]]

_COMPARISONS: Final[Mapping[type[ast.cmpop], type[ast.cmpop]]] = {
    one: other
    for pair in ((ast.Lt, ast.LtE), (ast.Gt, ast.GtE), (ast.Eq, ast.NotEq), (ast.In, ast.NotIn), (ast.Is, ast.IsNot))
    for one, other in (pair, pair[::-1])
}
_OPERATIONS: Final[Mapping[type[ast.operator], type[ast.operator]]] = {
    one: other
    for pair in ((ast.Add, ast.Sub), (ast.BitAnd, ast.BitOr), (ast.LShift, ast.RShift))
    for one, other in (pair, pair[::-1])
}
_FUNCTIONS: Final = {"any": "all", "all": "any", "min": "max", "max": "min"}
_SMALL: Final = 8
_SKIPPED: Final = (ast.Assert, ast.Raise, ast.pattern, ast.arguments)
_NO_EXPRESSIONS: Final = ("annotation", "returns", "decorator_list", "type_params")
_SWITCH: Final = "_site_is_changed_"
_MARK: Final = "_site_is_reached_"


@dataclass(frozen=True, slots=True)
class Mutant:
    """A module with one change; `str` says where and what."""

    module: str
    function: str
    line: int
    change: str
    code: CodeType

    def __str__(self) -> str:
        return f"{self.module}:{self.line} {self.function}: {self.change}"


def live_functions() -> Live:
    """All functions of this process by file, qualified name and first line, however they are wrapped."""
    found: dict[tuple[str, str, int], list[FunctionType]] = defaultdict(list)
    for one in gc.get_objects():
        if isinstance(one, FunctionType):
            found[_key(one.__code__)].append(one)
    return found


def forget_caches() -> None:
    """Empty every `functools.cache` of this process."""
    for one in gc.get_objects():
        if type(one).__name__ == "_lru_cache_wrapper":
            one.cache_clear()


class Source:
    """The text of one module, whose sites are numbered as they are met."""

    def __init__(self, module: ModuleType) -> None:
        assert module.__file__ is not None
        self.module = module
        self.path = module.__file__
        self._text = Path(self.path).read_text(encoding="utf-8")

    def mark(self, reached: Callable[[int], object], live: Live) -> None:
        """From now on the module tells whenever a site is reached, by its number."""

        def marked(_: str, original: ast.expr, first: int, others: list[Other]) -> ast.expr:
            calls: list[ast.expr] = [_call(_MARK, first + offset) for offset in range(len(others))]
            return ast.Subscript(ast.Tuple([*calls, original], ast.Load()), ast.Constant(-1), ast.Load())

        vars(self.module)[_MARK] = reached
        self._put(self._compiled(marked), live)

    def mutant(self, number: int) -> Mutant:
        """The module with the change at one site."""
        where: list[tuple[str, int, str]] = []

        def changed(function: str, original: ast.expr, first: int, others: list[Other]) -> ast.expr:
            if not 0 <= number - first < len(others):
                return original
            new = others[number - first]()
            where.append((function, original.lineno, f"`{ast.unparse(new)}` for `{ast.unparse(original)}`"))
            # what a function sees of the functions around it must stay the same, so the original stays in the text
            return ast.IfExp(ast.Name(_SWITCH, ast.Load()), new, original)

        code = self._compiled(changed)
        return Mutant(self.module.__name__, *where[0], code)

    def change(self, mutant: Mutant, live: Live) -> None:
        """From now on the functions of the module are those of the mutant."""
        vars(self.module)[_SWITCH] = True
        self._put(mutant.code, live)

    def _compiled(self, at: Callable[[str, ast.expr, int, list[Other]], ast.expr]) -> CodeType:
        """The text with another expression at each site."""
        tree = ast.parse(self._text)
        numbers = 0

        def ask(function: str, original: ast.expr, others: list[Other]) -> ast.expr:
            nonlocal numbers
            numbers += len(others)
            return ast.copy_location(at(function, original, numbers - len(others), others), original)

        for name, function in _functions(tree.body, ""):
            truth = isinstance(function.returns, ast.Name) and function.returns.id == "bool"
            for statement in function.body:
                _visit(statement, partial(ask, name), truth=truth)
        return compile(ast.fix_missing_locations(tree), self.path, "exec", dont_inherit=True)

    @staticmethod
    def _put(module: CodeType, live: Live) -> None:
        for code in _codes(module):
            for function in live.get(_key(code), ()):
                if function.__code__.co_freevars == code.co_freevars:
                    function.__code__ = code


def _key(code: CodeType) -> tuple[str, str, int]:
    return code.co_filename, code.co_qualname, code.co_firstlineno


def _codes(code: CodeType) -> Iterator[CodeType]:
    for inner in code.co_consts:
        if isinstance(inner, CodeType):
            yield inner
            yield from _codes(inner)


def _functions(body: Iterable[ast.stmt], prefix: str) -> Iterator[tuple[str, Definition]]:
    """The functions of a module and of its classes, not those inside functions."""
    for statement in body:
        match statement:
            case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name):
                yield prefix + name, statement
            case ast.ClassDef(name=name, body=inner):
                yield from _functions(inner, f"{prefix}{name}.")


def _visit(parent: ast.AST, ask: Callable[[ast.expr, list[Other]], ast.expr], *, truth: bool) -> None:
    """Ask for another expression at each site below, inner ones first; `truth`: what is returned there is a bool."""
    for field, value in ast.iter_fields(parent):
        several = isinstance(value, list)
        for index, child in enumerate(value if several else [value]):
            if field in _NO_EXPRESSIONS or not isinstance(child, ast.AST) or isinstance(child, _SKIPPED):
                continue
            others = [*_by_place(parent, field, child, truth), *_by_form(child)] if isinstance(child, ast.expr) else []
            _visit(child, ask, truth=truth and not isinstance(child, ast.FunctionDef))
            if others and isinstance(child, ast.expr):
                new = ask(child, others)
                if several:
                    value[index] = new
                else:
                    setattr(parent, field, new)


def _by_place(parent: ast.AST, field: str, child: ast.expr, truth: bool) -> Iterator[Other]:
    """What may stand in the place of an expression because of where it is."""
    match parent:
        case ast.If() | ast.IfExp() | ast.match_case() if field in ("test", "guard"):
            yield partial(_negated, child)
        case ast.comprehension() if field == "ifs":
            yield partial(ast.Constant, True)
        case ast.Return() if isinstance(child, ast.Constant) and isinstance(child.value, bool):
            yield partial(ast.Constant, not child.value)
        case ast.Return() if truth and not isinstance(child, ast.Compare):
            yield partial(_negated, child)
        case ast.Expr() if isinstance(child, ast.Call):
            yield partial(ast.Constant, None)


def _by_form(child: ast.expr) -> Iterator[Other]:
    """What may stand in the place of an expression because of what it is."""
    match child:
        case ast.Compare(ops=operators):
            for index, operator in enumerate(operators):
                other = [*operators[:index], _COMPARISONS[type(operator)](), *operators[index + 1 :]]
                yield partial(_with, child, ops=other)
        case ast.BoolOp(op=operator):
            yield partial(_with, child, op=ast.Or() if isinstance(operator, ast.And) else ast.And())
        case ast.UnaryOp(op=ast.Not() | ast.Invert(), operand=operand):
            yield partial(deepcopy, operand)
        case ast.BinOp(op=operation) if type(operation) in _OPERATIONS:
            yield partial(_with, child, op=_OPERATIONS[type(operation)]())
        case ast.Constant(value=int(value)) if not isinstance(value, bool) and 0 <= value <= _SMALL:
            yield from (partial(ast.Constant, near) for near in (value + 1, value - 1) if near >= 0)
        case ast.Call(func=ast.Name(id=name)) if name in _FUNCTIONS:
            yield partial(_with, child, func=ast.Name(_FUNCTIONS[name], ast.Load()))
        case ast.Call(func=ast.Name(id="reversed"), args=[operand]):
            yield partial(deepcopy, operand)
        case ast.Subscript(value=value, slice=ast.Slice(None, None, ast.UnaryOp(ast.USub(), ast.Constant(1)))):
            yield partial(deepcopy, value)


def _negated(value: ast.expr) -> ast.expr:
    if isinstance(value, ast.UnaryOp) and isinstance(value.op, ast.Not):
        return deepcopy(value.operand)
    return ast.UnaryOp(ast.Not(), deepcopy(value))


def _with(node: ast.expr, **fields: object) -> ast.expr:
    new = deepcopy(node)
    for name, value in fields.items():
        setattr(new, name, value)
    return new


def _call(name: str, number: int) -> ast.expr:
    return ast.Call(ast.Name(name, ast.Load()), [ast.Constant(number)], [])
