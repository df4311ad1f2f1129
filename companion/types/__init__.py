"""The data that folders hand to each other: frozen classes with units in their names, and MAVLink's numbers.

Imports nothing of the program but ``frames`` and ``errors``, computes no more than properties, and touches
nothing outside.
"""
