"""Offline plans, one or many, with the measures of the paper's tables beside the paper's own figures.

Plans from mission files alone: no link, no clock but to time a plan, no files but those that are named.
"""
