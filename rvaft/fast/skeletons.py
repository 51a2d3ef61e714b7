"""Lines that differ in their numbers alone, as those of one publisher mostly do.

The *skeleton* of a line is what remains without the characters that numbers are written with. Two lines of the same skeleton have the same
strings, but for these characters, and the same brackets: such a character never stands behind the backslash of an escape, so what is
inside a string in one line is so in the other. Hence, where one line is an object in which no key is repeated, and the others are
JSON, they are objects in which no key is repeated. And where every line of a block holds an object, and the block holds as many
values as it has lines, every line holds one value.
"""

from collections.abc import Callable, Iterable
from typing import Final

from rvaft.fast.blocks import Block

_OF_NUMBERS: Final = b"0123456789.+-eE"
MEMORY: Final = 4096
"""How many skeletons are remembered; then the memory starts afresh."""
_FEW: Final = 16
"""One line in so many may have a skeleton that is new: such lines take long."""
_REST: Final = 64
"""After a block with more new ones, so many are not looked at."""


class Skeletons:
    """The skeletons of lines that are one object each, and repeat none of these quoted keys.

    `sound` says of a line whether it is one object and does not exceed the limits of a trace.
    """

    def __init__(self, keys: Iterable[bytes], sound: Callable[[bytes], bool]) -> None:
        self._keys = tuple(key.translate(None, _OF_NUMBERS) for key in keys)
        self._sound = sound
        self._known: set[bytes] = set()
        self._resting = 0

    def count(self, block: Block) -> int | None:
        """The number of lines of a block whose lines all have known skeletons, or None where some have not."""
        if self._resting:
            self._resting -= 1
            return None
        lines = block.text.translate(None, _OF_NUMBERS).split(b"\n")
        if not lines[-1]:
            lines.pop()
        new = set(lines) - self._known
        if len(new) * _FEW > len(lines) + _FEW:
            self._resting = _REST
            return None
        if new and not self._learn(lines, block, new):
            return None
        return len(lines)

    def _learn(self, lines: list[bytes], block: Block, new: set[bytes]) -> bool:
        if len(self._known) + len(new) > MEMORY:
            self._known.clear()
            new = set(lines)
        for skeleton in new:
            if b"\\u" in skeleton or any(skeleton.count(key) > 1 for key in self._keys):
                return False
            if not self._sound(block.lines[lines.index(skeleton)]):
                return False
            self._known.add(skeleton)
        return True
