"""State and decisions of one flight: the flight's state, the known world, plans and their judgement.

Synchronous and without a clock. The modules use configuration, planning, assurance and missions, never the
link.
"""
