// The map: a canvas with the world, north up, in metres.

import { clock, memberName, metres, trackKind, trackName } from "./words.js";
import { Ground } from "./ground.js";
import { Reach } from "./reach.js";

export const LAYERS = [
  ["flown", "flown so far", true],
  ["mission", "mission in the autopilot", true],
  ["ahead", "next 30 s and its spread (2σ)", true],
  ["candidate", "last plan, not handed over", true],
  ["operator", "operator's own items", true],
  ["returns", "return to launch from here", true],
  ["tracks", "moving threats and their radius", true],
  ["team", "team: members and their plans", true],
  ["reach", "where they can be by then", true],
  ["field", "radar threat at this height", true],
  ["radars", "radars and their range", true],
  ["fences", "fences", true],
  ["obstacles", "obstacles, tops in metres up", true],
  ["horizon", "sensing horizon, sub goals", true],
  ["tree", "the planner's search tree", true],
  ["threatTree", "the threats' trees", false],
  ["relief", "ground, metres up", true],
  ["tiles", "map from a file; only drawn", true],
];

const AHEAD_S = 30;
const MARGIN = 0.2; // of the longer side, that pictures are larger by on each

function colours(element) {
  const style = getComputedStyle(element);
  return new Proxy({}, { get: (kept, name) => (kept[name] ??= style.getPropertyValue(`--${name}`).trim()) });
}

export class GroundMap {
  constructor(canvas, store, on) {
    this.canvas = canvas;
    this.store = store;
    this.on = on;
    this.layers = Object.fromEntries(LAYERS.map(([name, , shown]) => [name, shown]));
    this.centre = [0, 0];
    this.scale = 0; // pixels a metre
    this.isFollowing = false;
    this.reach = new Reach();
    this.ground = new Ground(() => on.ground());
    this.field = null;
    this.kept = {}; // what is drawn anew only when it changes, by name: a picture and where its middle lies
    this.paths = {};
    this.recolour();
    this.listen();
    new ResizeObserver(() => this.resize()).observe(canvas);
    this.resize();
  }

  recolour() {
    this.ink = colours(this.canvas);
    this.kept = {};
    this.fieldPicture = null;
    this.on.changed();
  }

  resize() {
    const ratio = window.devicePixelRatio || 1;
    const box = this.canvas.getBoundingClientRect();
    this.ratio = ratio;
    this.width = Math.max(1, box.width);
    this.height = Math.max(1, box.height);
    this.canvas.width = Math.round(this.width * ratio);
    this.canvas.height = Math.round(this.height * ratio);
    this.kept = {};
    if (!this.hasMoved) this.fit();
    this.on.changed();
  }

  // Show the whole world.
  fit() {
    const bounds = this.store.world?.bounds_m;
    if (!bounds) return;
    const [west, east, south, north] = bounds;
    const beside = this.width > 700 ? this.on.covered() : 0; // by the legend
    this.scale = Math.min((this.width - beside - 50) / (east - west), this.height / (north - south)) * 0.94;
    this.centre = [(west + east) / 2 - (beside - 50) / 2 / this.scale, (south + north) / 2];
    this.hasMoved = false;
    this.on.changed();
  }

  zoom(factor, x = this.width / 2, y = this.height / 2) {
    const before = this.placeAt(x, y);
    this.scale = Math.min(50, Math.max(1e-4, this.scale * factor));
    const after = this.placeAt(x, y);
    if (!this.isFollowing) this.centre = [this.centre[0] + before[0] - after[0], this.centre[1] + before[1] - after[1]];
    this.hasMoved = true;
    this.on.changed();
  }

  move(dx, dy) {
    this.centre = [this.centre[0] - dx / this.scale, this.centre[1] + dy / this.scale];
    this.hasMoved = true;
    this.setFollowing(false);
    this.on.changed();
  }

  setFollowing(isFollowing) {
    if (this.isFollowing === isFollowing) return;
    this.isFollowing = isFollowing;
    this.on.following(isFollowing);
    this.on.changed();
  }

  placeAt(x, y) {
    return [this.centre[0] + (x - this.width / 2) / this.scale, this.centre[1] - (y - this.height / 2) / this.scale];
  }

  pixelOf(place) {
    return [
      this.width / 2 + (place[0] - this.centre[0]) * this.scale,
      this.height / 2 - (place[1] - this.centre[1]) * this.scale,
    ];
  }

  listen() {
    const canvas = this.canvas;
    const fingers = new Map();
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      fingers.set(event.pointerId, [event.offsetX, event.offsetY]);
    });
    canvas.addEventListener("pointermove", (event) => {
      const before = fingers.get(event.pointerId);
      if (!before) {
        this.on.hover(this.named(event.offsetX, event.offsetY), event.offsetX, event.offsetY);
        return;
      }
      const here = [event.offsetX, event.offsetY];
      if (fingers.size === 2) {
        const other = [...fingers].find(([id]) => id !== event.pointerId)[1];
        const far = Math.hypot(here[0] - other[0], here[1] - other[1]);
        const was = Math.hypot(before[0] - other[0], before[1] - other[1]);
        if (was > 10) this.zoom(far / was, (here[0] + other[0]) / 2, (here[1] + other[1]) / 2);
      } else {
        this.move(here[0] - before[0], here[1] - before[1]);
      }
      fingers.set(event.pointerId, here);
    });
    for (const kind of ["pointerup", "pointercancel"]) canvas.addEventListener(kind, (event) => fingers.delete(event.pointerId));
    canvas.addEventListener("pointerleave", () => this.on.hover(null));
    canvas.addEventListener(
      "wheel",
      (event) => {
        event.preventDefault();
        this.zoom(Math.exp(-event.deltaY * 0.0015), event.offsetX, event.offsetY);
      },
      { passive: false },
    );
    canvas.addEventListener("keydown", (event) => {
      const steps = { ArrowLeft: [60, 0], ArrowRight: [-60, 0], ArrowUp: [0, 60], ArrowDown: [0, -60] };
      if (steps[event.key]) {
        event.preventDefault();
        event.stopPropagation();
        this.move(...steps[event.key]);
      }
    });
  }

  // What lies at a pixel, in words.
  named(x, y) {
    const store = this.store;
    const place = this.placeAt(x, y);
    const near = (other, pixels = 14) => Math.hypot(other[0] - place[0], other[1] - place[1]) * this.scale < pixels;
    for (const track of store.tracks) {
      if (near(track.position_enu_m)) {
        const speed = Math.hypot(track.velocity_enu_m_s[0], track.velocity_enu_m_s[1]);
        return `${trackName(track, store.world)}: ${trackKind(track)}, ${speed.toFixed(0)} m/s, up to ${track.speed_max_m_s.toFixed(0)}; a threat within ${metres(track.max_threat_radius_m)}`;
      }
    }
    for (const radar of store.world?.radars ?? []) {
      if (near(radar.position_enu_m)) {
        return `${radar.name}: radar, up to ${metres(radar.max_threat_radius_m)}${store.isKnown(radar) ? "" : ", not sensed yet"}`;
      }
    }
    for (const [number, goal] of store.allGoals.entries()) if (near(goal)) return `${store.goalNames[number]}, at ${goal[2].toFixed(0)} m`;
    for (const [number, goal] of (store.trees?.sub_goals_enu_m ?? []).entries()) {
      if (this.layers.horizon && near(goal, 8)) return `sub goal ${number + 1} of the last plan's search`;
    }
    for (const wall of store.walls) {
      if (store.isFence(wall) ? false : inside(place, wall.polygon_enu_m)) {
        return `${wall.name}: from ${wall.base_m.toFixed(0)} to ${wall.top_m.toFixed(0)} m up`;
      }
    }
    const up = this.layers.relief ? this.ground.at(place) : null;
    return up === null ? null : `ground: ${up.toFixed(0)} m up`;
  }

  setField(field) {
    this.field = field?.levels ? field : null;
    this.fieldPicture = null;
    this.on.changed();
  }

  // --- drawing

  draw() {
    const context = this.canvas.getContext("2d");
    const store = this.store;
    if (store.world && !(this.scale > 0)) this.fit();
    if (this.isFollowing && store.ownship) this.centre = store.ownship.position_enu_m.slice(0, 2);
    this.toPixels(context);
    context.fillStyle = this.ink.ground;
    context.fillRect(0, 0, this.width, this.height);
    if (!store.world?.bounds_m || !(this.scale > 0)) return;
    const layers = JSON.stringify(this.layers);
    const { version, standing } = store;
    const still = [version.world, version.obstacles, store.known, layers, this.field?.height_m, this.ground.version, standing?.next_goal, standing?.goals, store.goalNames.join()];
    this.keep(context, "still", still.join(), (kept) => this.drawStill(kept));
    const search = [version.trees, this.reach.version, layers];
    this.keep(context, "search", search.join(), (kept) => {
      this.drawTrees(kept);
      this.drawReach(kept);
    });
    this.drawWays(context);
    this.drawTeam(context);
    this.drawTracks(context);
    this.drawHorizon(context);
    this.drawOwnship(context);
    this.drawScale(context);
  }

  // Draw by a picture that is larger than the map, so that it can be moved a while before it is made anew.
  keep(context, name, content, draw) {
    const margin = Math.round(MARGIN * Math.max(this.width, this.height));
    const key = `${content}/${this.scale}/${this.width}/${this.height}/${this.ratio}`;
    const kept = (this.kept[name] ??= { picture: document.createElement("canvas"), key: "", centre: [0, 0] });
    const offset = () => [(kept.centre[0] - this.centre[0]) * this.scale, (this.centre[1] - kept.centre[1]) * this.scale];
    if (kept.key !== key || Math.max(...offset().map(Math.abs)) > margin) {
      kept.key = key;
      kept.centre = [...this.centre];
      const { width, height } = this;
      this.width += 2 * margin;
      this.height += 2 * margin;
      kept.picture.width = Math.round(this.width * this.ratio); // which clears it, too
      kept.picture.height = Math.round(this.height * this.ratio);
      draw(kept.picture.getContext("2d"));
      Object.assign(this, { width, height });
    }
    const [dx, dy] = offset();
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.drawImage(kept.picture, Math.round((dx - margin) * this.ratio), Math.round((dy - margin) * this.ratio));
  }

  toPixels(context) {
    context.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
  }

  // Draw in metres, north up.
  toMetres(context) {
    const k = this.ratio * this.scale;
    context.setTransform(k, 0, 0, -k, this.ratio * (this.width / 2 - this.centre[0] * this.scale), this.ratio * (this.height / 2 + this.centre[1] * this.scale));
  }

  // What changes only with the view and the world.
  drawStill(context) {
    this.ground.draw(context, this, this.ink, this.layers);
    this.drawGrid(context);
    if (this.layers.field) this.drawField(context);
    if (this.layers.obstacles || this.layers.fences) this.drawWalls(context);
    if (this.layers.radars) this.drawRadars(context);
    this.drawEnds(context);
  }

  drawGrid(context) {
    const [west, east, south, north] = this.store.world.bounds_m;
    const rough = 90 / this.scale;
    const power = 10 ** Math.floor(Math.log10(rough));
    const step = [1, 2, 5, 10].map((n) => n * power).find((n) => n >= rough);
    this.step = step;
    this.toPixels(context);
    context.strokeStyle = this.ink.grid;
    context.lineWidth = 1;
    context.beginPath();
    const [left, top] = this.placeAt(0, 0);
    const [right, bottom] = this.placeAt(this.width, this.height);
    for (let x = Math.ceil(left / step) * step; x <= right; x += step) {
      const [px] = this.pixelOf([x, 0]);
      context.moveTo(px, 0);
      context.lineTo(px, this.height);
    }
    for (let y = Math.ceil(bottom / step) * step; y <= top; y += step) {
      const [, py] = this.pixelOf([0, y]);
      context.moveTo(0, py);
      context.lineTo(this.width, py);
    }
    context.stroke();
    const [x0, y0] = this.pixelOf([west, north]);
    context.strokeStyle = this.ink.muted;
    context.setLineDash([2, 4]);
    context.strokeRect(x0, y0, (east - west) * this.scale, (north - south) * this.scale);
    context.setLineDash([]);
  }

  drawField(context) {
    const field = this.field;
    if (!field) return;
    this.fieldPicture ??= fieldPicture(field, this.ink.radar);
    this.toPixels(context);
    const [x, y] = this.pixelOf([field.west_m - field.spacing_m / 2, field.south_m + (field.rows - 0.5) * field.spacing_m]);
    context.imageSmoothingEnabled = true;
    context.drawImage(this.fieldPicture, x, y, field.columns * field.spacing_m * this.scale, field.rows * field.spacing_m * this.scale);
  }

  drawWalls(context) {
    const store = this.store;
    for (const wall of store.walls) {
      const isFence = store.isFence(wall);
      if (isFence ? !this.layers.fences || wall.name === "fence ceiling" : !this.layers.obstacles) continue;
      this.toMetres(context);
      context.beginPath();
      for (const [index, point] of wall.polygon_enu_m.entries()) {
        if (index) context.lineTo(point[0], point[1]);
        else context.moveTo(point[0], point[1]);
      }
      context.closePath();
      this.toPixels(context);
      if (isFence) {
        context.globalAlpha = 0.13;
        context.fillStyle = this.ink.fence;
        context.fill();
        context.globalAlpha = 1;
        context.strokeStyle = this.ink.fence;
        context.lineWidth = 1.5;
        context.setLineDash([7, 4]);
        context.stroke();
        context.setLineDash([]);
        continue;
      }
      const isClear = this.heightNow !== null && (this.heightNow > wall.top_m || this.heightNow < wall.base_m);
      context.globalAlpha = isClear ? 0.45 : 1;
      context.fillStyle = this.ink.obstacle;
      context.fill();
      context.globalAlpha = 1;
      context.strokeStyle = this.ink.ground;
      context.lineWidth = 1;
      context.stroke();
      this.writeTop(context, wall);
    }
  }

  get heightNow() {
    return this.field?.height_m ?? null;
  }

  writeTop(context, wall) {
    if (this.store.world.dimension !== 3) return;
    const xs = wall.polygon_enu_m.map((point) => point[0]);
    const ys = wall.polygon_enu_m.map((point) => point[1]);
    const width = (Math.max(...xs) - Math.min(...xs)) * this.scale;
    const height = (Math.max(...ys) - Math.min(...ys)) * this.scale;
    if (Math.min(width, height) < 13 || Math.max(width, height) < 30) return;
    const [x, y] = this.pixelOf([(Math.max(...xs) + Math.min(...xs)) / 2, (Math.max(...ys) + Math.min(...ys)) / 2]);
    context.save();
    context.translate(x, y);
    if (width < 30) context.rotate(-Math.PI / 2);
    context.font = "11px system-ui, sans-serif";
    context.textAlign = "center";
    context.textBaseline = "middle";
    context.fillStyle = this.ink["obstacle-top"];
    context.fillText(`${wall.top_m.toFixed(0)}`, 0, 0);
    context.restore();
  }

  drawRadars(context) {
    this.toPixels(context);
    context.font = "12px system-ui, sans-serif";
    for (const radar of this.store.world.radars ?? []) {
      const [x, y] = this.pixelOf(radar.position_enu_m);
      const isKnown = this.store.isKnown(radar);
      context.globalAlpha = isKnown ? 1 : 0.5;
      context.strokeStyle = context.fillStyle = this.ink.radar;
      context.lineWidth = 1.2;
      context.setLineDash(isKnown ? [6, 4] : [2, 5]);
      circle(context, x, y, radar.max_threat_radius_m * this.scale);
      context.stroke();
      context.setLineDash([]);
      context.beginPath();
      context.moveTo(x, y - 7);
      context.lineTo(x + 6, y + 5);
      context.lineTo(x - 6, y + 5);
      context.closePath();
      if (isKnown) context.fill();
      else context.stroke();
      if (this.scale > 0.04) this.label(context, radar.name + (isKnown ? "" : " (not sensed)"), x + 9, y + 4, this.ink.radar);
      context.globalAlpha = 1;
    }
  }

  drawEnds(context) {
    this.toPixels(context);
    const store = this.store;
    const next = store.standing?.next_goal ?? 0;
    if (store.world.start_enu_m) {
      const [x, y] = this.pixelOf(store.world.start_enu_m);
      context.fillStyle = this.ink.start;
      diamond(context, x, y, 6);
      context.fill();
    }
    for (const [number, goal] of store.allGoals.entries()) {
      const [x, y] = this.pixelOf(goal);
      context.fillStyle = context.strokeStyle = this.ink.goal;
      context.globalAlpha = (store.isShared ? store.isFlownGoal(number) : number < next) ? 0.4 : 1;
      circle(context, x, y, Math.max(5, goal[3] * this.scale));
      context.lineWidth = 1.5;
      context.stroke();
      diamond(context, x, y, 6);
      context.fill();
      this.label(context, store.goalNames[number], x + 10, y - 8, this.ink.goal);
      context.globalAlpha = 1;
    }
  }

  drawScale(context) {
    this.toPixels(context);
    const length = this.step * this.scale;
    const x = this.width - 18 - length;
    const y = this.height - 16;
    context.strokeStyle = context.fillStyle = this.ink.ink;
    context.lineWidth = 2;
    context.beginPath();
    context.moveTo(x, y - 5);
    context.lineTo(x, y);
    context.lineTo(x + length, y);
    context.lineTo(x + length, y - 5);
    context.stroke();
    this.label(context, metres(this.step), x + length / 2, y - 7, this.ink.ink, "center");
    context.beginPath();
    context.moveTo(this.width - 14, y - 22);
    context.lineTo(this.width - 9, y - 36);
    context.lineTo(this.width - 4, y - 22);
    context.closePath();
    context.fill();
    this.label(context, "N", this.width - 9, y - 38, this.ink.ink, "center");
  }

  label(context, text, x, y, colour, align = "left") {
    context.font = "12px system-ui, -apple-system, 'Segoe UI', Roboto, 'DejaVu Sans', sans-serif";
    if (align === "left" && x > this.width - 10 - context.measureText(text).width) {
      align = "right"; // so that it stays on the map
      x -= 28;
    }
    context.textAlign = align;
    context.textBaseline = "alphabetic";
    context.lineWidth = 3;
    context.strokeStyle = this.ink.ground;
    context.lineJoin = "round";
    context.strokeText(text, x, y);
    context.fillStyle = colour;
    context.fillText(text, x, y);
  }

  drawTrees(context) {
    const trees = this.store.trees;
    if (!trees || !(this.layers.tree || this.layers.threatTree)) return;
    if (this.paths.version !== this.store.version.trees) {
      this.paths = {
        version: this.store.version.trees,
        tree: edges(trees.tree_enu_m, trees.tree_parents),
        threatTree: edges(trees.threat_tree_enu_m, trees.threat_tree_parents),
      };
    }
    this.toMetres(context);
    context.lineWidth = 1 / this.scale;
    for (const [name, colour] of [["threatTree", "threat-tree"], ["tree", "tree"]]) {
      if (!this.layers[name]) continue;
      context.strokeStyle = this.ink[colour];
      context.globalAlpha = 0.4;
      context.stroke(this.paths[name]);
      context.globalAlpha = 1;
    }
  }

  drawReach(context) {
    if (!this.layers.reach) return;
    this.toMetres(context);
    for (const line of this.reach.lines) {
      context.strokeStyle = this.ink.reach;
      context.globalAlpha = { 10: 1, 20: 0.75, 30: 0.55, 60: 0.35 }[line.seconds] ?? 0.5;
      context.lineWidth = 1.5 / this.scale;
      context.beginPath();
      if (line.pieces) {
        for (let k = 0; k < line.pieces.length; k += 4) {
          context.moveTo(line.pieces[k], line.pieces[k + 1]);
          context.lineTo(line.pieces[k + 2], line.pieces[k + 3]);
        }
      } else {
        context.arc(line.centre[0], line.centre[1], line.radius, 0, 7);
      }
      context.stroke();
    }
    this.toPixels(context);
    for (const line of this.reach.lines) {
      context.globalAlpha = 0.9;
      const top = line.pieces ? highest(line.pieces) : [line.centre[0], line.centre[1] + line.radius];
      if (!top) continue;
      const [x, y] = this.pixelOf(top);
      this.label(context, `${line.seconds} s`, x, y - 3, this.ink.reach, "center");
    }
    context.globalAlpha = 1;
  }

  drawWays(context) {
    const store = this.store;
    this.toPixels(context);
    const line = (places, colour, width, dash = [], alpha = 1) => {
      if (places.length < 2) return;
      context.strokeStyle = colour;
      context.lineWidth = width;
      context.lineJoin = context.lineCap = "round";
      context.setLineDash(dash);
      context.globalAlpha = alpha;
      context.beginPath();
      for (const [index, place] of places.entries()) {
        const [x, y] = this.pixelOf(place);
        if (index) context.lineTo(x, y);
        else context.moveTo(x, y);
      }
      context.stroke();
      context.setLineDash([]);
      context.globalAlpha = 1;
    };
    if (this.layers.operator && store.standing) line(store.standing.operator_enu_m ?? [], this.ink.operator, 1.5, [2, 5]);
    if (this.layers.mission && store.plan && store.isFlown) {
      line(store.plan.path.map((row) => row.slice(1, 3)), this.ink.mission, 1.5, [], 0.45); // it is extended along this
    }
    if (this.layers.candidate && store.candidateOnly) {
      line(store.candidateOnly.path.map((row) => row.slice(1, 3)), this.ink.candidate, 2, [10, 5, 1, 5], 0.95);
    }
    if (this.layers.mission && store.mission) {
      line(store.mission.waypoints_enu_m, this.ink.mission, 2.5, [], 0.55);
      context.fillStyle = this.ink.mission;
      for (const place of store.mission.waypoints_enu_m) {
        const [x, y] = this.pixelOf(place);
        circle(context, x, y, 3);
        context.fill();
      }
    }
    if (this.layers.flown) line(this.flownPlaces(), this.ink.flown, 3);
    if (this.layers.ahead) this.drawAhead(context);
    const home = store.standing?.returns;
    if (this.layers.returns && home?.way_enu_m?.length) {
      line(home.way_enu_m, home.is_safe ? this.ink.back : this.ink.goal, 1.5, [8, 4]);
    }
    const back = store.standing?.handback?.way_enu_m;
    if (back?.length) line(back, store.standing.handback.is_safe ? this.ink.back : this.ink.goal, 3, [3, 6]);
  }

  flownPlaces() {
    const store = this.store;
    const rows = store.rows;
    let end = rows.length;
    while (end > 0 && rows[end - 1][0] > store.now) end--;
    const step = Math.max(1, Math.floor(end / 1500));
    const places = [];
    for (let row = 0; row < end; row += step) places.push([rows[row][1], rows[row][2]]);
    if (store.ownship) places.push(store.ownship.position_enu_m);
    return places;
  }

  drawAhead(context) {
    const ahead = this.store.ahead(AHEAD_S);
    this.toPixels(context);
    context.fillStyle = context.strokeStyle = this.ink.ahead;
    let drawn = -Infinity;
    for (const entry of ahead) {
      if (!entry.covariance || entry.in_s - drawn < 4) continue;
      drawn = entry.in_s;
      const [x, y] = this.pixelOf(entry.place);
      context.globalAlpha = 0.16;
      ellipse(context, x, y, entry.covariance[0], entry.covariance[1], entry.covariance[2], 2 * this.scale, 3);
      context.fill();
      context.globalAlpha = 0.6;
      context.lineWidth = 1;
      context.stroke();
    }
    context.globalAlpha = 1;
    for (const seconds of [10, 20, 30]) {
      const entry = ahead.find((one) => one.in_s >= seconds);
      if (!entry || this.scale < 0.2) continue;
      const [x, y] = this.pixelOf(entry.place);
      this.label(context, `+${seconds} s`, x + 8, y - 6, this.ink.ahead);
    }
  }

  // Each other member of the team: what it told that it flies, and where it is.
  drawTeam(context) {
    if (!this.layers.team) return;
    this.toPixels(context);
    context.fillStyle = context.strokeStyle = this.ink.team;
    for (const member of this.store.others) {
      context.globalAlpha = member.is_lost ? 0.4 : 0.9;
      context.lineWidth = 2;
      context.setLineDash([7, 4]);
      context.beginPath();
      for (const [index, place] of member.plan_enu_m.entries()) {
        const [x, y] = this.pixelOf(place);
        if (index) context.lineTo(x, y);
        else context.moveTo(x, y);
      }
      context.stroke();
      const end = member.plan_enu_m.at(-1);
      if (end && member.circle_m) {
        circle(context, ...this.pixelOf(end), member.circle_m * this.scale);
        context.stroke();
      }
      context.setLineDash([]);
      const place = member.place_enu_m ?? member.plan_enu_m[0];
      if (place) {
        const [x, y] = this.pixelOf(place);
        if (member.place_enu_m) {
          diamond(context, x, y, 7);
          context.fill();
        }
        this.label(context, memberName(member), x + 11, y + 4, this.ink.team);
      }
    }
    context.globalAlpha = 1;
  }

  drawTracks(context) {
    if (!this.layers.tracks) return;
    this.toPixels(context);
    const members = new Set(this.layers.team ? this.store.others.map((member) => `system:${member.system}`) : []);
    for (const track of this.store.tracks.filter((one) => !members.has(one.identity))) {
      const [x, y] = this.pixelOf(track.position_enu_m);
      const colour = track.flies_on ? this.ink.muted : this.ink.dynamic;
      context.fillStyle = context.strokeStyle = colour;
      if (!track.flies_on) {
        context.globalAlpha = 0.1;
        circle(context, x, y, track.max_threat_radius_m * this.scale);
        context.fill();
        context.globalAlpha = 0.9;
        context.lineWidth = 1.5;
        context.stroke();
      }
      context.globalAlpha = 0.35;
      ellipse(context, x, y, track.covariance[0][0], track.covariance[0][2], track.covariance[2][2], 2 * this.scale, 0);
      context.fill();
      context.globalAlpha = 1;
      const [vx, vy] = track.velocity_enu_m_s;
      const ahead = track.flies_on ? 30 : 10;
      context.lineWidth = 2;
      context.beginPath();
      context.moveTo(x, y);
      context.lineTo(x + vx * ahead * this.scale, y - vy * ahead * this.scale);
      context.stroke();
      if (track.is_airborne) diamond(context, x, y, 7);
      else square(context, x, y, 6);
      context.fill();
      context.strokeStyle = this.ink.ground;
      context.lineWidth = 1.5;
      context.stroke();
      this.label(context, trackName(track, this.store.world), x + 11, y + 4, colour);
    }
  }

  drawHorizon(context) {
    const { ownship, world, trees } = this.store;
    if (!this.layers.horizon || !ownship) return;
    this.toPixels(context);
    const [x, y] = this.pixelOf(ownship.position_enu_m);
    context.strokeStyle = this.ink.horizon;
    context.globalAlpha = 0.7;
    context.lineWidth = 1;
    context.setLineDash([1, 4]);
    circle(context, x, y, world.sensing_horizon_m * this.scale);
    context.stroke();
    context.setLineDash([]);
    context.globalAlpha = 1;
    for (const place of trees?.sub_goals_enu_m ?? []) {
      const [px, py] = this.pixelOf(place);
      context.fillStyle = this.ink["sub-goal"];
      diamond(context, px, py, 4);
      context.fill();
    }
  }

  drawOwnship(context) {
    const ownship = this.store.ownship;
    if (!ownship) return;
    this.toPixels(context);
    const [x, y] = this.pixelOf(ownship.position_enu_m);
    context.fillStyle = this.ink.flown;
    context.globalAlpha = 0.2;
    circle(context, x, y, Math.max(4, 2 * ownship.position_std_m[0] * this.scale));
    context.fill();
    context.globalAlpha = 1;
    context.save();
    context.translate(x, y);
    context.rotate(ownship.course_rad);
    context.beginPath();
    for (const [index, [px, py]] of [[0, -14], [4, -2], [13, 3], [13, 6], [3, 4], [2, 10], [5, 12], [5, 14], [0, 12.5], [-5, 14], [-5, 12], [-2, 10], [-3, 4], [-13, 6], [-13, 3], [-4, -2]].entries()) {
      if (index) context.lineTo(px, py);
      else context.moveTo(px, py);
    }
    context.closePath();
    context.strokeStyle = this.ink.ground;
    context.lineWidth = 3;
    context.stroke();
    context.fill();
    context.restore();
    const up = ownship.position_enu_m[2];
    const low = this.ground.at(ownship.position_enu_m);
    const above = low === null ? "" : `, ${Math.abs(up - low).toFixed(0)} m ${up < low ? "below" : "above"} ground`;
    this.label(context, `${up.toFixed(0)} m up${above} · ${clock(this.store.now - (this.store.begin || 0))}`, x + 15, y + 24, this.ink.ink);
  }

  // What each entry of the legend looks like.
  swatch(name, canvas) {
    const context = canvas.getContext("2d");
    const ratio = window.devicePixelRatio || 1;
    canvas.width = 30 * ratio;
    canvas.height = 14 * ratio;
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    const ink = this.ink;
    const stroke = (colour, width, dash = []) => {
      context.strokeStyle = colour;
      context.lineWidth = width;
      context.setLineDash(dash);
      context.beginPath();
      context.moveTo(1, 7);
      context.lineTo(29, 7);
      context.stroke();
    };
    const looks = {
      flown: () => stroke(ink.flown, 3),
      mission: () => {
        context.globalAlpha = 0.55;
        stroke(ink.mission, 2.5);
        context.globalAlpha = 1;
        context.fillStyle = ink.mission;
        for (const x of [6, 24]) {
          circle(context, x, 7, 3);
          context.fill();
        }
      },
      ahead: () => {
        context.fillStyle = ink.ahead;
        context.globalAlpha = 0.35;
        for (const x of [8, 15, 22]) {
          circle(context, x, 7, 5);
          context.fill();
        }
      },
      candidate: () => stroke(ink.candidate, 2, [9, 4, 1, 4]),
      operator: () => stroke(ink.operator, 1.5, [2, 4]),
      returns: () => stroke(ink.back, 1.5, [8, 4]),
      tracks: () => {
        context.fillStyle = ink.dynamic;
        square(context, 15, 7, 5);
        context.fill();
      },
      team: () => {
        context.fillStyle = ink.team;
        stroke(ink.team, 2, [7, 4]);
        diamond(context, 15, 7, 5);
        context.fill();
      },
      reach: () => stroke(ink.reach, 1.5),
      field: () => {
        const shade = context.createLinearGradient(0, 0, 30, 0);
        shade.addColorStop(0, "transparent");
        shade.addColorStop(1, ink.radar);
        context.fillStyle = shade;
        context.globalAlpha = 0.6;
        context.fillRect(0, 1, 30, 12);
      },
      radars: () => stroke(ink.radar, 1.2, [6, 4]),
      fences: () => stroke(ink.fence, 1.5, [7, 4]),
      obstacles: () => {
        context.fillStyle = ink.obstacle;
        context.fillRect(7, 1, 16, 12);
      },
      horizon: () => stroke(ink.horizon, 1.2, [1, 3]),
      tree: () => stroke(ink.tree, 1),
      threatTree: () => stroke(ink["threat-tree"], 1),
      relief: () => {
        context.fillStyle = ink["relief-high"];
        context.fillRect(1, 1, 28, 12);
        stroke(ink.contour, 1);
      },
      tiles: () => {
        context.strokeStyle = ink.muted;
        for (const x of [4, 15]) context.strokeRect(x, 1.5, 11, 11);
      },
    };
    looks[name]?.();
  }
}

function circle(context, x, y, radius) {
  context.beginPath();
  context.arc(x, y, radius, 0, 2 * Math.PI);
}

function diamond(context, x, y, size) {
  context.beginPath();
  context.moveTo(x, y - size);
  context.lineTo(x + size, y);
  context.lineTo(x, y + size);
  context.lineTo(x - size, y);
  context.closePath();
}

function square(context, x, y, size) {
  context.beginPath();
  context.rect(x - size, y - size, 2 * size, 2 * size);
}

// The ellipse of a covariance, so many pixels a metre of deviation, and pixels at least.
function ellipse(context, x, y, ee, en, nn, pixels, least) {
  const middle = (ee + nn) / 2;
  const apart = Math.hypot((ee - nn) / 2, en);
  const long = Math.max(least, Math.sqrt(Math.max(0, middle + apart)) * pixels);
  const short = Math.max(least, Math.sqrt(Math.max(0, middle - apart)) * pixels);
  context.beginPath();
  context.ellipse(x, y, long, short, -0.5 * Math.atan2(2 * en, ee - nn), 0, 2 * Math.PI);
}

function edges(places, parents) {
  const path = new Path2D();
  for (let row = 0; row < places.length; row++) {
    const parent = parents[row];
    if (parent < 0 || parent >= places.length) continue;
    path.moveTo(places[parent][0], places[parent][1]);
    path.lineTo(places[row][0], places[row][1]);
  }
  return path;
}

function highest(pieces) {
  let top = null;
  for (let k = 0; k < pieces.length; k += 2) if (!top || pieces[k + 1] > top[1]) top = [pieces[k], pieces[k + 1]];
  return top;
}

export function inside(place, polygon) {
  let isIn = false;
  for (let a = 0, b = polygon.length - 1; a < polygon.length; b = a++) {
    const [ax, ay] = polygon[a];
    const [bx, by] = polygon[b];
    if (ay > place[1] !== by > place[1] && place[0] < ((bx - ax) * (place[1] - ay)) / (by - ay) + ax) isIn = !isIn;
  }
  return isIn;
}

// The radars' field as a picture, north up.
export function fieldPicture(field, colour) {
  const levels = Uint8Array.from(atob(field.levels), (letter) => letter.charCodeAt(0));
  const canvas = document.createElement("canvas");
  canvas.width = field.columns;
  canvas.height = field.rows;
  const context = canvas.getContext("2d");
  context.fillStyle = colour;
  context.fillRect(0, 0, 1, 1);
  const [red, green, blue] = context.getImageData(0, 0, 1, 1).data;
  const picture = context.createImageData(field.columns, field.rows);
  for (let row = 0; row < field.rows; row++) {
    for (let column = 0; column < field.columns; column++) {
      const level = levels[(field.rows - 1 - row) * field.columns + column];
      picture.data.set([red, green, blue, Math.round(0.45 * level)], 4 * (row * field.columns + column));
    }
  }
  context.putImageData(picture, 0, 0);
  return canvas;
}
