"""What a campaign's rows say: intervals, differences, and whether the paper's orderings hold.

Reads stored rows and writes tables and a page; plans nothing and changes no row.
"""
