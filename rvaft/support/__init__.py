"""What every part of the toolkit stands on, and what knows nothing of trees."""
