"""HTML pages about monitored logs."""
