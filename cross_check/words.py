"""All words over some letters: the traces that leave nothing out, up to a length."""

from collections.abc import Iterable, Iterator
from itertools import product

from rvaft.values import Json


def words(events: Iterable[Json], longest: int) -> Iterator[tuple[Json, ...]]:
    """Every sequence of at most `longest` of these events, the empty one first, shorter before longer, one at a time.

    Within a length they come in the order of the letters, the last place varying fastest. There are
    k⁰ + k¹ + … + kⁿ of them for k letters and length n.
    """
    letters = tuple(events)
    for length in range(longest + 1):
        yield from product(letters, repeat=length)
