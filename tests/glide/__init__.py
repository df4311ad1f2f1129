"""Engines that stop anywhere: where the aircraft comes down.

The flights use the simulator and the whole service; what is judged is the simulator's truth.
"""
