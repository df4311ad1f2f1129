// The ground under the map, from files on the service's computer: map tiles, and heights with shade and contours.

import { contour } from "./reach.js";

const TILE_PIXELS = 400; // of the screen, at most about which a tile is drawn wide
const TILES_MAX = 600; // in a picture
const KEPT_MAX = 1200; // of a picture's tiles, and of coarser ones that stand in for them, none is fetched twice
const NAMES_PIXELS = 28; // between two contours' names
const LINES = 12; // contours at most
const NO_STEP = 65535;
const LIGHT = [-0.5, 0.5, Math.SQRT1_2]; // from the north-west, as maps have it, 45° high
const ABOVE = 4; // zoom levels up to which a coarser tile stands in for one that is not there

export class Ground {
  constructor(changed) {
    this.changed = changed;
    this.forget();
  }

  forget() {
    this.tiles = this.heights = null;
    this.credit = "";
    this.pictures = new Map();
    this.version = (this.version ?? 0) + 1;
    this.relief = {};
  }

  has(name) {
    return Boolean(name === "tiles" ? this.tiles : name === "relief" ? this.heights : true);
  }

  // What there is about a mission, as the service tells it.
  set(told) {
    this.forget();
    this.area = told.area_m;
    this.tiles = told.tiles ?? null;
    this.credit = told.tiles?.credit ?? "";
    this.heights = told.heights ? heightsOf(told.heights) : null;
    this.changed();
  }

  // Height of the ground at a place [m up], or null.
  at(place) {
    const grid = this.heights;
    if (!grid) return null;
    const x = (place[0] - grid.west) / grid.spacing;
    const y = (place[1] - grid.south) / grid.spacing;
    const i = Math.floor(x);
    const j = Math.floor(y);
    if (!(i >= 0 && j >= 0 && i + 1 < grid.columns && j + 1 < grid.rows)) return null;
    const from = j * grid.columns + i;
    const along = (row) => grid.up[row] + (x - i) * (grid.up[row + 1] - grid.up[row]);
    const up = along(from) + (y - j) * (along(from + grid.columns) - along(from));
    return Number.isFinite(up) ? up : null;
  }

  // Draw it on a map, or another view of that kind.
  draw(context, view, ink, layers) {
    if (this.heights && layers.relief) this.drawRelief(context, view, ink);
    if (this.tiles && layers.tiles) this.drawTiles(context, view, Number(ink["tiles-opacity"]));
    if (this.heights && layers.relief) this.drawContours(context, view, ink);
    context.setTransform(view.ratio, 0, 0, view.ratio, 0, 0);
  }

  drawRelief(context, view, ink) {
    const grid = this.heights;
    const key = `${ink["relief-low"]}${ink["relief-high"]}`;
    if (this.relief.key !== key) this.relief = { ...this.relief, key, picture: shaded(grid, ink["relief-low"], ink["relief-high"]) };
    context.setTransform(view.ratio, 0, 0, view.ratio, 0, 0);
    const [x, y] = view.pixelOf([grid.west - grid.spacing / 2, grid.south + (grid.rows - 0.5) * grid.spacing]);
    context.imageSmoothingEnabled = true;
    context.drawImage(this.relief.picture, x, y, grid.columns * grid.spacing * view.scale, grid.rows * grid.spacing * view.scale);
  }

  drawContours(context, view, ink) {
    const grid = this.heights;
    this.relief.lines ??= linesOf(grid);
    view.toMetres(context);
    context.strokeStyle = ink.contour;
    context.globalAlpha = 0.55;
    for (const line of this.relief.lines) {
      context.lineWidth = (line.isFifth ? 1.2 : 0.6) / view.scale;
      context.stroke(line.path);
    }
    context.globalAlpha = 1;
    if (!view.label) return;
    view.toPixels(context);
    const named = [];
    for (const line of this.relief.lines) {
      const [x, y] = view.pixelOf(line.named);
      if (x < 0 || y < 0 || x > view.width || y > view.height || named.some(([a, b]) => Math.hypot(a - x, b - y) < NAMES_PIXELS)) continue;
      named.push([x, y]);
      view.label(context, `${line.level}`, x, y + 4, ink.contour, "center");
    }
  }

  drawTiles(context, view, alpha) {
    const { tiles, area } = this;
    const [left, top] = view.placeAt(0, 0);
    const [right, bottom] = view.placeAt(view.width, view.height);
    const west = Math.max(left, area[0]);
    const east = Math.min(right, area[1]);
    const south = Math.max(bottom, area[2]);
    const north = Math.min(top, area[3]);
    if (!(west < east && south < north)) return;
    const corners = [[west, south], [west, north], [east, south], [east, north]].map((place) => mercatorOf(tiles, place));
    const us = corners.map((corner) => corner[0]);
    const vs = corners.map((corner) => corner[1]);
    const world = (tiles.east_m[1] / tiles.scale) * view.scale * view.ratio; // pixels that zoom 0 would be wide
    let zoom = Math.min(tiles.zoom_max, Math.max(tiles.zoom_min, Math.ceil(Math.log2(world / TILE_PIXELS))));
    const range = (values) => [Math.floor(Math.min(...values) * 2 ** zoom), Math.floor(Math.max(...values) * 2 ** zoom)];
    const number = () => {
      const [[a, b], [c, d]] = [range(us), range(vs)];
      return (b - a + 1) * (d - c + 1);
    };
    while (zoom > tiles.zoom_min && number() > TILES_MAX) zoom--;
    if (number() > TILES_MAX) return; // from so far away they would be dots
    const [firstColumn, lastColumn] = range(us);
    const [firstRow, lastRow] = range(vs);
    const drawn = new Map();
    for (let row = firstRow; row <= lastRow; row++) {
      for (let column = firstColumn; column <= lastColumn; column++) {
        const found = this.nearest(zoom, column, row);
        if (found) drawn.set(found.key, found);
      }
    }
    context.globalAlpha = alpha;
    for (const tile of [...drawn.values()].sort((a, b) => a.zoom - b.zoom)) this.drawTile(context, view, tile);
    context.globalAlpha = 1;
  }

  drawTile(context, view, { picture, zoom, column, row }) {
    const corner = (right, down) => view.pixelOf(placeOf(this.tiles, (column + right) / 2 ** zoom, (row + down) / 2 ** zoom));
    const [x, y] = corner(0, 0);
    const [rx, ry] = corner(1, 0);
    const [dx, dy] = corner(0, 1);
    const { width, height } = picture;
    const k = view.ratio;
    // A pixel's breadth more, so that no seam is left between two.
    const more = 1 + 0.7 / (k * Math.hypot(rx - x, ry - y));
    context.setTransform((k * more * (rx - x)) / width, (k * more * (ry - y)) / width, (k * more * (dx - x)) / height, (k * more * (dy - y)) / height, k * x, k * y);
    context.imageSmoothingEnabled = true;
    context.drawImage(picture, 0, 0);
  }

  // A tile's picture, or that of a coarser one that covers it; it is fetched where it is not here yet.
  nearest(zoom, column, row) {
    for (let up = 0; up <= ABOVE && zoom - up >= this.tiles.zoom_min; up++) {
      const place = [zoom - up, column >> up, row >> up];
      const key = place.join("/");
      const kept = this.pictures.get(key);
      if (kept === undefined) {
        this.fetch(key);
        continue; // meanwhile, a coarser one that is here already
      }
      if (kept?.isLoaded) return { key, picture: kept.image, zoom: place[0], column: place[1], row: place[2] };
      if (kept !== null) continue;
    }
    return null;
  }

  fetch(key) {
    const image = new Image();
    const entry = { image, isLoaded: false };
    const { pictures } = this;
    if (pictures.size >= KEPT_MAX) pictures.delete(pictures.keys().next().value);
    pictures.set(key, entry);
    image.addEventListener("load", () => {
      entry.isLoaded = true;
      this.renew();
    });
    image.addEventListener("error", () => pictures.set(key, null)); // there is none
    image.src = `/tiles/${key}`;
  }

  // Draw anew, once for all pictures that come together.
  renew() {
    clearTimeout(this.timer);
    this.timer = setTimeout(() => {
      this.version++;
      this.changed();
    }, 40);
  }

  // A rectangle of it as one picture, so many pixels along its longer side.
  picture([west, east, south, north], ink, layers, pixels) {
    const scale = pixels / Math.max(east - west, north - south);
    const view = new PlainView([(west + east) / 2, (south + north) / 2], scale, Math.round((east - west) * scale), Math.round((north - south) * scale));
    const canvas = document.createElement("canvas");
    canvas.width = view.width;
    canvas.height = view.height;
    const context = canvas.getContext("2d");
    context.fillStyle = ink.soft;
    context.fillRect(0, 0, canvas.width, canvas.height);
    this.draw(context, view, ink, layers);
    return canvas;
  }
}

class PlainView {
  constructor(centre, scale, width, height) {
    Object.assign(this, { centre, scale, width, height, ratio: 1 });
  }

  placeAt(x, y) {
    return [this.centre[0] + (x - this.width / 2) / this.scale, this.centre[1] - (y - this.height / 2) / this.scale];
  }

  pixelOf(place) {
    return [this.width / 2 + (place[0] - this.centre[0]) * this.scale, this.height / 2 - (place[1] - this.centre[1]) * this.scale];
  }

  toMetres(context) {
    const k = this.scale;
    context.setTransform(k, 0, 0, -k, this.width / 2 - this.centre[0] * k, this.height / 2 + this.centre[1] * k);
  }
}

export function heightsOf(told) {
  const bytes = Uint8Array.from(atob(told.steps), (letter) => letter.charCodeAt(0));
  const data = new DataView(bytes.buffer);
  const up = new Float32Array(told.columns * told.rows);
  for (let at = 0; at < up.length; at++) {
    const step = data.getUint16(2 * at, true);
    up[at] = step === NO_STEP ? NaN : told.low_m + step * told.step_m;
  }
  const { columns, rows } = told;
  return { west: told.west_m, south: told.south_m, spacing: told.spacing_m, columns, rows, up };
}

// The mission's metres of a place in Web Mercator, and back.
export function placeOf(tiles, u, v) {
  const a = (u - tiles.middle[0]) / tiles.scale;
  const b = (v - tiles.middle[1]) / tiles.scale;
  const terms = [1, a, b, a * a, a * b, b * b];
  const sum = (factors) => factors.reduce((total, factor, index) => total + factor * terms[index], 0);
  return [sum(tiles.east_m), sum(tiles.north_m)];
}

export function mercatorOf(tiles, place) {
  const [, ea, eb] = tiles.east_m;
  const [, na, nb] = tiles.north_m;
  const whole = ea * nb - eb * na;
  let [u, v] = tiles.middle;
  for (let turn = 0; turn < 4; turn++) {
    const [x, y] = placeOf(tiles, u, v);
    u += (tiles.scale * (nb * (place[0] - x) - eb * (place[1] - y))) / whole;
    v += (tiles.scale * (ea * (place[1] - y) - na * (place[0] - x))) / whole;
  }
  return [u, v];
}

function rgb(colour) {
  const context = document.createElement("canvas").getContext("2d");
  context.fillStyle = colour;
  context.fillRect(0, 0, 1, 1);
  return context.getImageData(0, 0, 1, 1).data;
}

// Heights as a picture, north up: from one colour to another with the height, darker on slopes away from the light.
function shaded(grid, lowColour, highColour) {
  const { columns, rows, spacing, up } = grid;
  const [from, to] = [rgb(lowColour), rgb(highColour)];
  let low = Infinity;
  let high = -Infinity;
  for (const height of up) {
    if (height < low) low = height;
    if (height > high) high = height;
  }
  const canvas = document.createElement("canvas");
  canvas.width = columns;
  canvas.height = rows;
  const context = canvas.getContext("2d");
  const picture = context.createImageData(columns, rows);
  for (let j = 0; j < rows; j++) {
    for (let i = 0; i < columns; i++) {
      const here = up[j * columns + i];
      if (Number.isNaN(here)) continue; // and so nothing is drawn
      const height = (a, b) => {
        const other = up[Math.min(rows - 1, Math.max(0, b)) * columns + Math.min(columns - 1, Math.max(0, a))];
        return Number.isNaN(other) ? here : other;
      };
      const east = (height(i + 1, j) - height(i - 1, j)) / (2 * spacing);
      const north = (height(i, j + 1) - height(i, j - 1)) / (2 * spacing);
      const light = Math.max(0, (LIGHT[2] - LIGHT[0] * east - LIGHT[1] * north) / Math.hypot(east, north, 1));
      const share = high > low ? (here - low) / (high - low) : 0;
      const shade = 0.45 + 0.55 * Math.min(1.25, light / LIGHT[2]);
      const pixel = 4 * ((rows - 1 - j) * columns + i);
      for (let c = 0; c < 3; c++) picture.data[pixel + c] = (from[c] + share * (to[c] - from[c])) * shade;
      picture.data[pixel + 3] = 255;
    }
  }
  context.putImageData(picture, 0, 0);
  return canvas;
}

// Contours at round heights, and where each is named: nearest to the line from corner to corner.
function linesOf(grid) {
  const known = grid.up.filter((height) => !Number.isNaN(height));
  const low = known.reduce((least, height) => Math.min(least, height), Infinity);
  const high = known.reduce((most, height) => Math.max(most, height), -Infinity);
  const rough = Math.max(5, (high - low) / LINES);
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((n) => n * power).find((n) => n >= rough);
  const field = Float64Array.from(grid.up, (height) => (Number.isNaN(height) ? Infinity : height));
  const lines = [];
  for (let level = Math.ceil(low / step) * step; level <= high; level += step) {
    const pieces = contour(field, grid, level);
    if (!pieces.length) continue;
    const path = new Path2D();
    let named = [pieces[0], pieces[1]];
    let least = Infinity;
    for (let k = 0; k < pieces.length; k += 4) {
      path.moveTo(pieces[k], pieces[k + 1]);
      path.lineTo(pieces[k + 2], pieces[k + 3]);
      const away = Math.abs((pieces[k] - grid.west) / (grid.columns * grid.spacing) - (pieces[k + 1] - grid.south) / (grid.rows * grid.spacing));
      if (away < least) [least, named] = [away, [pieces[k], pieces[k + 1]]];
    }
    lines.push({ level, path, named, isFifth: Math.round(level / step) % 5 === 0 });
  }
  return lines;
}
