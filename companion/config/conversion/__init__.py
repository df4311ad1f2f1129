"""Mission files from what people have, and back: ground stations' plans, KML, GeoJSON, GPX, tables of radars.

The formats know degrees and the kinds of places only; what is composed of them is a mission file like any
other, checked before it is written. Nothing here runs in a flight.
"""
