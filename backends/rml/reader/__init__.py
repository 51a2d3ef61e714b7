"""RML as the published compiler and monitor read it: parser, event types, terms and transitions."""
