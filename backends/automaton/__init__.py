"""Trees as finite automata in the HOA format, and a monitor for any HOA text."""

from backends.automaton.backend import AutomatonBackend

__all__ = ["AutomatonBackend"]
