"""The formula of each gate, as text: what people who read or diff specifications rely on."""

import pytest

from tests.backends.ltlf.building import body, text_of

PINNED: list[tuple[str, str, list[str]]] = [
    ("t or a b;", "strict", ["a | b"]),
    ("t or a b;", "projected", ["!rel U (rel & (a | b))"]),
    ("t or a b;", "scattered", ["F a | F b"]),
    ("t or a b c;", "strict", ["a | b | c"]),
    ("t or a b c;", "projected", ["!rel U (rel & (a | b | c))"]),
    ("t or a b c;", "scattered", ["F a | F b | F c"]),
    ("t and a b;", "strict", ["s1 := a | b", "s1 & X[!] s1 & !(a & X[!] a) & !(b & X[!] b)"]),
    (
        "t and a b;",
        "projected",
        [
            "s1 := a | b",
            "!rel U (rel & s1 & X[!](!rel U (rel & s1)) & !(a & X[!](!rel U (rel & a))) & !(b & X[!](!rel U (rel & b))))",
        ],
    ),
    ("t and a b;", "scattered", ["F a & F b"]),
    (
        "t and a b c;",
        "strict",
        [
            "s1 := a | b | c",
            "s2 := X[!] a",
            "s3 := X[!] b",
            "s4 := X[!] c",
            "s1 & X[!](s1 & X[!] s1) & !((a & X[!](a | s2)) | X[!](a & s2)) & !((b & X[!](b | s3)) | X[!](b & s3)) & !((c & X[!](c | s4)) | X[!](c & s4))",
        ],
    ),
    (
        "t and a b c;",
        "projected",
        [
            "s1 := a | b | c",
            "s2 := X[!](!rel U (rel & a))",
            "s3 := X[!](!rel U (rel & b))",
            "s4 := X[!](!rel U (rel & c))",
            "!rel U (rel & s1 & X[!](!rel U (rel & s1 & X[!](!rel U (rel & s1)))) & !((a & X[!](!rel U (rel & (a | s2)))) | X[!](!rel U (rel & a & s2))) & !((b & X[!](!rel U (rel & (b | s3)))) | X[!](!rel U (rel & b & s3))) & !((c & X[!](!rel U (rel & (c | s4)))) | X[!](!rel U (rel & c & s4))))",
        ],
    ),
    ("t and a b c;", "scattered", ["F a & F b & F c"]),
    ("t sand a b;", "strict", ["a & X[!] b"]),
    ("t sand a b;", "projected", ["!rel U (rel & a & X[!](!rel U (rel & b)))"]),
    ("t sand a b;", "scattered", ["F(a & X[!] F b)"]),
    ("t sand a b c;", "strict", ["a & X[!](b & X[!] c)"]),
    ("t sand a b c;", "projected", ["!rel U (rel & a & X[!](!rel U (rel & b & X[!](!rel U (rel & c)))))"]),
    ("t sand a b c;", "scattered", ["F(a & X[!] F(b & X[!] F c))"]),
    ("t sand_rl a b;", "strict", ["b & X[!] a"]),
    ("t sand_rl a b;", "projected", ["!rel U (rel & b & X[!](!rel U (rel & a)))"]),
    ("t sand_rl a b;", "scattered", ["F(b & X[!] F a)"]),
    ("t sand_rl a b c;", "strict", ["c & X[!](b & X[!] a)"]),
    ("t sand_rl a b c;", "projected", ["!rel U (rel & c & X[!](!rel U (rel & b & X[!](!rel U (rel & a)))))"]),
    ("t sand_rl a b c;", "scattered", ["F(c & X[!] F(b & X[!] F a))"]),
    ("t 1of2 a b;", "strict", ["a | b"]),
    ("t 1of2 a b;", "projected", ["!rel U (rel & (a | b))"]),
    ("t 1of2 a b;", "scattered", ["F a | F b"]),
    ("t 2of2 a b;", "strict", ["s1 := a | b", "s1 & X[!] s1 & !(a & X[!] a) & !(b & X[!] b)"]),
    (
        "t 2of2 a b;",
        "projected",
        [
            "s1 := a | b",
            "!rel U (rel & s1 & X[!](!rel U (rel & s1)) & !(a & X[!](!rel U (rel & a))) & !(b & X[!](!rel U (rel & b))))",
        ],
    ),
    ("t 2of2 a b;", "scattered", ["F a & F b"]),
    ("t 2of3 a b c;", "strict", ["s1 := a | b | c", "s1 & X[!] s1 & !(a & X[!] a) & !(b & X[!] b) & !(c & X[!] c)"]),
    (
        "t 2of3 a b c;",
        "projected",
        [
            "s1 := a | b | c",
            "!rel U (rel & s1 & X[!](!rel U (rel & s1)) & !(a & X[!](!rel U (rel & a))) & !(b & X[!](!rel U (rel & b))) & !(c & X[!](!rel U (rel & c))))",
        ],
    ),
    ("t 2of3 a b c;", "scattered", ["s1 := F b", "s2 := F c", "(F a & (s1 | s2)) | (s1 & s2)"]),
    (
        "t sand v d; v 2of3 a b c;",
        "strict",
        [
            "s1 := a | b | c",
            "s2 := s1 & X[!](s1 & X[!] d)",
            "s3 := X[!] a",
            "s4 := a & s3",
            "s5 := X[!] b",
            "s6 := b & s5",
            "s7 := X[!] c",
            "s8 := c & s7",
            "(s2 & !s4 & !s6 & !s8) | (s1 & X[!] s2 & !((a & X[!](a | s3)) | X[!] s4) & !((b & X[!](b | s5)) | X[!] s6) & !((c & X[!](c | s7)) | X[!] s8))",
        ],
    ),
    (
        "t sand v d; v 2of3 a b c;",
        "projected",
        [
            "s1 := a | b | c",
            "s2 := s1 & X[!](!rel U (rel & s1 & X[!](!rel U (rel & d))))",
            "s3 := X[!](!rel U (rel & a))",
            "s4 := a & s3",
            "s5 := X[!](!rel U (rel & b))",
            "s6 := b & s5",
            "s7 := X[!](!rel U (rel & c))",
            "s8 := c & s7",
            "!rel U (rel & ((s2 & !s4 & !s6 & !s8) | (s1 & X[!](!rel U (rel & s2)) & !((a & X[!](!rel U (rel & (a | s3)))) | X[!](!rel U (rel & s4))) & !((b & X[!](!rel U (rel & (b | s5)))) | X[!](!rel U (rel & s6))) & !((c & X[!](!rel U (rel & (c | s7)))) | X[!](!rel U (rel & s8))))))",
        ],
    ),
    (
        "t sand v d; v 2of3 a b c;",
        "scattered",
        ["s1 := X[!] F d", "s2 := F(b & s1)", "s3 := F(c & s1)", "(F(a & s1) & (s2 | s3)) | (s2 & s3)"],
    ),
    (
        "t and g c; g sand a b on e(); event e() = {e: 1};",
        "strict",
        [
            "s1 := X[!] b",
            "s2 := X[!](a & s1)",
            "(c & X[!](g & s2)) | (g & X[!]((c & s2) | (a & X[!]((c & s1) | (b & X[!] c)))))",
        ],
    ),
    (
        "t and g c; g sand a b on e(); event e() = {e: 1};",
        "projected",
        [
            "s1 := X[!](!rel U (rel & b))",
            "s2 := X[!](!rel U (rel & a & s1))",
            "!rel U (rel & ((c & X[!](!rel U (rel & g & s2))) | (g & X[!](!rel U (rel & ((c & s2) | (a & X[!](!rel U (rel & ((c & s1) | (b & X[!](!rel U (rel & c)))))))))))))",
        ],
    ),
    (
        "t and g c; g sand a b on e(); event e() = {e: 1};",
        "scattered",
        [
            "s1 := X[!] F b",
            "s2 := X[!] F(a & s1)",
            "F((g & X[!] F((a & X[!] F((b & X[!] F c) | (c & s1))) | (c & s2))) | (c & X[!] F(g & s2)))",
        ],
    ),
    ("causality bottom_up; t or g; g sand a b on e(); event e() = {e: 1};", "strict", ["a & X[!](b & X[!] g)"]),
    (
        "causality bottom_up; t or g; g sand a b on e(); event e() = {e: 1};",
        "projected",
        ["!rel U (rel & a & X[!](!rel U (rel & b & X[!](!rel U (rel & g)))))"],
    ),
    (
        "causality bottom_up; t or g; g sand a b on e(); event e() = {e: 1};",
        "scattered",
        ["F(a & X[!] F(b & X[!] F g))"],
    ),
    ("t and x y; x on e(_); y on e(1); event e(p) = {e: p};", "strict", ["(y & X[!] x) | (x & X[!] y)"]),
    (
        "t and x y; x on e(_); y on e(1); event e(p) = {e: p};",
        "projected",
        ["!rel U (rel & ((y & X[!](!rel U (rel & x))) | (x & X[!](!rel U (rel & y)))))"],
    ),
    ("t and x y; x on e(_); y on e(1); event e(p) = {e: p};", "scattered", ["F((x & X[!] F y) | (y & X[!] F x))"]),
    ("t or a b; a on e(X) when X > 1; b; event e(p) = {e: p};", "strict", ["a | b"]),
    ("t or a b; a on e(X) when X > 1; b; event e(p) = {e: p};", "projected", ["!rel U (rel & (a | b))"]),
    ("t or a b; a on e(X) when X > 1; b; event e(p) = {e: p};", "scattered", ["F a | F b"]),
]


@pytest.mark.parametrize(("tree", "semantics", "expected"), PINNED)
def test_pinned(tree: str, semantics: str, expected: list[str]) -> None:
    assert body(text_of(tree, semantics)) == expected


def test_whole_text() -> None:
    tree = """
        event reading(v) = { topic: "/sensor", value: v };
        ignore reading(V) when V < 0;
        t sand a b;
        a on reading(Value);
        b on reading(_) when Value >= 250;
    """
    assert text_of(tree, "projected").splitlines() == [
        "/* rvaft",
        'atom a := { topic: "/sensor", value: Value } when Value >= 250',
        'atom b := { topic: "/sensor", value: _ }',
        'relevant rel := { topic: "/sensor", value: Value }',
        'relevant rel := { topic: "/sensor", value: _ }',
        'ignored rel := { topic: "/sensor", value: V } when V < 0',
        "*/",
        "!rel U (rel & a & X[!](!rel U (rel & b)))",
    ]


def test_text_is_the_same_every_time() -> None:
    tree = "t and a b; a 2of3 c d e; b or c f;"
    assert len({text_of(tree, "strict") for _ in range(3)}) == 1
