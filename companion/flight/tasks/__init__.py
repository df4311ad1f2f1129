"""The tasks of one flight: they wait, listen and plan, and apply what they find to the flight's state.

Composes everything below; what it does by the clock is decided in :mod:`companion.flight.state`.
"""
