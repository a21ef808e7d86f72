"""Processes, priorities, code of users, and which code this is."""
