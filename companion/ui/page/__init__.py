"""The page: what the service knows and decides, or a recording says, drawn in a browser; read-only.

It gets the recorder's messages and serves the files of its own folder. It may use recordings, the mission
file's world and the pictures' fields. Nothing waits for it, and no decision depends on it.
"""
