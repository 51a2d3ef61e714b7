"""What every engine and backend works on: analyses of patterns, guards and times."""
