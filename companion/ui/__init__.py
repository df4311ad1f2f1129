"""What people look at: the page in a browser, and the pictures and reports of plans and flights.

Only listens: nothing in it is waited for, and nothing decides on it.
"""
