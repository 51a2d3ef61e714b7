"""The names that `import rvaft` gives: explicit, complete, and imported on use only."""

import ast
import pkgutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import rvaft
from rvaft import OptionError, WrongType, errors


def test_every_name_is_there_and_listed() -> None:
    assert dir(rvaft) == sorted(rvaft.__all__) == sorted(set(rvaft.__all__))
    for name in rvaft.__all__:
        assert getattr(rvaft, name) is not None
    namespace: dict[str, object] = {}
    exec("from rvaft import *", namespace)
    assert set(rvaft.__all__) <= set(namespace)


def test_type_checkers_and_the_interpreter_see_the_same_names() -> None:
    source = ast.parse(Path(rvaft.__file__).read_text(encoding="utf-8"))
    imported = {
        alias.name: node.module
        for branch in source.body
        if isinstance(branch, ast.If)
        for node in branch.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert imported == rvaft._MODULE_OF
    assert {*imported, "__version__"} == set(rvaft.__all__)


def test_every_error_can_be_imported_from_the_package() -> None:
    classes = [
        value
        for value in vars(errors).values()
        if isinstance(value, type) and issubclass(value, Exception) and value.__module__ == errors.__name__
    ]
    for error in classes:
        assert getattr(rvaft, error.__name__) is error
        assert issubclass(error, rvaft.RvaftError)
        assert error is rvaft.RvaftError or any(
            issubclass(error, builtin) for builtin in (ValueError, RuntimeError, LookupError, TypeError)
        )


def test_no_function_shares_its_name_with_a_module() -> None:
    modules = {module.name for module in pkgutil.iter_modules(rvaft.__path__)}
    assert not modules & set(rvaft.__all__)


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = rvaft.nothing


def test_the_package_alone_imports_nothing() -> None:
    """Neither a module of its own nor a library."""
    some = {"rvaft", "networkx", "lark", "sympy", "spot", "rich", "hypothesis", "click"}
    program = f"import sys, rvaft; print(*sorted(name for name in sys.modules if name.partition('.')[0] in {some}))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["rvaft"]


def test_the_two_verbs_narrow_to_a_branch_or_a_kind() -> None:
    nodes = [rvaft.Node("a"), rvaft.Node("b", kind=rvaft.Kind.ATTACK)]
    tree = rvaft.RVAFT("top", [rvaft.Node("top", rvaft.Gate.OR, ("a", "b")), *nodes])
    for option in ({"branch": 2}, {"kind": "attack"}):
        assert rvaft.monitor(tree, **option).step({"event": "a"}) is rvaft.Verdict.FALSE
        assert rvaft.monitor(tree, **option).step({"event": "b"}) is rvaft.Verdict.TRUE
    with pytest.raises(rvaft.TreeError, match="branch 3"):
        rvaft.monitor(tree, branch=3)
    with pytest.raises(rvaft.TreeError, match="fault"):
        rvaft.monitor(tree, kind="fault")
    with pytest.raises(rvaft.UnknownBackend, match="known: "):
        rvaft.translate(tree, "klingon")


TREE = rvaft.RVAFT("a", [rvaft.Node("a")])
api: Any = rvaft  # whose arguments no type checker looks at
NO_TREE = "tree must be an RVAFT, as rvaft.load returns it, not "


@pytest.mark.parametrize(
    ("call", "error", "said"),
    [
        (lambda: api.monitor("x"), WrongType, NO_TREE + "str"),
        (lambda: api.check("x"), WrongType, NO_TREE + "str"),
        (lambda: api.translate(None, "rml"), WrongType, NO_TREE + "NoneType"),
        (lambda: api.translate(TREE, ["rml"]), WrongType, "language must be a str, the name of a backend, not list"),
        (lambda: api.translate(TREE, "rml", branch="1"), WrongType, "branch must be an int, not str"),
        (lambda: api.translate(TREE, "rml", limit=1.5), WrongType, "limit must be an int, not float"),
        (lambda: api.monitor(TREE, branch=1.0), WrongType, "branch must be an int, not float"),
        (lambda: api.monitor(TREE, limit=None), WrongType, "limit must be an int, not NoneType"),
        (
            lambda: api.monitor(TREE, semantics="weak"),
            OptionError,
            "unknown semantics 'weak'; known: strict, projected, consecutive, scattered",
        ),
        (lambda: api.monitor(TREE, kind="error"), OptionError, "unknown kind 'error'; known: fault, attack"),
        (
            lambda: api.Node("x", "orr", ["a"]),
            OptionError,
            "unknown gate 'orr' of x; known: or, and, sand, sand_rl, pand, vot",
        ),
        (lambda: api.Node("x", kind="bug"), OptionError, "unknown kind 'bug' of x; known: fault, attack"),
        (lambda: api.Node("x", "or", "ab"), WrongType, "the children of x must be a tuple of names, not str"),
        (lambda: api.Node("x", "or", ["a", 3]), WrongType, "a child of x must be the name of a node, a str, not int"),
        (lambda: api.Node("x", on="e"), WrongType, "the event (`on`) of x must be an On, not str"),
        (lambda: api.Node("x", when="X > 3"), WrongType, "the guard (`when`) of x must be a guard, not str"),
    ],
)
def test_a_wrong_argument_is_told_in_one_sentence(
    call: Callable[[], object], error: type[rvaft.RvaftError], said: str
) -> None:
    with pytest.raises(error) as caught:
        call()
    assert str(caught.value) == said


def test_a_part_without_a_feasible_scenario_is_named() -> None:
    tree = rvaft.loads("toplevel top; top or a b; a; b and c d attack; c when 2 > 3; d;")
    with pytest.raises(rvaft.TreeError, match="branch 2 has no feasible scenario"):
        rvaft.monitor(tree, branch=2)
    with pytest.raises(rvaft.TreeError, match="the part of kind attack has no feasible scenario"):
        rvaft.monitor(tree, kind="attack")


def test_words_stand_for_gates_and_kinds() -> None:
    node = rvaft.Node("x", "vot", ["a", "b"], 1, kind="fault")  # type: ignore[arg-type]
    assert node == rvaft.Node("x", rvaft.Gate.VOT, ("a", "b"), 1, kind=rvaft.Kind.FAULT)


def test_the_findings_on_a_tree() -> None:
    tree = rvaft.RVAFT("top", [rvaft.Node("top", rvaft.Gate.OR, ("a",)), rvaft.Node("a"), rvaft.Node("b")])
    assert [(finding.code, finding.severity) for finding in rvaft.check(tree)] == [
        ("unreachable", rvaft.Severity.WARNING)
    ]


@pytest.mark.parametrize("hiding", ["backends.py", "backends/__init__.py"])
def test_a_package_of_the_user_that_hides_the_backends_is_named(tmp_path: Path, hiding: str) -> None:
    (tmp_path / hiding).parent.mkdir(exist_ok=True)
    (tmp_path / hiding).touch()
    (tmp_path / "own.py").write_text("import rvaft; rvaft.translate(rvaft.loads('top or a b;'), 'rml')")
    done = subprocess.run([sys.executable, "own.py"], capture_output=True, text=True, cwd=tmp_path, check=False)
    said = f"the backend rml failed: {tmp_path / hiding} is imported in place of its package backends; rename that"
    assert said in done.stderr.splitlines()[-1]
