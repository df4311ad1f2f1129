"""Encounters with aircraft that only pass: made from published models, and measured by published volumes.

The measures are those of RTCA DO-365 and ASTM F3442. They know paths alone, and nothing of what avoids.
"""
