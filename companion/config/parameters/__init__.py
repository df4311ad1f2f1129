"""The mission file's values that a pilot may change in the field: MAVLink parameters, and their metadata.

They use the mission file's models. Nothing here receives or sends.
"""
