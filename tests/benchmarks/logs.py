"""Logs to time monitors on: the same bytes for the same arguments, written fast, and what a monitor
has to find in them.

`python -m tests.benchmarks.logs DIR` writes them in full size, each with the tree that it is watched for.

The lines look as ROSMonitoring writes them (`json.dumps` of a message with `topic` and `time` added): fields in no
particular order, a blank after commas and colons, coordinates with all their digits.
"""

import sys
from collections import Counter, defaultdict, deque
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import cycle, islice
from pathlib import Path
from random import Random
from typing import Final

TREE: Final = Path(__file__).parents[2] / "trees" / "remote_inspection" / "pruned.rvaft"
BOUND: Final = 250
"""The reading from which on radiation is high in the tree."""
WAYPOINTS: Final = range(100, 110)
"""The waypoints of the rounds that come to nothing; the last five events have others."""
ENDING: Final = Counter(move=2, inspect=1, radiation=1, goal=1)
"""The relevant events of the attack at the end of every log."""

MESSAGES: Final = {
    name: (frame, f"{text}\n")
    for line in Path(__file__).with_name("messages.txt").read_text(encoding="utf-8").splitlines()
    for name, frame, text in [line.split("|", 2)]
}
"""Of each message the frame and the text: `joints` has a `name` that is a list, `rosout` words of
the tree in strings.
"""

_IGNORING = f"""
ignore radiation(V, _) when V < {BOUND};
ignore move(W, _) when W >= {WAYPOINTS[0]};
ignore inspect(W) when W >= {WAYPOINTS[0]};
ignore result(W, _) when W >= {WAYPOINTS[0]};
ignore goal(W) when W >= {WAYPOINTS[0]};
"""


@dataclass(frozen=True, slots=True)
class Log:
    """A log, and what is known of it: how many events, and how many of each type.

    The pruned tree is detected at the last event under `scattered`, and not before; under
    `projected` it is lost with the second event of one of its types, at `lost`.
    """

    file: Path
    events: int
    types: Counter[str]
    lost: int


def ignoring_tree(folder: Path) -> Path:
    """A file with the pruned tree, and declarations that ignore all of an `inspections` log but its
    last five events.
    """
    file = folder / "ignoring.rvaft"
    file.write_text(f'import "{TREE}";\n{_IGNORING}', encoding="utf-8")
    return file


def telemetry(file: Path, events: int = 1_000_000, *, seed: int = 1) -> Log:
    """What a robot says all day, 100 to 400 bytes a line: one event in a thousand is of a type of the tree.

    As many are of a second sensor, which the tree does not know.
    """
    source = _Source(seed, step=0.005)
    shares = {"odom": 6, "scan": 3, "tf": 6, "battery": 1, "joints": 4, "imu": 4, "velocity": 4, "rosout": 1}
    names = [name for name, share in shares.items() for _ in range(share)]
    types: Counter[str] = Counter()
    lost = 0

    def lines() -> Iterator[str]:
        nonlocal lost
        rounds = cycle(source.visit(readings=4))
        relevant, other = -1, -1
        for number in range(events - 5):
            if number % 1000 == 0:
                relevant, other = number + source.random.randrange(500), number + 500 + source.random.randrange(500)
            if number == relevant:
                name = next(rounds)
                types[name] += 1
                lost = lost or (number + 1 if types.total() == 2 else 0)
                yield source.event(name)
            elif number == other:
                yield source.radiation(sensor=1)
            else:
                yield source.say(source.random.choice(names))
        yield from source.attack()

    _write(file, lines())
    return Log(file, events, types + ENDING, lost)


def inspections(file: Path, events: int = 300_000, *, readings: int = 76, seed: int = 2) -> Log:
    """Rounds of a robot that inspects waypoints, nothing but events of the tree's types, as the published log has them.

    The published log has 95 readings in 100 events, which `readings` per visit say; with 1 all five
    types are equally frequent, and the lines shorter.
    """
    source = _Source(seed, step=1.0)
    types: Counter[str] = Counter()

    def lines() -> Iterator[str]:
        for name in islice(cycle(source.visit(readings)), events - 5):
            types[name] += 1
            yield source.event(name)
        yield from source.attack()

    _write(file, lines())
    return Log(file, events, types + ENDING, lost=2)


def attacks(file: Path, events: int = 300_000) -> Path:
    """Write rounds of five events that come to nothing, and an attack after each."""
    source = _Source(7, step=1.0)

    def lines() -> Iterator[str]:
        for _ in range(events // 10):
            yield from map(source.event, ("move", "goal", "radiation", "result", "radiation"))
            yield from source.attack()

    _write(file, lines())
    return file


SSHD_TREE: Final = """event failed(ip) = { event: "failed", ip: ip };
event accepted(ip) = { event: "accepted", ip: ip };
time time as s late 0 s;
semantics scattered;
top   sand fails ok within 1 min;
fails times 5 on failed(IP);
ok    on accepted(IP);
"""
"""Five failures of one address, then a success, within a minute: the tree of the logs of `sshd`."""


def sshd(path: Path, lines: int = 1_000_000, addresses: int = 4_000, *, seed: int = 3) -> Counter[str]:
    """Write a day of logins, and return the number of detections of `SSHD_TREE` per address with `--key ip --repeat`.

    Four lines of ten are failures, one in twenty is a success. An attack starts every 6,400 lines.
    Times never go back.
    """
    random = Random(seed)
    names = [f"10.{n >> 16 & 255}.{n >> 8 & 255}.{n & 255}" for n in range(addresses)]
    kinds = ["failed"] * 8 + ["accepted"] + ["closed"] * 6 + ["session"] * 4 + ["invalid"]
    users = ["root", "admin", "alice", "bob", "carol", "git", "postgres", "ubuntu"]
    messages = {
        "failed": "Failed password for {user} from {ip} port {port} ssh2",
        "accepted": "Accepted password for {user} from {ip} port {port} ssh2",
        "closed": "Connection closed by authenticating user {user} {ip} port {port} [preauth]",
        "session": "pam_unix(sshd:session): session closed for user {user}",
        "invalid": "Invalid user {user} from {ip} port {port}",
    }
    planned: dict[int, tuple[str, str]] = {}
    failures: defaultdict[str, deque[int]] = defaultdict(lambda: deque(maxlen=5))
    detections: Counter[str] = Counter()
    now = 1_700_000_000_000

    def text(number: int) -> str:
        nonlocal now
        if number % 6_400 == 100:
            attacker = random.choice(names)
            places = sorted(random.sample(range(number + 1, number + 400), 6))
            planned.update((place, ("failed", attacker)) for place in places[:5])
            planned[places[5]] = ("accepted", attacker)
        now += random.randrange(172)
        drawn = random.choice(kinds), random.choice(names)
        kind, ip = planned.pop(number, drawn)
        recent = failures[ip]
        if kind == "failed":
            recent.append(now)
        elif kind == "accepted" and len(recent) == 5 and now - recent[0] <= 60_000:
            detections[ip] += 1
            recent.clear()
        user = random.choice(users)
        message = messages[kind].format(user=user, ip=ip, port=random.randrange(1024, 65536))
        return (
            f'{{"time": {now // 1000}.{now % 1000:03}, "event": "{kind}", "ip": "{ip}", '
            f'"user": "{user}", "message": "{message}"}}\n'
        )

    _write(path, map(text, range(lines)))
    return detections


def _write(file: Path, lines: Iterator[str]) -> None:
    with file.open("w", encoding="utf-8", newline="\n") as stream:
        while block := "".join(islice(lines, 1000)):
            stream.write(block)


class _Source:
    """Messages with values at random, one after the other in time; `step` is the mean time between two, in seconds."""

    def __init__(self, seed: int, step: float) -> None:
        self.random = Random(seed)
        self.step = step
        self.time = 490.0
        self.count = 0
        self.waypoint = WAYPOINTS[0]
        # Numbers are drawn as runs from a pool: to make each anew would take longer than all that is timed.
        self._pool = [repr(self.random.uniform(-8, 8) if n % 3 else self.random.gauss(0, 1e-5)) for n in range(16_384)]

    def say(self, name: str, **fields: int) -> str:
        """A message of that name, a line of the log; time goes on by a little, and never stands still."""
        self.time += self.step * (0.5 + self.random.random())
        self.count += 1
        secs = int(self.time)
        nsecs = int((self.time - secs) * 1e6) * 1000
        frame, text = MESSAGES[name]
        stamp = f'"stamp": {{"secs": {secs}, "nsecs": {nsecs}}}'
        start = int(self.random.random() * 16_000)
        return text % {
            **dict(zip("0123456", self._pool[start : start + 7], strict=True)),
            "header": f'"header": {{{stamp}, "frame_id": "{frame}", "seq": {self.count}}}',
            "now": f"{self.time:.6f}",
            "count": self.count,
            "waypoint": self.waypoint,
            **fields,
        }

    def visit(self, readings: int) -> tuple[str, ...]:
        """The event types of one visit to a waypoint, in order."""
        before = readings // 2
        return ("move", "goal", *["radiation"] * before, "result", "inspect", *["radiation"] * (readings - before))

    def event(self, name: str) -> str:
        """An event of a visit; each visit is to a waypoint at random."""
        if name == "radiation":
            return self.radiation()
        if name == "move":
            self.waypoint = self.random.choice(WAYPOINTS)
        return self.say(name)

    def radiation(self, sensor: int = 0) -> str:
        """A reading that is not high."""
        return self.say("radiation", value=self.random.randrange(BOUND), sensor=sensor)

    def attack(self) -> Iterator[str]:
        """The five events by which the tree is detected, at the last of them and not before: they
        follow each other at once.
        """
        self.step = min(self.step, 1.0)
        yield self.say("move", waypoint=1)
        yield self.say("inspect", waypoint=1)
        yield self.say("radiation", value=300, sensor=0)
        yield self.say("move", waypoint=2)
        yield self.say("goal", waypoint=3)


def main(folder: Path) -> None:
    """Write all logs and their tree into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    ignoring_tree(folder)
    for log in (
        telemetry(folder / "telemetry.jsonl"),
        inspections(folder / "inspections.jsonl"),
        inspections(folder / "inspections_even.jsonl", readings=1),
    ):
        sys.stdout.write(f"{log.file}: {log.events} events\n")
    (folder / "sshd.rvaft").write_text(SSHD_TREE, encoding="utf-8")
    logins = folder / "sshd.jsonl"
    sys.stdout.write(f"{logins}: {sshd(logins).total()} detections\n")


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: python -m tests.benchmarks.logs DIR")
    main(Path(sys.argv[1]))
