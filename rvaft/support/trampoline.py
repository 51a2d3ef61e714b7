"""Recursion without a stack limit: functions written as generators that yield the calls they need.

`result = yield other(…)` calls, `return value` answers. A tree may be thousands of gates deep; Python's own recursion may not.
"""

from collections.abc import Generator
from typing import Any, TypeAlias, TypeVar

T = TypeVar("T")
Call: TypeAlias = Generator[Any, Any, T]


def run(call: Call[T]) -> T:
    """The value of a call."""
    stack: list[Call[Any]] = [call]
    value: Any = None
    while stack:
        try:
            called = stack[-1].send(value)
        except StopIteration as stop:
            stack.pop()
            value = stop.value
        else:
            stack.append(called)
            value = None
    result: T = value
    return result
