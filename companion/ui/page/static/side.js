// The next two kilometres from the side: the ground, the flown and the planned path, the limits over ground, and
// where radars see.

import { heightsOf } from "./ground.js";

const BEHIND_M = 500;
const AHEAD_M = 2000;
const STEP_M = 25; // between two places at which the ground is looked up
const FLOOR_SHOWN_M = 150; // above all else, up to which the floor of a radar is shown
const PAD = { left: 42, right: 10, top: 8, bottom: 18 };

export class SideView {
  constructor(parent, store, ground) {
    this.store = store;
    this.ground = ground;
    this.figure = document.createElement("figure");
    this.figure.className = "side";
    this.figure.setAttribute("role", "img");
    const caption = document.createElement("figcaption");
    this.name = document.createElement("span");
    this.name.textContent = "From the side, 2 km ahead";
    this.name.title = "Ground, flown path (before 0) and planned path; dashed: the lowest and the highest height over ground; tinted: where a radar sees, above its floor";
    this.sight = document.createElement("i");
    this.floors = [];
    this.value = document.createElement("b");
    caption.append(this.name, this.sight, this.value);
    this.canvas = document.createElement("canvas");
    this.figure.append(caption, this.canvas);
    this.figure.hidden = true;
    parent.before(this.figure);
  }

  // From which height on each radar sees, in the order of the mission file.
  setFloors(told) {
    this.floors = told.map((grid) => grid && heightsOf(grid));
  }

  // Between which heights a radar sees over a place, or null: above what hides, and within its range.
  seen(number, place) {
    const radar = this.store.world?.radars?.[number];
    const grid = this.floors[number];
    if (!radar || !grid) return null;
    const column = Math.floor((place[0] - grid.west) / grid.spacing);
    const row = Math.floor((place[1] - grid.south) / grid.spacing);
    if (!(column >= 0 && row >= 0 && column < grid.columns && row < grid.rows)) return null;
    const floor = grid.up[row * grid.columns + column];
    const [east, north, up] = radar.position_enu_m;
    const rise = Math.sqrt(radar.max_threat_radius_m ** 2 - (place[0] - east) ** 2 - (place[1] - north) ** 2);
    return floor < up + rise ? [Math.max(floor, up - rise), up + rise] : null;
  }

  // Rows [distance from the aircraft, up, ground or null, place], behind it and ahead.
  profile() {
    const passed = this.store.rows.filter((row) => row[0] <= this.store.now);
    const flown = this.measured(passed.map((row) => row.slice(1, 4)).reverse(), BEHIND_M).map(([away, ...rest]) => [-away, ...rest]);
    const planned = this.measured([this.store.ownship.position_enu_m, ...this.store.ahead(Infinity).slice(1).map((entry) => entry.place)], AHEAD_M);
    return { flown: flown.reverse(), planned };
  }

  // Places along a line every few metres, up to a length.
  measured(places, most) {
    const rows = [];
    let passed = 0;
    for (let k = 0; k < places.length && passed <= most; k++) {
      const [from, to] = [places[Math.max(0, k - 1)], places[k]];
      const length = Math.hypot(to[0] - from[0], to[1] - from[1]);
      const steps = Math.max(1, Math.ceil(length / STEP_M));
      for (let step = k ? 1 : steps; step <= steps; step++) {
        const at = from.map((value, axis) => value + ((to[axis] - value) * step) / steps);
        rows.push([passed + (length * step) / steps, at[2], this.ground.at(at), at]);
      }
      passed += length;
    }
    return rows.filter((row) => row[0] <= most);
  }

  draw() {
    const limits = this.store.world?.terrain;
    const isShown = Boolean(limits && this.store.ownship && this.ground.has("relief"));
    this.figure.hidden = !isShown;
    if (!isShown) return;
    const { flown, planned } = this.profile();
    const rows = [...flown, ...planned];
    const known = rows.filter((row) => row[2] !== null);
    if (!known.length) return;
    const over = known.filter((row) => row[0] >= 0).map((row) => row[1] - row[2]);
    const least = over.length ? Math.min(...over) : NaN;
    this.value.textContent = Number.isFinite(least) ? `lowest ${least.toFixed(0)} m over ground` : "–";
    this.figure.setAttribute("aria-label", `${this.name.textContent}: ${this.value.textContent}`);
    this.sight.textContent = this.sightWords(planned);
    this.sight.dataset.state = this.sight.textContent.startsWith("in sight") ? "seen" : "";
    this.figure.dataset.state = least < limits.height_min_m ? "danger" : "";
    const highest = Number.isFinite(limits.height_max_m) ? limits.height_max_m : limits.height_min_m;
    const low = Math.min(...known.map((row) => row[2])) - 10;
    const top = Math.max(...rows.map((row) => row[1]), ...known.map((row) => row[2] + highest));
    const floors = [...this.floors.keys()].flatMap((number) => known.map((row) => this.seen(number, row[3])?.[0] ?? -Infinity));
    const high = Math.max(top, ...floors.filter((floor) => floor < top + FLOOR_SHOWN_M)) + 10;
    this.paint(flown, planned, known, limits, low, high);
  }

  // Which radar sees the planned path first, and after how far.
  sightWords(planned) {
    if (!this.floors.length) return "";
    for (const [away, up, , place] of planned) {
      for (const number of this.floors.keys()) {
        const seen = this.seen(number, place);
        if (!seen || up <= seen[0] || up > seen[1]) continue;
        const { name } = this.store.world.radars[number];
        return away < STEP_M ? `in sight of ${name}` : `in sight of ${name} in ${(away / 1000).toFixed(1)} km`;
      }
    }
    return "out of radars' sight";
  }

  // Where a radar sees along the view: its floor as a line, and above it a tint.
  paintFloor(number, rows, context, x, y, line, high) {
    const colour = getComputedStyle(this.figure).getPropertyValue("--radar").trim();
    const dashes = this.store.isKnown(this.store.world.radars[number]) ? [] : [2, 3];
    let run = [];
    for (const [away, , ground, place] of [...rows, [NaN, 0, null, null]]) {
      const seen = place && this.seen(number, place);
      if (seen) {
        run.push([away, Math.max(seen[0], ground ?? -Infinity), Math.max(seen[0], Math.min(seen[1], high))]);
        continue;
      }
      if (run.length > 1) {
        context.fillStyle = colour;
        context.globalAlpha = 0.13;
        context.beginPath();
        run.forEach(([at, floor], index) => (index ? context.lineTo(x(at), y(floor)) : context.moveTo(x(at), y(floor))));
        for (const [at, , top] of run.toReversed()) context.lineTo(x(at), y(top));
        context.fill();
        context.globalAlpha = 1;
        line(run, colour, 1, dashes);
      }
      run = [];
    }
  }

  paint(flown, planned, known, limits, low, high) {
    const ratio = window.devicePixelRatio || 1;
    const width = Math.max(120, Math.floor(this.figure.getBoundingClientRect().width) - 16);
    const height = 110;
    this.canvas.width = width * ratio;
    this.canvas.height = height * ratio;
    this.canvas.style.width = `${width}px`;
    this.canvas.style.height = `${height}px`;
    const context = this.canvas.getContext("2d");
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    const ink = (variable) => getComputedStyle(this.figure).getPropertyValue(variable).trim();
    const x = (away) => PAD.left + ((away + BEHIND_M) / (BEHIND_M + AHEAD_M)) * (width - PAD.left - PAD.right);
    const y = (up) => height - PAD.bottom - ((up - low) / (high - low)) * (height - PAD.top - PAD.bottom);
    const line = (points, colour, thick, dashes = []) => {
      context.strokeStyle = colour;
      context.lineWidth = thick;
      context.setLineDash(dashes);
      context.beginPath();
      points.forEach(([away, up], index) => (index ? context.lineTo(x(away), y(up)) : context.moveTo(x(away), y(up))));
      context.stroke();
      context.setLineDash([]);
    };
    context.fillStyle = ink("--contour");
    context.globalAlpha = 0.35;
    context.beginPath();
    context.moveTo(x(known[0][0]), y(low));
    for (const [away, , ground] of known) context.lineTo(x(away), y(ground));
    context.lineTo(x(known.at(-1)[0]), y(low));
    context.fill();
    context.globalAlpha = 1;
    context.save();
    context.beginPath();
    context.rect(PAD.left, PAD.top, width - PAD.left - PAD.right, height - PAD.top - PAD.bottom);
    context.clip();
    for (const number of this.floors.keys()) this.paintFloor(number, known, context, x, y, line, high);
    context.restore();
    line(known.map((row) => [row[0], row[2]]), ink("--contour"), 1.5);
    line(known.map((row) => [row[0], row[2] + limits.height_min_m]), ink("--danger"), 1, [4, 4]);
    if (Number.isFinite(limits.height_max_m)) line(known.map((row) => [row[0], row[2] + limits.height_max_m]), ink("--muted"), 1, [4, 4]);
    line(flown, ink("--flown"), 2);
    line(planned, ink("--mission"), 2);
    context.fillStyle = ink("--flown");
    context.beginPath();
    context.arc(x(0), y(this.store.ownship.position_enu_m[2]), 4, 0, 2 * Math.PI);
    context.fill();
    context.fillStyle = ink("--muted");
    context.font = "11px system-ui, sans-serif";
    context.textAlign = "right";
    for (const up of [low + 10, high - 10]) context.fillText(`${up.toFixed(0)} m`, PAD.left - 4, y(up) + 4);
    context.textAlign = "center";
    for (const away of [0, 500, 1000, 1500, 2000]) context.fillText(away ? `${away / 1000} km` : "now", x(away) - (away === 2000 ? 14 : 0), height - 4);
  }
}
