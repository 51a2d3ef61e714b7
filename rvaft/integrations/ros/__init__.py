"""ROSMonitoring: an oracle that answers its monitors (`protocol`, `server`), and its `configuration` for a tree."""
