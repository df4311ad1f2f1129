"""The page: what the service knows and decides, or a recording says, drawn in a browser; read-only.

It is fed with the recorder's own messages and serves files that lie beside it. It may touch recordings, the
mission file's world and pictures' fields; nothing in it is waited for, and nothing decides on it.
"""
