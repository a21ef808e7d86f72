"""Messages as arrays, and their types."""
