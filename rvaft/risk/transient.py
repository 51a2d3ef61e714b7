"""Probabilities of a chain in time, by uniformization: sums of terms that are not negative.

So small probabilities have a small relative error, too (Jensen's method; Stewart, *Introduction to
the Numerical Solution of Markov Chains*, 1994, chapter 8).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from rvaft.errors import TooLarge, installed
from rvaft.risk.chain import DEFAULT_STATES, Machine, State
from rvaft.risk.model import PACKAGES

if TYPE_CHECKING:
    import numpy as np

_MOST_WORK: Final = 20_000_000_000
"""The numbers that may be multiplied, about a minute."""
_CALL: Final = 5_000
"""What one step costs beside its numbers."""


@dataclass(frozen=True, slots=True, eq=False)
class Chain:
    """The reachable states of a machine: `index` has their numbers, `top` that of the state in which the root has
    happened, or None. `moves` is a sparse matrix of rates per unit of time, without the diagonal.
    """

    machine: Machine
    index: dict[State, int]
    top: int | None
    moves: Any
    leaving: "np.ndarray[Any, Any]"

    def start(self, state: State) -> "np.ndarray[Any, Any]":
        """Return the probabilities of the states at time 0, if the machine is in `state`."""
        import numpy as np  # noqa: PLC0415 -- imported on use

        found = np.zeros(len(self.index))
        for resolved, weight in self.machine.resolved(state).items():
            found[self.index[resolved]] += weight
        return found


def chain(machine: Machine, *, states: int = DEFAULT_STATES, start: State | None = None) -> Chain:
    """Return the chain from the start of a machine; raises `TooLarge` beyond a number of states."""
    import numpy as np  # noqa: PLC0415 -- imported on use

    sparse = installed("scipy.sparse", "scipy", PACKAGES)
    index = {
        state: number for number, state in enumerate(machine.resolved(machine.start() if start is None else start))
    }
    waiting = list(index)
    rows: list[int] = []
    columns: list[int] = []
    rates: list[float] = []
    for state in waiting:
        for leaf, rate in machine.rates(state):
            after = machine.after(state, leaf.name)
            if after == state:
                continue
            if after not in index:
                if len(index) >= states:
                    raise TooLarge("states of a chain", limit=states)
                index[after] = len(index)
                waiting.append(after)
            rows.append(index[state])
            columns.append(index[after])
            rates.append(rate)
    moves = sparse.csr_matrix((rates, (rows, columns)), shape=(len(index), len(index)))
    top = next((number for state, number in index.items() if machine.decided(state)), None)
    return Chain(machine, index, top, moves, np.asarray(moves.sum(axis=1)).ravel())


def mean_time(chain: Chain) -> "np.ndarray[Any, Any]":
    """Return the mean time until the root happens, from each state; infinite where it may never happen."""
    import numpy as np  # noqa: PLC0415 -- imported on use

    sparse, linalg = (installed(name, "scipy", PACKAGES) for name in ("scipy.sparse", "scipy.sparse.linalg"))
    size = len(chain.index)
    certain = np.ones(size, dtype=bool)
    certain[chain.leaving == 0] = False
    if chain.top is not None:
        certain[chain.top] = True
    coming = chain.moves.tocoo()
    while True:  # a state is not certain if it can reach one that is not
        doubtful = coming.row[~certain[coming.col] & certain[coming.row]]
        if not len(doubtful):
            break
        certain[doubtful] = False
    found = np.full(size, math.inf)
    if chain.top is None:
        return found
    found[chain.top] = 0.0
    inner = np.flatnonzero(certain & (np.arange(size) != chain.top))
    if len(inner):
        matrix = (sparse.diags(chain.leaving) - chain.moves).tocsr()[inner][:, inner].tocsc()
        found[inner] = np.atleast_1d(linalg.spsolve(matrix, np.ones(len(inner))))
    return found


def within(chain: Chain, times: Sequence[float]) -> "np.ndarray[Any, Any]":
    """Return the probabilities that the root happens within each time, from each state: (times, states).

    Raises `TooLarge` if the rates are too high for the times.
    """
    import numpy as np  # noqa: PLC0415 -- imported on use

    target = np.zeros(len(chain.index))
    if chain.top is None:
        return np.zeros((len(times), len(chain.index)))
    target[chain.top] = 1.0
    found = reached(chain.moves, target, times, sum(leaf.times for leaf in chain.machine.leaves))
    found[:, chain.top] = 1.0  # and not one rounding less
    return found


def from_start(chain: Chain, state: State, times: Sequence[float]) -> "np.ndarray[Any, Any]":
    """Return the probability that the root happens within each time, from one state of the machine.

    Raises `TooLarge` if the rates are too high for the times.
    """
    import numpy as np  # noqa: PLC0415 -- imported on use

    if chain.top is None or not len(times):
        return np.zeros(len(times))
    now = chain.start(state)
    fastest = float(chain.leaving.max(initial=0.0))
    if not fastest:
        return np.full(len(times), now[chain.top])
    step = _step(chain.moves, fastest, max(times)).T.tocsr()
    depth = sum(leaf.times for leaf in chain.machine.leaves)
    weights = [_poisson(time * fastest, depth) for time in times]
    most = max(first + len(weight) for first, weight in weights)
    inside = np.empty(most)
    for count in range(most):
        inside[count] = now[chain.top]
        now = step @ now
    found = [float(weight @ inside[first : first + len(weight)]) for first, weight in weights]
    result: np.ndarray[Any, Any] = np.minimum(np.array(found), 1.0)
    return result


def reached(moves: Any, target: "np.ndarray[Any, Any]", times: Sequence[float], depth: int) -> "np.ndarray[Any, Any]":
    """Return the probabilities to be in a state of `target` at each time, from each state: (times, states).

    `target` is 1 for states without moves that are asked for, else 0. `moves` is a sparse matrix of
    rates, and `depth` bounds the number of moves by which the target is reached, if it is. Raises
    `TooLarge` if the rates are too high for the times.
    """
    import numpy as np  # noqa: PLC0415 -- imported on use

    found = np.zeros((len(times), len(target)))
    fastest = float(np.asarray(moves.sum(axis=1)).max(initial=0.0))
    if not fastest or not len(times):
        found += target
        return found
    step = _step(moves, fastest, max(times))
    weights = [_poisson(time * fastest, depth) for time in times]
    now = target
    for count in range(max(first + len(weight) for first, weight in weights)):
        for place, (first, weight) in enumerate(weights):
            if first <= count < first + len(weight):
                found[place] += weight[count - first] * now
        now = step @ now
    found[found > 1.0] = 1.0
    return found


def _step(moves: Any, fastest: float, longest: float) -> Any:
    """Return the matrix of one step at the fastest rate; raises `TooLarge` for too many steps."""
    import numpy as np  # noqa: PLC0415 -- imported on use

    sparse = installed("scipy.sparse", "scipy", PACKAGES)
    steps, size = longest * fastest, moves.shape[0]
    if (steps + 10 * math.sqrt(steps) + 50) * (moves.nnz + size + _CALL) > _MOST_WORK:
        raise TooLarge("steps of a chain, because its rates are high for this time", limit=_MOST_WORK)
    leaving = np.asarray(moves.sum(axis=1)).ravel()
    return (moves / fastest + sparse.identity(size, format="csr") - sparse.diags(leaving / fastest)).tocsr()


def _poisson(mean: float, depth: int) -> "tuple[int, np.ndarray[Any, Any]]":
    """Return the probabilities of numbers of events from a first number on, as far as they matter.

    The terms of the sums do not fall as the number grows but by these. So the numbers far below the
    mean do not matter, and the first term that counts is at most `depth`; 60 terms later the rest is
    below 1e-16 of it. Ratios to the largest are multiplied, which keeps the relative error of each
    small.
    """
    import numpy as np  # noqa: PLC0415 -- imported on use

    width = int(10 * math.sqrt(mean)) + 60
    mode = int(mean)
    first, last = max(0, mode - width), mode + width + depth
    up = np.cumprod(mean / np.arange(mode + 1, last + 1, dtype=float))
    down = np.cumprod(np.arange(mode, first, -1, dtype=float) / mean)[::-1] if mode > first else np.zeros(0)
    found = np.concatenate([down, [1.0], up])
    return first, found / found.sum()
