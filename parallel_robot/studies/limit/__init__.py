"""What no controller can do better: the error that noise, delay and disturbance leave."""
