"""A reader of RML with the semantics of the published compiler and monitor."""
