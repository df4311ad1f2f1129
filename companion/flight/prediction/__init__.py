"""What the autopilot flies when the service does not: in other flight modes, in a return, after a handback.

The modules predict tracks and check them; they neither wait nor send.
"""
