"""Kernels of threats: membership and non-membership, and from when on a pursuer could threaten a place.

Numbers and arrays in, numbers and status codes out.
"""
