"""Sections of the mission file that stand by themselves, and the base of all sections.

They use the layers below only, and the file's model uses them.
"""
