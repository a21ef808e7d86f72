"""What a run was like: metrics, claims, timing, replay, report, video; the monitor."""
