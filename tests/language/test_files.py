"""Files: imports, prunes, and files that are no trees at all."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from rvaft import LanguageError, WrongType, dumps, load, loads
from rvaft.language.draft import UNMENTIONED, Draft
from rvaft.language.parser import parse_file


def write(folder: Path, **texts: str) -> Path:
    """Write the files (`x_dft="…"` is x.dft) and return the path of main.rvaft."""
    for name, text in texts.items():
        path = folder / name.replace("__", "/").replace("_", ".")
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return folder / "main.rvaft"


def facts(draft: Draft) -> dict[str, tuple[str, ...]]:
    """The nodes of a draft with their children."""
    return {name: tuple(child.value for child in node.children()) for name, node in draft.nodes.items()}


def test_an_import_is_relative_to_its_file_and_counts_once(tmp_path: Path) -> None:
    main = write(
        tmp_path,
        main_rvaft='import "sub/a.rvaft"; import "b.rvaft"; import "./b.rvaft"; a on e(X);',
        sub__a_rvaft='import "../b.rvaft"; toplevel a; a or b c;',
        b_rvaft="event e(x) = { x: x }; toplevel b; b and d;",
    )
    draft = parse_file(main)
    assert facts(draft) == {"b": ("d",), "a": ("b", "c")}
    assert len(draft.events) == 1
    assert [Path(place.file).name for place in draft.nodes["a"].statements] == ["a.rvaft", "main.rvaft"]
    assert draft.events[0].place.file.endswith("sub/../b.rvaft")


@pytest.mark.parametrize(
    ("main", "a", "b", "root"),
    [
        ("", "toplevel a;", "", "a"),
        ("toplevel main;", "toplevel a;", "toplevel b;", "main"),
        ("", "toplevel a;", "toplevel b;", "a"),  # a imports b
        ("", "", "toplevel b;", "b"),
    ],
)
def test_the_toplevel_of_the_importing_file_wins(tmp_path: Path, main: str, a: str, b: str, root: str) -> None:
    path = write(tmp_path, main_rvaft=f'import "a.dft"; main; {main}', a_dft=f'import "b.dft"; a; {a}', b_dft=f"b; {b}")
    assert parse_file(path).root == root


def test_imports_that_contradict_each_other_leave_both_toplevels(tmp_path: Path) -> None:
    path = write(tmp_path, main_rvaft='import "a.dft"; import "b.dft";', a_dft="toplevel a; a;", b_dft="toplevel b; b;")
    draft = parse_file(path)
    assert [said.value for said in draft.toplevels] == ["a", "b"]
    assert draft.root is None


@pytest.mark.parametrize(
    ("main", "others", "told"),
    [
        (
            'a;\nimport "b.dft";',
            {"b_dft": 'b; import "c.dft";', "c_dft": '  import "main.rvaft";'},
            "c.dft:1:10: import cycle",
        ),
        ('import "a.dft";', {"a_dft": 'toplevel "A";\n"A" por "B" "C";'}, "a.dft:2:5: the gate `por` of `A`"),
        ('a;\nimport "absent.dft";', {}, "main.rvaft:2:8: cannot import `absent.dft`: cannot read the file: No such"),
        ('a;\nimport "folder";', {}, "main.rvaft:2:8: cannot import `folder`: cannot read the file: Is a directory"),
        ('a;\nimport "nul\\u0000l";', {}, "cannot read the file: embedded null byte"),
    ],
)
def test_an_error_in_an_import_is_told_where_it_is(
    tmp_path: Path, main: str, others: dict[str, str], told: str
) -> None:
    (tmp_path / "folder").mkdir()
    with pytest.raises(LanguageError) as caught:
        parse_file(write(tmp_path, main_rvaft=main, **others))
    assert told in str(caught.value)
    assert (caught.value.__cause__ is not None) == ("cannot read" in told)


def test_a_long_chain_of_imports(tmp_path: Path) -> None:
    for number in range(1100):
        (tmp_path / f"{number}.dft").write_text(f'n{number} or n{number + 1}; import "{number + 1}.dft";')
    (tmp_path / "1100.dft").write_text("n1100;")
    assert len(parse_file(tmp_path / "0.dft").nodes) == 1101


@pytest.mark.parametrize(
    ("text", "left"),
    [
        ("r or a b c; prune a c;", {"r": ("b",)}),
        ("prune a; r and a b; a or c d; c or e; b or d;", {"r": ("b",), "b": ("d",)}),
        ("r sand a b; a or x; x or y; y; prune a;", {"r": ("b",)}),
        ("r or a b; a 2of3 c d e; prune a; prune a;", {"r": ("b",)}),
        ("r or a b c d; a and x; b and x; x; prune a b c;", {"r": ("d",)}),
        ("toplevel a; r or a b; b or c; prune r; a;", {"a": ()}),
        ("r or a b; u or x; a or x; x; prune a;", {"r": ("b",), "u": ("x",), "x": ()}),
        ("r or a b; a or g; g 2of2 x y; x or z; prune a x;", {"r": ("b",)}),
    ],
)
def test_a_pruned_node_goes_with_what_only_it_reaches(
    tmp_path: Path, text: str, left: dict[str, tuple[str, ...]]
) -> None:
    draft = parse_file(write(tmp_path, main_rvaft=text))
    assert draft.broken_prunes == []
    assert {name: set(names) for name, names in facts(draft).items()} == {n: set(c) for n, c in left.items()}


@pytest.mark.parametrize(
    ("text", "faults"),
    [
        ("r 2of3 a b c;\nprune b;", [("the KofN gate r would lose a child; prune r too, or rewrite it", "b", "r", 2)]),
        ("r or a b; a and c d;\nprune c\nd;", [("the gate a would have no child left; prune a too", "c", "a", 2)]),
        ("r or a;\n\nprune x;", [(UNMENTIONED, "x", None, 3)]),
        ("r or a;\nprune r;", [("it is the root", "r", None, 2)]),
        ("toplevel r; r or a;\nprune r;", [("it is the root", "r", None, 2)]),
        (
            "r or a b c; a or x;\nprune x\ny;",
            [(UNMENTIONED, "y", None, 3), ("the gate a would have no child left; prune a too", "x", "a", 2)],
        ),
    ],
)
def test_a_prune_that_cannot_be_is_noted(
    tmp_path: Path, text: str, faults: list[tuple[str, str, str | None, int]]
) -> None:
    broken = parse_file(write(tmp_path, main_rvaft=text)).broken_prunes
    assert [(b.reason, b.pruned, b.node, b.place.line) for b in broken] == faults


@pytest.mark.parametrize(
    ("data", "line", "message"),
    [
        (b"", 1, "the text has no tree"),
        (b"\xef\xbb\xbf \r\n", 1, "the text has no tree"),
        (b"a;\nb\xff;", 2, "not valid UTF-8"),
        (b"\x7fELF\x02\x01\x01\x00\x00", 1, "binary data"),
        ("a;".encode("utf-16"), 1, "not valid UTF-8"),
    ],
)
def test_files_that_are_no_trees(tmp_path: Path, data: bytes, line: int, message: str) -> None:
    path = tmp_path / "x.dft"
    path.write_bytes(data)
    with pytest.raises(LanguageError, match=message) as caught:
        parse_file(path)
    assert (caught.value.file, caught.value.line) == (str(path), line)
    assert "\n" not in caught.value.message


def test_missing_files_and_folders(tmp_path: Path) -> None:
    for read in (parse_file, load):
        with pytest.raises(FileNotFoundError, match="cannot read the file: No such file") as caught:
            read(tmp_path / "none.rvaft")
        assert caught.value.filename == str(tmp_path / "none.rvaft")
    with pytest.raises(IsADirectoryError, match="cannot read the file: Is a directory"):
        parse_file(str(tmp_path))
    with pytest.raises(LanguageError, match="cannot read the file: embedded null byte"):
        parse_file("a\0b")


def test_byte_order_mark_and_line_ends(tmp_path: Path) -> None:
    path = tmp_path / "x.dft"
    path.write_bytes(b'\xef\xbb\xbftoplevel "A"; // top\r\n"A" or "B"\r\n"C";\r\n')
    assert facts(parse_file(path)) == {"A": ("B", "C")}
    assert load(path) == load(str(path)) == load(os.path.relpath(path)) == loads("A or B C;", "x.dft")


@pytest.mark.parametrize("text", ["{}", 'import "{}";\ntop or a;'])
def test_a_file_without_end_is_an_error(tmp_path: Path, text: str) -> None:
    endless = Path("/dev/zero")
    if not endless.exists():
        pytest.skip("this system has no /dev/zero")
    (tmp_path / "main.rvaft").write_text(text.format(endless))
    with pytest.raises(LanguageError, match="larger than 16 MiB"):
        parse_file(endless if text == "{}" else tmp_path / "main.rvaft")


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: loads(b"a;"), "the text of a tree must be a str, not bytes"),  # type: ignore[arg-type]
        (lambda: loads(Path("a")), "the text of a tree must be a str, not PosixPath"),  # type: ignore[arg-type]
        (lambda: dumps("a;"), "a tree to print must be an RVAFT, not str"),  # type: ignore[arg-type]
        (lambda: load(b"a.rvaft"), "the path of a tree must be a str or a path, not bytes"),  # type: ignore[arg-type]
        (lambda: load(None), "the path of a tree must be a str or a path, not NoneType"),  # type: ignore[arg-type]
    ],
)
def test_arguments_of_a_wrong_type(call: Callable[[], object], said: str) -> None:
    with pytest.raises(WrongType) as caught:
        call()
    assert str(caught.value).replace("WindowsPath", "PosixPath") == said


def test_no_error_quotes_a_file_outside_the_folder_of_the_tree(tmp_path: Path) -> None:
    folder = tmp_path / "trees"
    (folder / "inner").mkdir(parents=True)
    (tmp_path / "secret.txt").write_text("root:x:0:0\n")
    (folder / "own.rvaft").write_text("root:x;")
    (folder / "link.rvaft").symlink_to(tmp_path / "secret.txt")
    (folder / "inner" / "far.rvaft").write_text('import "../../secret.txt";')
    tree = folder / "tree.rvaft"
    for path in (str(tmp_path / "secret.txt"), "../secret.txt", "link.rvaft", "inner/far.rvaft"):
        tree.write_text(f'import "{path}"; top or a;')
        with pytest.raises(LanguageError, match=r"1:1: this is not in the language of trees") as raised:
            load(tree)
        assert "root:x" not in str(raised.value)
        with pytest.raises(LanguageError, match="it is outside the folder of the tree; move it there, or read"):
            load(tree, confine_imports=True)
    tree.write_text('import "own.rvaft"; top or a;')
    with pytest.raises(LanguageError, match="root:x"):
        load(tree)


def test_confined_imports_of_the_folder_of_the_tree_and_those_in_it(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "events.rvaft").write_text('import "../more.rvaft"; event e(x) = { x: x };')
    (tmp_path / "more.rvaft").write_text("ignore e(2);")
    (tmp_path / "tree.rvaft").write_text('import "parts/events.rvaft"; top and a; a on e(1);')
    assert load(tmp_path / "tree.rvaft", confine_imports=True).root == "top"
