"""The numbers of the house: how large it is, how deep its circles are, which names stand twice."""

import ast
import io
import re
import tokenize
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Final

import networkx

ROOT: Final = Path(__file__).parent.parent.parent
PRODUCT: Final = ("rvaft", "backends", "cross_check")
SMALL: Final = 60
BLANK: Final = (tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER)
GATES: Final = re.compile(r"\bGate\.(OR|AND|SAND|SAND_RL|VOT)\b")
BARE: Final = re.compile(r"[a-z]+(ing|ed)")


def modules(*folders: str) -> dict[str, Path]:
    """The files below some folders by the name of the module."""
    paths = (path for folder in folders for path in sorted((ROOT / folder).rglob("*.py")))
    return {".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path for path in paths}


def code_lines(text: str, tree: ast.Module) -> int:
    """How many lines have a token that is neither a comment nor part of a docstring."""
    docs: set[int] = set()
    for node in ast.walk(tree):
        match node:
            case ast.Expr(value=ast.Constant(value=str()), lineno=first, end_lineno=int(last)):
                docs.update(range(first, last + 1))
    tokens = (token for token in tokenize.generate_tokens(io.StringIO(text).readline) if token.type not in BLANK)
    return len({line for token in tokens for line in range(token.start[0], token.end[0] + 1)} - docs)


def imports(
    parent: ast.AST, known: Mapping[str, object], *, inside: bool = False, hidden: bool = False
) -> Iterator[tuple[str, bool, bool]]:
    """Yield each import of a known module: its name, whether it is inside a function, and whether it is hidden.

    An import is hidden that only type checkers see, or that names the module in a text: `import_module("…")`.
    """
    for node in ast.iter_child_nodes(parent):
        match node:
            case ast.If(test=ast.Name(id="TYPE_CHECKING")):
                yield from imports(node, known, inside=inside, hidden=True)
                continue
            case ast.Call(
                func=ast.Name(id="import_module") | ast.Attribute(attr="import_module"),
                args=[ast.Constant(value=str(name)), *_],
            ) if name in known:
                yield name, inside, True
                continue
            case ast.Import(names=names):
                found = [name.name for name in names]
            case ast.ImportFrom(module=str(base), names=names, level=0):
                found = [inner if (inner := f"{base}.{name.name}") in known else base for name in names]
            case _:
                within = inside or isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef))
                yield from imports(node, known, inside=within, hidden=hidden)
                continue
        yield from ((name, inside, hidden) for name in dict.fromkeys(found) if name in known)


def largest_circle(edges: Iterable[tuple[str, str, bool, bool]]) -> int:
    """How many modules import each other, at most; 0 if none do."""
    circles = networkx.strongly_connected_components(networkx.DiGraph([(a, b) for a, b, *_ in edges]))
    largest = max(map(len, circles), default=0)
    return largest if largest > 1 else 0


def imported() -> list[tuple[str, str, bool, bool]]:
    """Each import of the product: who imports what, whether inside a function, and by name or for types only."""
    files = modules(*PRODUCT)
    trees = ((name, ast.parse(path.read_text(encoding="utf-8"))) for name, path in files.items())
    return [(name, *found) for name, tree in trees for found in imports(tree, files)]


def measured() -> dict[str, int]:
    """The numbers as they are."""
    files, tests = modules(*PRODUCT), modules("tests")
    texts = {name: path.read_text(encoding="utf-8") for name, path in files.items()}
    trees = {name: ast.parse(text) for name, text in texts.items()}
    lines = {name: len(text.splitlines()) for name, text in texts.items()}
    edges = imported()
    classes = Counter(node.name for tree in trees.values() for node in ast.walk(tree) if isinstance(node, ast.ClassDef))
    return {
        "product files": len(files),
        "product lines": sum(lines.values()),
        "lines of code alone": sum(code_lines(text, trees[name]) for name, text in texts.items()),
        "files under 60 lines, __init__ aside": sum(
            lines[name] < SMALL for name, path in files.items() if path.stem != "__init__"
        ),
        "most files in one folder": max(Counter(path.parent for path in files.values()).values()),
        "largest import circle": largest_circle(edges),
        "imports of ours inside functions": sum(inner for _, _, inner, _ in edges),
        "imports of ours by name or for types only": sum(hidden for *_, hidden in edges),
        "class names used twice": sum(count > 1 for count in classes.values()),
        "files that name gates": sum(bool(GATES.search(text)) for text in texts.values()),
        "modules that are bare gerunds or participles": sum(bool(BARE.fullmatch(path.stem)) for path in files.values()),
        "test lines": sum(len(path.read_text(encoding="utf-8").splitlines()) for path in tests.values()),
    }


def sizes() -> dict[str, tuple[int, int, int]]:
    """The lines, the lines of code alone, and the words of docstrings and comments, of each part of the product."""
    found: dict[str, tuple[int, int, int]] = {}
    for path in modules(*PRODUCT).values():
        text = path.read_text(encoding="utf-8")
        own = len(text.splitlines()), code_lines(text, ast.parse(text)), words(text)
        parents = path.relative_to(ROOT).parts[:-1]
        for part in (".".join(parents[:2] if parents[0] == "rvaft" else parents[:1]), "product"):
            before = found.get(part, (0, 0, 0))
            found[part] = (before[0] + own[0], before[1] + own[1], before[2] + own[2])
    return dict(sorted(found.items()))


def words(text: str) -> int:
    """How many words the comments and docstrings of a module have."""
    documented = [
        node.value.value
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
    ]
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    comments = [token.string for token in tokens if token.type == tokenize.COMMENT]
    return sum(len(one.split()) for one in (*documented, *comments))
