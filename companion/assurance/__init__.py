"""Independent check of every plan and mission, and the order of the steps where none passes.

And what a flight met, read off its paths when it is over. Plain NumPy and shapely; touches no code of the
planner's, whose mistakes it would share.
"""
