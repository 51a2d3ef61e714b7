"""The checker is checked: wrong trees, and small changes of the product's own functions."""
