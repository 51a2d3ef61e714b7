"""The configuration itself, in the format of ROSMonitoring's generator."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

from rvaft.errors import ToolMissing
from rvaft.rosmonitoring.options import Action, Options, Oracle
from rvaft.rosmonitoring.planning import Planned
from rvaft.rosmonitoring.topics import Subscription
from rvaft.values import Json

if TYPE_CHECKING:
    from types import ModuleType

_HEADER: Final = "# Written by rvaft rosmonitoring: change the tree and write it again.\n"
_FINAL_ONLY: Final = 2
"""ROSMonitoring's `warning` that reports `false` and leaves `currently_false` alone, which the RML oracle always begins with."""


def configuration(monitors: Sequence[Planned], options: Options) -> dict[str, Json]:
    """The configuration as a value. `nodes` are the publishers that monitors come between."""
    publishers = dict.fromkeys(
        name
        for monitor in monitors
        for topic, action in monitor.topics
        if action is Action.FILTER
        for name in topic.publishers
    )
    return {
        "ros_version": options.ros_version.value,
        "nodes": [{"node": {"name": name}} for name in publishers],
        "monitors": [{"monitor": _monitor(monitor, options)} for monitor in monitors],
    }


def yaml_text(value: Json) -> str:
    """A configuration as YAML; raises `ToolMissing` without the library."""
    text: str = _library().safe_dump(value, sort_keys=False, allow_unicode=True)
    return _HEADER + text


def stated_ids(text: str) -> list[str]:
    """The ids of the monitors in a configuration that was written here, edited or not; none of any other text."""
    library = _library()
    try:
        value = library.safe_load(text) if text.startswith(_HEADER) else {}
        ids = [entry["monitor"]["id"] for entry in value["monitors"]]
    except (library.YAMLError, LookupError, TypeError):
        return []
    return [id_ for id_ in ids if isinstance(id_, str)]


def _monitor(monitor: Planned, options: Options) -> dict[str, Json]:
    return {
        "id": monitor.id,
        "log": f"./logs/{monitor.id}.jsonl",
        "silent": False,
        "warning": _FINAL_ONLY if options.oracle is Oracle.RML else 1,
        "oracle": {"url": _in_url(options.host), "port": monitor.port, "action": "nothing"},
        "topics": [_topic(topic, action) for topic, action in monitor.topics],
    }


def _topic(topic: Subscription, action: Action) -> dict[str, Json]:
    """A topic; with publishers in it a monitor would come between even where it only logs."""
    stated: dict[str, Json] = {"name": topic.name, "type": topic.type, "action": action.value}
    return stated if action is Action.LOG else {**stated, "publishers": list(topic.publishers)}


def _in_url(host: str) -> str:
    """The host as it stands in a URL."""
    return f"[{host}]" if ":" in host else host


def _library() -> "ModuleType":
    """The library, imported now."""
    try:
        import yaml  # noqa: PLC0415 -- imported on use
    except ImportError:
        raise ToolMissing("PyYAML", remedy="pip install 'rvaft[ros]'") from None
    return yaml
