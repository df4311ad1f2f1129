"""Pictures and reports of missions, plans and flights.

It draws what it is given and writes the files that are named. It is the only folder that uses matplotlib,
which the extra ``plot`` installs.
"""
