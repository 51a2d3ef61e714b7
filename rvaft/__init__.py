"""Attack-fault trees with runtime events."""
