"""RML texts with the verdicts of the published tools after each event, as observed: T is ⊤, F is ⊥, ? is neither."""

import json
import re
from dataclasses import dataclass
from typing import Any, Final

from rvaft.model.values import Json

LETTERS: Final = """\
a matches {e:'a'};
b matches {e:'b'};
c matches {e:'c'};
av(x) matches {e:'a', v:x};
bv(x) matches {e:'b', v:x};
"""
"""Event types that every text may use: a letter, alone or with its field v."""


@dataclass(frozen=True, slots=True)
class Case:
    """A text without the letters, and traces (see `events`) with their verdicts."""

    name: str
    text: str
    runs: dict[str, str]

    @property
    def whole(self) -> str:
        """The text with the letters."""
        return LETTERS + self.text


def events(trace: str) -> list[Json]:
    """`a` is {"e": "a"}, `a1` has v as well, `a1/2` has v and w; a trace in square brackets is JSON."""
    if trace.startswith("["):
        found: list[Any] = json.loads(trace)
        return found
    return [_event(word) for word in trace.split()]


def _event(word: str) -> dict[str, Json]:
    match = re.fullmatch(r"([a-z])(-?\d+)?(?:/(\d+))?", word)
    assert match
    letter, v, w = match.groups()
    return {"e": letter, **({} if v is None else {"v": int(v)}), **({} if w is None else {"w": int(w)})}


CASES: Final = (
    Case("one event", "Main = a all;", {"a": "T", "b": "F", "a b": "TT"}),
    Case("empty halts at once", "Main = empty;", {"a": "T"}),
    Case("a type halts after its event, then nothing follows", "Main = a b;", {"a b": "?T", "a b a": "?TT", "b": "F"}),
    Case("all halts at once", "Main = all;", {"a": "T"}),
    Case("sequence with a first part that may halt", "Main = a? b all;", {"b": "T", "a b": "?T", "a a": "?F"}),
    Case("star takes what it can", "Main = (a* a) (c all);", {"a a c": "??F", "a c": "?F"}),
    Case("star, then more", "Main = a* b all;", {"a a b": "??T", "b": "T", "c": "F"}),
    Case("plus wants one", "Main = a+ b all;", {"b": "F", "a a b": "??T"}),
    Case("optional once", "Main = a? b all;", {"a a": "?F"}),
    Case("closure of a sequence", "Main = c (a b)!;", {"c": "T", "c b": "TT"}),
    Case("closure inside a sequence", "Main = (a b)! c all;", {"c": "T", "a c": "?T", "a b c": "??T"}),
    Case("times", "Main = a{2} b all;", {"a a b": "??T", "a b": "?F"}),
    Case("times 0 takes nothing, but may halt", "Main = a{0} b all;", {"b": "T", "a": "F"}),
    Case("times of what may halt", "Main = (a?){2} b all;", {"b": "T", "a b": "?T", "a a b": "??T", "a a a": "??F"}),
    Case("times in parentheses", "Main = a{(2)} b all;", {"a a b": "??T"}),
    Case("union commits to the left", "Main = (a b) \\/ (a c);", {"a b": "?T", "a c": "?F"}),
    Case("union in the other order", "Main = (b \\/ c) a;", {"c a": "?T", "b a": "?T"}),
    Case("union, last of three", "Main = a \\/ b \\/ c all;", {"c": "T", "a": "T"}),
    Case("shuffle takes turns", "Main = (a b) | (c c);", {"a c b c": "???T", "c c a b": "???T", "a c c": "???"}),
    Case("shuffle commits to the left", "Main = (a b) | (a c);", {"a a": "??", "a c": "?F", "a b a c": "???T"}),
    Case("shuffle of three", "Main = a | b | c;", {"c b a": "??T", "b b": "?F"}),
    Case("conjunction", "Main = (a b) /\\ (a (b \\/ c));", {"a b": "?T", "a c": "?F"}),
    Case("all is neutral in a conjunction", "Main = (a b) /\\ all;", {"a b": "?T", "b": "F"}),
    Case("conjunction of unequal lengths", "Main = (a b) /\\ a;", {"a b": "?F"}),
    Case("conjunction of two that end, then all", "Main = (a /\\ (a \\/ b)) all;", {"a": "T", "a c": "TT", "b": "F"}),
    Case("juxtaposition binds tighter than conjunction", "Main = a /\\ a b;", {"a b": "?F"}),
    Case("conjunction binds tighter than union", "Main = a b /\\ a b \\/ c;", {"c": "T", "a b": "?T"}),
    Case("union binds tighter than shuffle", "Main = a \\/ b | c;", {"a c": "?T", "c b": "?T", "a b": "?F"}),
    Case("`all` ends an inner sequence", "Main = (a all) b;", {"a": "T", "a c": "TT"}),
    Case("`all` in the middle waits for an event", "Main = a (all b);", {"a": "?", "a c": "?T"}),
    Case("three in a row with `all` first", "Main = (a all b) c;", {"a c c": "?TT", "a": "?"}),
    Case("filter keeps the rest", "Main = a >> a a all;", {"b a c a": "???T", "a a": "?T"}),
    Case("filter with an else", "Main = a >> (a a) : (b c);", {"a b c a": "???T", "b b": "?F"}),
    Case("filter with an else that may stop", "Main = c (a >> a : b*);", {"c b a": "??T", "c b c": "??F"}),
    Case("filter takes everything to its right", "Main = a >> a | b;", {"c a": "??", "a c b": "???"}),
    Case("filter of nothing", "Main = none >> empty : a b all;", {"a b": "?T"}),
    Case("filter inside stays live", "Main = (c \\/ a >> a) all;", {"b a": "?T", "c": "T"}),
    Case(
        "irrelevant events do not end a filter with `all` outside it",
        """rel matches a | b;
Main = (rel >> a) all;""",
        {"c a c c": "?TTT", "c c": "??"},
    ),
    Case(
        "irrelevant events, `all` inside",
        """rel matches a | b;
Main = rel >> a all;""",
        {"c a c c": "?TTT", "b": "F"},
    ),
    Case("recursion", "Main = a Main \\/ b all;", {"a a b": "??T", "a c": "?F"}),
    Case(
        "mutual recursion",
        """Main = a Other;
Other = b Main \\/ c all;""",
        {"a b a c": "???T", "a a": "?F"},
    ),
    Case(
        "a balanced language",
        """Main = S all;
S = a S b \\/ c;""",
        {"a a c b b": "????T", "a c c": "??F"},
    ),
    Case(
        "recursion under a conjunction",
        """Main = E /\\ F;
E = a (E \\/ b);
F = (a \\/ b) (F \\/ empty);""",
        {"a a b": "??T", "a b": "?T"},
    ),
    Case("if chooses", "Main = if (1 < 2) a all else b all;", {"a": "T", "b": "F"}),
    Case("if takes everything to its right", "Main = if (1 > 2) a else b | c;", {"b c": "?T", "c": "?"}),
    Case(
        "generic equation counts",
        """Main = G<2>;
G<n> = if (n > 0) a G<n-1> else b all;""",
        {"a a b": "??T", "a b": "?F"},
    ),
    Case(
        "generic with two parameters",
        """Main = G<1,2>;
G<x,y> = av(x) av(y) all;""",
        {"a1 a2": "?T", "a1 a1": "?F"},
    ),
    Case(
        "generic argument shadows",
        """Main = {let x; av(x) G<2>};
G<x> = bv(x) all;""",
        {"a1 b2": "?T", "a1 b1": "?F"},
    ),
    Case(
        "arguments are calculated",
        """Main = {let x; av(x) G<x+1>};
G<y> = bv(y) all;""",
        {"a1 b2": "?T", "a1 b1": "?F"},
    ),
    Case(
        "a generic equation without arguments never goes on",
        """Main = a G;
G<n> = a all;""",
        {"a a": "?F"},
    ),
    Case(
        "the wrong number of arguments never goes on",
        """Main = a G<1,2>;
G<n> = a all;""",
        {"a a": "?F"},
    ),
    Case(
        "arguments for an equation without parameters",
        """Main = a F<1>;
F = a all;""",
        {"a a": "?F"},
    ),
    Case(
        "an argument without a value is false",
        """Main = G<z>;
G<n> = {let y; bv(y) (if (y == 1) av(n) else a) all};""",
        {"b0 a": "?T", "b1 a1": "?F"},
    ),
    Case("let binds once", "Main = {let x; av(x) bv(x) all};", {"a1 b1": "?T", "a1 b2": "?F"}),
    Case("without let every event is new", "Main = av(x) bv(x) all;", {"a1 b2": "?T"}),
    Case(
        "let in a loop is new each time",
        "Main = {let x; av(x) bv(x) Main};",
        {"a1 b1 a2 b2": "????", "a1 b1 a2 b1": "???F"},
    ),
    Case(
        "let outside a loop is bound for good",
        """Main = {let x; Loop};
Loop = av(x) Loop \\/ b all;""",
        {"a1 a1 b": "??T", "a1 a2": "?F"},
    ),
    Case(
        "scope is dynamic",
        """Main = {let x; av(x) Other};
Other = bv(x) all;""",
        {"a1 b1": "?T", "a1 b2": "?F"},
    ),
    Case(
        "inner let hides outer",
        "Main = {let x; av(x) {let x; bv(x) bv(x)} bv(x) all};",
        {"a1 b2 b2 b1": "???T", "a1 b2 b1": "??F"},
    ),
    Case(
        "two variables", "Main = {let x, y; av(x) bv(y) av(y) bv(x) all};", {"a1 b2 a2 b1": "???T", "a1 b2 a1": "??F"}
    ),
    Case(
        "both sides of a conjunction bind alike",
        """any1(x) matches {v:x};
Main = {let x; (av(x) /\\ any1(x)) bv(x) all};""",
        {"a1 b1": "?T", "a1 b2": "?F"},
    ),
    Case(
        "a conjunction looks for a way that both share",
        """two(x) matches {v:x} | {w:x};
w(x) matches {w:x};
Main = {let x; (two(x) /\\ w(x)) bv(x) all};""",
        {"a1/2 b2": "?T", "a1/2 b1": "?F"},
    ),
    Case(
        "a union inside a conjunction commits, its last alternative does not",
        """two(x) matches {v:x} | {w:x};
w(x) matches {w:x};
Main = {let x; ((c \\/ two(x)) /\\ w(x)) bv(x) all};""",
        {"a1/2 b2": "?T"},
    ),
    Case(
        "a first alternative inside a conjunction commits",
        """two(x) matches {v:x} | {w:x};
w(x) matches {w:x};
Main = {let x; ((two(x) \\/ c) /\\ w(x)) bv(x) all};""",
        {"a1/2 b2": "FF"},
    ),
    Case(
        "a block inside a conjunction commits",
        """two(x) matches {v:x} | {w:x};
w(x) matches {w:x};
Main = {let x; ({let y; two(x)} /\\ w(x)) bv(x) all};""",
        {"a1/2 b2": "FF"},
    ),
    Case(
        "star inside a conjunction does not commit",
        """two(x) matches {v:x} | {w:x};
w(x) matches {w:x};
Main = {let x; (two(x)+ /\\ w(x)) bv(x) all};""",
        {"a1/2 b2": "?T"},
    ),
    Case(
        "the binding of a lost alternative is lost",
        "Main = {let x; ((av(x) b) \\/ (av(x) c)) bv(x) all};",
        {"a1 b b1": "??T", "a1 c": "?F"},
    ),
    Case(
        "a `|` in a pattern binds its first match",
        """two(x) matches {v:x} | {w:x};
Main = {let x; two(x) bv(x) all};""",
        {"a1/2 b1": "?T", "a1/2 b2": "?F"},
    ),
    Case(
        "fields vary slowest first",
        """two(x,y) matches {v:x|y, w:x|y};
Main = {let x, y; two(x,y) bv(x) bv(y) all};""",
        {"a1/2 b1 b2": "??T"},
    ),
    Case(
        "derived types",
        """ab matches a | b;
Main = ab c all;""",
        {"b c": "?T", "c": "F"},
    ),
    Case(
        "derived type with a literal",
        """a2 matches av(2);
Main = a2 all;""",
        {"a2": "T", "a1": "F"},
    ),
    Case(
        "derived type with a parameter",
        """either(x) matches av(x) | bv(x);
Main = {let x; either(x) either(x) all};""",
        {"a1 b1": "?T", "a1 b2": "?F"},
    ),
    Case(
        "derived type with `_`",
        """any1 matches av(_) | bv(_);
Main = any1 all;""",
        {"b1": "T", "b": "F"},
    ),
    Case(
        "negation",
        """na not matches a;
Main = na all;""",
        {"b": "T", "a": "F"},
    ),
    Case(
        "negation of several",
        """n not matches a | b;
Main = n all;""",
        {"c": "T", "b": "F"},
    ),
    Case(
        "negation with a bound variable",
        """no(x) not matches bv(x);
Main = {let x; av(x) no(x) all};""",
        {"a1 b2": "?T", "a1 b1": "?F", "a1 c": "?T"},
    ),
    Case(
        "negation with an unbound variable opens it",
        """no(x) not matches bv(x);
Main = {let x; no(x) bv(x) bv(x) all};""",
        {"c b1 b1": "??T", "c b1 b2": "??F", "b1": "F"},
    ),
    Case(
        "an open variable is one for both sides",
        """no(x) not matches bv(x);
Main = {let x; no(x) (av(x) /\\ a) bv(x) all};""",
        {"c a1 b1": "??T", "c a1 b2": "??F"},
    ),
    Case(
        "an open variable is seen by the right side at once",
        """no(x) not matches bv(x);
other(x) not matches {v:x};
v(x) matches {v:x};
Main = {let x; no(x) (v(x) /\\ other(x)) all};""",
        {"c a1": "?F"},
    ),
    Case(
        "an unbound variable in a `not` type and a conjunction",
        """no(x) not matches bv(x);
Main = {let x; (av(x) /\\ no(x)) all};""",
        {"a1": "F"},
    ),
    Case(
        "two open variables stay apart",
        """no(x) not matches bv(x);
Main = ({let x; no(x) av(x)} | {let x; no(x) av(x)}) b;""",
        {"c a1 c a2 b": "????T", "c c a1 a2 b": "????T"},
    ),
    Case(
        "a variable in one alternative of a pattern only",
        """ac(x) matches {e:'a', v:x} | {e:'c'};
Main = {let x; ac(x) av(x) av(x) all};""",
        {"c a1 a1": "??T", "c a1 a2": "??F", "a1 a2": "?F"},
    ),
    Case(
        "filter over an open variable",
        """no(x) not matches bv(x);
Main = {let x; no(x) (bv(x) >> bv(x) bv(x)) all};""",
        {"c b1 b1 c": "??TT", "c b1 b2 b1": "???T"},
    ),
    Case(
        "a filter type with a variable is bound by its first event",
        "Main = {let x; av(x) >> a a all};",
        {"a1 a2": "??", "a1 a1": "?T", "b a1 a1": "??T"},
    ),
    Case(
        "redeclared event type",
        """x matches {v:1};
x matches {v:2};
Main = x x all;""",
        {"a1 a2": "?T", "a3": "F"},
    ),
    Case(
        "declared twice with different parameters",
        """x(v) matches {v:v};
x matches {e:'c'};
Main = x(1) x all;""",
        {"a1 c": "?T", "c": "F"},
    ),
    Case(
        "`any` redeclared is wider",
        """any matches 'x';
Main = any all;""",
        {"a": "T"},
    ),
    Case(
        "`none` redeclared",
        """none matches {e:'a'};
Main = none all;""",
        {"a": "T", "b": "F"},
    ),
    Case("undeclared type", "Main = zzz all;", {"a": "F"}),
    Case("wrong arity", "Main = a(1) all;", {"a": "F"}),
    Case("argument that is not calculated", "Main = av(1+1) all;", {"a2": "F"}),
    Case("negative argument", "Main = av(-1) all;", {"a-1": "T", "a1": "F"}),
    Case("negated variable is not calculated", "Main = {let x; bv(x) av(-x) all};", {"b1 a-1": "?F", "b1 a1": "?F"}),
    Case(
        "not of a calculated argument",
        """no(x) not matches av(x);
Main = no(1+1) all;""",
        {"a2": "T"},
    ),
    Case(
        "guard",
        """big(x) matches {v:x} with x > 1;
Main = big(x) all;""",
        {"a2": "T", "a1": "F", "a": "F"},
    ),
    Case(
        "guard with both connectives",
        """g(x) matches {v:x} with (x > 1 && x < 4) || x == 9;
Main = g(x) all;""",
        {"a2": "T", "a1": "F", "a4": "F", "a9": "T"},
    ),
    Case(
        "each operator has its own level: 10-3+2 is 5",
        """g(x) matches {v:x} with x == 10-3+2;
Main = g(x) all;""",
        {"a5": "T", "a9": "F"},
    ),
    Case(
        "8/4*2 is 1",
        """g(x) matches {v:x} with x == 8/4*2;
Main = g(x) all;""",
        {"a1": "T", "a4": "F"},
    ),
    Case(
        "power and functions",
        """g(x) matches {v:x} with x == max(2^3, min(1, 0)) - abs(-1);
Main = g(x) all;""",
        {"a7": "T"},
    ),
    Case(
        "division by zero does not hold",
        """g(x) matches {v:x} with 1/x > 0;
Main = g(x) all;""",
        {"a0": "F", "a1": "T"},
    ),
    Case(
        "guard of a derived type",
        """g(x) matches av(x) | bv(x) with x >= 2;
Main = g(x) all;""",
        {"b2": "T", "b1": "F"},
    ),
    Case(
        "guard over an argument",
        """g(x) matches {e:'a'} with x > 1;
Main = {let x; bv(x) g(x) all};""",
        {"b2 a": "?T", "b1 a": "?F"},
    ),
    Case(
        "whole pattern is a variable beside another",
        """p matches {v:7} | z;
Main = p all;""",
        {"c": "T"},
    ),
    Case(
        "unquoted and quoted fields",
        """p matches {'e':'a', v:1};
Main = p all;""",
        {"a1": "T"},
    ),
    Case("more fields do no harm", "Main = a all;", {"a1/2": "T"}),
    Case("a call takes the parenthesis", "Main = a (b) all;", {"a b": "FF", "a": "F"}),
    Case("no call: a sequence in parentheses", "Main = a (b c) all;", {"a b c": "??T"}),
    Case("no call: the type in parentheses", "Main = (a) (b) all;", {"a b": "?T"}),
    Case(
        "comments",
        """// first
Main = a // then
 all;""",
        {"a": "T"},
    ),
    Case("var for let", "Main = {var x; av(x) bv(x) all};", {"a1 b1": "?T"}),
    Case("k of n as a union of shuffles commits", "Main = ((a | b) \\/ (a | c)) all;", {"a b": "?T", "a c": "?F"}),
    Case("the disjunction that misses what its left side has begun", "Main = (a b c) \\/ (a b a);", {"a b a": "??F"}),
    Case(
        "at most one direction: late exit first",
        "Main = a (((b all) /\\ (b all)) \\/ ((c /\\ c) (a all)));",
        {"a b": "?T", "a c a": "??T", "a a": "?F"},
    ),
    Case(
        "scattered",
        """na not matches a;
nb not matches b;
Main = (na* a all) /\\ (nb* b all);""",
        {"c b c a": "???T", "a c": "??", "b b b": "???"},
    ),
    Case("any* a never takes a", "Main = any* a all;", {"a": "?", "b a a": "???"}),
    Case(
        "literals",
        """p matches {v:true} | {v:null} | {v:'s'} | {v:1.5};
Main = p* c all;""",
        {
            '[{"v": true}, {"v": null}, {"v": "s"}, {"v": 1.5}, {"e": "c"}]': "????T",
            '[{"v": 1}]': "F",
            '[{"v": false}]': "F",
            '[{"v": "true"}]': "F",
            '[{"v": "null"}]': "F",
        },
    ),
    Case(
        "lists",
        """p matches {v:[]};
q(x) matches {v:[x]};
Main = {let x; q(x) p q(x) all};""",
        {
            '[{"v": [1]}, {"v": []}, {"v": [1]}]': "??T",
            '[{"v": [1]}, {"v": []}, {"v": [2]}]': "??F",
            '[{"v": [1, 2]}]': "F",
            '[{"v": "x"}]': "F",
        },
    ),
    Case(
        "open lists",
        """r(x) matches {v:[x, ...]};
s matches {v:[...]};
Main = {let x; r(x) r(x) s all};""",
        {
            '[{"v": [1]}, {"v": [1, 2]}, {"v": [3]}]': "??T",
            '[{"v": [1]}, {"v": [1, 2]}, {"v": []}]': "??F",
            '[{"v": []}]': "F",
        },
    ),
    Case(
        "`[...]` wants an item",
        """s matches {v:[...]};
Main = s all;""",
        {'[{"v": []}]': "F", '[{"v": [null]}]': "T"},
    ),
    Case(
        "nested patterns",
        """p(x) matches {a:{b:[{c:x|5}, _]}};
Main = {let x; p(x) p(x) all};""",
        {
            '[{"a": {"b": [{"c": 1, "d": 2}, 0], "z": 0}}, {"a": {"b": [{"c": 1}, 1]}}]': "?T",
            '[{"a": {"b": [{"c": 1}]}}]': "F",
            '[{"a": {"b": [{"c": 1}, 0]}}, {"a": {"b": [{"c": 2}, 0]}}]': "?F",
        },
    ),
    Case(
        "a variable in two places of a pattern",
        """p(x) matches {v:x, w:x};
Main = p(x) all;""",
        {'[{"v": 1, "w": 1}]': "T", '[{"v": 1, "w": 2}]': "F", '[{"v": [1, "a"], "w": [1, "a"]}]': "T"},
    ),
    Case(
        "variables for strings, booleans, null and lists",
        """p(x) matches {v:x};
Main = {let x; p(x) p(x) all};""",
        {
            '[{"v": "1"}, {"v": "1"}]': "?T",
            '[{"v": "1"}, {"v": 1}]': "?F",
            '[{"v": true}, {"v": true}]': "?T",
            '[{"v": true}, {"v": "true"}]': "?F",
            '[{"v": null}, {"v": null}]': "?T",
            '[{"v": null}, {"v": false}]': "?F",
            '[{"v": [1, [2]]}, {"v": [1, [2]]}]': "?T",
            '[{"v": [1, 2]}, {"v": [1]}]': "?F",
        },
    ),
    Case(
        "a pattern as the argument of a parent",
        """p(x) matches {e:'a', v:x};
q matches p({k:1});
r matches p([_, ...]);
n not matches p({k:1});
Main = q r n all;""",
        {
            '[{"e": "a", "v": {"k": 1, "l": 2}}, {"e": "a", "v": [0]}, {"e": "a", "v": {"k": 2}}]': "??T",
            '[{"e": "a", "v": 1}]': "F",
            '[{"e": "a", "v": {"k": 1}}, {"e": "a", "v": []}]': "?F",
            '[{"e": "a", "v": {"k": 1}}, {"e": "a", "v": [0]}, {"e": "a", "v": {"k": 1}}]': "??F",
        },
    ),
    Case(
        "a string as the argument of a parent",
        """p(x) matches {v:x};
q matches p('s');
Main = q all;""",
        {'[{"v": "s"}]': "T", '[{"v": "t"}]': "F"},
    ),
    Case(
        "escapes",
        """p matches {'a b':'it\\'s\\n\\t\\\\'};
Main = p all;""",
        {'[{"a b": "it\'s\\n\\t\\\\"}]': "T", '[{"a b": "its"}]': "F"},
    ),
    Case(
        "quotes and umlauts",
        """p matches {'e':'"ü"'};
Main = p all;""",
        {'[{"e": "\\"ü\\""}]': "T", '[{"e": "ü"}]': "F"},
    ),
    Case(
        "a string that is a keyword",
        """p matches {'matches':'true', 'Topic':'_', '1':'x'};
Main = p all;""",
        {'[{"matches": "true", "Topic": "_", "1": "x"}]': "T", '[{"matches": true, "Topic": "_", "1": "x"}]': "F"},
    ),
    Case(
        "string in another language's quotes stays",
        """p matches {v:'a"b'};
Main = p all;""",
        {'[{"v": "a\\"b"}]': "T"},
    ),
    Case(
        "a guard that combines an argument with a field",
        """p(x,y) matches {v:x, w:y} with y - x >= 2;
Main = {let x, y; av(x) p(x,y) all};""",
        {
            '[{"e": "a", "v": 1}, {"v": 1, "w": 3}]': "?T",
            '[{"e": "a", "v": 1}, {"v": 1, "w": 2}]': "?F",
            '[{"e": "a", "v": 1}, {"v": 2, "w": 9}]': "?F",
        },
    ),
    Case("nothing in the event", "Main = any all;", {"[{}]": "T"}),
)
