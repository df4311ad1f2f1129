"""A team in fast time: point masses that fly what they agree on, with the program's own agreement and bytes.

``scenes`` draws starts and goals, ``candidates`` plans, ``team_radio`` loses and delays what is sent,
``fast_time`` flies it all, and ``true_distances`` judges the flight by itself. ``python -m sim.team`` flies
many.
"""
