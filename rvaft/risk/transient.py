"""Probabilities of a chain in time, by uniformization: sums of terms that are not negative.

So small probabilities have a small relative error, too (Jensen's method; Stewart, *Introduction to
the Numerical Solution of Markov Chains*, 1994, chapter 8).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from rvaft.errors import TooLarge
from rvaft.risk.chain import DEFAULT_STATES, Machine, State

if TYPE_CHECKING:
    import numpy as np

_MOST_WORK: Final = 20_000_000_000
"""The numbers that may be multiplied, about a minute."""


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
    from scipy.sparse import csr_matrix  # noqa: PLC0415 -- imported on use

    index = {state: number for number, state in enumerate(machine.resolved(machine.start() if start is None else start))}
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
    moves = csr_matrix((rates, (rows, columns)), shape=(len(index), len(index)))
    top = next((number for state, number in index.items() if machine.decided(state)), None)
    return Chain(machine, index, top, moves, np.asarray(moves.sum(axis=1)).ravel())


def mean_time(chain: Chain) -> "np.ndarray[Any, Any]":
    """Return the mean time until the root happens, from each state; infinite where it may never happen."""
    import numpy as np  # noqa: PLC0415 -- imported on use
    from scipy.sparse import diags  # noqa: PLC0415 -- imported on use
    from scipy.sparse.linalg import spsolve  # noqa: PLC0415 -- imported on use

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
        matrix = (diags(chain.leaving) - chain.moves).tocsr()[inner][:, inner].tocsc()
        found[inner] = np.atleast_1d(spsolve(matrix, np.ones(len(inner))))
    return found


def within(chain: Chain, times: Sequence[float]) -> "np.ndarray[Any, Any]":
    """Return the probabilities that the root happens within each time, from each state: (times, states).

    Raises `TooLarge` if the rates are too high for the times.
    """
    import numpy as np  # noqa: PLC0415 -- imported on use
    from scipy.sparse import diags, identity  # noqa: PLC0415 -- imported on use

    found = np.zeros((len(times), len(chain.index)))
    if chain.top is None:
        return found
    fastest = float(chain.leaving.max(initial=0.0))
    now = np.zeros(len(chain.index))
    now[chain.top] = 1.0
    if not fastest:
        return found + now
    longest = max(times, default=0.0) * fastest
    if (longest + 10 * math.sqrt(longest) + 50) * (chain.moves.nnz + len(chain.index)) > _MOST_WORK:
        raise TooLarge("steps of a chain, because its rates are high for this time", limit=_MOST_WORK)
    step = chain.moves / fastest + identity(len(chain.index), format="csr") - diags(chain.leaving / fastest)
    step = step.tocsr()
    depth = sum(leaf.times for leaf in chain.machine.leaves)
    weights = [_poisson(time * fastest, depth) for time in times]
    for count in range(max(map(len, weights), default=0)):
        for place, weight in enumerate(weights):
            if count < len(weight):
                found[place] += weight[count] * now
        now = step @ now
    return np.minimum(found, 1.0)


def _poisson(mean: float, depth: int) -> "np.ndarray[Any, Any]":
    """Return the probabilities of 0, 1, 2, … events, as far as they matter.

    No term of the sum falls as the number grows but by these; the first that counts is at most
    `depth`, and 60 terms after it the rest is below 1e-16 of it. Ratios to the largest are multiplied,
    because that keeps the relative error of each small.
    """
    import numpy as np  # noqa: PLC0415 -- imported on use

    last = int(mean + 10 * math.sqrt(mean)) + depth + 60
    mode = int(mean)
    up = np.cumprod(mean / np.arange(mode + 1, last + 1, dtype=float))
    down = np.cumprod(np.arange(mode, 0, -1, dtype=float) / mean)[::-1] if mode else np.zeros(0)
    found = np.concatenate([down, [1.0], up])
    return found / found.sum()
