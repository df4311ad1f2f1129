"""The page in a browser, and the pictures and reports of plans and flights.

It only receives: nothing waits for it, and no decision depends on it.
"""
