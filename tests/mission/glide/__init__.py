"""Which field is glided to, what is named before, and the mission there.

Tests of ``companion.mission.glide``, on small worlds worked out by hand.
"""
