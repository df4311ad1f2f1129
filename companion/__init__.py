"""Online safe path planning for fixed-wing aircraft, on a companion computer.

Here are the command line, and what every room stands on: time, frames, errors. Imports nothing of the
simulator.
"""

__version__ = "0.2.0"
