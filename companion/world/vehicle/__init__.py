"""Model of the aircraft: its limits, its LQG-MP tables, and its track under the autopilot's guidance.

The modules compute numbers and tables for the kernels. They use neither received messages nor plans.
"""
