"""Readers and writers of foreign files, one module a format, by ``found_places`` of the package above.

What a file holds and a mission file does not is remarked, never dropped in silence. All files are read as
those of strangers: their size, depth and numbers are limited.
"""
