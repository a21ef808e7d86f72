"""A recorded run computed again."""
