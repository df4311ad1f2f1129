"""The editor: a mission file on the map of the page, changed, checked, planned and flown in the simulator.

The file stays the truth: each change replaces a few characters of its text, and everything shown is read from
that text again. It may use the page, the planner's offline plans and the mission file's checks. Nothing here
runs in a flight of an aircraft.
"""

from companion.ui.editor.edit_command import register

__all__ = ["register"]
