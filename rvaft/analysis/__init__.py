"""What is asked of trees, patterns and guards before any event comes."""
