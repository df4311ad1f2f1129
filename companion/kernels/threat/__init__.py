"""Kernels of threats: membership and non-membership, the pursuers' trees, and what they can reach in time.

Numbers and arrays in, numbers and status codes out; what is random is drawn outside and passed in.
"""
