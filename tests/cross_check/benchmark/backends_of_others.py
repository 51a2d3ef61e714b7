"""Backends that misbehave, put in the place of the real ones."""

import os
import signal
import time
from collections.abc import Callable
from typing import ClassVar

import pytest

from cross_check.benchmark import measurement
from rvaft import backend as registry
from rvaft.backend import Backend, Metrics, Specification
from rvaft.model.tree import RVAFT
from rvaft.model.verdict import Semantics
from rvaft.monitors import Monitor


def endless() -> None:
    while True:
        pass


def waiting() -> None:
    while True:
        time.sleep(1)


def greedy() -> None:
    bytearray(2**40)


def killed() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def broken() -> None:
    raise ZeroDivisionError("a defect\nof somebody")


class Odd(Backend):
    """Does something else where it should translate, or where it should read."""

    name: ClassVar[str] = "odd"
    language: ClassVar[str] = "odd"
    suffix: ClassVar[str] = ".odd"
    default_limit: ClassVar[int] = 1

    def __init__(
        self, *, translating: Callable[[], None] | None = None, reader: Callable[[str], Monitor] | None = None
    ) -> None:
        self.translating = translating
        self.reader = reader

    def translate(self, tree: RVAFT, semantics: Semantics, *, limit: int | None = None) -> Specification:  # noqa: ARG002
        if self.translating is not None:
            self.translating()
        return Specification("text", "odd", Metrics(symbols=7), self.read)

    def read(self, text: str, *, atoms: object = None) -> Monitor:  # noqa: ARG002
        assert self.reader is not None
        return self.reader(text)


def reading(does: Callable[[], None]) -> Odd:
    """Does that instead of reading."""

    def read(_text: str) -> Monitor:
        does()
        raise AssertionError("it returned")

    return Odd(reader=read)


def plant(monkeypatch: pytest.MonkeyPatch, odd: Odd) -> None:
    """Let `odd` be measured; processes are forked, so they have it too. Nothing warms it up."""
    real = registry.backend
    warm_up = measurement._warm_up
    monkeypatch.setattr(measurement, "backend", lambda name: odd if name == "odd" else real(name))
    monkeypatch.setattr(measurement, "_warm_up", lambda name, semantics: name == "odd" or warm_up(name, semantics))
