"""The elements of a core as a configuration has them: its events, and its parts as wholes."""

from collections.abc import Mapping
from functools import cached_property
from typing import TypeAlias

from rvaft.engine.configuration import Configuration
from rvaft.engine.plan import Plan
from rvaft.engine.progress import DONE, TOUCHED, Progress

Resolution: TypeAlias = Mapping[int, tuple[int, ...]]
"""The nodes of the core that a scenario reaches, parents first, each with the children it keeps."""


class Elements:
    """Which elements are there, taken, finished."""

    def __init__(self, plan: Plan, progress: Progress) -> None:
        self.plan = plan
        self.progress = progress

    @cached_property
    def members(self) -> frozenset[int]:
        """The nodes of the core."""
        return frozenset(self.plan.core)

    @cached_property
    def mask(self) -> int:
        """The same as a set of bits."""
        return sum(1 << node for node in self.plan.core)

    def touched(self, configuration: Configuration) -> int:
        """The elements of which something is taken."""
        touched = configuration.taken & self.mask
        for part in self.plan.parts:
            if self.progress.flags(configuration, part) & TOUCHED:
                touched |= 1 << part
        return touched

    def present(self, configuration: Configuration, kept: Resolution) -> tuple[int, int]:
        """The elements of a resolution that have events, and those of them that are finished; parts as finished as can be.

        The resolution may be in the making: what it has reached but not resolved is looked at too.
        """
        present = 1 << self.plan.root if self.plan.own[self.plan.root] else 0
        finished = present & configuration.taken
        for children in kept.values():
            for child in children:
                if child in self.members:
                    own = 1 << child if self.plan.own[child] else 0
                    present |= own
                    finished |= own & configuration.taken
                else:
                    flags = self.progress.flags(configuration, child)
                    if not flags & DONE or flags & TOUCHED:
                        present |= 1 << child
                    if flags & DONE and flags & TOUCHED:
                        finished |= 1 << child
        return present, finished

    def has(self, configuration: Configuration, child: int, flag: int) -> bool:
        """Whether a child of a core node is a part with a flag."""
        return child not in self.members and bool(self.progress.flags(configuration, child) & flag)
