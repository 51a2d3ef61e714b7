"""A fold over any tree of values, without recursion."""

from collections.abc import Callable, Sequence
from typing import TypeVar

T = TypeVar("T")
R = TypeVar("R")


def fold(root: T, children: Callable[[T], Sequence[T]], step: Callable[[T, list[R]], R]) -> R:
    """The value of a tree from the values of its children."""
    order, todo = list[T](), [root]
    while todo:
        order.append(part := todo.pop())
        todo.extend(reversed(children(part)))
    done: list[R] = []
    for part in reversed(order):
        done.append(step(part, [done.pop() for _ in children(part)]))
    return done.pop()
