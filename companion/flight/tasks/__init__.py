"""The tasks of one flight: they wait, receive and plan, and apply what they learn to the flight's state.

The package composes all others of the flight.
"""
