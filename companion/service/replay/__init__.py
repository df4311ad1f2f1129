"""A recorded flight through the same code again: the same missions, or the first difference in words.

Reads recordings and runs the flight on their time, with stand-ins for link and plan timing; it writes
nothing and reaches no autopilot.
"""
