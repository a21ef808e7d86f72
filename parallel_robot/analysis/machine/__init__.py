"""A described machine for people: what was read of its file, its state, its picture."""
