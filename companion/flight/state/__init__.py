"""What is known and decided of one flight: its state, the situation, plans and what is thought of them.

Synchronous and without a clock; touches configuration, planning, assurance and missions, never the link.
"""
