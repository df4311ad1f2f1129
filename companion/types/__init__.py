"""Data that packages pass to each other: frozen classes with units in their names, and numbers of MAVLink.

These modules import only ``frames`` and ``errors`` from the program. They compute nothing but properties, and
do no I/O.
"""
