"""The page of results in the repository, made from small stored rows and from reasons that people wrote.

It depends on rows and texts alone: made anew, it has the same bytes.
"""
