"""Pictures of runs: figures for a paper, and the interactive page."""
