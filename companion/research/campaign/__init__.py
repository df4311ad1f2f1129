"""Plans and flights by the thousand, each a row with the measures of the paper's tables.

Made from mission files alone: no link, no clock but to time a plan, no files but those that are named.
Flights and pursuers are the simulator's, which offers them.
"""
