"""A trace without end does not take memory without end, where the values that matter are bounded."""

import subprocess
import sys

import pytest

PROGRAM = """
import sys
from itertools import islice
import rvaft

TREE = '''
event go(w, t)   = { do: "go", where: w, time: t };
event stay(w, t) = { do: "stay", where: w, time: t };
event read(v, t) = { value: v, time: t };
top or round high;
round sand p q never;
p on go(W, T1);
q on stay(W, T2);
never when T2 + 10 <= T1;
high sand r s;
r on go(U, _);
s sand t h;
t on read(V, T3);
h when V >= 250 and T3 >= 0;
'''

def events():
    number = 0
    while True:
        where = f"w{number * 7 % 10}"
        yield {"do": "go", "where": where, "time": number}
        yield {"value": number % 250, "time": number}
        yield {"do": "stay", "where": where, "time": number + 1}
        yield {"other": number, "name": f"n{number % 1000}"}
        number += 1

def resident():
    with open("/proc/self/statm") as status:
        return int(status.read().split()[1]) * 4096 / 1e6

few, many = int(sys.argv[1]), int(sys.argv[2])
monitor = rvaft.monitor(rvaft.loads(TREE), semantics=sys.argv[3])
stream = events()
for event in islice(stream, few):
    monitor.step(event)
before = resident()
for event in islice(stream, many - few):
    verdict = monitor.step(event)
assert verdict is rvaft.Verdict.UNKNOWN
print(resident() - before)
"""


def growth(few: int, many: int, semantics: str) -> float:
    """Megabytes between two lengths of one trace."""
    command = [sys.executable, "-c", PROGRAM, str(few), str(many), semantics]
    return float(subprocess.run(command, capture_output=True, text=True, check=True).stdout)


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_memory_stays() -> None:
    assert growth(30_000, 200_000, "scattered") < 2


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_memory_stays_over_ten_million_events() -> None:
    assert growth(10**6, 10**7, "scattered") < 5
