"""Small changes of Python functions: the places where one is possible, and the functions changed where they live.

A site is an expression in the body of a function and another one in its place. What has no meaning
to be wrong about is left out: assertions, what is raised, annotations, doc strings.
"""

import ast
import gc
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any, Final, TypeAlias

Key: TypeAlias = tuple[str, str, int]
Live: TypeAlias = Mapping[Key, list[FunctionType]]
Ask: TypeAlias = Callable[[ast.expr, list[ast.expr]], ast.expr]
"""What is to stand in the place of an expression, given the others that may stand there."""

PAIRS: Final = (
    *((ast.Lt, ast.LtE), (ast.Gt, ast.GtE), (ast.Eq, ast.NotEq), (ast.In, ast.NotIn), (ast.Is, ast.IsNot)),
    *((ast.Add, ast.Sub), (ast.BitAnd, ast.BitOr), (ast.LShift, ast.RShift), (ast.And, ast.Or)),
)
OPERATORS: Final[dict[type[ast.AST], Any]] = {one: other for pair in PAIRS for one, other in (pair, pair[::-1])}
FUNCTIONS: Final = {"any": "all", "all": "any", "min": "max", "max": "min"}
SKIPPED: Final = (ast.Assert, ast.Raise, ast.pattern, ast.arguments)
NO_EXPRESSIONS: Final = ("annotation", "returns", "decorator_list", "type_params")
SWITCH: Final = "_site_is_changed_"
MARK: Final = "_site_is_reached_"


def live_functions() -> Live:
    """All functions of this process by file, qualified name and first line, however they are wrapped."""
    found: dict[Key, list[FunctionType]] = defaultdict(list)
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

    def mark(self, reached: Callable[[int], object], live: Live) -> None:
        """From now on the module tells whenever a site is reached, by its number."""

        def marked(_: str, original: ast.expr, first: int, others: list[ast.expr]) -> ast.expr:
            numbers = (ast.Constant(first + offset) for offset in range(len(others)))
            calls: list[ast.expr] = [ast.Call(ast.Name(MARK, ast.Load()), [number], []) for number in numbers]
            return ast.Subscript(ast.Tuple([*calls, original], ast.Load()), ast.Constant(-1), ast.Load())

        vars(self.module)[MARK] = reached
        self.put(self._compiled(marked), live)

    def mutant(self, number: int) -> tuple[str, CodeType]:
        """The module with the change at one site, and where and what it is."""
        where = ""

        def changed(function: str, original: ast.expr, first: int, others: list[ast.expr]) -> ast.expr:
            nonlocal where
            if not 0 <= number - first < len(others):
                return original
            new = others[number - first]
            change = f"`{ast.unparse(new)}` for `{ast.unparse(original)}`"
            where = f"{self.module.__name__}:{original.lineno} {function}: {change}"
            # what a function sees of the functions around it must stay the same, so the original stays in the text
            return ast.IfExp(ast.Name(SWITCH, ast.Load()), new, original)

        code = self._compiled(changed)
        return where, code

    def put(self, module: CodeType, live: Live) -> None:
        """From now on the functions of the module are these."""
        vars(self.module)[SWITCH] = True
        for code in _codes(module):
            for function in live.get(_key(code), ()):
                if function.__code__.co_freevars == code.co_freevars:
                    function.__code__ = code

    def _compiled(self, at: Callable[[str, ast.expr, int, list[ast.expr]], ast.expr]) -> CodeType:
        """The text with another expression at each site."""
        tree = ast.parse(Path(self.path).read_text(encoding="utf-8"))
        numbers = 0

        def ask(function: str, original: ast.expr, others: list[ast.expr]) -> ast.expr:
            nonlocal numbers
            numbers += len(others)
            return ast.copy_location(at(function, original, numbers - len(others), others), original)

        for name, function in _functions(tree.body, ""):
            truth = isinstance(function.returns, ast.Name) and function.returns.id == "bool"
            for statement in function.body:
                _visit(statement, partial(ask, name), truth=truth)
        return compile(ast.fix_missing_locations(tree), self.path, "exec", dont_inherit=True)


def _key(code: CodeType) -> Key:
    return code.co_filename, code.co_qualname, code.co_firstlineno


def _codes(code: CodeType) -> Iterator[CodeType]:
    for inner in code.co_consts:
        if isinstance(inner, CodeType):
            yield inner
            yield from _codes(inner)


def _functions(body: Iterable[ast.stmt], prefix: str) -> Iterator[tuple[str, ast.FunctionDef | ast.AsyncFunctionDef]]:
    """The functions of a module and of its classes, not those inside functions."""
    for statement in body:
        match statement:
            case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name):
                yield prefix + name, statement
            case ast.ClassDef(name=name, body=inner):
                yield from _functions(inner, f"{prefix}{name}.")


def _visit(parent: ast.AST, ask: Ask, *, truth: bool) -> None:
    """Ask for another expression at each site below, inner ones first; `truth`: what is returned there is a bool."""
    for field, value in ast.iter_fields(parent):
        for index, child in enumerate(value if isinstance(value, list) else [value]):
            if field in NO_EXPRESSIONS or not isinstance(child, ast.AST) or isinstance(child, SKIPPED):
                continue
            others = list(_others(parent, field, child, truth)) if isinstance(child, ast.expr) else []
            _visit(child, ask, truth=truth and not isinstance(child, ast.FunctionDef))
            if others and isinstance(child, ast.expr):
                if isinstance(value, list):
                    value[index] = ask(child, others)
                else:
                    setattr(parent, field, ask(child, others))


def _others(parent: ast.AST, field: str, child: ast.expr, truth: bool) -> Iterator[ast.expr]:
    """What may stand in the place of an expression because of where it is, and because of what it is."""
    match parent:
        case ast.If() | ast.IfExp() | ast.match_case() if field in ("test", "guard"):
            yield ast.UnaryOp(ast.Not(), child)
        case ast.comprehension() if field == "ifs":
            yield ast.Constant(True)
        case ast.Return() if isinstance(child, ast.Constant) and isinstance(child.value, bool):
            yield ast.Constant(not child.value)
        case ast.Return() if truth and not isinstance(child, ast.Compare):
            yield ast.UnaryOp(ast.Not(), child)
        case ast.Expr() if isinstance(child, ast.Call):
            yield ast.Constant(None)
    match child:
        case ast.Compare(left, operators, right):
            for index, operator in enumerate(operators):
                yield ast.Compare(
                    left, [*operators[:index], OPERATORS[type(operator)](), *operators[index + 1 :]], right
                )
        case ast.BoolOp(op, values):
            yield ast.BoolOp(OPERATORS[type(op)](), values)
        case ast.BinOp(left, op, right) if type(op) in OPERATORS:
            yield ast.BinOp(left, OPERATORS[type(op)](), right)
        case ast.UnaryOp(ast.Not() | ast.Invert(), operand) | ast.Call(ast.Name("reversed"), [operand]):
            yield operand
        case ast.Constant(int(value)) if not isinstance(value, bool) and 0 <= value <= 8:
            yield from (ast.Constant(near) for near in (value + 1, value - 1) if near >= 0)
        case ast.Call(ast.Name(name), arguments, keywords) if name in FUNCTIONS:
            yield ast.Call(ast.Name(FUNCTIONS[name], ast.Load()), arguments, keywords)
        case ast.Subscript(value, ast.Slice(None, None, ast.UnaryOp(ast.USub(), ast.Constant(1)))):
            yield value
