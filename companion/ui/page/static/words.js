// Figures and decisions as a person says them.

import { KINDS } from "./kinds.js"; // from the service, which has them for the report, too

export function clock(seconds) {
  if (!Number.isFinite(seconds)) return "--:--";
  const whole = Math.floor(Math.abs(seconds));
  const text = `${String(Math.floor(whole / 60)).padStart(2, "0")}:${String(whole % 60).padStart(2, "0")}`;
  return seconds < 0 ? `−${text}` : text;
}

export function span(seconds) {
  if (seconds < 90) return `${Math.max(0, Math.round(seconds))} s`;
  return `${Math.floor(seconds / 60)} min ${String(Math.round(seconds % 60)).padStart(2, "0")} s`;
}

export function metres(value) {
  if (value >= 10000) return `${Math.round(value / 1000)} km`;
  return value >= 1000 ? `${(value / 1000).toFixed(1)} km` : `${Math.round(value / 10) * 10} m`;
}

const WINDS = ["north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west"];

export function bearing(from, to) {
  const angle = Math.atan2(to[0] - from[0], to[1] - from[1]);
  return WINDS[Math.round((angle / Math.PI) * 4 + 8) % 8];
}

export function side(from, to, course) {
  const angle = ((Math.atan2(to[0] - from[0], to[1] - from[1]) - course) * 180) / Math.PI;
  const turned = ((angle + 540) % 360) - 180;
  if (Math.abs(turned) <= 30) return "ahead";
  if (Math.abs(turned) >= 150) return "behind";
  return turned > 0 ? "to the right" : "to the left";
}

export function decisionWords(decision) {
  const [head, state] = KINDS[decision.kind] ?? [decision.kind, ""];
  const why = decision.why?.occasion;
  const parts = [];
  if (why) parts.push(`because: ${why}`);
  if (Number.isFinite(decision.plan_ms)) parts.push(`planned in ${Math.round(decision.plan_ms)} ms`);
  if (Number.isFinite(decision.track_to_mission_ms)) {
    parts.push(`${(decision.track_to_mission_ms / 1000).toFixed(1)} s from the sighting to the mission flown`);
  }
  return { head, state, text: decision.text ?? "", detail: parts.join("; ") };
}

export function trackName(track, world) {
  const threats = world?.dynamic_threats ?? [];
  const named = threats.find((threat) => threat.identity && threat.identity === track.identity);
  if (named) return named.name;
  return threats.length === 1 && !track.flies_on ? threats[0].name : track.identity;
}

export function memberName(member) {
  const goals = member.goals.length ? `, goal ${member.goals.join(", ")}` : "";
  return `system ${member.system}${member.is_lost ? ", lost" : goals}`;
}

export function trackKind(track) {
  if (track.flies_on) return "aircraft passing";
  if (track.speed_max_m_s < 1) return "parked";
  return track.is_airborne ? "flying pursuer" : "ground pursuer";
}
