"""Common slips in `topic` statements: one function each; the first that knows something speaks."""

from typing import Final

from rvaft.language.advice import Advice, Hint, meant
from rvaft.language.lexemes import Lexeme, Situation
from rvaft.language.words import TOPIC, shown
from rvaft.printable import visible

_EXAMPLE: Final = 'as in topic "/name" type "package.msg.Name"'


def _string(lexeme: Lexeme) -> bool:
    return lexeme.text[:1] == '"' and lexeme.is_name


def _starting(at: Situation) -> bool:
    """Whether the statement so far is the word `topic`, which no string, `type` and string follow."""
    return [lexeme.text for lexeme in at.before] == [TOPIC] and at.can("K_OF_N")


def _misspelt_topic(at: Situation) -> Advice | None:
    if len(at.before) != 1 or not _string(at.bad) or not at.after or at.after[0].text != "type":
        return None
    word = at.before[0]
    if word.text != TOPIC and meant(word.text, (TOPIC,)):
        return Advice(f"unknown statement {shown(word.text)}: did you mean {TOPIC}?", word.start)
    return None


def _bare_topic(at: Situation) -> Advice | None:
    if not _starting(at):
        return None
    if at.bad.text in ("/", "~") or (at.bad.is_word and at.after and at.after[0].text == "type"):
        return Advice(f"the name of a topic stands in quotes, {_EXAMPLE}", at.bad.start)
    return None


def _no_type(at: Situation) -> Advice | None:
    if not _starting(at) or not _string(at.bad):
        return None
    following = at.after[0] if at.after else None
    if following is not None and following.text == "type":
        return Advice(f"the message type of a topic stands in quotes, {_EXAMPLE}", at.after[-1].start)
    if following is not None and following.is_word and meant(following.text, ("type",)):
        return Advice(f"unknown word {shown(following.text)}: did you mean type?", following.start)
    return Advice(f"the message type of topic {shown(at.bad.text)[1:-1]} is missing, {_EXAMPLE}", at.bad.end)


def _misspelt_from(at: Situation) -> Advice | None:
    if at.can("FROM") and not at.new_line and at.bad.is_word and meant(at.bad.text, ("from",)):
        return Advice(f"unknown word {shown(at.bad.text)}: did you mean from?", at.bad.start)
    return None


def _between_publishers(at: Situation) -> Advice | None:
    if at.can("COMMA", "SEMICOLON") and at.bad.is_name and not at.new_line:
        return Advice("publishers are separated by commas", at.bad.start)
    return None


def _bare_publisher(at: Situation) -> Advice | None:
    if not at.can("NAME") or at.bad.text not in ("/", "~") or [x.text for x in at.before[:1]] != [TOPIC]:
        return None
    text = at.bad.text + (at.after[0].text if at.after else "")
    return Advice(f'a name with other characters than letters, digits and _ is quoted: "{visible(text)}"', at.bad.start)


TOPIC_SLIPS: Final[tuple[Hint, ...]] = (
    _misspelt_topic,
    _bare_topic,
    _no_type,
    _misspelt_from,
    _between_publishers,
    _bare_publisher,
)
