"""A small HTTP server for this computer alone."""
