"""What a configuration is asked to be."""

from dataclasses import dataclass
from enum import StrEnum

from rvaft.errors import RvaftError
from rvaft.serving.hosts import host as checked
from rvaft.serving.server import LOCAL, PORT
from rvaft.verdict import Semantics


class RosVersion(StrEnum):
    """Which ROS the monitors are generated for."""

    ROS1 = "ros1"
    ROS2 = "ros2"


class Action(StrEnum):
    """What a monitor does with messages: look at them, or stand between publishers and topic and keep some back."""

    LOG = "log"
    FILTER = "filter"


class Oracle(StrEnum):
    """Who answers the monitors: `rvaft serve`, or the RML oracle that comes with ROSMonitoring."""

    RVAFT = "rvaft"
    RML = "rml"


@dataclass(frozen=True, slots=True)
class Options:
    """`port` is that of the first oracle; without `action`, topics with publishers are filtered where that is possible.

    Raises `OptionError` for what is no host.
    """

    semantics: Semantics = Semantics.PROJECTED
    action: Action | None = None
    oracle: Oracle = Oracle.RVAFT
    host: str = LOCAL
    port: int = PORT
    ros_version: RosVersion = RosVersion.ROS2

    def __post_init__(self) -> None:
        checked(self.host)


class NoConfiguration(RvaftError, ValueError):
    """ROSMonitoring cannot monitor this tree as it stands; the message says what to write where."""
