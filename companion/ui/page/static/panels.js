// The questions of the first screen, answered in words.

import { bearing, clock, decisionWords, metres, side, span, trackKind, trackName } from "./words.js";

const OLD_S = 6; // seconds after which what was heard last is old
const LOOKS_AHEAD_S = 120;
const TURN_BACK_SOON_S = 60; // from then on the time to turn back is marked

const MODES = {
  waiting: "waits for the autopilot",
  standby: "stands by: the autopilot flies no mission",
  departing: "watches the operator's mission up to the takeover",
  active: "flies the aircraft's mission",
  lost: "waits for the autopilot to come back",
  suspended: "stands back: the pilot flies",
  yielded: "stands back: somebody chose another mission or item",
  arrived: "is done: the last goal is reached",
};

export function modeWords(mode) {
  return MODES[mode] ?? mode ?? "is not known";
}

// Whether it is safe: a state, a word, and why.
export function verdict(store, isConnected, silence) {
  const { standing, world, ownship, level } = store;
  const limit = world?.threat_level_max;
  if (!isConnected) return ["unknown", "Not known", "The service does not answer; what is shown is old. Trying again."];
  if (world?.error) return ["unknown", "Not known", `The mission file cannot be read here: ${world.error}`];
  if (standing && !standing.is_warm) return ["unknown", "Getting ready", "The planner is being prepared; nothing is planned yet."];
  if (standing && !standing.is_heard) return ["danger", "No autopilot", "Nothing has been heard of the autopilot for 5 s; it flies on as it was told last."];
  if (!ownship) return ["unknown", "Not known yet", "The aircraft's position has not been heard."];
  if (silence > OLD_S) return ["unknown", "Not known", `Nothing new for ${span(silence)}.`];
  if (Number.isFinite(level) && limit !== undefined && level > limit) {
    return ["danger", "In danger", `Under threat now: level ${level.toFixed(2)}, more than the ${limit.toFixed(2)} that the mission allows.`];
  }
  if (standing?.is_in_trouble) return ["danger", "Flying blind", "The planner cannot do its work: what it needs is missing or too old."];
  if (standing?.emergency && standing.mode === "active") {
    const isKept = standing.emergency.startsWith("keep");
    return [isKept ? "watch" : "danger", isKept ? "Take care" : "Emergency", `No plan passes: ${standing.emergency}.`];
  }
  return verdictAhead(store, limit);
}

function verdictAhead(store, limit) {
  const { standing, level, safeUntil, now } = store;
  if (standing && standing.mode !== "active") {
    const back = standing.handback;
    if (standing.mode === "suspended" && back?.text) {
      const threat = Number.isFinite(level) && level > 0.01 ? ` Threat level ${level.toFixed(2)} now.` : "";
      return [back.is_safe && !threat ? "unknown" : "watch", "Pilot flies", `Handing back here and now is ${back.text}.${threat}`];
    }
    const words = { arrived: "Arrived", suspended: "Pilot flies" };
    return [standing.mode === "arrived" ? "safe" : "unknown", words[standing.mode] ?? "Not planning", `The service ${modeWords(standing.mode)}.`];
  }
  if (Number.isFinite(level) && level > 0.01) {
    return ["watch", "Take care", `Seen a little: threat level ${level.toFixed(2)}, the mission allows ${limit?.toFixed(2)}.`];
  }
  if (Number.isFinite(safeUntil) && store.tracks.some((track) => !track.flies_on)) {
    const left = safeUntil - now;
    const when = left > 0 ? `in ${span(left)}` : "now";
    return ["watch", "Take care", `A pursuer that knew the whole way could threaten it ${when}; the planner looks for a better one.`];
  }
  const ahead = store.threatAhead(0.01);
  if (ahead?.level > 0.01) {
    const isOver = limit !== undefined && ahead.level > limit;
    return [isOver ? "danger" : "watch", isOver ? "In danger" : "Take care", `The way ahead comes under threat in ${span(ahead.in_s)}: up to level ${ahead.level.toFixed(2)}, the mission allows ${limit?.toFixed(2)}.`];
  }
  if (!store.mission) return ["unknown", "Not planned yet", "The first plan is being made."];
  return ["safe", "Safe", "Nothing that is known can threaten the way ahead, whatever it does."];
}

// What happens next: sentences, each with a smaller one.
export function nextSteps(store) {
  const { standing, ownship, mission, now } = store;
  const steps = [];
  const goals = store.goals;
  const next = standing?.next_goal ?? 0;
  if (standing && ["suspended", "yielded", "standby", "departing"].includes(standing.mode)) {
    const back = standing.handback?.text;
    return [
      [`The service ${modeWords(standing.mode)}`, back ? `handed back here: ${back}` : ""],
      ...(goals.length > next ? [[`Still to be reached: ${goals.length - next} goal${goals.length - next > 1 ? "s" : ""}`, ownship ? `the next ${metres(Math.hypot(goals[next][0] - ownship.position_enu_m[0], goals[next][1] - ownship.position_enu_m[1]))} to the ${bearing(ownship.position_enu_m, goals[next])}` : ""]] : []),
    ];
  }
  if (ownship && goals.length && next < goals.length) {
    const goal = goals[next];
    const away = Math.hypot(goal[0] - ownship.position_enu_m[0], goal[1] - ownship.position_enu_m[1]);
    const name = goals.length > 1 ? `goal ${next + 1} of ${goals.length}` : "the goal";
    const rows = store.ahead(Infinity);
    const rest = rows.length ? rows[rows.length - 1] : null;
    const leads = rest && Math.hypot(rest.place[0] - goals.at(-1)[0], rest.place[1] - goals.at(-1)[1]) < goals.at(-1)[3] + 5;
    const when = leads ? ` in about ${span(rest.in_s)}` : "";
    const whole = leads && next < goals.length - 1 ? `all goals${when}` : "";
    steps.push([
      `Flies to ${name}, ${metres(away)} to the ${bearing(ownship.position_enu_m, goal)}${whole ? "" : when}`,
      whole || `at ${goal[2].toFixed(0)} m up`,
    ]);
  } else if (goals.length && next >= goals.length) {
    steps.push(["The last goal is reached", "what follows is the operator's mission"]);
  }
  const soon = store.ahead(30);
  if (soon.length > 1) {
    const end = soon.at(-1);
    const climb = end.place[2] - ownship.position_enu_m[2];
    const turn = turnWords(store.plan.path[soon[0].row][4], store.plan.path[end.row][4]);
    const level = Math.abs(climb) < 5 ? "level" : climb > 0 ? `climbs ${climb.toFixed(0)} m` : `descends ${(-climb).toFixed(0)} m`;
    const stray = end.covariance ? `, within ${(2 * Math.sqrt(Math.max(end.covariance[0], end.covariance[2]))).toFixed(0)} m of the planned place (2σ)` : "";
    steps.push([`Next ${span(Math.ceil(end.in_s / 5) * 5)}: ${turn}, ${level}`, `then ${metres(Math.hypot(end.place[0] - ownship.position_enu_m[0], end.place[1] - ownship.position_enu_m[1]))} ${bearing(ownship.position_enu_m, end.place)} of here, ${end.place[2].toFixed(0)} m up${stray}`]);
  }
  if (mission) {
    steps.push([`In the autopilot since ${span(now - mission.stamp_s)}: ${mission.waypoints_enu_m.length} waypoints`, standing ? `at item ${standing.item ?? "?"} of ${standing.num_items}` : ""]);
  }
  if (!steps.length) steps.push([standing ? `The service ${modeWords(standing.mode)}` : "Not known yet", ""]);
  return steps;
}

function turnWords(from, to) {
  const angle = ((((to - from) * 180) / Math.PI + 540) % 360) - 180;
  if (Math.abs(angle) < 8) return "straight on";
  return `turns ${Math.abs(angle).toFixed(0)}° to the ${angle > 0 ? "right" : "left"}`;
}

// What it is afraid of, the nearest first: [kind, sentence, smaller sentence].
export function fears(store) {
  const { ownship, world, safeUntil, now } = store;
  const found = [];
  const here = ownship?.position_enu_m;
  for (const track of store.tracks) {
    if (!here) continue;
    const away = Math.hypot(...track.position_enu_m.map((value, axis) => value - here[axis]));
    const where = `${metres(away)} ${side(here, track.position_enu_m, ownship.course_rad)}`;
    const left = away - track.max_threat_radius_m;
    const name = `${trackName(track, world)}, ${trackKind(track)}`;
    if (track.flies_on) {
      found.push([away, "other", `${name}: ${where}`, "hunts nobody; it is kept clear of"]);
      continue;
    }
    const after = left / Math.max(1, track.speed_max_m_s + ownship.ground_speed_m_s);
    const soonest = left <= 0 ? "within its reach now, if it sees the aircraft" : `a threat within ${metres(track.max_threat_radius_m)}; it could ${after < 1 ? "be so near any moment" : `not be so near for ${span(after)} at least`}`;
    const way = safeUntil === undefined || !store.isFlown ? "" : safeUntil === null ? " On the way that is flown it never can." : ` On the way that is flown: in ${span(safeUntil - now)} at the earliest.`;
    found.push([left, "hunter", `${name}: ${where}`, `${soonest}.${way}`]);
  }
  const inRange = [];
  for (const radar of world?.radars ?? []) {
    if (!here || !store.isKnown(radar)) continue;
    const left = Math.hypot(...radar.position_enu_m.map((value, axis) => value - here[axis])) - radar.max_threat_radius_m;
    if (left <= 0) inRange.push(radar.name);
    else if (left / Math.max(1, ownship.ground_speed_m_s) < LOOKS_AHEAD_S) {
      found.push([left, "radar", `${radar.name}, radar ${side(here, radar.position_enu_m, ownship.course_rad)}`, `its range begins ${metres(left)} away`]);
    }
  }
  if (inRange.length) {
    const isSeen = store.level > 0.01;
    const who = inRange.join(", ");
    found.push([isSeen ? -1 : 0, "radar", `In range of ${who}`, isSeen ? `seen: threat level ${store.level.toFixed(2)}` : `hidden from ${inRange.length > 1 ? "these radars" : "this radar"} now, by walls or by flying low`]);
  }
  const rank = { hunter: 0, radar: 1, other: 2 };
  found.sort((one, other) => rank[one[1]] - rank[other[1]] || one[0] - other[0]);
  const unknown = (world?.radars ?? []).filter((radar) => !store.isKnown(radar)).length;
  if (!found.length) found.push([0, "none", "Nothing near that is known", ""]);
  if (unknown) found.push([Infinity, "none", `${unknown} radar${unknown > 1 ? "s" : ""} of the mission file not sensed yet`, ""]);
  return found.slice(0, 6).map(([, kind, text, small]) => [kind, text, small]);
}

// What a return to launch does, and whether it keeps clear from here.
function returnWords({ returns }) {
  if (!returns?.text) return "";
  return `RTL here ${returns.text}${returns.is_safe ? "" : ": NOT safe from here"}. `;
}

// What is left on board, and what the way home and the reserve take of it: [state, word].
function energyChip({ left_wh, home_wh, margin_wh, turn_back_in_s }) {
  const left = `battery: ${Math.round(left_wh)} Wh left`;
  if (!Number.isFinite(margin_wh)) return ["unknown", `${left}, way home not known`];
  const state = margin_wh <= 0 ? "danger" : turn_back_in_s !== null && turn_back_in_s <= TURN_BACK_SOON_S ? "watch" : "safe";
  const turn = turn_back_in_s === null ? "" : turn_back_in_s <= 0 ? ", turn back now" : `, turn back in ${span(turn_back_in_s)}`;
  return [state, `${left}, way home ${Math.round(home_wh)} Wh${turn}`];
}

// What the pilot can do now.
export function pilotWords(store) {
  const { standing, world } = store;
  if (!standing) return ["Not known yet", ""];
  const resumes = world?.resume === "auto";
  const auto = store.link?.dialect === "px4" ? "MISSION" : "AUTO";
  switch (standing.mode) {
    case "active":
      return ["Take over at any time: choose another flight mode.", returnWords(standing) + (resumes ? `Choosing ${auto} again hands back.` : "The service then stays back for the rest of the flight.")];
    case "suspended": {
      if (!resumes) return ["You fly. The mission file does not let the service take over again.", ""];
      const back = standing.handback;
      if (!back?.text) return [`You fly. ${auto} hands back; whether that is safe here is not known.`, ""];
      return [back.is_safe ? `Hand back here: yes, ${back.text}. Choose ${auto}.` : `Hand back here: ${back.text}.`, back.way_enu_m?.length ? "The map shows, dotted, what would be flown." : ""];
    }
    case "yielded":
      return [`Leave ${auto} and return to it to hand back.`, "Until then the mission that was chosen is flown."];
    case "departing":
      return [`The operator's mission is flown; the service takes over by itself.`, "Another flight mode keeps it from that."];
    case "standby":
      return [`Choose ${auto} and arm: then the mission is flown.`, ""];
    case "arrived":
      return ["The operator's mission goes on from here.", "The service changes nothing any more."];
    default:
      return [`The service ${modeWords(standing.mode)}.`, ""];
  }
}

// Link, planner and health: [state, word].
export function healthChips(store, isConnected, isPlayed) {
  const { standing, link } = store;
  const chips = [];
  if (!isPlayed) chips.push(isConnected ? ["safe", "service answers"] : ["danger", "service silent"]);
  if (!standing) return chips;
  chips.push(standing.is_heard ? ["safe", `autopilot heard${standing.autopilot_mode ? `: ${standing.autopilot_mode}` : ""}`] : ["danger", "autopilot silent"]);
  const missing = link?.missing_streams ?? [];
  chips.push(missing.length ? ["watch", `${missing.length} stream${missing.length > 1 ? "s" : ""} missing`] : ["safe", "all streams come"]);
  const plans = [...store.plans.values()];
  const last = plans.at(-1);
  if (!standing.is_warm) chips.push(["unknown", "planner is prepared"]);
  else if (standing.is_in_trouble) chips.push(["danger", "planner in trouble"]);
  else if (last) {
    const gap = Number.isFinite(last.gap) ? `, within ${Math.ceil(100 * last.gap)} % of the best there can be` : "";
    chips.push([last.plan_ms > 4000 ? "watch" : "safe", `planner: ${Math.round(last.plan_ms)} ms, ${span(store.now - last.stamp_s)} ago${gap}`]);
  }
  else chips.push(["unknown", "no plan yet"]);
  chips.push([standing.is_armed ? "safe" : "unknown", standing.is_airborne ? "in the air" : standing.is_armed ? "armed" : "disarmed"]);
  chips.push(standing.is_recording ? ["safe", "recording"] : ["watch", "not recorded"]);
  if (Number.isFinite(store.energy?.left_wh)) chips.push(energyChip(store.energy));
  const sigma = store.ownship?.position_std_m?.[0];
  if (Number.isFinite(sigma)) chips.push([sigma > 10 ? "watch" : "safe", `position ±${sigma.toFixed(0)} m`]);
  return chips;
}

function setText(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

function setList(list, rows, make) {
  const key = JSON.stringify(rows);
  if (list.dataset.key === key) return;
  list.dataset.key = key;
  list.replaceChildren(...rows.map(make));
}

function item(text, small, data = {}) {
  const element = document.createElement("li");
  Object.assign(element.dataset, data);
  const body = document.createElement("div");
  body.textContent = text;
  if (small) {
    const more = document.createElement("small");
    more.textContent = small;
    body.append(more);
  }
  element.append(body);
  return element;
}

export class Panels {
  constructor(store, onSeek) {
    this.store = store;
    this.onSeek = onSeek;
    this.find = (id) => document.getElementById(id);
    this.seen = { version: -1, count: 0 };
    this.differing = new Set();
  }

  draw(isConnected, silence, isPlayed) {
    const store = this.store;
    const { world } = store;
    setText(this.find("mission"), world?.name ?? "Companion");
    document.title = world?.name ? `${world.name} – companion` : "Companion";
    const mode = store.standing ? `The service ${modeWords(store.standing.mode)}` : "";
    setText(this.find("about"), [world?.description, mode].filter(Boolean).join(" · "));
    setText(this.find("clock"), clock(store.now - (Number.isFinite(store.begin) ? store.begin : 0)));
    const [state, word, why] = verdict(store, isConnected, silence);
    this.find("verdict").dataset.state = state;
    setText(this.find("verdict-word"), word);
    setText(this.find("verdict-why"), why);
    setList(this.find("next"), nextSteps(store), ([text, small]) => item(text, small));
    setList(this.find("fears"), fears(store), ([kind, text, small]) => item(text, small, { kind }));
    const [can, more] = pilotWords(store);
    const pilot = this.find("pilot");
    if (pilot.dataset.key !== can + more) {
      pilot.dataset.key = can + more;
      pilot.textContent = can;
      if (more) {
        const small = document.createElement("small");
        small.textContent = more;
        pilot.append(small);
      }
    }
    setList(this.find("health"), healthChips(store, isConnected, isPlayed), ([kind, text]) => {
      const chip = document.createElement("li");
      chip.dataset.state = kind;
      chip.textContent = text;
      return chip;
    });
    this.find("ground").setAttribute("aria-label", this.mapWords(word));
    this.drawDecisions(isPlayed);
  }

  mapWords(word) {
    const { ownship, world } = this.store;
    if (!world) return "Map; nothing is known yet";
    const where = ownship ? `the aircraft ${ownship.position_enu_m.map((value) => value.toFixed(0)).join(", ")} metres east, north, up` : "no aircraft yet";
    return `Map of ${world.name}: ${word}; ${where}; ${this.store.tracks.length} moving threats. Arrows move it.`;
  }

  drawDecisions(isPlayed) {
    const store = this.store;
    const key = `${store.version.decisions}/${store.decisions.length}/${this.differing.size}`;
    if (key === this.seen.key) return;
    const isNews = this.seen.key !== undefined && store.decisions.length > this.seen.count && !isPlayed;
    this.seen = { key, count: store.decisions.length };
    const shown = store.decisions.slice(-150).reverse();
    const list = this.find("decisions");
    list.replaceChildren(
      ...shown.map((decision, index) => {
        const words = decisionWords(decision);
        const row = document.createElement("li");
        if (words.state) row.dataset.state = words.state;
        if (isPlayed && index === 0) row.className = "now";
        if (this.differing.has(decision.stamp_s)) row.classList.add("differs");
        const time = document.createElement(isPlayed ? "button" : "span");
        time.textContent = clock(decision.stamp_s - (Number.isFinite(store.begin) ? store.begin : 0));
        if (isPlayed) time.addEventListener("click", () => this.onSeek(decision.stamp_s));
        const body = document.createElement("div");
        const head = document.createElement("b");
        head.textContent = words.head;
        body.append(head, words.text ? `: ${words.text}` : "");
        if (words.detail) {
          const small = document.createElement("small");
          small.textContent = words.detail;
          body.append(small);
        }
        row.append(time, body);
        return row;
      }),
    );
    if (isNews) {
      const words = decisionWords(store.decisions.at(-1));
      this.find("said").textContent = `${words.head}: ${words.text}`;
    }
  }
}
