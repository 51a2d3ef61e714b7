"""`topic` declarations: what they say, where the word is still a name, and that nothing of them gets lost."""

import json
import pickle
from pathlib import Path

import pytest

from rvaft import RVAFT, Node, Topic, TreeError, dumps, load, loads, monitor
from rvaft.core.restriction import restrict
from rvaft.language.parser import parse
from rvaft.model.nodes import Place
from tests.cli.runs import run
from tests.tables import rows

TREE = "top or a b;\na fault;\nb attack;\n"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ('topic "/c" type "a.msg.B";', [Topic("/c", "a.msg.B")]),
        ('topic "c" type "a.msg.B" from n;', [Topic("c", "a.msg.B", ("n",))]),
        ('topic "/c" type "a.msg.B" from n, "/ns/m", "n";', [Topic("/c", "a.msg.B", ("n", "/ns/m"))]),
        ('topic"/c"type"a.msg.B"from n;', [Topic("/c", "a.msg.B", ("n",))]),
        ('topic // one\n"/c" /* "two" */ type # three\n\t"a.msg.B"\nfrom\nn;', [Topic("/c", "a.msg.B", ("n",))]),
        ('topic "/c" type "a.action._x.Y_Message";', [Topic("/c", "a.action._x.Y_Message")]),
        ('topic "/c" type "a.msg.B" from topic, type, from;', [Topic("/c", "a.msg.B", ("topic", "type", "from"))]),
        # said again: one type, all publishers, the first spelling
        (
            'topic "/c" type "a.msg.B" from n;\ntopic "c" type "a.msg.B" from m, n;\ntopic "/d" type "a.msg.B";',
            [Topic("/c", "a.msg.B", ("n", "m")), Topic("/d", "a.msg.B")],
        ),
    ],
)
def test_a_declaration(text: str, expected: list[Topic]) -> None:
    found = loads(f"{TREE}{text}", "some.rvaft").topics
    assert list(found.values()) == expected
    assert all(name == f"/{topic.name.removeprefix('/')}" for name, topic in found.items())
    before = text[: text.index('"')]
    place = Place("some.rvaft", 4 + before.count("\n"), len(before) - before.rfind("\n"))
    assert next(iter(found.values())).place == place


@pytest.mark.parametrize("text", rows(__file__, "topic_words.txt"))
def test_its_words_are_still_names(text: str) -> None:
    tree = parse(text).build()
    assert not tree.topics
    assert parse(dumps(tree)).build() == tree


def test_they_are_kept_by_imports_prunes_parts_and_pickles(tmp_path: Path) -> None:
    (tmp_path / "types.rvaft").write_text('topic "/c" type "a.msg.B" from n;\n' + TREE)
    (tmp_path / "main.rvaft").write_text('import "types.rvaft";\nprune b;\ntopic "/c" type "a.msg.B" from m;\n')
    tree = load(tmp_path / "main.rvaft")
    expected = {"/c": Topic("/c", "a.msg.B", ("n", "m"))}
    assert "b" not in tree.nodes
    assert dict(tree.topics) == expected
    for part in (restrict(tree, branch=1), restrict(tree, kind="fault"), pickle.loads(pickle.dumps(tree))):
        assert dict(part.topics) == expected
    assert pickle.loads(pickle.dumps(tree)) == tree
    copies = loads('topic "/c" type "a.msg.B";\ntop and x y;\nx or a b;\ny or a b;\na fault;\nb attack;\n')
    assert restrict(copies, kind="fault").root == "top"
    assert dict(restrict(copies, kind="fault").topics) == {"/c": Topic("/c", "a.msg.B")}


def test_trees_that_differ_in_topics_are_not_equal_but_mean_the_same() -> None:
    one, other = loads(TREE), loads(TREE + 'topic "/c" type "a.msg.B";')
    assert one != other
    assert loads(TREE + 'topic "/c" type "a.msg.B" from n;') != other
    assert loads('topic "/d" type "a.msg.D"; topic "/c" type "a.msg.B";' + TREE) == loads(
        TREE + 'topic "/c" type "a.msg.B"; topic "/d" type "a.msg.D";'
    )
    assert monitor(one).step({"event": "a"}) is monitor(other).step({"event": "a"})


@pytest.mark.parametrize(("text", "parts"), rows(__file__, "wrong_topics.txt"))
def test_a_wrong_declaration_is_an_error_at_its_place(text: str, parts: list[str]) -> None:
    with pytest.raises(TreeError) as caught:
        loads(f"{text}\n{TREE}")
    for part in parts:
        assert part in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("topics", "rule"),
    [
        ([Topic("/c", "a.msg.B"), Topic("c", "a.msg.B")], "duplicate-topic"),
        ([Topic("/c", "a.B")], "malformed-topic"),
        ([Topic("/c d", "a.msg.B")], "malformed-topic"),
        ([Topic("/c", "a.msg.B", ("",))], "malformed-topic"),
    ],
)
def test_a_tree_built_in_code_cannot_have_one_either(topics: list[Topic], rule: str) -> None:
    with pytest.raises(TreeError) as caught:
        RVAFT("a", [Node("a")], topics=topics)
    assert caught.value.rule == rule


@pytest.mark.parametrize(("events", "unused"), rows(__file__, "unused_topics.txt"))
def test_a_topic_that_no_event_type_has_is_a_warning(events: str, unused: bool, tmp_path: Path) -> None:
    (path := tmp_path / "some.rvaft").write_text(f'{events}topic "/c" type "a.msg.B";\n{TREE}')
    result = run("check", path)
    assert result.exit_code == 0
    found = [line for line in result.stdout.splitlines() if "[unused-topic]" in line]
    assert len(found) == unused
    assert all(f"{path}:" in line and "no event type has the topic /c" in line for line in found)


def test_show_writes_them_where_the_format_has_them(tmp_path: Path) -> None:
    (path := tmp_path / "some.rvaft").write_text(f'topic "c" type "a.msg.B" from n, "/ns/m";\n{TREE}')
    assert loads(run("show", path, "--format", "rvaft").stdout) == load(path)
    value = json.loads(run("show", path, "--format", "json").stdout)
    assert value["topics"] == [{"name": "c", "type": "a.msg.B", "publishers": ["n", "/ns/m"]}]
    assert "rvaft: warning: galileo: topic declarations left out\n" in run("show", path, "--format", "galileo").stderr
