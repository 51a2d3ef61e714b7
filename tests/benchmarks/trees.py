"""The trees that benchmarks speak of."""

from rvaft import RVAFT, Gate, Node


def flat(gate: Gate, size: int, threshold: int | None = None) -> RVAFT:
    """One gate over leaves with default events: pairwise disjoint, so their letters are mutually exclusive."""
    leaves = [Node(f"e{number}") for number in range(size)]
    return RVAFT("top", [Node("top", gate, tuple(leaf.name for leaf in leaves), threshold), *leaves])


def chain(gates: int) -> RVAFT:
    """A chain of `or` gates, each with a leaf of its own and the next gate: one branch more than gates."""
    nodes = [Node(f"g{i}", Gate.OR, (f"a{i}", f"g{i + 1}")) for i in range(gates)]
    return RVAFT("g0", [*nodes, *(Node(f"a{i}") for i in range(gates)), Node(f"g{gates}")])


def text_of_size(nodes: int) -> str:
    """A tree of about that many nodes as text: gates in turn, three children each."""
    gates = ("or", "and", "sand", "2of3")
    inner = (nodes - 1) // 3
    lines = ["toplevel n0;"]
    for index in range(inner):
        children = " ".join(f"n{3 * index + offset}" for offset in (1, 2, 3))
        lines.append(f'n{index} {gates[index % 4]} {children} label "node {index}";')
    lines += [f"n{index};" for index in range(inner, 3 * inner + 1)]
    return "\n".join(lines)
