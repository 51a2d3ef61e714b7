"""The logs beside the trees for CloudTrail, journald and a ROS 2 mission; `python -m
tests.trees.logs` writes them anew.

Every log tells its tree's story with one thing changed, which its name says.
"""

import json
from collections.abc import Callable, Iterator, Mapping
from datetime import UTC, datetime, timedelta
from math import nan
from pathlib import Path
from typing import Any, Final

Log = list[dict[str, Any]]
TREES: Final = Path(__file__).parents[2] / "trees"
MORNING: Final = datetime(2026, 3, 2, 8, 0, tzinfo=UTC)


# CloudTrail: `number` failed logins, a login, more rights, a download.


def record(second: float, user: str, name: str, origin: str = "203.0.113.7", **more: Any) -> dict[str, Any]:
    """A record of CloudTrail, less the fields that nobody here asks for."""
    time = (MORNING + timedelta(seconds=second)).strftime("%Y-%m-%dT%H:%M:%SZ")
    rest = {"sourceIPAddress": origin, "requestParameters": None, "responseElements": None, **more}
    return {"eventTime": time, "eventName": name, "userIdentity": {"type": "IAMUser", "userName": user}, **rest}


def login(second: float, user: str, outcome: str, origin: str = "203.0.113.7") -> dict[str, Any]:
    """A login to the console."""
    return record(second, user, "ConsoleLogin", origin, responseElements={"ConsoleLogin": outcome})


def rights(second: float, user: str, *, denied: bool = False) -> dict[str, Any]:
    """An attempt to have more rights."""
    if denied:
        return record(second, user, "CreatePolicyVersion", errorCode="AccessDenied")
    given = {"policyVersion": {"versionId": "v2", "isDefaultVersion": True}}
    return record(second, user, "CreatePolicyVersion", responseElements=given)


def download(second: float, user: str, bucket: str = "payroll-2026", size: float = 48_318_382.0) -> dict[str, Any]:
    """An object read from a bucket."""
    read, sent = {"bucketName": bucket}, {"bytesTransferredOut": size}
    return record(second, user, "GetObject", requestParameters=read, additionalEventData=sent)


def takeover(number: int = 20, *, user: str = "alice") -> Log:
    """The story, with another user and other calls in between; from the first event used to the
    last it takes 9 min 30 s.
    """
    gap = 400 / number
    failures = [login(round(index * gap), user, "Failure") for index in range(number)]
    others = [login(round(index * 120 + 7), "bob", "Failure", "10.0.3.8") for index in range(3)]
    others += [record(181, "carol", "DescribeInstances"), login(390, "bob", "Success", "10.0.3.8")]
    last = [login(420, user, "Success"), record(425, user, "ListBuckets"), rights(440, user, denied=True)]
    last += [rights(480, user), download(500, user, "public-web"), download(570, user)]
    return sorted(failures + others, key=lambda event: event["eventTime"]) + last


def failed(log: Log, user: str = "alice") -> list[int]:
    """Where the failed logins of a user stand."""
    return [
        place
        for place, event in enumerate(log)
        if event["userIdentity"]["userName"] == user and event["responseElements"] == {"ConsoleLogin": "Failure"}
    ]


def changed(log: Log, place: int, **fields: Any) -> Log:
    """The log with other values in the fields of one event; None takes the field away."""
    event = {name: value for name, value in {**log[place], **fields}.items() if name not in fields or value is not None}
    return [*log[:place], event, *log[place + 1 :]]


def moved(log: Log, place: int, to: int) -> Log:
    """The log with one event that comes later than its time says."""
    rest = [*log[:place], *log[place + 1 :]]
    return [*rest[: to - 1], log[place], *rest[to - 1 :]]


def takeovers(number: int = 20) -> Iterator[tuple[str, Log]]:
    """The logs of CloudTrail by name, with so many failures for the twenty of the tree."""
    story = takeover(number)
    first, *_, last = failed(story)
    at_last = story[last]["eventTime"]
    yield "takeover", story
    yield "one_failure_short", [*story[:last], *story[last + 1 :]]
    yield "failure_of_another_user", changed(story, last, userIdentity={"type": "IAMUser", "userName": "bob"})
    yield "login_of_another_user", [*story[:-6], login(420, "bob", "Success"), *story[-5:]]
    yield "login_from_inside", changed(story, len(story) - 6, sourceIPAddress="10.0.3.9")
    yield "rights_denied", changed(story, len(story) - 3, **rights(480, "alice", denied=True))
    yield "ten_minutes_and_a_second", [*story[:-1], download(601, "alice")]
    yield "a_late_failure_in_time", moved(story, last, last + 2)
    later = next(place for place, event in enumerate(story) if event["eventTime"] > at(300))
    yield "a_failure_five_minutes_late", moved(story, first, later + 1)
    yield "a_time_without_zone", changed(story, last, eventTime=at_last.removesuffix("Z"))
    yield "a_time_that_nobody_reads", changed(story, last, eventTime="02/Mar/2026 08:06")
    yield "a_time_that_is_not_there", changed(story, last, eventTime=None)


def at(second: float) -> str:
    """The time that so many seconds have in a record."""
    time: str = record(second, "", "")["eventTime"]
    return time


# journald


HOST: Final = "web1"
WRONG: Final = "pam_unix(sshd:auth): authentication failure; logname= uid=0 euid=0 tty=ssh ruser= rhost={}  user={}"


def entry(second: float, identifier: str, message: Any, uid: int = 0, **more: str) -> dict[str, Any]:
    """An entry of the journal, less the fields that nobody here asks for."""
    time = str(round((MORNING.timestamp() + second) * 1_000_000))
    rest = {"_HOSTNAME": HOST, "_UID": str(uid), "SYSLOG_IDENTIFIER": identifier, "MESSAGE": message}
    return {"__REALTIME_TIMESTAMP": time, **rest, **more}


def wrong(second: float, user: str = "deploy", origin: str = "203.0.113.9") -> Log:
    """A wrong password, as PAM and as the SSH server tell it."""
    port = 40_000 + round(second)
    return [
        entry(second, "sshd", WRONG.format(origin, user)),
        entry(second + 1.9, "sshd", f"Failed password for {user} from {origin} port {port} ssh2"),
    ]


def sudo(second: float, uid: int = 1001, command: str = "/bin/bash") -> dict[str, Any]:
    """A command as root."""
    return entry(second, "sudo", f"  deploy : TTY=pts/0 ; PWD=/home/deploy ; USER=root ; COMMAND={command}", uid)


def logind(second: float, user: str = "deploy") -> dict[str, Any]:
    """A session begins."""
    known = "8d45620c1a4348dbb17410da57c60c66"
    return entry(second, "systemd-logind", f"New session 42 of user {user}.", USER_ID=user, MESSAGE_ID=known)


def root_shell(user: str = "deploy") -> Log:
    """The story, with wrong passwords of another user and a timer in between."""
    tries = [entry for index in range(5) for entry in (*wrong(20.5 * index), *wrong(20.5 * index + 4, "git"))]
    accepted = entry(110, "sshd", "Accepted password for deploy from 203.0.113.9 port 40110 ssh2")
    timer = entry(111.5, "CRON", "(root) CMD (run-parts /etc/cron.hourly)")
    return [*tries, accepted, logind(110.1, user), timer, sudo(140)]


def root_shells() -> Iterator[tuple[str, Log]]:
    """The logs of the journal by name."""
    story = root_shell()
    switch = entry(150, "su", "pam_unix(su:session): session opened for user root(uid=0) by deploy(uid=1001)", 1001)
    yield "sudo", story
    yield "su", [*story[:-1], switch]
    yield "four_wrong_passwords", story[4:]
    yield "five_from_two_addresses", [*wrong(0, origin="198.51.100.4"), *story[4:]]
    yield "session_of_another_user", root_shell("backup")
    yield "root_starts_a_shell", [*story[:-1], sudo(140, uid=0)]
    yield "another_machine", changed(story, len(story) - 1, _HOSTNAME="web2")
    yield "a_message_of_bytes", changed(story, len(story) - 1, MESSAGE=[*map(ord, "deploy : COMMAND=\x1b")])
    yield "eleven_minutes", [*story[:-1], sudo(660)]
    yield "a_time_that_is_a_number", changed(story, 0, __REALTIME_TIMESTAMP=1_772_438_400_000_000)


# The mission of the robot, in ROS 2


def message(second: float, topic: str, **fields: Any) -> dict[str, Any]:
    """A message with the stamp of its header."""
    sec, nanosec = divmod(round(second * 1_000_000_000), 1_000_000_000)
    return {"topic": topic, "header": {"stamp": {"sec": 1_772_438_400 + sec, "nanosec": nanosec}}, **fields}


def battery(second: float) -> dict[str, Any]:
    """The state of a battery that measures no temperature, current or charge: NaN by definition."""
    return message(second, "/battery_state", voltage=24.9, temperature=nan, current=nan, charge=nan, percentage=0.83)


def reading(second: float, value: float) -> dict[str, Any]:
    """A message of the radiation sensor."""
    return message(second, "/radiation_sensor_plugin/sensor_0", value=value)


def command(second: float, name: str, waypoint: int | str) -> dict[str, Any]:
    """A command to the robot."""
    return message(second, "/command", name=name, waypoint=waypoint)


def visit(start: float, waypoint: int, value: float = 42.5, stay: float = 6, *, to: int | str, goal: int | str) -> Log:
    """What happens at a waypoint: 30 s from the arrival to the next, or longer where the robot stays."""
    left = start + 3 + stay
    return [
        message(start, "/move_base/result", waypoint=waypoint, result="success"),
        command(start + 1.5, "inspect", waypoint),
        battery(start + 2),
        reading(start + 3, value),
        command(left, "move", to),
        message(left + 0.25, "/move_base/goal", goal=goal),
        reading(left + 5, 57.25),
    ]


HIGH: Final = 312.5
FAULTS: Final = (2, 6, 9)
ATTACKS: Final = (4, 6, 10)
"""Waypoints at which the robot stays too long where radiation is high; after which it goes
somewhere else than it was told.
"""
UNREAD: Final = 7
"""The waypoint at which the sensor measures NaN."""


def mission() -> Log:
    """Twelve waypoints; at 0 and 3 radiation is high, and all goes as it should."""
    log: Log = []
    for waypoint in range(12):
        value = HIGH if waypoint in {0, 3, *FAULTS, *ATTACKS} else nan if waypoint == UNREAD else 42.5
        to = "entrance" if waypoint == 11 else waypoint + 1
        goal = 99 if waypoint in ATTACKS else to
        stay = 12.5 if waypoint in FAULTS or waypoint == UNREAD else 6
        log += visit(40.0 * waypoint, waypoint, value, stay, to=to, goal=goal)
    return log


def missions() -> Iterator[tuple[str, Log]]:
    """The logs of the robot by name."""
    fault, attack = visit(0, 0, HIGH, 10, to=1, goal=1), visit(0, 0, HIGH, 9.999999999, to=1, goal=2)
    yield "mission", mission()
    yield "ten_seconds", fault
    yield "a_nanosecond_less", visit(0, 0, HIGH, 9.999999999, to=1, goal=1)
    yield "altered_waypoint", attack
    yield "to_decontamination", visit(0, 0, HIGH, 12.5, to="entrance", goal=3)
    yield "radiation_not_a_number", visit(0, 0, nan, 12.5, to=1, goal=2)
    yield "no_stamp", changed(fault, 3, header={"frame_id": "base_link"})
    yield "a_late_reading", moved(fault, 3, 5)


STORIES: Final[Mapping[str, Callable[[], Iterator[tuple[str, Log]]]]] = {
    "cloudtrail/takeover": takeovers,
    "journald/root_shell": root_shells,
    "remote_inspection/mission": missions,
}
"""The logs of a tree by name."""


if __name__ == "__main__":
    for tree, logs in STORIES.items():
        folder = TREES / f"{tree}.traces"
        folder.mkdir(exist_ok=True)
        for name, log in logs():
            text = "".join(f"{json.dumps(event, separators=(',', ':'))}\n" for event in log)
            (folder / f"{name}.jsonl").write_text(text, encoding="utf-8")
