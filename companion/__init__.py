"""Online safe path planning for fixed-wing aircraft, on a companion computer."""

__version__ = "0.1.0"
