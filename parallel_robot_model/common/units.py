"""Units of time: stamps are whole nanoseconds, all else is in seconds."""

NANOSECONDS = 1_000_000_000  # in one second
