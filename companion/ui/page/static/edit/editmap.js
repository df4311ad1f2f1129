// The map of the page, on which elements are drawn, selected and dragged.

import { GroundMap, inside } from "../map.js";

const HANDLE = 9; // pixels about a handle that belong to it
const TAU = 2 * Math.PI;

export class EditMap extends GroundMap {
  // What is edited, besides what the page's map knows.
  begin(edit) {
    this.edit = edit;
    this.changed();
  }

  changed() {
    this.on.changed();
  }

  // Before the page's own listeners, which move the map.
  listen() {
    const canvas = this.canvas;
    canvas.addEventListener("pointerdown", (event) => this.press(event));
    canvas.addEventListener("pointermove", (event) => this.slide(event));
    canvas.addEventListener("pointerup", (event) => this.release(event));
    canvas.addEventListener("pointercancel", () => this.cancel());
    canvas.addEventListener("dblclick", () => this.edit?.closeDrawing());
    canvas.addEventListener("keydown", (event) => {
      if (!event.key.startsWith("Arrow") || !this.edit?.selected) return;
      event.stopImmediatePropagation(); // it moves what is selected, not the map
      this.edit.nudge(event);
    });
    super.listen();
  }

  press(event) {
    if (!this.edit || event.button !== 0) return;
    const [x, y] = [event.offsetX, event.offsetY];
    this.pressed = [x, y];
    if (this.edit.tool) {
      event.stopImmediatePropagation();
      return;
    }
    const found = this.hit(x, y);
    this.picked = found;
    if (!found || found.isPicked === false) return; // the map is moved; a click selects what lies there
    event.stopImmediatePropagation();
    this.canvas.focus();
    this.canvas.setPointerCapture(event.pointerId);
    this.drag = { ...found, from: this.placeAt(x, y), by: [0, 0] };
    this.edit.select(found.element, found.corner ?? null);
  }

  slide(event) {
    if (!this.edit) return;
    const [x, y] = [event.offsetX, event.offsetY];
    this.pointer = [x, y];
    if (this.edit.tool) {
      this.changed();
      return;
    }
    if (!this.drag) {
      if (!event.buttons) this.canvas.classList.toggle("over", Boolean(this.hit(x, y)));
      return;
    }
    event.stopImmediatePropagation();
    const here = this.placeAt(x, y);
    this.drag.by = this.snapped(this.drag, [here[0] - this.drag.from[0], here[1] - this.drag.from[1]], event.altKey);
    this.drag.at = here;
    this.edit.preview(this.drag);
  }

  release(event) {
    if (!this.edit) return;
    const [x, y] = [event.offsetX, event.offsetY];
    const isClick = this.pressed && Math.hypot(x - this.pressed[0], y - this.pressed[1]) < 4;
    this.pressed = null;
    if (this.edit.tool) {
      event.stopImmediatePropagation();
      if (isClick) this.edit.draw(this.rounded(this.placeAt(x, y)), this.closes(x, y));
      return;
    }
    if (this.drag) {
      event.stopImmediatePropagation();
      const drag = this.drag;
      this.drag = null;
      this.edit.drop(drag, isClick);
    } else if (isClick) {
      this.edit.select(this.picked?.element ?? null);
    }
  }

  // Everything, below the buttons.
  fit() {
    super.fit();
    if (!(this.scale > 0)) return;
    this.scale *= 0.94;
    this.centre = [this.centre[0], this.centre[1] + 20 / this.scale];
  }

  cancel() {
    this.drag = null;
    this.edit?.preview(null);
  }

  // Metres to which places are rounded: about two pixels.
  get grain() {
    return Math.max(0.1, 10 ** Math.floor(Math.log10(2.5 / this.scale)));
  }

  rounded(place) {
    const step = this.grain;
    return place.map((value) => Number((Math.round(value / step) * step).toFixed(1)));
  }

  // The step that takes the dragged place to round numbers; a polygon keeps its shape.
  snapped(drag, by, isFree) {
    if (isFree) return by.map((value) => Number(value.toFixed(1)));
    const origin = drag.origin;
    return this.rounded([origin[0] + by[0], origin[1] + by[1]]).map((value, axis) => Number((value - origin[axis]).toFixed(4)));
  }

  closes(x, y) {
    const first = this.edit.drawing?.[0];
    if (!first || this.edit.drawing.length < 3) return false;
    const [px, py] = this.pixelOf(first);
    return Math.hypot(px - x, py - y) < HANDLE + 3;
  }

  // What lies at a pixel: handles of what is selected first, then elements, small ones first.
  hit(x, y) {
    const { edit } = this;
    const near = (place, pixels = HANDLE) => {
      const [px, py] = this.pixelOf(place);
      return Math.hypot(px - x, py - y) <= pixels;
    };
    for (const handle of this.handles()) if (near(handle.place)) return handle;
    const here = this.placeAt(x, y);
    const points = edit.elements.filter((one) => one.place_m && near(one.place_m, 12));
    const point = points.find((one) => one === edit.selected) ?? points[0];
    if (point) return { element: point, part: "body", origin: point.place_m };
    const areas = edit.elements.filter((one) => one.polygon_enu_m?.length > 2 && inside(here, one.polygon_enu_m));
    const area = areas.find((one) => one === edit.selected) ?? areas[0];
    // An area is dragged once it is selected: else the map could not be moved where areas cover it.
    if (area) return { element: area, part: "body", origin: area.polygon_enu_m[0], isPicked: area === edit.selected };
    const bounds = edit.sections.find((one) => one.kind === "bounds");
    return bounds && this.isOnEdge(bounds.box_m, x, y) ? { element: bounds, isPicked: false } : null;
  }

  isOnEdge([west, east, south, north], x, y) {
    const [left, top] = this.pixelOf([west, north]);
    const [right, bottom] = this.pixelOf([east, south]);
    const isInside = x > left - 6 && x < right + 6 && y > top - 6 && y < bottom + 6;
    return isInside && (Math.min(Math.abs(x - left), Math.abs(x - right)) < 6 || Math.min(Math.abs(y - top), Math.abs(y - bottom)) < 6);
  }

  // Where what is selected can be taken hold of.
  handles() {
    const one = this.edit?.selected;
    if (!one) return [];
    const found = [];
    if (one.kind === "bounds") {
      const [west, east, south, north] = one.box_m;
      for (const [side, place] of [[[0, 2], [west, south]], [[0, 3], [west, north]], [[1, 2], [east, south]], [[1, 3], [east, north]],
        [[0], [west, (south + north) / 2]], [[1], [east, (south + north) / 2]], [[2], [(west + east) / 2, south]], [[3], [(west + east) / 2, north]]]) {
        found.push({ element: one, part: "side", side, place, origin: place });
      }
      return found;
    }
    for (const key of ["polygon_enu_m", "route_enu_m"]) {
      const line = one[key] ?? [];
      const isClosed = key === "polygon_enu_m";
      for (const [corner, place] of line.entries()) found.push({ element: one, part: key, corner, place, origin: place });
      for (let k = 0; k < line.length; k++) {
        const next = line[k + 1] ?? (isClosed ? line[0] : null);
        if (!next) continue;
        const middle = [(line[k][0] + next[0]) / 2, (line[k][1] + next[1]) / 2];
        if (Math.hypot(next[0] - line[k][0], next[1] - line[k][1]) * this.scale < 45) continue;
        found.push({ element: one, part: key, between: k + 1, place: middle, origin: middle });
      }
    }
    const radius = radiusOf(one);
    if (radius && one.place_m) {
      const place = [one.place_m[0] + radius[1], one.place_m[1]];
      if (radius[1] * this.scale > 16) found.push({ element: one, part: "radius", key: radius[0], place, origin: place });
    }
    if (one.kind === "start" && one.place_m) {
      const course = ((one.values.course_deg ?? 0) * Math.PI) / 180;
      const far = 46 / this.scale;
      const place = [one.place_m[0] + far * Math.sin(course), one.place_m[1] + far * Math.cos(course)];
      found.push({ element: one, part: "course", place, origin: place });
    }
    return found;
  }

  // --- drawing

  draw() {
    super.draw();
    if (!this.edit || !(this.scale > 0) || !this.store.world?.bounds_m) return;
    const context = this.canvas.getContext("2d");
    this.toPixels(context);
    for (const one of this.edit.elements) this.drawElement(context, one);
    for (const plan of this.edit.plans()) this.drawPlan(context, plan);
    this.drawFaults(context);
    this.drawSelected(context);
    this.drawPreview(context);
    if (this.store.ownship) this.drawOwnship(context);
  }

  trace(context, places, isClosed = false) {
    context.beginPath();
    for (const [index, place] of places.entries()) {
      const [x, y] = this.pixelOf(place);
      if (index) context.lineTo(x, y);
      else context.moveTo(x, y);
    }
    if (isClosed) context.closePath();
  }

  // What the page's map does not have: vehicles where they start, their routes, fields, people, the start's course.
  drawElement(context, one) {
    const ink = this.ink;
    if (one.kind === "glide.people" && one.polygon_enu_m) {
      this.trace(context, one.polygon_enu_m, true);
      context.globalAlpha = 0.18;
      context.fillStyle = ink.danger;
      context.fill();
      context.globalAlpha = 1;
      context.strokeStyle = ink.danger;
      context.lineWidth = 1.5;
      context.setLineDash([3, 3]);
      context.stroke();
      context.setLineDash([]);
    }
    if (!one.place_m) return;
    const [x, y] = this.pixelOf(one.place_m);
    if (one.kind === "glide.fields") {
      context.strokeStyle = context.fillStyle = ink.start;
      context.lineWidth = 1.5;
      context.beginPath();
      context.arc(x, y, Math.max(5, (radiusOf(one)?.[1] ?? 0) * this.scale), 0, TAU);
      context.stroke();
      this.label(context, one.name, x + 8, y + 4, ink.start);
    }
    if (one.kind === "dynamic_threats") this.drawVehicle(context, one, x, y);
    if (one.kind === "start") {
      const course = ((one.values.course_deg ?? 0) * Math.PI) / 180;
      context.strokeStyle = ink.start;
      context.lineWidth = 2;
      context.beginPath();
      context.moveTo(x, y);
      context.lineTo(x + 38 * Math.sin(course), y - 38 * Math.cos(course));
      context.stroke();
      this.label(context, "start", x + 9, y + 16, ink.start);
    }
  }

  drawVehicle(context, one, x, y) {
    const ink = this.ink;
    context.globalAlpha = this.store.tracks.length ? 0.35 : 1;
    context.strokeStyle = context.fillStyle = ink.dynamic;
    if (one.route_enu_m?.length) {
      this.trace(context, [one.place_m, ...one.route_enu_m]);
      context.lineWidth = 1.5;
      context.setLineDash([6, 4]);
      context.stroke();
      context.setLineDash([]);
    }
    const radius = (radiusOf(one)?.[1] ?? 0) * this.scale;
    context.beginPath();
    context.arc(x, y, radius, 0, TAU);
    context.save();
    context.globalAlpha *= 0.1;
    context.fill();
    context.restore();
    context.lineWidth = 1;
    context.stroke();
    context.fillRect(x - 6, y - 6, 12, 12);
    this.label(context, one.name, x + 11, y + 4, ink.dynamic);
    context.globalAlpha = 1;
  }

  drawPlan(context, plan) {
    const rows = plan.path;
    const place = (row) => [row[1], row[2]];
    context.lineJoin = context.lineCap = "round";
    context.lineWidth = plan.isOther ? 2.5 : 3;
    context.strokeStyle = plan.isOther ? this.ink.candidate : this.ink.mission;
    context.globalAlpha = plan.isOld ? 0.35 : 0.95;
    context.setLineDash(plan.isOther ? [9, 6] : []);
    this.trace(context, rows.map(place));
    context.stroke();
    context.setLineDash([]);
    // Where it is under threat.
    context.strokeStyle = this.ink.reach;
    context.lineWidth = 5;
    context.globalAlpha = 0.6;
    for (let k = 1; k < rows.length; k++) {
      if (!(rows[k][4] > 0.01)) continue;
      this.trace(context, [place(rows[k - 1]), place(rows[k])]);
      context.stroke();
    }
    context.globalAlpha = 1;
  }

  drawFaults(context) {
    for (const one of this.edit.elements) {
      if (!one.faults?.length) continue;
      const place = one.place_m ?? middleOf(one.polygon_enu_m);
      if (!place) continue;
      const [x, y] = this.pixelOf(place);
      context.strokeStyle = this.ink.danger;
      context.lineWidth = 2.5;
      context.beginPath();
      context.arc(x, y, 15, 0, TAU);
      context.stroke();
      context.fillStyle = this.ink.danger;
      context.beginPath();
      context.arc(x + 12, y - 12, 8, 0, TAU);
      context.fill();
      this.write(context, "!", x + 12, y - 8);
    }
  }

  write(context, text, x, y) {
    context.fillStyle = this.ink.paper;
    context.font = "bold 12px system-ui, sans-serif";
    context.textAlign = "center";
    context.fillText(text, x, y);
  }

  drawSelected(context) {
    const one = this.edit.selected;
    if (!one) return;
    context.strokeStyle = this.ink.focus;
    context.lineWidth = 2;
    if (one.polygon_enu_m) {
      this.trace(context, one.polygon_enu_m, true);
      context.stroke();
    }
    if (one.place_m) {
      const [x, y] = this.pixelOf(one.place_m);
      context.strokeRect(x - 11, y - 11, 22, 22);
    }
    if (one.kind === "bounds") {
      const [west, east, south, north] = one.box_m;
      this.trace(context, [[west, south], [east, south], [east, north], [west, north]], true);
      context.stroke();
    }
    for (const handle of this.handles()) {
      const [x, y] = this.pixelOf(handle.place);
      const isChosen = handle.corner !== undefined && handle.corner === this.edit.corner && handle.part === this.edit.cornerKey;
      context.fillStyle = isChosen ? this.ink.focus : this.ink.paper;
      context.globalAlpha = handle.between === undefined ? 1 : 0.6;
      context.beginPath();
      if (handle.between !== undefined) context.arc(x, y, 4, 0, TAU);
      else if (handle.part === "radius" || handle.part === "course") context.arc(x, y, 5.5, 0, TAU);
      else context.rect(x - 5, y - 5, 10, 10);
      context.fill();
      context.stroke();
      context.globalAlpha = 1;
    }
  }

  // What is being drawn, and where the pointer would add to it.
  drawPreview(context) {
    const { tool, drawing } = this.edit;
    if (!tool) return;
    const places = [...(drawing ?? [])];
    if (this.pointer) places.push(this.rounded(this.placeAt(...this.pointer)));
    context.strokeStyle = context.fillStyle = this.ink.focus;
    context.lineWidth = 2;
    context.setLineDash([5, 4]);
    this.trace(context, places, tool.isArea && places.length > 2);
    context.stroke();
    context.setLineDash([]);
    for (const place of places) {
      const [x, y] = this.pixelOf(place);
      context.beginPath();
      context.arc(x, y, 4, 0, TAU);
      context.fill();
    }
    const last = places[places.length - 1];
    if (last) {
      const [x, y] = this.pixelOf(last);
      this.label(context, `${last[0]}, ${last[1]}`, x + 10, y - 10, this.ink.ink);
    }
  }
}

// Key and metres of an element's radius.
export function radiusOf(one) {
  const key = { goals: "acceptance_radius_m", radars: "max_threat_radius_m", dynamic_threats: "max_threat_radius_m", "glide.fields": "radius_m" }[one.kind];
  if (!key) return null;
  const value = one.values?.[key] ?? (one.kind === "goals" ? 60 : null);
  return typeof value === "number" ? [key, value] : null;
}

export function middleOf(polygon) {
  if (!polygon?.length) return null;
  return [0, 1].map((axis) => polygon.reduce((sum, corner) => sum + corner[axis], 0) / polygon.length);
}
