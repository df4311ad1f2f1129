"""Monte Carlo runs and measures."""
