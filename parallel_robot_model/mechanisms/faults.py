"""What a kernel returns: that it has found something, or why not."""

FOUND = 0  # no fault
NOT_CLOSED = 1  # no posture fits: out of reach
SINGULAR = 2  # the closures, or those and the tool, lose their rank on the way
NOT_FINITE = 3  # a position is not a number
