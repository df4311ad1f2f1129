"""Pictures and reports of missions, plans and flights.

Only listens: it draws what it is given and writes the files that are named. The only folder that knows
matplotlib, which the extra ``plot`` brings.
"""
