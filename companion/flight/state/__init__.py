"""What is known of one flight: its state, the world, the autopilot's list, and how it goes on in its modes.

Synchronous and without a clock. The modules use configuration, planning, assurance and missions, never the
link.
"""
