"""Predictions of what the autopilot flies without the service: in other modes, in a return, after a handback.

The modules predict tracks and check them; they neither wait nor send.
"""
