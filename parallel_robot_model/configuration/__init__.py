"""Parameters: fields, files, places, the loop and its hazards."""
