"""From the ground to the takeover: summary of the operator's list, prediction of the start, time of takeover.

The modules decide nothing about a flight under way; they neither wait nor send.
"""
