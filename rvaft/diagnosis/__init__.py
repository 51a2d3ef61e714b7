"""Why nothing was detected: near misses."""
