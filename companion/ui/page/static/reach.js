// Where a moving threat can be by when: the planner's own reckoning, done here again so that it moves with the
// track. Ways round walls by fast sweeping of the Eikonal equation on a grid (Zhao, Math. Comp. 74, 2005).

export const TIMES_S = [10, 20, 30, 60];
const CELLS = 128; // along the longer side
const CELL_MIN_M = 5;
const DEVIATIONS = 2; // of a track's place, by which it is taken to be nearer
const SHORTENED = 0.98; // sweeping finds ways too long, by less than this
const SEED_CELLS = 6; // about the threat in which ways are straight lines
const STANDS_M = 1; // higher a wall does not stand on the ground: it is driven under

export function gridOf(world, cells = CELLS) {
  const [west, east, south, north] = world.bounds_m;
  const spacing = Math.max(CELL_MIN_M, Math.max(east - west, north - south) / cells);
  return {
    west,
    south,
    spacing,
    columns: Math.floor((east - west) / spacing) + 2,
    rows: Math.floor((north - south) / spacing) + 2,
  };
}

function isInside(x, y, polygon) {
  let inside = false;
  for (let a = 0, b = polygon.length - 1; a < polygon.length; b = a++) {
    const [ax, ay] = polygon[a];
    const [bx, by] = polygon[b];
    if (ay > y !== by > y && x < ((bx - ax) * (y - ay)) / (by - ay) + ax) inside = !inside;
  }
  return inside;
}

// Which cells hold a wall; in the plane one that reaches through the flight level, else one on the ground.
export function wallsOn(grid, world, walls) {
  const blocked = new Uint8Array(grid.columns * grid.rows);
  const level = world.dimension === 2 ? world.start_enu_m[2] : NaN;
  for (const wall of walls) {
    const isPassed = Number.isNaN(level) ? wall.base_m > STANDS_M : wall.base_m > level || wall.top_m < level;
    if (isPassed) continue;
    const xs = wall.polygon_enu_m.map((point) => point[0]);
    const ys = wall.polygon_enu_m.map((point) => point[1]);
    const cell = (value, low, most) => Math.min(most - 1, Math.max(0, Math.floor((value - low) / grid.spacing + 0.5)));
    const lastColumn = cell(Math.max(...xs), grid.west, grid.columns);
    const lastRow = cell(Math.max(...ys), grid.south, grid.rows);
    for (let i = cell(Math.min(...xs), grid.west, grid.columns); i <= lastColumn; i++) {
      for (let j = cell(Math.min(...ys), grid.south, grid.rows); j <= lastRow; j++) {
        if (isInside(grid.west + i * grid.spacing, grid.south + j * grid.spacing, wall.polygon_enu_m)) {
          blocked[j * grid.columns + i] = 1;
        }
      }
    }
  }
  return blocked;
}

function deviation(track) {
  const [a, , c] = [track.covariance[0][0], 0, track.covariance[2][2]];
  const b = track.covariance[0][2];
  return Math.sqrt(Math.max(0, (a + c) / 2 + Math.hypot((a - c) / 2, b)));
}

export function nearer(track) {
  return DEVIATIONS * deviation(track);
}

function isFree(ax, ay, bx, by, grid, blocked) {
  const steps = Math.floor((2 * Math.hypot(bx - ax, by - ay)) / grid.spacing);
  for (let k = 1; k <= steps; k++) {
    const share = k / (steps + 1);
    const i = Math.min(grid.columns - 1, Math.max(0, Math.floor((ax + share * (bx - ax) - grid.west) / grid.spacing + 0.5)));
    const j = Math.min(grid.rows - 1, Math.max(0, Math.floor((ay + share * (by - ay) - grid.south) / grid.spacing + 0.5)));
    if (blocked[j * grid.columns + i]) return false;
  }
  return true;
}

function sweep(way, blocked, grid, right, up) {
  const { columns, rows, spacing } = grid;
  let changed = false;
  for (let s = 0; s < columns; s++) {
    const i = right ? s : columns - 1 - s;
    for (let t = 0; t < rows; t++) {
      const j = up ? t : rows - 1 - t;
      const at = j * columns + i;
      if (blocked[at]) continue;
      const a = Math.min(i > 0 ? way[at - 1] : Infinity, i < columns - 1 ? way[at + 1] : Infinity);
      const b = Math.min(j > 0 ? way[at - columns] : Infinity, j < rows - 1 ? way[at + columns] : Infinity);
      const least = Math.min(a, b);
      if (least >= way[at]) continue;
      let found = least + spacing;
      if (Math.abs(a - b) < spacing) found = 0.5 * (a + b + Math.sqrt(2 * spacing * spacing - (a - b) ** 2));
      if (found < way[at] - 1e-6) {
        way[at] = found;
        changed = true;
      }
    }
  }
  return changed;
}

// Seconds from the track's instant to its earliest arrival in each cell, row by row from the south.
export function arrivals(track, grid, blocked) {
  const { columns, rows, spacing, west, south } = grid;
  const way = new Float64Array(columns * rows).fill(Infinity);
  const [x, y] = track.position_enu_m;
  const a = Math.min(columns - 1, Math.max(0, Math.floor((x - west) / spacing + 0.5)));
  const b = Math.min(rows - 1, Math.max(0, Math.floor((y - south) / spacing + 0.5)));
  for (let i = Math.max(0, a - SEED_CELLS); i < Math.min(columns, a + SEED_CELLS + 1); i++) {
    for (let j = Math.max(0, b - SEED_CELLS); j < Math.min(rows, b + SEED_CELLS + 1); j++) {
      const px = west + i * spacing;
      const py = south + j * spacing;
      if (!blocked[j * columns + i] && isFree(x, y, px, py, grid, blocked)) way[j * columns + i] = Math.hypot(px - x, py - y);
    }
  }
  way[b * columns + a] = Math.hypot(west + a * spacing - x, south + b * spacing - y);
  if (track.speed_max_m_s > 0) {
    for (;;) {
      const one = sweep(way, blocked, grid, true, true);
      const other = sweep(way, blocked, grid, false, false);
      if (!one && !other) break;
      sweep(way, blocked, grid, true, false);
      sweep(way, blocked, grid, false, true);
    }
  }
  const near = nearer(track);
  for (let at = 0; at < way.length; at++) {
    const left = Math.max(0, SHORTENED * way[at] - near - 0.5 * spacing);
    way[at] = left === 0 ? 0 : track.speed_max_m_s > 0 ? left / track.speed_max_m_s : Infinity;
  }
  return way;
}

// Line pieces [x0, y0, x1, y1, …] along which a field of cells has a level (marching squares).
export function contour(field, grid, level) {
  const { columns, rows, spacing, west, south } = grid;
  const pieces = [];
  const cap = 1e9; // walls and places never come to
  for (let j = 0; j + 1 < rows; j++) {
    for (let i = 0; i + 1 < columns; i++) {
      const at = j * columns + i;
      const sw = Math.min(cap, field[at]);
      const se = Math.min(cap, field[at + 1]);
      const nw = Math.min(cap, field[at + columns]);
      const ne = Math.min(cap, field[at + columns + 1]);
      const key = (sw <= level ? 1 : 0) | (se <= level ? 2 : 0) | (ne <= level ? 4 : 0) | (nw <= level ? 8 : 0);
      if (key === 0 || key === 15) continue;
      const x = west + i * spacing;
      const y = south + j * spacing;
      // Against a wall the line keeps to the middle between the cells.
      const part = (p, q) => (p >= cap || q >= cap ? 0.5 : (level - p) / (q - p));
      const points = [];
      if ((key & 1) !== ((key >> 1) & 1)) points.push([x + part(sw, se) * spacing, y]);
      if (((key >> 1) & 1) !== ((key >> 2) & 1)) points.push([x + spacing, y + part(se, ne) * spacing]);
      if (((key >> 2) & 1) !== ((key >> 3) & 1)) points.push([x + part(nw, ne) * spacing, y + spacing]);
      if (((key >> 3) & 1) !== (key & 1)) points.push([x, y + part(sw, nw) * spacing]);
      for (let k = 0; k + 1 < points.length; k += 2) pieces.push(...points[k], ...points[k + 1]);
    }
  }
  return pieces;
}

// Each hunting track's isochrones: [{identity, seconds, pieces}] or circles [{identity, seconds, centre, radius}].
export class Reach {
  constructor() {
    this.key = "";
    this.lines = [];
    this.dueAt = -Infinity;
  }

  renew(store, version) {
    const world = store.world;
    if (!world?.bounds_m) return;
    const walls = `${store.version.world}/${store.version.obstacles}/${world.name}`;
    if (walls !== this.walls) {
      this.walls = walls;
      this.grid = gridOf(world);
      this.blocked = wallsOn(this.grid, world, store.walls.filter((wall) => !store.isFence(wall)));
    }
    this.version = version;
    this.lines = [];
    for (const track of store.tracks) {
      if (track.flies_on || track.speed_max_m_s < 1) continue; // nobody's, or it stays where it is
      const arrived = track.is_airborne ? null : arrivals(track, this.grid, this.blocked);
      for (const seconds of TIMES_S) {
        if (arrived) {
          this.lines.push({ identity: track.identity, seconds, pieces: contour(arrived, this.grid, seconds) });
        } else {
          const radius = track.speed_max_m_s * seconds + nearer(track);
          this.lines.push({ identity: track.identity, seconds, centre: track.position_enu_m, radius });
        }
      }
    }
  }
}
