"""Messages of Protocol Buffers, decoded by the descriptors in a recording.

The JSON mapping of Protocol Buffers is not used: it writes 64-bit integers as texts and leaves out
fields with default values, so that guards would be undefined.
"""

from collections.abc import Callable, Iterator
from typing import Any, Final

from rvaft.errors import installed
from rvaft.model.values import Json

_TIMES: Final = frozenset({"google.protobuf.Timestamp", "google.protobuf.Duration"})
_REMEDY: Final = "pip install '.[bags]' in a checkout of rvaft"


def decoder(descriptors: bytes, name: str) -> Callable[[bytes], dict[str, Json]]:
    """Return the function from the bytes of a message of this type to its fields.

    `descriptors` is a serialised `FileDescriptorSet`. Numbers are numbers, an enumeration is a name, bytes are a
    list, and a time is `{"sec": …, "nanosec": …}` as in ROS. A field without presence is always there, and
    another one if it is set. Raises `ToolMissing`, and any exception of the library for malformed descriptors.
    """
    types = installed("google.protobuf.descriptor_pb2", "protobuf", _REMEDY)
    pools = installed("google.protobuf.descriptor_pool", "protobuf", _REMEDY)
    factory = installed("google.protobuf.message_factory", "protobuf", _REMEDY)
    files = {one.name: one for one in types.FileDescriptorSet.FromString(descriptors).file}
    pool, added = pools.DescriptorPool(), set[str]()
    for file in files:
        for one in _in_order(file, files, added):
            pool.AddSerializedFile(one.SerializeToString())
    message = factory.GetMessageClass(pool.FindMessageTypeByName(name))
    return lambda data: _fields(message.FromString(data))


def _in_order(file: str, files: dict[str, Any], added: set[str]) -> Iterator[Any]:
    """Iterate over a file and those that it imports, which come first, unless they were added."""
    agenda = [(file, False)]
    while agenda:
        name, ready = agenda.pop()
        if ready:
            yield files[name]
        elif name not in added and name in files:
            added.add(name)
            agenda += [(name, True), *((one, False) for one in files[name].dependency)]


def _fields(message: Any) -> dict[str, Json]:
    """Return the fields of a message, nested at most as deep as the library reads it."""
    described = message.DESCRIPTOR
    if described.full_name in _TIMES:
        return {"sec": message.seconds, "nanosec": message.nanos}
    return {
        field.name: _field(field, getattr(message, field.name))
        for field in described.fields
        if not field.has_presence or message.HasField(field.name)
    }


def _field(field: Any, value: Any) -> Json:
    if not field.is_repeated:
        return _value(field, value)
    if field.message_type is not None and field.message_type.GetOptions().map_entry:
        inner = field.message_type.fields_by_name["value"]
        return {_text(key): _value(inner, one) for key, one in value.items()}
    return [_value(field, one) for one in value]


def _text(key: Any) -> str:
    return str(key).lower() if isinstance(key, bool) else str(key)


def _value(field: Any, value: Any) -> Json:
    if field.message_type is not None:
        return _fields(value)
    if field.enum_type is not None:
        known = field.enum_type.values_by_number.get(value)
        return value if known is None else known.name
    return list(value) if isinstance(value, bytes) else value
