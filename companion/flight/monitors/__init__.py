"""What is kept up to date beside planning: fences, rally points, and the ages of all that is heard.

Decides nothing: it applies what it reads to the flight's state, and tells the pilot.
"""
