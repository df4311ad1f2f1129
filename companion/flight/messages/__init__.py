"""Messages of a flight: frames of the vehicle's link, decisions announced to the pilot, and observers.

The modules use the link and the recording; they decide nothing.
"""
