"""Do these specifications say the same thing? Differential runs over traces."""
