// Elements of a mission: what each tool draws, how one looks while it is dragged, and all of them as the page's world.

export const TOOLS = [
  { name: "goal", words: "Goal", hint: "Click where the goal is.", kind: "goals" },
  { name: "obstacle", words: "Obstacle", hint: "Click corner after corner; the first again, Enter or a double click closes it.", kind: "obstacles", isArea: true },
  { name: "noFly", words: "No-fly area", hint: "Click corners of an area that is closed at all heights; Enter closes it.", kind: "obstacles", isArea: true },
  { name: "fence", words: "Fence", hint: "Click corners of the area to stay in; Enter closes it. Walls are made where it ends within the bounds.", isArea: true },
  { name: "radar", words: "Radar", hint: "Click where the radar stands.", kind: "radars" },
  { name: "vehicle", words: "Vehicle", hint: "Click where the vehicle starts.", kind: "dynamic_threats" },
  { name: "route", words: "Route", hint: "Select a vehicle; click the points that it drives to, and Enter at the end.", isLine: true },
  { name: "people", words: "People", hint: "Click corners of an area in which it must not come down; Enter closes it. Needs a section glide.", kind: "glide.people", isArea: true },
  { name: "field", words: "Field", hint: "Click where it may come down without thrust. Needs a section glide.", kind: "glide.fields" },
];
const ALL_HEIGHTS_M = 300; // A no-fly area ends so far beyond the bounds.

// Whether keys are letters of what is being written.
export function isTyping(event) {
  return ["INPUT", "SELECT", "TEXTAREA"].includes(event.target.tagName) && event.target.type !== "range" && event.target.type !== "checkbox";
}

// The changes that add what was drawn, and its path.
export function newElement(tool, drawing, editor) {
  if (tool.name === "fence") return { changes: [{ do: "fence", path: ["obstacles"], value: drawing }] };
  if (tool.name === "route") return newRoute(drawing, editor.selected);
  const where = tool.kind.split(".");
  const path = [...where, editor.elements.filter((one) => one.kind === tool.kind).length];
  return { changes: [{ do: "add", path, value: valuesOf(tool, drawing, editor) }], path };
}

function newRoute(drawing, one) {
  if (one?.kind !== "dynamic_threats") return null;
  const from = one.route_enu_m?.length ?? 0;
  const changes = drawing.map((place, k) => ({ do: "add", path: [...one.path, "route_enu_m", from + k], value: place }));
  return { changes: [...changes, { do: "set", path: [...one.path, "behaviour"], value: "drive" }], path: one.path };
}

function valuesOf(tool, drawing, { elements, state }) {
  const [east_m, north_m] = drawing[0];
  const [, , , , low, high] = state.bounds_m ?? [0, 0, 0, 0, 0, 200];
  const up = elements.find((one) => one.kind === "start")?.values.up_m ?? (low + high) / 2;
  const name = freeName(tool.name === "noFly" ? "no-fly area" : tool.name, elements);
  switch (tool.name) {
    case "goal":
      return { east_m, north_m, up_m: up, acceptance_radius_m: 60 };
    case "obstacle":
      return { name, polygon_enu_m: drawing, base_m: Math.min(0, low), top_m: Math.round(high) };
    case "noFly":
      return { name, polygon_enu_m: drawing, base_m: Math.max(low - ALL_HEIGHTS_M, -1000), top_m: Math.min(high + ALL_HEIGHTS_M, 20000) };
    case "radar":
      return { name, east_m, north_m, up_m: 0, max_threat_radius_m: 500 };
    case "vehicle":
      return { name, east_m, north_m, speed_m_s: 10, max_threat_radius_m: 250 };
    case "people":
      return { name, polygon_enu_m: drawing };
    default:
      return state.sections.terrain ? { name, east_m, north_m, radius_m: 60 } : { name, east_m, north_m, up_m: 0, radius_m: 60 };
  }
}

function freeName(word, elements) {
  const names = new Set(elements.map((one) => one.name));
  for (let number = 1; ; number++) if (!names.has(`${word} ${number}`)) return `${word} ${number}`;
}

// An element as it would be where it is dragged to.
export function moved(drag) {
  const one = drag.element;
  const [east, north] = drag.by;
  const shift = (place) => [place[0] + east, place[1] + north, ...place.slice(2)];
  switch (drag.part) {
    case "body":
      return { ...one, ...(one.place_m && { place_m: shift(one.place_m) }), ...(one.polygon_enu_m && { polygon_enu_m: one.polygon_enu_m.map(shift) }) };
    case "side": {
      const box = [...one.box_m];
      for (const side of drag.side) box[side] = Number((box[side] + (side < 2 ? east : north)).toFixed(1));
      return { ...one, box_m: box };
    }
    case "radius": {
      const far = Math.hypot(drag.origin[0] + east - one.place_m[0], drag.origin[1] + north - one.place_m[1]);
      return { ...one, values: { ...one.values, [drag.key]: Math.max(1, Math.round(far)) } };
    }
    case "course": {
      const angle = Math.atan2(drag.at[0] - one.place_m[0], drag.at[1] - one.place_m[1]);
      return { ...one, values: { ...one.values, course_deg: (Math.round((angle * 180) / Math.PI) + 360) % 360 } };
    }
    default: {
      const line = [...one[drag.part]];
      if (drag.between === undefined) line[drag.corner] = shift(line[drag.corner]);
      else line.splice(drag.between, 0, shift(drag.origin));
      return { ...one, [drag.part]: line };
    }
  }
}

// What the page's map draws of a mission, as far as it can be read.
export function worldOf(state, elements, before) {
  const of = (kind) => elements.filter((one) => one.kind === kind);
  const number = (value, usual = 0) => (typeof value === "number" ? value : usual);
  return {
    name: state.sections[""]?.name,
    dimension: state.sections[""]?.dimension,
    bounds_m: state.bounds_m ?? before?.bounds_m ?? null,
    sensing_horizon_m: number(state.sections.planning?.sensing_horizon_m),
    threat_level_max: number(state.sections.planning?.threat_level_max, 1),
    start_enu_m: of("start")[0]?.place_m ?? null,
    goals: of("goals").filter((one) => one.place_m).map((one) => [...one.place_m, number(one.values.acceptance_radius_m, 60)]),
    obstacles: of("obstacles").filter((one) => one.polygon_enu_m?.length).map((one) => (
      { name: one.name, polygon_enu_m: one.polygon_enu_m, base_m: number(one.values.base_m), top_m: number(one.values.top_m) })),
    radars: of("radars").filter((one) => one.place_m).map((one) => (
      { name: one.name, position_enu_m: one.place_m, max_threat_radius_m: number(one.values.max_threat_radius_m) })),
    dynamic_threats: of("dynamic_threats").map((one) => ({ name: one.name, identity: one.values.identity })),
  };
}
