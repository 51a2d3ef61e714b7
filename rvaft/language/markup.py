"""XML documents as elements with positions, for trees of other tools.

Documents of strangers are safe to read: a document type, which could declare entities, is refused, and no depth of
nesting exceeds the stack, since elements are built without recursion.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final
from xml.parsers import expat

from rvaft.errors import LanguageError
from rvaft.model.nodes import Place

SUFFIX: Final = ".xml"
"""The extension of XML documents."""


@dataclass(slots=True, eq=False)
class Element:
    """An element: its local name, attributes, inner elements, own text and position."""

    name: str
    attributes: dict[str, str]
    place: Place
    children: "list[Element]" = field(default_factory=list)
    texts: list[str] = field(default_factory=list)

    @property
    def text(self) -> str:
        """The text of the element itself, with single spaces between its words."""
        return " ".join("".join(self.texts).split())

    def named(self, *names: str) -> "Iterator[Element]":
        """Yield the inner elements of these names."""
        return (child for child in self.children if child.name in names)

    def first(self, name: str) -> "Element | None":
        """Return the first inner element of a name."""
        return next(self.named(name), None)

    def attribute(self, name: str) -> str:
        """Return an attribute that must be there and not empty; raises `LanguageError`."""
        value = self.attributes.get(name, "").strip()
        if not value:
            raise self.error(f'<{self.name}> needs an attribute {name}: add {name}="..."')
        return value

    def error(self, message: str) -> LanguageError:
        """Return an error at the element."""
        return LanguageError(message, file=self.place.file, line=self.place.line, column=self.place.column)


def is_document(text: str) -> bool:
    """Whether a text is an XML document and no tree of this language, in which nothing begins with `<`."""
    return text.lstrip("\ufeff \t\r\n").startswith("<")


def read_document(text: str, file: str) -> Element:
    """Return the root element of a document; raises `LanguageError`, which quotes nothing of the document.

    >>> root = read_document('<a><b x="1"> two  words </b></a>', "a.xml")
    >>> root.children[0].attributes, root.children[0].text
    ({'x': '1'}, 'two words')
    """
    parser = expat.ParserCreate("utf-8", namespace_separator=" ")
    top = Element("", {}, Place(file))
    inside = [top]

    def here() -> Place:
        return Place(file, parser.CurrentLineNumber, parser.CurrentColumnNumber + 1)

    def start(name: str, attributes: dict[str, str]) -> None:
        local = {key.rpartition(" ")[2]: value for key, value in attributes.items()}
        element = Element(name.rpartition(" ")[2], local, here())
        inside[-1].children.append(element)
        inside.append(element)

    def text_part(data: str) -> None:
        inside[-1].texts.append(data)

    def refuse(*_: object) -> None:
        line, column = here()[1:]
        why = "an XML document with a document type (DOCTYPE) is not read, since it can declare entities"
        raise LanguageError(f"{why}; remove the declaration", file=file, line=line, column=column)

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda _: inside.pop() and None
    parser.CharacterDataHandler = text_part
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(text.removeprefix("\ufeff").encode(), True)
    except expat.ExpatError as error:
        what = f"this is not well-formed XML ({expat.ErrorString(error.code)}); correct it, or export the tree again"
        raise LanguageError(what, file=file, line=error.lineno, column=error.offset + 1) from None
    except UnicodeEncodeError as error:
        line = text.count("\n", 0, error.start) + 1
        raise LanguageError("the text has an unpaired surrogate", file=file, line=line) from None
    return top.children[0]
