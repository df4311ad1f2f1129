"""What makes a campaign's runs: processes of this computer, or workers on many.

Knows what a run is and what came of it, and nothing of rows or progress.
"""
