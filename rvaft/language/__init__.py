"""The language of trees: a superset of Galileo's but for a few gates, read and written."""
