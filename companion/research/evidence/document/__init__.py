"""The page of results that the repository keeps: from small stored rows, and reasons that people wrote.

Made of rows and texts alone; whoever makes it anew gets the same bytes.
"""
