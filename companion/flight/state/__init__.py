"""The knowledge of one flight: its state, the world, the autopilot's list, and the table of modes.

Synchronous and without a clock. The modules use configuration, planning, assurance and missions, never the
link.
"""
