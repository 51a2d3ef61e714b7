"""XES event logs (IEEE 1849) of process mining, read incrementally."""

from collections.abc import Iterable, Iterator
from contextlib import suppress
from typing import ClassVar, Final
from xml.etree import ElementTree as ET
from xml.parsers import expat

from rvaft.errors import TraceError
from rvaft.model.values import Json
from rvaft.readers.json_lines import MAX_DEPTH, settled
from rvaft.readers.log import MAX_LINE, FieldType, Log, LogReader

CASE: Final = "case"
"""The field with the name of an event's case."""
_NAME: Final = "concept:name"
_HOLDERS: Final = {"log": ("",), "trace": ("log",), "event": ("log", "trace")}
_TYPES: Final = {
    **dict.fromkeys(("string", "date", "id"), FieldType.TEXT),
    **dict.fromkeys(("int", "float"), FieldType.NUMBER),
    "boolean": FieldType.BOOL,
}


class XesReader(LogReader):
    """XES events: the fields are the attributes of event and case; `case` is the name of the case.

    >>> import io
    >>> case = '<string key="concept:name" value="c7"/>'
    >>> event = '<event><string key="concept:name" value="pay"/></event>'
    >>> text = f"<log><trace>{case}{event}</trace></log>"
    >>> list(Log(XesReader(), io.BytesIO(text.encode()), "orders.xes").events())
    [{'case': 'c7', 'concept:name': 'pay'}]
    """

    name: ClassVar[str] = "xes"
    suffixes: ClassVar[tuple[str, ...]] = (".xes",)
    unit: ClassVar[str] = "event"

    def events(self, log: Log) -> Iterator[tuple[int, dict[str, Json]]]:
        """Yield the events with their numbers in the file."""
        number, case, begun = 0, dict[str, Json](), False
        path: list[ET.Element] = []
        source = _XmlStream(log)
        try:
            for moment, element in ET.iterparse(source, events=("start", "end")):  # noqa: S314 (there are no entities)
                name, above = _local(element), _local(path[-1]) if path else ""
                if moment == "start":
                    if above not in _HOLDERS.get(name, (above or "log",)) or len(path) > MAX_DEPTH:
                        reason = "is nested too deeply" if len(path) > MAX_DEPTH else f"stands in {above or 'no log'}"
                        raise log.error_at(f"not XES: {name} {reason}", number + 1)
                    case, begun = ({}, False) if name == "trace" else (case, begun)
                    path.append(element)
                    continue
                path.pop()
                above = _local(path[-1]) if path else ""
                if above not in ("log", "trace"):
                    continue
                path[-1].remove(element)  # free the memory
                source.pending = 0
                is_event = name == "event"
                number += is_event
                try:
                    if is_event:
                        begun = True
                        own = {_of_event(key): value for key, value in _attributes(element).items()}
                        event = settled({**(case if above == "trace" else {}), **own}, log)
                    elif above == "trace":
                        new = {_of_case(key): value for key, value in _attributes([element]).items()}
                        if begun or new.keys() & case.keys():
                            reason = "stands behind it" if begun else "is repeated"
                            raise ValueError(f"an attribute of its case {reason}")  # noqa: TRY301
                        case |= new
                except ValueError as error:
                    log.reject(max(number, 1), str(error))
                else:
                    if is_event:
                        yield number, event
        except TraceError:
            raise
        except (ET.ParseError, LookupError, ValueError) as error:  # LookupError: an unknown encoding
            raise log.error_at(f"not XML, or damaged: {error}", None) from error


class _XmlStream:
    """A stream of XML without document types, whose entities could expand without bounds.

    `pending` counts bytes since the last event.
    """

    def __init__(self, log: Log) -> None:
        self.pending = 0
        self._log, self._begun = log, list[object]()
        self._prolog = expat.ParserCreate()
        self._prolog.StartDoctypeDeclHandler = self._refuse
        self._prolog.StartElementHandler = lambda *element: self._begun.append(element)

    def _refuse(self, *_type: object) -> None:
        reason = "it has a document type (<!DOCTYPE), which is not read, as it can define anything: remove that"
        raise self._log.error_at(reason, None)

    def read(self, size: int = -1, /) -> bytes:
        if self.pending > MAX_LINE:
            raise self._log.error_at(f"an event is longer than {MAX_LINE // 1024**2} MiB", self._log.place + 1)
        data = self._log.stream.read(size)
        self.pending += len(data)
        if not self._begun:
            with suppress(expat.ExpatError, LookupError, UnicodeError):  # the parser reports these
                self._prolog.Parse(data)
        return data


def _attributes(elements: Iterable[ET.Element]) -> dict[str, Json]:
    found: dict[str, Json] = {}
    for element in elements:
        kind, key, text = _local(element), element.get("key"), element.get("value")
        if key is None:
            raise ValueError(f"an attribute ({kind}) has no key")
        if key in found:
            raise ValueError(f"the key {key} is repeated")
        if kind == "container":
            found[key] = _attributes(element)
        elif kind == "list":
            values = next((one for one in element if _local(one) == "values"), element)
            found[key] = [_attributes([one]) for one in values]
        elif kind not in _TYPES:
            raise ValueError(f"the attribute {key} has a type that XES does not define ({kind})")
        elif text is None:
            raise ValueError(f"the attribute {key} has no value")
        else:
            try:
                found[key] = _TYPES[kind].value_of(text)
            except ValueError as error:
                raise ValueError(f"the attribute {key} is {error}") from None
    return found


def _of_case(key: str) -> str:
    return CASE if key == _NAME else f"{CASE}:{key}"


def _of_event(key: str) -> str:
    """Return a field that differs from those of the case."""
    return f"event:{key}" if key == CASE or key.startswith(f"{CASE}:") else key


def _local(element: ET.Element) -> str:
    return element.tag.rpartition("}")[2].lower()
