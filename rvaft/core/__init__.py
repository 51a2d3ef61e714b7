"""The analyses of patterns, guards and times that the engine and the backends share."""
