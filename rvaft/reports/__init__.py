"""Pages about what monitors found in logs."""
