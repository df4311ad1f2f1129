"""Evaluation of a campaign's rows: intervals, differences, and whether the paper's orderings hold.

It reads stored rows and writes tables and a page. It plans nothing and changes no row.
"""
