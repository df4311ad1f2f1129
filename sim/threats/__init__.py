"""Moving threats that are simulated: how one drives round obstacles after the aircraft, and is reported.

It knows the truth, which the program under test never sees but through the reports that are sent.
"""
