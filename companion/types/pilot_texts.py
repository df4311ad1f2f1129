"""Every text that the pilot reads, with its cause and what the pilot can do.

A text reports only what matters for the pilot's decisions: whether the flight is safe, what changes, where
the next turn is, when the aircraft arrives. Nothing is sent while nothing changes. A STATUSTEXT carries 50
characters. A longer text is sent in chunks (MAVLink ``common.xml``, STATUSTEXT).
"""

from __future__ import annotations

import re

from companion.types.mavlink_enums import Severity
from companion.types.pilot_text import NOTHING, OTHER_AIRCRAFT, PilotMessage, PilotText

TEXTS = {
    "mission": PilotText(
        "mission", Severity.INFO,
        "Mission read: {mission}",
        "The mission in the autopilot was read, on the ground or because it has changed.",
        "Compare it with the mission that you meant to upload.",
    ),
    "takeover": PilotText(
        "takeover", Severity.INFO,
        "Planner takes over {when}",
        "The mission was read. Up to there the autopilot flies the mission as uploaded.",
        NOTHING,
    ),
    "landing": PilotText(
        "mission", Severity.INFO,
        "After the goal {landing}",
        "The mission was read.",
        "Compare it with the landing that you meant to upload.",
    ),
    "return": PilotText(
        "return", Severity.INFO,
        "RTL here {returns}",
        "The mission was read: what a return to launch does, by the autopilot's parameters.",
        "Compare it with what you expect of a failsafe.",
    ),
    "no landing": PilotText(
        "mission", Severity.WARNING,
        "No landing in the mission: will circle at the goal",
        "The mission was read. Nothing follows the goal.",
        "Add a landing, or be ready to fly from the goal yourself.",
    ),
    "check": PilotText(
        "fault", Severity.WARNING,
        "CHECK: {fault}",
        "Something in the mission, the mission file or a parameter is wrong.",
        "Correct it before take-off. Where the aircraft cannot fly as the mission file asks, the planner "
        "does not take over.",
    ),
    "path ready": PilotText(
        "ready", Severity.INFO,
        "Path ready for takeover",
        "The first path was planned before the takeover.",
        NOTHING,
    ),
    "path": PilotText(
        "swap", Severity.NOTICE,
        "New path, safe. {turn}, {arrival}",
        "The autopilot flies another path, and the difference can be seen on a map. Safe: it keeps all "
        "limits of the mission file. The arrival is that at the last goal, or in a circle elsewhere.",
        NOTHING,
    ),
    "unsafe path": PilotText(
        "swap", Severity.WARNING,
        "New path, NOT safe. {turn}, {arrival}",
        "No path keeps all limits. This one keeps clear of obstacles and fences, but not of threats.",
        "Decide whether to go on. Another flight mode takes over at any time.",
    ),
    "unsafe": PilotText(
        "emergency", Severity.CRITICAL,
        "NOT safe ahead: {word}",
        "No path keeps clear of everything.",
        "Watch the aircraft and be ready to take over.",
    ),
    "take over": PilotText(
        "emergency", Severity.CRITICAL,
        "NOT safe ahead, no way out: TAKE OVER",
        "No path, circle, rally point or return keeps clear of everything. The autopilot flies its "
        "mission on.",
        "Take over and fly around the obstacle yourself.",
    ),
    "wind": PilotText(
        "emergency", Severity.CRITICAL,
        "Wind {word} m/s: too strong to plan",
        "The wind is stronger than 60 % of the cruise airspeed. The mission in the autopilot is flown on.",
        "Land, or fly home.",
    ),
    "refused": PilotText(
        "emergency", Severity.WARNING,
        "Autopilot takes no new path, old one is {word}",
        "Three uploads in a row failed.",
        "Check the link. Take over if the old path is not safe.",
    ),
    "unreadable": PilotText(
        "rejected", Severity.WARNING,
        "Cannot read the autopilot's mission",
        "The download of the mission failed.",
        "Check the link. The planner tries again every two seconds.",
    ),
    "no goal": PilotText(
        "no plan", Severity.WARNING,
        "No waypoint in the mission to fly to",
        "The mission has no goal.",
        "Upload a mission.",
    ),
    "other mission": PilotText(
        "mission", Severity.NOTICE,
        "Other mission uploaded: {mission}",
        "Another ground station has uploaded a mission in flight. The planner plans for its goals.",
        "Check that it is the mission you want.",
    ),
    "flying": PilotText(
        "mode", Severity.NOTICE, "Planner flies the mission",
        "The planner has taken over, or was handed back to.", NOTHING,
    ),
    "off": PilotText(
        "parameters", Severity.WARNING,
        "Planner is off: parameter {parameter} is 0",
        "The planner has taken over, and a parameter has switched planning off.",
        "Set the parameter to 1 to have the planner plan.",
    ),
    "paused": PilotText(
        "suspended", Severity.WARNING,
        "Planner paused in {mode}. {back}",
        "The flight mode is another one: by the pilot, by a failsafe or after a reboot.",
        "Select the mission mode to have the planner fly on.",
    ),
    "failsafe": PilotText(
        "suspended", Severity.WARNING,
        "Failsafe: autopilot flies {mode}. {back}",
        "The autopilot has changed its flight mode and reports a failsafe. The planner waits.",
        "Read the autopilot's own text. Select the mission mode only if the cause is gone.",
    ),
    "returning": PilotText(
        "suspended", Severity.WARNING,
        "Autopilot returns by the checked path",
        "A return to launch, begun by anybody, has joined the return path in the autopilot's list. The "
        "planner does not interfere.",
        "Watch the return. To end it, leave the mission mode, choose an item of the mission, and select the "
        "mission mode again.",
    ),
    "return set": PilotText(
        "return", Severity.NOTICE, "{name} set to {value}, was {before}",
        "The mission file has `authority.set_return`, and the planner has set the parameter with which a "
        "return to launch follows a checked path.",
        "Set it back after the flight if other flights need the old value.",
    ),
    "return not set": PilotText(
        "return", Severity.WARNING,
        "{name} could not be set: RTL may be straight",
        "The mission file has `authority.set_return`, and the autopilot does not report the new value.",
        "Set the parameter to 2 by the ground station.",
    ),
    "return renewed": PilotText(
        "return", Severity.NOTICE,
        "Planner plans the rest of the return",
        "A return to launch follows the checked path, and the mission file has `authority.renew_return`.",
        "Watch the return. To end it, leave the mission mode.",
    ),
    "return path": PilotText(
        "return", Severity.INFO,
        "RTL returns by a checked path of {length} km",
        "The first return path was stored in the autopilot, or there is one again. It is kept up to date "
        "without further texts.",
        NOTHING,
    ),
    "return straight": PilotText(
        "return", Severity.WARNING,
        "{mode} is straight, not by the checked path",
        "The autopilot returns straight, although its parameter RTL_AUTOLAND asks for the return path in its "
        "list. ArduPlane before 4.6.2 does not know the value 4.",
        "Take over if something is in the way. Set RTL_AUTOLAND 2 before the next flight.",
    ),
    "return unsafe": PilotText(
        "return", Severity.WARNING,
        "RTL from here is NOT safe: {what}",
        "The planner flies. A return to launch that begins here, by anybody, would lead too near to an "
        "obstacle or a fence, as the autopilot's parameters stand.",
        "Do not select RTL here, and expect the same of a failsafe. With RTL_AUTOLAND 2 or 4 on ArduPlane, "
        "or RTL_TYPE 2 and a landing in the mission on PX4, the planner keeps a checked path.",
    ),
    "return safe": PilotText(
        "return", Severity.NOTICE,
        "RTL from here is safe",
        "A return to launch would keep clear again.",
        NOTHING,
    ),
    "meets": PilotText(
        "ahead", Severity.CRITICAL,
        "{mode} meets {what} in {time} s: {advice}",
        "The planner does not fly. What the aircraft does next in this flight mode leads too near to an "
        "obstacle or a fence. The ways out keep clear for 20 s.",
        "Do what the text says, at once.",
    ),
    "meets nothing": PilotText(
        "ahead", Severity.NOTICE,
        "{mode} keeps clear again",
        "What the aircraft does next keeps clear for 20 s.",
        NOTHING,
    ),
    "no thrust": PilotText(
        "engine", Severity.CRITICAL,
        "NO THRUST: {ends}",
        "The throttle is open and the aircraft loses height or airspeed, or the engine reports no speed. The "
        "time is that to the height of home at the present sink.",
        "Fly to a place where the aircraft can land, or restart the engine.",
    ),
    "glide": PilotText(
        "engine", Severity.CRITICAL,
        "NO THRUST: glide to {field}, {away} km left, {spare} m spare",
        "Thrust is missing, and this field of the mission file, home or rally point is within glide; spare "
        "is the height left over it. With `authority.glide` the planner flies there.",
        "Without `authority.glide`, fly to the field. Otherwise watch, and take over to land.",
    ),
    "no field": PilotText(
        "engine", Severity.CRITICAL,
        "NO THRUST: no field in glide, {where}",
        "Thrust is missing, and no field is within glide. With `authority.glide` the planner flies to open "
        "ground away from obstacles and people.",
        "Choose a place to come down.",
    ),
    "final": PilotText(
        "engine", Severity.CRITICAL,
        "NO THRUST: final to {field}",
        "The glide straight to the field needs all of the height: the autopilot was sent to the landing.",
        "Take over to flare, if the autopilot does not.",
    ),
    "no field ahead": PilotText(
        "engine", Severity.WARNING,
        "No field in glide for {seconds} s from {time}",
        "A new path has stretches from which no field is within glide; the first begins in that time.",
        "Fly higher, or name more fields in the mission file.",
    ),
    "thrust": PilotText(
        "engine", Severity.NOTICE,
        "Thrust again",
        "The aircraft gains energy again.",
        NOTHING,
    ),
    "battery reach": PilotText(
        "energy", Severity.INFO,
        "Battery: goal and home reachable, {left} Wh at home",
        "The planner has taken over. That much would be left at home after the goal and the way home from "
        "there, and the reserve is part of it.",
        NOTHING,
    ),
    "battery short": PilotText(
        "energy", Severity.WARNING,
        "Battery: goal and home NOT both reachable",
        "The planner has taken over. After the goal and the way home from there less than the reserve would "
        "be left.",
        "Be ready to turn back. The time is told a minute before.",
    ),
    "battery ratio": PilotText(
        "energy", Severity.WARNING,
        "Battery falls {ratio} times as fast as planned",
        "Over the last minute at least 1.3 times as much energy was used as the mission file's section "
        "`energy` says.",
        "Look for the cause: a weak battery, wind, ice, drag. The planner counts with what it measures.",
    ),
    "battery turn": PilotText(
        "energy", Severity.WARNING,
        "Battery: turn back in {time} s",
        "If the aircraft flies on for longer, it does not come home with the reserve. Told a minute and half "
        "a minute before.",
        "Select RTL by then, unless `authority.turn_back` has the planner do it.",
    ),
    "battery return": PilotText(
        "energy", Severity.CRITICAL,
        "Battery: turning back now",
        "The planner has commanded return to launch, since what is left is needed for the way home "
        "(`authority.turn_back`).",
        "Watch the return. Any other flight mode ends it, and it is not commanded again in this flight.",
    ),
    "battery blocked": PilotText(
        "energy", Severity.CRITICAL,
        "Battery: turn back! RTL does not keep clear",
        "What is left is needed for the way home, but the autopilot's return meets an obstacle, or is not "
        "known. The planner flies on.",
        "Take over and fly home around the obstacle.",
    ),
    "off path": PilotText(
        "off path", Severity.WARNING,
        "Aircraft {what}",
        "The aircraft has not followed its path for 3 s. The planner plans from where it is.",
        "Look for the cause: engine, wind, icing, limits of the autopilot.",
    ),
    "other item": PilotText(
        "suspended", Severity.WARNING,
        "Planner paused: other mission chosen. {back}",
        "Somebody has uploaded another mission or made another item current.",
        "To resume, leave the mission mode and select it again.",
    ),
    "contradiction": PilotText(
        "suspended", Severity.WARNING,
        "Planner paused: two autopilots on one id",
        "Two systems send heartbeats under the autopilot's id, and they contradict each other.",
        "Find the second one and give it another id.",
    ),
    "silent": PilotText(
        "mode", Severity.WARNING,
        "Autopilot not heard, planner waits",
        "No heartbeat came for some seconds.",
        "Check the cable between the autopilot and the companion computer.",
    ),
    "arrived": PilotText(
        "arrived", Severity.NOTICE,
        "At the goal, planner is done",
        "The last goal was reached.",
        "Land as planned, or take over.",
    ),
    "return ended": PilotText(
        "arrived", Severity.NOTICE, "At the end of the return, planner is done",
        "A return whose rest the planner has planned has come to the landing, or over home.", NOTHING,
    ),
    "goals missed": PilotText(
        "arrived", Severity.WARNING,
        "At the last goal, {number} before it not reached",
        "The mission was flown past its last goal, but not through all goals before it.",
        "Fly a mission through these goals, or land.",
    ),
    "landed": PilotText(
        "landed", Severity.INFO,
        "Landed, flight over",
        "The autopilot was disarmed.",
        NOTHING,
    ),
    "handback safe": PilotText(
        "handback", Severity.NOTICE,
        "{mode} from here is safe for 10 s",
        "The planner does not fly. For the next 10 s of what is flown now, the mission mode may be selected "
        "at any moment: the way that the autopilot would take keeps clear for 45 s.",
        "Select the mission mode when you like. The text is taken back at once when it is no longer true.",
    ),
    "handback unsafe": PilotText(
        "handback", Severity.WARNING,
        "{mode} from here is NOT safe: {what}",
        "The planner does not fly. Now, or within the next 10 s of what is flown now, the way that the "
        "autopilot would take does not keep clear.",
        "Fly somewhere else before you select the mission mode.",
    ),
    "restarted": PilotText(
        "restart", Severity.INFO,
        "Planner restarted in flight, flies on",
        "The service was started again while the autopilot flew a mission of the planner's.",
        NOTHING,
    ),
    "missing": PilotText(
        "stale", Severity.WARNING,
        "No {what}: planner waits, mission flies on",
        "The position or the mission item is missing or cannot be right.",
        "Watch the aircraft. The path is not adapted to anything new.",
    ),
    "old": PilotText(
        "stale", Severity.INFO,
        "No {what} for {age} s",
        "Something that the planner can do without for a while is missing.",
        "Check its source.",
    ),
    "back": PilotText(
        "fresh", Severity.NOTICE,
        "{what} is back",
        "What was missing is received again.",
        NOTHING,
    ),
    "fences": PilotText(
        "fence", Severity.INFO,
        "Fences: {fences}",
        "The fences in the autopilot were read, or have changed.",
        "Compare them with the fences that you meant to upload.",
    ),
    "bad fence": PilotText(
        "fence", Severity.WARNING,
        "Fence not understood: {reason}",
        "A fence in the autopilot cannot be used.",
        "Correct the fence. The planner does not keep to it.",
    ),
    "rally points": PilotText(
        "rally", Severity.INFO,
        "Rally points: {points}",
        "The rally points in the autopilot were read, or have changed.",
        NOTHING,
    ),
    "another autopilot": PilotText(
        "link", Severity.WARNING,
        "Autopilot {other} on the link; planner flies {own}",
        "A second autopilot is heard.",
        "Check that the planner flies the right one.",
    ),
    "second address": PilotText(
        "link", Severity.WARNING,
        "Autopilot's id from a second address",
        "Another sender uses the autopilot's id.",
        "Find it and give it another id.",
    ),
    "parameter source": PilotText(
        "link", Severity.WARNING,
        "Unknown sender tried to set a parameter",
        "A system that the mission file does not list has tried to set a parameter of the planner's.",
        "Add it to the mission file if it may do so.",
    ),
    "flood": PilotText(
        "link", Severity.WARNING,
        "Link flooded, planner misses messages",
        "More messages come than the planner takes from one sender.",
        "Find the sender and slow it down.",
    ),
    "calm": PilotText(
        "link", Severity.NOTICE,
        "Link no longer flooded",
        "The flood has ended.",
        NOTHING,
    ),
    "reloaded": PilotText(
        "reload", Severity.NOTICE,
        "Mission file read again",
        "The service was told to read the mission file again.",
        NOTHING,
    ),
    "not reloaded": PilotText(
        "reload", Severity.WARNING,
        "Mission file refused: {key}",
        "The mission file was read again, and a key of it is wrong. The old one is still used.",
        "Correct the key. `companion check` says what is wrong.",
    ),
    "parameter": PilotText(
        "parameters", Severity.NOTICE,
        "Parameter {parameter}",
        "A parameter of the planner's was set, or is still set.",
        NOTHING,
    ),
    "parameter refused": PilotText(
        "parameters", Severity.WARNING,
        "{parameter} stays {value}: {reason}",
        "A value that was sent for a parameter of the planner's is not allowed.",
        "Send one that is allowed.",
    ),
    "other ground": PilotText(
        "ground", Severity.WARNING,
        "GROUND differs: {source} {theirs} m, map {ours} m",
        "Above mean sea level. The autopilot's stored heights, its range finder or its estimator differed "
        "for 3 s from the map by more than `terrain.home_tolerance_m`. Each is told once in a flight.",
        "Fly higher: one of the two is wrong, and paths keep their height over the map's ground.",
    ),
    "no ground": PilotText(
        "ground", Severity.WARNING,
        "GROUND unknown to the autopilot, waypoints need it",
        "For 10 s the autopilot has had no heights here, which `terrain.item_frame: terrain` needs.",
        "Take over, or watch the height: it flies on by the last one that it had.",
    ),
    **OTHER_AIRCRAFT,
    "recording": PilotText(
        "recording", Severity.INFO, "Recording stopped, flight goes on",
        "The disk is full or cannot be written to.", NOTHING,
    ),
    "stopped": PilotText(
        "stopped", Severity.WARNING, "Planner stopped, autopilot flies its mission",
        "The service was stopped.", NOTHING,
    ),
}  # fmt: skip
SUBJECTS = {
    "unsafe path": "path", "unsafe": "path", "take over": "path", "wind": "path",
    "paused": "mode", "flying": "mode", "other item": "mode", "contradiction": "mode", "silent": "mode",
    "failsafe": "mode", "returning": "mode", "arrived": "mode", "goals missed": "mode",
    "return path": "return", "return straight": "return", "return unsafe": "return", "return safe": "return",
    "meets": "ahead", "meets nothing": "ahead",
    "no thrust": "engine", "thrust": "engine", "glide": "glide", "no field": "glide", "final": "glide",
    "battery turn": "battery", "battery return": "battery", "battery blocked": "battery",
    "handback safe": "handback", "handback unsafe": "handback",
    "flood": "flood", "calm": "flood", "fences": "fences", "bad fence": "fences",
}  # fmt: skip


def pilot_message(key: str, subject: str = "", /, **values: object) -> PilotMessage:
    """Return a text of :data:`TEXTS` with its values.

    Parameters
    ----------
    key : str
        Key of the text.
    subject : str
        Subject, for a text that is used for several subjects; by default that of the table.
    **values : object
        Values for the names in braces.
    """
    row = TEXTS[key]
    return PilotMessage(row.severity, row.template.format(**values), subject or SUBJECTS.get(key, key))


_PATTERNS = {
    re.compile(re.sub(r"\\{\w+\\}", ".+", re.escape(row.template))): row.kind for row in TEXTS.values()
}


def kind_of(text: str) -> str | None:
    """Return the kind of decision that a text reports; None if the text is not in :data:`TEXTS`."""
    return next((kind for pattern, kind in _PATTERNS.items() if pattern.fullmatch(text)), None)
