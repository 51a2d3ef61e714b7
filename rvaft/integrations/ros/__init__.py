"""ROSMonitoring: its oracle (`protocol`, `server`), and the `configuration` of monitors for a tree."""
